# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs as npz files of NumPy, whole or not at all."""

from collections.abc import Mapping
from dataclasses import asdict, fields
import json
from pathlib import Path
from typing import Any
import zipfile

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, scene_from_text, scene_to_text
from snake_sim_ros.scene.quoting import cut, LONGEST_REASON, quoted
from snake_sim_ros.scene.whole_files import whole_file
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.trajectory import Trajectory

FORMAT = 2  # of the files; format 1 had no contacts, and no number of its format
ARRAYS = (
    *('time', 'position', 'orientation', 'joint_angle', 'joint_velocity', 'joint_torque'),
    *('contact_sample', 'contact_number', 'contact_point', 'contact_force', 'level'),
)
USUAL_BYTES = 256_000_000  # to which any file may unpack
MOST_TIMES = 100  # its size to which a larger one may: runs have 2 to 10, a bomb has 1000


def write(trajectory: Trajectory, path: Path, sensors: Mapping[str, Array] | None = None) -> None:
    """
    Write a trajectory, without the velocities and impulses that other programs do not need.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
    sensors : mapping, optional
        More arrays by their names, as `recorded_sensors` returns them.

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


def read(path: Path) -> Trajectory:
    """
    Read what `write` wrote.

    Raises
    ------
    ParameterError
        If the file is not whole, was not written by `write`, is of another version, or if its
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
            report=report_from_text(texts['report']),
            seconds=float(data['seconds']),
            interrupted=bool(data['interrupted']),
        )
        trajectory.check()
    except Exception as error:  # and so does broken text
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
        What writes such files, for the sentence on those that are broken.

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
    except Exception:  # broken data makes NumPy, zipfile and zlib raise whatever they like
        raise ParameterError(f'{path} is not a whole npz file; {source}') from None


def format_of(data: Mapping[str, Array]) -> int:
    """Return the number of the format of a file: 1 if it has none, 0 if it is no number."""
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
        If a value is of another kind than that of a report.

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
