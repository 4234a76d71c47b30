# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs: which sources name one, how one is read, and a summary of how it went."""

from pathlib import Path
from typing import Any

from snake_sim_ros.recording import npz
from snake_sim_ros.recording.bag_reader import read_bag
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.trajectory import Trajectory


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
        return npz.read(path)
    if path.suffix == '.mcap' or path.is_dir():
        return read_bag(path, namespace)
    raise ParameterError(
        f'a recorded run ends in .npz or .mcap, or is the folder of a bag; got {path}'
    )


def summary(trajectory: Trajectory) -> dict[str, Any]:
    """Return how a run went, name -> value as JSON has them."""
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
        'penetration_max': report.penetration_max,
        'joint_gap_max': report.joint_gap_max,
        'joint_twist_max': report.joint_twist_max,
    }
