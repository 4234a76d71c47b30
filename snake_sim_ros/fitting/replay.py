# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A recording simulated again in segments, and what is left between simulation and measurement.

Each segment starts from a measured state. Such a state is not exact, and a robot forgets it:
angles and velocities by sliding, with a time constant of 0.3 s in lateral undulation. Residuals
therefore begin after a burn-in. Place and heading are not forgotten, but on a floor they do not
matter: the path of every segment is moved and turned about the vertical to where it fits best.
"""

from collections.abc import Container
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from snake_sim_ros.fitting.recording import Recording
from snake_sim_ros.fitting.references import references
from snake_sim_ros.fitting.start_states import (
    CONJUGATE,
    Measured,
    measured_at,
    start_state,
    WINDOW,
)
from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity
from snake_sim_ros.scene.parameters import Array, Scene, with_settings
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.accuracy import RESIDUAL
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.bdf2 import step as bdf2
from snake_sim_ros.stepping.levels import is_vertical
from snake_sim_ros.stepping.methods import make_stepper, share_compiled, what_is_not_planar
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.state import State

ACCURACY = 3e-4
PERIOD = 0.01  # s between two states of which those at the times of samples are interpolated
TURNS = 4  # iterations for the heading that fits best
LEAST_SAMPLES = 5  # of poses and of angles in a segment
ALIGNED = 4  # numbers by which the path of a segment is moved and turned
LOST = 1e3  # residual of a segment whose simulation diverges, in units of the noise


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """How a recording is cut, and how exact it is."""

    noise_position: float = quantity(
        1e-3, 'm', 'standard deviation of measured positions', above=0
    )
    noise_angle: float = quantity(
        8.7e-3, 'rad', 'standard deviation of measured angles and orientations', above=0
    )
    segment: float = quantity(4.0, 's', 'length of a segment', minimum=0.2)
    burn_in: float = quantity(2.0, 's', 'time before a segment that is simulated only', minimum=0)
    horizon: float = quantity(
        0.05, 's', 'how long a command is extrapolated with its velocity', minimum=0, maximum=1
    )


class Segment(NamedTuple):
    """A segment: where its simulation starts, its references, and its samples."""

    start: float  # of the simulation [s]
    begin: float  # of the residuals [s]
    end: float  # [s]
    measured: Measured  # at the start
    angle: Array  # references (steps, n-1, 2) [rad]
    rate: Array  # [rad/s]
    times: Array  # of all samples, each once [s]
    poses: Array  # rows of the samples of poses in `times`
    joints: Array
    position: Array  # (k, l, 3) [m]
    orientation: Array  # (k, l, 4)
    joint_angle: Array  # (m, n-1, 2) [rad]


class Residual(NamedTuple):
    """
    What is left in a segment, in units of the noise; nan where nothing was measured.

    Poses have shape (k, l, 6), position and turn, and joint angles (m, n-1, 2).
    """

    poses: Array
    joints: Array

    def flat(self) -> Array:
        """Return all numbers that there are."""
        both = np.concatenate([self.poses.ravel(), self.joints.ravel()])
        return np.asarray(both[~np.isnan(both)])


class Replay:
    """
    A recording in segments that are simulated with any values of its scene.

    Parameters
    ----------
    recording : Recording
    scene : Scene
        With the method and the steps of the simulations.
    settings : Settings
    law : str
        One of `references.LAWS`.

    Raises
    ------
    ParameterError
        If the recording is too short for two segments, or has too few samples in them.

    """

    def __init__(self, recording: Recording, scene: Scene, settings: Settings, law: str) -> None:
        self.recording, self.scene, self.settings = recording, scene, settings
        self.law = law
        self.every = max(1, round(PERIOD / scene.dt))
        self.period = self.every * scene.dt
        first = np.ceil((recording.begin + WINDOW) / self.period - 1e-6) * self.period
        steps = int((recording.end - first) / scene.dt + 1e-6)
        wanted = WINDOW + settings.burn_in + 2 * settings.segment
        there = max(0.0, recording.end - recording.begin)
        if steps * scene.dt < wanted - WINDOW - self.period:
            raise ParameterError(
                f'the recording must have at least {wanted:g} s with commands, angles and poses, '
                f'a burn-in and two segments; it has {there:.3g} s'
            )
        middles = first + (np.arange(steps) + 0.5) * scene.dt
        told = references(recording, scene.robot, middles, law, settings.horizon)
        self.is_flat = not what_is_not_planar(scene) and not is_vertical(*told).any()
        self.segments = self._cut(first, steps, *told)
        if len(self.segments) < 2:
            raise ParameterError(
                f'the recording has {len(self.segments)} segments of {settings.segment:g} s with '
                f'enough samples, at least 2 are needed'
            )
        self._known: Stepper | None = None
        self._known_scene = scene

    def _cut(self, first: float, steps: int, angle: Array, rate: Array) -> tuple[Segment, ...]:
        """Return the segments that have enough samples."""
        settings, dt = self.settings, self.scene.dt
        length = max(1, round(settings.segment / self.period)) * self.every
        burn = round(settings.burn_in / self.period) * self.every
        found = []
        for begin in range(burn, steps - length // 2, length):
            part = slice(begin - burn, min(begin + length, steps // self.every * self.every))
            times = first + dt * np.array([part.start, begin, part.stop])
            told = np.stack([angle[part.start], rate[part.start]])
            item = self._segment(times.tolist(), angle[part], rate[part], told)
            if item:
                found.append(item)
        return tuple(found)

    def _segment(
        self, times: list[float], angle: Array, rate: Array, told: Array
    ) -> Segment | None:
        """Return a segment; None if it has too few samples."""
        recording, (start, begin, end) = self.recording, times
        joints, poses = (
            slice(*np.searchsorted(of, [begin - 1e-9, end - 1e-9]))
            for of in (recording.joint_time, recording.pose_time)
        )
        measured = measured_at(recording, start, told)
        both = recording.pose_time[poses], recording.joint_time[joints]
        if not measured or min(map(len, both)) < LEAST_SAMPLES:
            return None
        every, place = np.unique(np.concatenate(both), return_inverse=True)
        return Segment(
            start, begin, end, measured, angle, rate,
            every, place[: len(both[0])], place[len(both[0]) :],
            recording.position[poses], recording.orientation[poses], recording.joint_angle[joints],
        )  # fmt: skip

    def compile(self) -> None:
        """Compile what segments need, by the first one, before threads simulate them."""
        self.residuals(self.scene, self.segments[:1])

    def residuals(
        self, scene: Scene, segments: tuple[Segment, ...] | None = None
    ) -> list[Residual]:
        """Return what is left in segments, all of them by default."""
        stepper = make_stepper(scene)
        if self._known:
            share_compiled(self._known, self._known_scene, stepper, scene)
        found = [
            self._residual(scene, stepper, item)
            for item in (self.segments if segments is None else segments)
        ]
        self._known = self._known or stepper
        return found

    def _residual(self, scene: Scene, stepper: Stepper, segment: Segment) -> Residual:
        settings = self.settings
        q = self.simulated(scene, stepper, segment)
        if q is None:
            size = segment.position.shape[:2]
            lost = np.where(np.isnan(segment.joint_angle), np.nan, LOST)
            return Residual(np.full((*size, 6), LOST), lost)
        links = q[segment.poses][:, self.recording.links]
        poses = aligned(segment, links, settings.noise_position, settings.noise_angle)
        angle = joint_angles(q[segment.joints])
        return Residual(poses, (segment.joint_angle - angle) / settings.noise_angle)

    def simulated(self, scene: Scene, stepper: Stepper, segment: Segment) -> Array | None:
        """Return the coordinates (m, n, 7) at the times of a segment; None if it diverges."""
        state = start_state(scene, segment.measured, is_flat=self.is_flat)
        samples = make_samples(scene, self.every, len(segment.angle) // self.every)
        report = stepper.advance(
            state, stepper.empty_history(), segment.angle, segment.rate, samples
        )[2]
        if report.failure:
            return None
        q = np.concatenate([state.q[None], samples.q])
        u = np.concatenate([state.u[None], samples.u])
        return between(q, u, self.period, segment.times - segment.start)

    def start(self, scene: Scene) -> State:
        """Return the state at the start of the first segment."""
        return start_state(scene, self.segments[0].measured, is_flat=self.is_flat)


def between(q: Array, u: Array, period: float, times: Array) -> Array:
    """
    Return coordinates at times between states, cubic in time.

    Parameters
    ----------
    q, u : ndarray, shapes (k, n, 7) and (k, n, 6)
        As of `state.State`, a period apart.
    period : float
        [s]
    times : ndarray, shape (m,)
        Since the first state [s].

    Returns
    -------
    ndarray, shape (m, n, 7)

    """
    row = np.clip((times / period + 1e-9).astype(int), 0, len(q) - 2)
    s = (times / period - row)[:, None, None]
    first, second = q[row], q[row + 1]
    turned = np.where((first[..., 3:] * second[..., 3:]).sum(-1, keepdims=True) < 0.0, -1.0, 1.0)
    rates = []
    for coordinates, velocity in ((first, u[row]), (second, u[row + 1])):
        omega = np.zeros((*velocity.shape[:-1], 4))
        omega[..., 1:] = velocity[..., 3:] / 2
        rates.append(np.concatenate([velocity[..., :3], product(coordinates[..., 3:], omega)], -1))
    second = np.concatenate([second[..., :3], second[..., 3:] * turned], axis=-1)
    rates[1][..., 3:] *= turned
    change = second - first
    found = first + s * (
        period * rates[0]
        + s * (3 * change - period * (2 * rates[0] + rates[1]))
        + s**2 * (period * (rates[0] + rates[1]) - 2 * change)
    )
    found[..., 3:] /= np.linalg.norm(found[..., 3:], axis=-1, keepdims=True)
    return np.asarray(found)


def aligned(segment: Segment, q: Array, noise_position: float, noise_angle: float) -> Array:
    """
    Return the residuals of poses after the path is moved and turned to where it fits best.

    Parameters
    ----------
    segment : Segment
    q : ndarray, shape (k, l, 7)
        Simulated coordinates of the links that were measured.
    noise_position, noise_angle : float
        [m], [rad]

    Returns
    -------
    ndarray, shape (k, l, 6)
        Position and turn, in units of the noise.

    """
    place, p = q[..., :3], q[..., 3:]
    ratio = (noise_position / noise_angle) ** 2
    for _ in range(TURNS):
        off = segment.position - place
        center, shift = place.mean(axis=(0, 1)), off.mean(axis=(0, 1))
        across = (place - center)[..., [1, 0]] * (-1.0, 1.0)
        turn = _turn(segment.orientation, p)
        asked = (across * (off - shift)[..., :2]).sum() + ratio * turn[..., 2].sum()
        heading = asked / ((across**2).sum() + ratio * turn[..., 2].size)
        by = about(2, float(heading))
        place = (place - center) @ rotation_matrices(by).T + center + shift
        p = product(np.broadcast_to(by, p.shape), p)
    off = (segment.position - place) / noise_position
    return np.concatenate([off, _turn(segment.orientation, p) / noise_angle], axis=-1)


def _turn(a: Array, b: Array) -> Array:
    """Return the small rotation vectors in frame I from orientations b to a, shape (..., 3)."""
    turn = product(a, b * CONJUGATE)
    return np.asarray(2.0 * turn[..., 1:] * np.where(turn[..., :1] < 0.0, -1.0, 1.0))


def with_fit_steps(scene: Scene, given: Container[str] = ()) -> Scene:
    """
    Return a scene with the steps of a fit.

    They are those of an accuracy, if `method` and `dt` are not given and `bdf2` can run the scene.

    Parameters
    ----------
    scene : Scene
    given : container of str
        Dotted names of the values that a user gave beside the file of the scene.

    """
    if 'method' in given or 'dt' in given or bdf2.what_is_not_possible(scene):
        return scene
    settings = {'method': 'bdf2', 'dt': PERIOD, 'solver.residual_tolerance': RESIDUAL}
    if 'accuracy' not in given:
        settings['accuracy'] = ACCURACY
    return with_settings(scene, settings)
