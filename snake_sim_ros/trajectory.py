"""What a robot did: poses, joints and contacts over time, and the files that keep them."""

import csv
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import fields
from io import BytesIO
import json
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import scene_from_text
from snake_sim_ros.parameters import scene_to_text
from snake_sim_ros.records import ParameterError
from snake_sim_ros.stepping import Report

FORMAT = 2  # of npz files; 1, without contacts, did not say so


@dataclass(frozen=True)
class Trajectory:
    """
    What a robot did, recorded.

    Attributes
    ----------
    scene : Scene
    time : ndarray, shape (m,)
        [s]
    position : ndarray, shape (m, n, 3)
        Link centers [m, frame I].
    orientation : ndarray, shape (m, n, 4)
        Euler parameters of the link frames B, scalar first.
    joint_angle, joint_velocity, joint_torque : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad], [rad/s], [N m]; the torque is that of the step before, 0 at the start.
    contact_sample, contact_number : ndarray of int, shape (k,)
        Every contact that carried load in the step before a sample: the index of the sample, and
        the number of the contact as in `scenery`, up to 2n the front, then the rear spheres on the
        floor; -1 if it is not known.
    contact_point, contact_force : ndarray, shape (k, 3)
        As `contact_forces` returns them [m], [N], frame I.
    level : ndarray of str, shape (m,)
        Model level of the step before, that of the first one at the start.
    report : Report
    seconds : float
        Wall time of all steps, without compiling.
    interrupted : bool
        Whether it was ended from the keyboard.

    """

    scene: Scene
    time: Array
    position: Array
    orientation: Array
    joint_angle: Array
    joint_velocity: Array
    joint_torque: Array
    contact_sample: Array
    contact_number: Array
    contact_point: Array
    contact_force: Array
    level: Array
    report: Report
    seconds: float
    interrupted: bool

    def contacts(self, k: int) -> tuple[Array, Array]:
        """Return points and forces of the contacts at a sample, shape (contacts, 3) each."""
        first, last = np.searchsorted(self.contact_sample, [k, k + 1])
        return self.contact_point[first:last], self.contact_force[first:last]

    def save(self, path: Path) -> None:
        """Write everything as an npz file, whole or not at all."""
        report = {**asdict(self.report), 'joint_torque': self.report.joint_torque.tolist()}
        buffer = BytesIO()
        np.savez_compressed(
            buffer,
            format=FORMAT,
            **{name: getattr(self, name) for name in ARRAYS},
            scene=scene_to_text(self.scene),
            report=json.dumps(report),
            seconds=self.seconds,
            interrupted=self.interrupted,
        )
        path.write_bytes(buffer.getvalue())

    @classmethod
    def load(cls, path: Path) -> 'Trajectory':
        """
        Read what `save` wrote.

        Raises
        ------
        ParameterError
            If the file is not whole, not one of `save`, or of another version.

        """
        try:
            with np.load(path) as file:
                data = {name: file[name] for name in file.files}
        except FileNotFoundError:
            raise ParameterError(f'no file {path}') from None
        except (BadZipFile, EOFError, ValueError, TypeError, AttributeError):
            raise ParameterError(
                f'{path} is not a whole npz file; snake-sim run --out writes one'
            ) from None
        if 'scene' not in data or 'position' not in data:
            raise ParameterError(f'{path} is not a recorded run: it has no scene or no position')
        version = int(data['format']) if 'format' in data else 1
        if version != FORMAT:
            raise ParameterError(
                f'{path} is a run in format {version}, of another version of snake_sim_ros; this '
                f'one reads format {FORMAT}: run its scene again'
            )
        try:
            report = json.loads(str(data['report']))
            report['joint_torque'] = np.array(report['joint_torque'])
            return cls(
                scene=scene_from_text(str(data['scene'])),
                **{name: data[name] for name in ARRAYS},
                report=Report(**report),
                seconds=float(data['seconds']),
                interrupted=bool(data['interrupted']),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ParameterError(f'{path} is not a whole run: {error}') from None

    def save_csv(self, path: Path) -> None:
        """Write a table with a row for each sample: time, links, joints, sum of the forces."""
        n = self.position.shape[1]
        links = [f'link_{i + 1}' for i in range(n)]
        joints = [f'joint_{j + 1}_{axis}' for j in range(n - 1) for axis in ('yaw', 'pitch')]
        names = ['time [s]']
        names += [f'{link} {axis} [m]' for link in links for axis in 'xyz']
        names += [f'{link} {part}' for link in links for part in ('e0', 'e1', 'e2', 'e3')]
        for what in ('angle [rad]', 'velocity [rad/s]', 'torque [N m]'):
            names += [f'{joint} {what}' for joint in joints]
        names += [f'contact force {axis} [N]' for axis in 'xyz']
        force = np.zeros((len(self.time), 3))
        np.add.at(force, self.contact_sample, self.contact_force)
        columns = [self.position, self.orientation]
        columns += [self.joint_angle, self.joint_velocity, self.joint_torque, force]
        flat = [values.reshape(len(self.time), -1) for values in columns]
        with path.open('w', encoding='utf-8', newline='') as file:
            writer = csv.writer(file)
            writer.writerow([*names, 'level'])
            for row, level in zip(np.column_stack([self.time, *flat]), self.level, strict=True):
                writer.writerow([*row.tolist(), level])


ARRAYS = tuple(item.name for item in fields(Trajectory) if item.type is Array)
