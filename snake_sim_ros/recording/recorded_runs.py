# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs: npz files, which are read again, CSV tables for spreadsheets, and summaries."""

from collections.abc import Mapping
import csv
from dataclasses import asdict, fields
import json
from pathlib import Path
from typing import Any
import zipfile

import numpy as np

from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, ParameterError, quoted
from snake_sim_ros.scene.files import whole_file
from snake_sim_ros.scene.parameters import Array, scene_from_text, scene_to_text
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.trajectory import Trajectory

# ---- npz files ----------------------------------------------------------------------------------


FORMAT = 2  # of the files; format 1 had no contacts, and no number of its format
ARRAYS = (
    *('time', 'position', 'orientation', 'joint_angle', 'joint_velocity', 'joint_torque'),
    *('contact_sample', 'contact_number', 'contact_point', 'contact_force', 'level'),
)
USUAL_BYTES = 256_000_000  # that any file may unpack to
MOST_TIMES = 100  # times its size that a larger file may unpack to: runs have 2 to 10, bombs 1000


def write_npz(
    trajectory: Trajectory, path: Path, sensors: Mapping[str, Array] | None = None
) -> None:
    """
    Write a trajectory, without the velocities and impulses that most programs do not need.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
    sensors : mapping, optional
        More arrays by their names, as `recorded_sensors` returns them, or `velocity`
        and `joint_steps` of the trajectory.

    """
    arrays: dict[str, Any] = {name: getattr(trajectory, name) for name in ARRAYS}
    arrays |= sensors or {}
    with whole_file(path) as part, part.open('wb') as file:
        np.savez_compressed(
            file,
            format=FORMAT,
            **arrays,
            scene=scene_to_text(trajectory.scene),
            report=report_to_text(trajectory.report),
            seconds=trajectory.seconds,
            interrupted=trajectory.interrupted,
        )


def read_npz(path: Path) -> Trajectory:
    """
    Read what `write_npz` wrote.

    Raises
    ------
    ParameterError
        If the file is not whole, was not written by `write_npz`, is of another version, or if its
        arrays do not belong together.

    """
    data = load_arrays(path, 'snake-sim run --out writes one')
    texts = {name: item.tolist() for name, item in data.items() if item.dtype.kind == 'U'}
    if 'scene' not in texts or 'position' not in data:
        raise ParameterError(f'{path} is not a recorded run: it has no scene or no position')
    version = format_of(data)
    if version != FORMAT:
        raise ParameterError(
            f'{path} is a run in format {version}, of another version of snake_sim_ros; this '
            f'one reads format {FORMAT}: run its scene again'
        )
    try:
        trajectory = Trajectory(
            scene=scene_from_text(texts['scene']),
            **{name: data[name] for name in ARRAYS},
            velocity=data.get('velocity', np.zeros(0)),
            joint_steps=data.get('joint_steps', np.zeros(0)),
            report=report_from_text(texts['report']),
            seconds=float(data['seconds']),
            interrupted=bool(data['interrupted']),
        )
        trajectory.check()
    except Exception as error:  # parsers of broken text too
        raise ParameterError(
            f'{path} is not a whole run: {cut(str(error), LONGEST_REASON)}'
        ) from None
    return trajectory


def load_arrays(path: Path, source: str) -> dict[str, Array]:
    """
    Return all arrays of an npz file by their names.

    Parameters
    ----------
    path : Path
    source : str
        What writes such files, for the error on broken ones.

    Raises
    ------
    ParameterError
        If there is no such file, or it cannot be read, or is not whole.

    """
    try:
        with zipfile.ZipFile(path) as archive:
            size, full = path.stat().st_size, sum(item.file_size for item in archive.infolist())
        if full > max(USUAL_BYTES, MOST_TIMES * size):
            raise ParameterError(
                f'{path} is too large: it would unpack to {full} bytes, more than '
                f'{MOST_TIMES} times its size'
            )
        with np.load(path) as file:  # without pickles: files are data, never code
            return {name: np.asarray(file[name]) for name in file.files}
    except FileNotFoundError:
        raise ParameterError(f'no file {path}') from None
    except (IsADirectoryError, PermissionError) as error:
        raise ParameterError(f'{path} cannot be read: {error.strerror}') from None
    except ParameterError:
        raise
    except Exception:  # NumPy, zipfile and zlib raise anything on broken data
        raise ParameterError(f'{path} is not a whole npz file; {source}') from None


def format_of(data: Mapping[str, Array]) -> int:
    """Return the format number of a file: 1 if it has none, 0 if it is not a number."""
    number = data.get('format', np.array(1))
    return int(number) if number.dtype.kind == 'i' and not number.shape else 0


def report_to_text(report: Report) -> str:
    """Return a report as JSON."""
    return json.dumps({**asdict(report), 'joint_torque': report.joint_torque.tolist()})


def report_from_text(text: str) -> Report:
    """
    Return the report that `report_to_text` wrote.

    Raises
    ------
    ParameterError
        If a value has the wrong type.

    """
    values = json.loads(text)
    values['joint_torque'] = np.array(values['joint_torque'], dtype=float)
    usual, report = Report(), Report(**values)
    for item in fields(Report):
        kind, value = type(getattr(usual, item.name)), getattr(report, item.name)
        if type(value) is not kind:
            raise ParameterError(
                f'{item.name} of the report must be {kind.__name__}, got {quoted(value)}'
            )
    return report


# ---- CSV tables ---------------------------------------------------------------------------------


LOADS = (('force', 'N'), ('torque', 'N m'))
# Arrays of sensors, where their names or the numbers of their links are, and what columns are.
OF_LINKS = (
    ('imu_orientation', 'imu_name', [f'imu orientation {axis}' for axis in 'xyzw']),
    ('imu_angular_velocity', 'imu_name', [f'imu angular velocity {a} [rad/s]' for a in 'xyz']),
    ('imu_linear_acceleration', 'imu_name', [f'imu acceleration {a} [m/s^2]' for a in 'xyz']),
    (
        'contact_wrench',
        'contact_link',
        [
            *(f'contact force {a} [N]' for a in 'xyz'),
            *(f'contact torque {a} [N m]' for a in 'xyz'),
        ],
    ),
)


def write_csv(
    trajectory: Trajectory, path: Path, sensors: Mapping[str, Array] | None = None
) -> None:
    """
    Write a row for each sample: time, links, joints, sum of the contact forces, level, sensors.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
    sensors : mapping, optional
        As `recorded_sensors` returns them. Cells of samples without a reading are empty.

    """
    m = len(trajectory.time)
    links = list(trajectory.scene.robot.link_names)
    joints = list(trajectory.scene.robot.axis_names)
    names = ['time [s]']
    names += [f'{link} {axis} [m]' for link in links for axis in 'xyz']
    names += [f'{link} {part}' for link in links for part in ('e0', 'e1', 'e2', 'e3')]
    for what in ('angle [rad]', 'velocity [rad/s]', 'torque [N m]'):
        names += [f'{joint} {what}' for joint in joints]
    names += [f'contact force {axis} [N]' for axis in 'xyz']
    force = np.zeros((m, 3))
    np.add.at(force, trajectory.contact_sample, trajectory.contact_force)
    columns = [trajectory.position, trajectory.orientation, trajectory.joint_angle]
    columns += [trajectory.joint_velocity, trajectory.joint_torque, force]
    rows = np.column_stack([trajectory.time, *(values.reshape(m, -1) for values in columns)])
    measured = _measured(sensors or {}, trajectory.time, joints)
    with whole_file(path) as part, part.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file)
        writer.writerow([*names, 'level', *measured])
        readings = zip(*measured.values(), strict=True) if measured else iter([()] * m)
        for row, level, more in zip(rows, trajectory.level, readings, strict=True):
            writer.writerow([*row.tolist(), level, *more])


def _measured(
    sensors: Mapping[str, Array], time: Array, joints: list[str]
) -> dict[str, list[Any]]:
    """Return the columns of sensors by their names; samples without a reading are empty."""
    columns: dict[str, list[Any]] = {}
    rows = np.searchsorted(time, sensors.get('sensor_time', time)).tolist()
    for name, of_links, parts in OF_LINKS:
        for k, link in enumerate(sensors.get(of_links, ())):
            owner = f'link_{link}' if of_links == 'contact_link' else link
            for part, readings in zip(parts, sensors[name][:, k].T.tolist(), strict=True):
                cells = dict(zip(rows, readings, strict=True))
                columns[f'{owner} {part}'] = [cells.get(i, '') for i in range(len(time))]
    for what, unit in (('angle', 'rad'), ('velocity', 'rad/s'), ('torque', 'N m')):
        measured = sensors.get(f'measured_joint_{what}')
        if measured is not None:
            readings = measured.reshape(len(time), -1).T.tolist()
            names = [f'{joint} measured {what} [{unit}]' for joint in joints]
            columns |= dict(zip(names, readings, strict=True))
    return columns


# ---- any of them --------------------------------------------------------------------------------


def names_a_recorded_run(source: str) -> bool:
    """Return whether a source names a recorded run, not a scene."""
    return Path(source).suffix not in ('', '.yaml', '.yml') or Path(source).is_dir()


def read_run(path: Path, namespace: str | None = None) -> Trajectory:
    """
    Read a recorded run from an npz file or a bag.

    Parameters
    ----------
    path : Path
        An npz file, an MCAP file, or the folder of a bag.
    namespace : str, optional
        Namespace of the robot in a bag; needed if the bag has several robots.

    Raises
    ------
    ParameterError
        If it is neither, or cannot be read.

    """
    if path.suffix == '.npz':
        return read_npz(path)
    if path.suffix == '.mcap' or path.is_dir():
        # Decoding takes as long to import as the scene of a run, which needs none.
        from snake_sim_ros.recording.bag_reader import read_bag

        return read_bag(path, namespace)
    raise ParameterError(
        f'a recorded run ends in .npz or .mcap, or is the folder of a bag; got {path}'
    )


def summary(trajectory: Trajectory) -> dict[str, Any]:
    """Return a summary of a run, name -> JSON value."""
    scene, report = trajectory.scene, trajectory.report
    return {
        'method': method_of(scene),
        'level': report.level,
        'planar_steps': report.planar_steps,
        'status': report.status.value,
        'steps': report.steps,
        'internal_steps': report.parts,
        'us_per_step': 1e6 * trajectory.seconds / max(report.parts, 1),
        'real_time_factor': report.steps * scene.dt / max(trajectory.seconds, 1e-9),
        'iterations_per_step': report.iterations / max(report.steps, 1),
        'residual_max': report.residual_max,
        'printed_residual_max': report.printed_residual_max,
        'fallbacks': report.fallbacks,
        'unconverged_steps': report.unconverged,
        'overflows': report.overflows,
        'penetration_max': report.penetration_max,
        'joint_gap_max': report.joint_gap_max,
        'joint_twist_max': report.joint_twist_max,
    }
