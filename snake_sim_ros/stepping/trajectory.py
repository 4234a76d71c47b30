"""What a robot did: poses, joints and contacts over time, and the files that keep them."""

import csv
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import fields
from io import BytesIO
import json
from pathlib import Path

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import scene_from_text
from snake_sim_ros.scene.parameters import scene_to_text
from snake_sim_ros.stepping.base import Report

FORMAT = 2  # of npz files; 1, without contacts, did not say so
KINDS = {'f': 'floats', 'i': 'integers', 'U': 'text'}  # of numbers in arrays


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
            If the file is not whole, not one of `save`, of another version, or if its arrays do
            not belong together.

        """
        try:
            with np.load(path) as file:
                data = {name: np.asarray(file[name]) for name in file.files}
            texts = {name: item.tolist() for name, item in data.items() if item.dtype.kind == 'U'}
        except FileNotFoundError:
            raise ParameterError(f'no file {path}') from None
        except (IsADirectoryError, PermissionError) as error:
            raise ParameterError(f'{path} cannot be read: {error.strerror}') from None
        except Exception:  # broken data makes NumPy, zipfile and zlib raise whatever they like
            raise ParameterError(
                f'{path} is not a whole npz file; snake-sim run --out writes one'
            ) from None
        if 'scene' not in texts or 'position' not in data:
            raise ParameterError(f'{path} is not a recorded run: it has no scene or no position')
        number = data.get('format', np.array(1))
        version = int(number) if number.dtype.kind == 'i' and not number.shape else 0
        if version != FORMAT:
            raise ParameterError(
                f'{path} is a run in format {version}, of another version of snake_sim_ros; this '
                f'one reads format {FORMAT}: run its scene again'
            )
        try:
            run = cls(
                scene=scene_from_text(texts['scene']),
                **{name: data[name] for name in ARRAYS},
                report=_report(texts['report']),
                seconds=float(data['seconds']),
                interrupted=bool(data['interrupted']),
            )
            run.check()
        except Exception as error:  # and so does broken text
            raise ParameterError(f'{path} is not a whole run: {error}') from None
        return run

    def check(self) -> None:
        """
        Check that all arrays are of one run of the scene.

        Raises
        ------
        ParameterError
            If one has another shape or other values than a run can have.

        """
        n, m, k = self.scene.robot.link_count, np.size(self.time), np.size(self.contact_sample)
        for names, kind, shape in (
            (('time',), 'f', (m,)),
            (('position',), 'f', (m, n, 3)),
            (('orientation',), 'f', (m, n, 4)),
            (('joint_angle', 'joint_velocity', 'joint_torque'), 'f', (m, n - 1, 2)),
            (('contact_sample', 'contact_number'), 'i', (k,)),
            (('contact_point', 'contact_force'), 'f', (k, 3)),
            (('level',), 'U', (m,)),
        ):
            for name in names:
                array = getattr(self, name)
                if array.shape != shape or array.dtype.kind != kind:
                    raise ParameterError(
                        f'{name} must have shape {shape} of {KINDS[kind]}, got {array.shape} of '
                        f'{array.dtype}'
                    )
        if not all(map(str.isprintable, self.level.tolist())):
            raise ParameterError('level must be printable text')
        if not m:
            raise ParameterError('time must have a sample, got none')
        if not (np.isfinite(self.time).all() and (np.diff(self.time) >= 0.0).all()):
            raise ParameterError('time must be finite and never go back')
        count = contact_count(self.scene)
        for name, array, low, high in (
            ('contact_sample', self.contact_sample, 0, m - 1),
            ('contact_number', self.contact_number, -1, count - 1),
        ):
            if k and not low <= array.min() <= array.max() <= high:
                raise ParameterError(
                    f'{name} must be {low} to {high}, got {array.min()} to {array.max()}'
                )
        if (np.diff(self.contact_sample) < 0).any():
            raise ParameterError('contact_sample must be in the order of the samples')

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


def _report(text: str) -> Report:
    """
    Return the report that `Trajectory.save` wrote.

    Raises
    ------
    ParameterError
        If a value is of another kind than that of a report.

    """
    values = json.loads(text)
    values['joint_torque'] = np.array(values['joint_torque'], dtype=float)
    usual, report = Report(), Report(**values)
    for item in fields(Report):
        kind, value = type(getattr(usual, item.name)), getattr(report, item.name)
        if type(value) is not kind:
            raise ParameterError(f'{item.name} of the report must be {kind.__name__}, got {value}')
    return report


ARRAYS = tuple(item.name for item in fields(Trajectory) if item.type is Array)
