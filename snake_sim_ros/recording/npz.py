"""Recorded runs as npz files of NumPy, whole or not at all."""

from dataclasses import asdict
from dataclasses import fields
from io import BytesIO
import json
from pathlib import Path

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import scene_from_text
from snake_sim_ros.scene.parameters import scene_to_text
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.trajectory import Trajectory

FORMAT = 2  # of the files; format 1 had no contacts, and no number of its format
ARRAYS = (
    *('time', 'position', 'orientation', 'joint_angle', 'joint_velocity', 'joint_torque'),
    *('contact_sample', 'contact_number', 'contact_point', 'contact_force', 'level'),
)


def write(trajectory: Trajectory, path: Path) -> None:
    """Write a trajectory, without the velocities and impulses that other programs do not need."""
    report = {**asdict(trajectory.report), 'joint_torque': trajectory.report.joint_torque.tolist()}
    buffer = BytesIO()
    np.savez_compressed(
        buffer,
        format=FORMAT,
        **{name: getattr(trajectory, name) for name in ARRAYS},
        scene=scene_to_text(trajectory.scene),
        report=json.dumps(report),
        seconds=trajectory.seconds,
        interrupted=trajectory.interrupted,
    )
    path.write_bytes(buffer.getvalue())


def read(path: Path) -> Trajectory:
    """
    Read what `write` wrote.

    Raises
    ------
    ParameterError
        If the file is not whole, was not written by `write`, is of another version, or if its
        arrays do not belong together.

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
        trajectory = Trajectory(
            scene=scene_from_text(texts['scene']),
            **{name: data[name] for name in ARRAYS},
            report=_report(texts['report']),
            seconds=float(data['seconds']),
            interrupted=bool(data['interrupted']),
        )
        trajectory.check()
    except Exception as error:  # and so does broken text
        raise ParameterError(f'{path} is not a whole run: {error}') from None
    return trajectory


def _report(text: str) -> Report:
    """
    Return the report that `write` wrote.

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
