"""
States from which parts of a recording are simulated again, from what was measured around a time.

A parabola through the samples near the time gives each value and its rate. Where the robot lies
flat on a floor, it does so exactly: heading and yaw angles are measured, the rest is zero.
"""

from dataclasses import dataclass

import numpy as np

from snake_sim_ros.fitting.recording import Recording
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import about
from snake_sim_ros.scene.rotations import along_link
from snake_sim_ros.scene.rotations import product
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import State

WINDOW = 0.12  # s before and after the time within which samples are used
LEAST_SAMPLES = 4
MOMENT = 1e-3  # s before and after the time between which velocities are differences
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Measured:
    """
    What was measured at a time: values, and their rates in a second entry.

    Attributes
    ----------
    angle : ndarray, shape (2, n-1, 2)
        [rad], [rad/s]
    link : int
        Index of the link whose pose it is.
    position : ndarray, shape (2, 3)
        [m], [m/s]
    orientation : ndarray, shape (2, 4)
        Euler parameters, scalar first, and their rates [1/s].

    """

    angle: Array
    link: int
    position: Array
    orientation: Array


def measured_at(recording: Recording, time: float, told: Array) -> Measured | None:
    """
    Return what was measured at a time, or None if there are not enough samples around it.

    Parameters
    ----------
    recording : Recording
    time : float
        [s]
    told : ndarray, shape (2, n-1, 2)
        References, for the joints that were not measured [rad], [rad/s].

    """
    joints = _near(recording.joint_time, time)
    poses = _near(recording.pose_time, time)
    if min(len(joints), len(poses)) < LEAST_SAMPLES:
        return None
    angle = told.copy()
    values = recording.joint_angle[joints]
    known = np.isfinite(values).all(axis=0)
    angle[:, known] = _parabola(recording.joint_time[joints] - time, values[:, known])
    middle = recording.scene.robot.middle_link
    place = int(np.abs(recording.links - middle).argmin())
    since = recording.pose_time[poses] - time
    p = recording.orientation[poses, place]
    p = p * np.where(p @ p[0] < 0.0, -1.0, 1.0)[:, None]
    position = _parabola(since, recording.position[poses, place])
    return Measured(angle, int(recording.links[place]), position, _parabola(since, p))


def _near(times: Array, time: float) -> Array:
    begin, end = np.searchsorted(times, [time - WINDOW, time + WINDOW])
    return np.arange(begin, end)


def _parabola(since: Array, values: Array) -> Array:
    """Return value and rate at time 0 of the parabola through samples, shape (2, ...)."""
    powers = (since[:, None] / WINDOW) ** np.arange(3)
    found = np.linalg.lstsq(powers, values.reshape(len(since), -1), rcond=None)[0][:2]
    found[1] /= WINDOW
    return np.asarray(found.reshape(2, *values.shape[1:]))


def start_state(scene: Scene, measured: Measured, *, is_flat: bool) -> State:
    """
    Return the state of a robot that was measured.

    Parameters
    ----------
    scene : Scene
    measured : Measured
    is_flat : bool
        Whether the robot lies flat on the floor.

    """
    before, now, after = (
        _coordinates(scene, measured, moment, is_flat) for moment in (-MOMENT, 0.0, MOMENT)
    )
    n = len(now)
    u = np.empty((n, 6))
    u[:, :3] = (after[:, :3] - before[:, :3]) / (2 * MOMENT)
    ends = [p * np.where((p * now[:, 3:]).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
            for p in (before[:, 3:], after[:, 3:])]  # fmt: skip
    turn = product(now[:, 3:] * CONJUGATE, (ends[1] - ends[0]) / (2 * MOMENT))
    u[:, 3:] = 2.0 * turn[:, 1:]
    if is_flat:
        u[:, [2, 3, 5]] = 0.0
    lift = obstacles.lift_onto_ground(scene, now) if scene.ground.heights else None
    now[:, 2] += -gaps(scene.robot, now).min() if lift is None else lift
    return State(now, u)


def _coordinates(scene: Scene, measured: Measured, moment: float, is_flat: bool) -> Array:
    """Return coordinates some moment [s] after the time, shape (n, 7)."""
    angle, position, p = (
        part[0] + moment * part[1]
        for part in (measured.angle, measured.position, measured.orientation)
    )
    if is_flat:
        angle[:, 1] = 0.0
    q, i = chain_coordinates(scene.robot, angle), measured.link
    p = p / np.linalg.norm(p)
    if is_flat:
        (ax, ay, _), (bx, by, _) = along_link(q[i, 3:]), along_link(p)
        turn = about(2, float(np.arctan2(by, bx) - np.arctan2(ay, ax)))
    else:
        turn = product(p, q[i, 3:] * CONJUGATE)
    q[:, :3] = (q[:, :3] - q[i, :3]) @ rotation_matrices(turn).T + position
    if is_flat:
        q[:, 2] = 0.0
    q[:, 3:] = product(np.broadcast_to(turn, (len(q), 4)), q[:, 3:])
    return q
