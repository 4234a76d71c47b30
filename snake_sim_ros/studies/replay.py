# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A recording simulated again in segments, and what differs between simulation and measurement.

Each segment starts from a measured state: a parabola through the samples near a time gives each
value and its rate. Such a state is not exact, and a robot forgets it: angles and velocities by
sliding, with a time constant of 0.3 s in lateral undulation. Residuals therefore begin after a
burn-in. Place and heading are not forgotten, but on a floor they do not matter: the path of every
segment is moved and turned about the vertical to where it fits best.

A delay of commands need not be a multiple of the step: references are taken that much earlier.
Stamps may be on clocks of their own, a marker beside the center of its link, and the frame of the
poses tilted; see `Setup`.

Synthetic recordings are simulated here, too: what another recording would have measured of a
scene.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from snake_sim_ros.contact.placing import lift_out_of_world
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity
from snake_sim_ros.scene.parameters import Array, Scene, with_settings
from snake_sim_ros.scene.posture import chain_coordinates, gaps, joint_angles
from snake_sim_ros.scene.rotations import about, CONJUGATE, product, rotation_matrices
from snake_sim_ros.stepping.accuracy import RESIDUAL
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.bdf2 import step as bdf2
from snake_sim_ros.stepping.levels import is_vertical, what_is_not_flat
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import State
from snake_sim_ros.studies.recorded_motion import HORIZON, Recording, references

ACCURACY = 3e-4
PERIOD = 0.01  # s between two states of which those at the times of samples are interpolated
WINDOW = 0.12  # s before and after the start of a segment within which samples are used
LEAST_AROUND = 2  # samples on each side of a start: a parabola at its end says little
LEAST_SAMPLES = 5  # of poses and of angles in a segment
ROUNDING = 1e-6  # s
MOMENT = 1e-3  # s before and after the time between which velocities are differences
MOST_KNOWN = 8  # references that are kept, of different delays
TURNS = 4  # iterations for the heading that fits best
FARTHEST_OFFSET = 0.25  # s: how far an offset that is found may be from where the search starts
OFFSET_STEP = 0.025  # s, of the search for a start
ALIGNED = 4  # numbers by which the path of a segment is moved and turned
LOST = 1e3  # residual of a segment whose simulation fails, in units of the noise
START_ERROR = 5e-3  # rad, what a measured start is off by at most
MOST_START = 0.1  # effect of such an error, in units of the noise, that is not said
MOST_UNCONVERGED = 0.1  # share of the steps of a segment beyond which it is lost


@dataclass(frozen=True)
class Measured:
    """
    What was measured at a time: values, and their rates in a second entry.

    Attributes
    ----------
    angle : ndarray, shape (2, n-1, 2)
        [rad], [rad/s]
    links : ndarray of int, shape (l,)
        Indices of the links whose poses they are.
    position : ndarray, shape (2, l, 3)
        [m], [m/s]
    orientation : ndarray, shape (2, l, 4)
        Euler parameters, scalar first, and their rates [1/s].

    """

    angle: Array
    links: Array
    position: Array
    orientation: Array


def measured_at(recording: Recording, time: float, commanded: Array) -> Measured | None:
    """
    Return what was measured at a time, or None if there are not enough samples around it.

    Parameters
    ----------
    recording : Recording
    time : float
        [s]
    commanded : ndarray, shape (2, n-1, 2)
        References, for the joints that were not measured [rad], [rad/s].

    """
    joints = _near(recording.joint_time, time)
    poses = _near(recording.pose_time, time)
    if joints is None or poses is None:
        return None
    angle = commanded.copy()
    values = recording.joint_angle[joints]
    known = np.isfinite(values).all(axis=0)
    angle[:, known] = _parabola(recording.joint_time[joints] - time, values[:, known])
    since = recording.pose_time[poses] - time
    p = recording.orientation[poses]
    p = p * np.where((p * p[0]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    position = _parabola(since, recording.position[poses])
    return Measured(angle, recording.links, position, _parabola(since, p))


def _near(times: Array, time: float) -> Array | None:
    """Return the rows of samples around a time; None if there are not enough on both sides."""
    ends = [time - WINDOW, time + ROUNDING, time + WINDOW]
    begin, middle, end = np.searchsorted(times, ends)
    if min(middle - begin, end - middle) < LEAST_AROUND:
        return None
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
    if scene.world:
        now[:, 2] += lift_out_of_world(scene, now)
    return State(now, u)


def _coordinates(scene: Scene, measured: Measured, moment: float, is_flat: bool) -> Array:
    """Return coordinates some moment [s] after the time, shape (n, 7)."""
    angle, position, p = (
        part[0] + moment * part[1]
        for part in (measured.angle, measured.position, measured.orientation)
    )
    if is_flat:
        angle[:, 1] = 0.0
    q, i = chain_coordinates(scene.robot, angle), measured.links
    turns = product(p / np.linalg.norm(p, axis=-1, keepdims=True), q[i, 3:] * CONJUGATE)
    turn = (turns * np.where(turns @ turns[0] < 0.0, -1.0, 1.0)[:, None]).mean(axis=0)
    turn /= np.linalg.norm(turn)
    if is_flat:
        turn = about(2, 2.0 * math.atan2(turn[3], turn[0]))
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, :3] += (position - q[i, :3]).mean(axis=0)
    if is_flat:
        q[:, 2] = 0.0
    q[:, 3:] = product(np.broadcast_to(turn, (len(q), 4)), q[:, 3:])
    return q


@dataclass(frozen=True, kw_only=True)
class ReplaySettings(CheckedRecord):
    """How a recording is cut, and how exact it is."""

    noise_position: float = quantity(1e-3, 'm', 'standard deviation of positions', above=0)
    noise_angle: float = quantity(
        8.7e-3, 'rad', 'standard deviation of angles and orientations', above=0
    )
    segment: float = quantity(4.0, 's', 'length of a segment', minimum=0.2)
    burn_in: float = quantity(
        2.0, 's', 'time before a segment in which its start is forgotten', minimum=0
    )
    horizon: float = quantity(
        HORIZON,
        's',
        'how long a held command is extrapolated with its velocity',
        minimum=0,
        maximum=1,
    )


class Setup(NamedTuple):
    """
    How a motion was measured, where it was not with one clock, in the centers of links, and level.

    The clocks of the stamps are ahead of that of the commands. The pose of a link is that of its
    frame, moved to a marker; all links that are measured have theirs in the same place. Axes are
    those of messages: x along the link, toward the next one, y to the left and z up.
    """

    joints: float = 0.0  # offset of the clock of joint angles [s]
    poses: float = 0.0  # that of poses [s]
    x: float = 0.0  # place of the marker, from the center of its link, along its axes [m]
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0  # turn of the floor about x and then y of the frame of the poses [rad]
    pitch: float = 0.0


AS_STATED = Setup()


class Segment(NamedTuple):
    """A segment: where its simulation starts, its steps, and its samples."""

    start: float  # of the simulation [s]
    measured: Measured  # at the start
    steps: slice  # of the references of the replay
    pose_time: Array  # (k,) [s]
    joint_time: Array  # (m,) [s]
    position: Array  # (k, l, 3) [m]
    orientation: Array  # (k, l, 4)
    joint_angle: Array  # (m, n-1, 2) [rad]


class Residual(NamedTuple):
    """
    Measured minus simulated in a segment, in units of the noise; nan where nothing was measured.

    Poses have shape (k, l, 6), position and turn, and joint angles (m, n-1, 2).
    """

    poses: Array
    joints: Array

    def flat(self) -> Array:
        """Return all numbers that there are."""
        both = np.concatenate([self.poses.ravel(), self.joints.ravel()])
        return np.asarray(both[~np.isnan(both)])

    @property
    def is_lost(self) -> bool:
        """Whether the segment could not be simulated."""
        return bool((self.poses == LOST).all())


class Replay:
    """
    A recording in segments that are simulated with any values of its scene.

    Parameters
    ----------
    recording : Recording
    scene : Scene
        With the method and the steps of the simulations.
    settings : ReplaySettings
    law : str
        One of `recorded_motion.LAWS`.
    setup : Setup or None, optional
        Where a search for offsets of clocks starts, see `with_offsets`. Segments then end early
        enough for offsets that are FARTHEST_OFFSET away. Default: stamps are those of one clock.

    Raises
    ------
    ParameterError
        If the recording is too short for two segments, or has too few samples in them.

    """

    def __init__(
        self,
        recording: Recording,
        scene: Scene,
        settings: ReplaySettings,
        law: str,
        setup: Setup | None = None,
    ) -> None:
        self.setup = setup or AS_STATED
        self.margin = 0.0 if setup is None else FARTHEST_OFFSET
        self.given, recording = recording, on_one_clock(recording, self.setup)
        self.recording, self.scene, self.settings, self.law = recording, scene, settings, law
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
        self.middles = first + (np.arange(steps) + 0.5) * scene.dt
        self._references: dict[float, tuple[Array, Array]] = {}
        commanded = self.references(scene)
        self.is_flat = not what_is_not_flat(scene) and not is_vertical(*commanded).any()
        self.segments = self._cut(first, steps, np.stack(commanded))
        if len(self.segments) < 2:
            raise ParameterError(
                f'the recording has {len(self.segments)} segments of {settings.segment:g} s with '
                f'enough samples, at least 2 are needed'
            )

    def references(self, scene: Scene) -> tuple[Array, Array]:
        """Return the references of all steps with the delay of a scene, (steps, n-1, 2) each."""
        delay = scene.robot.command_delay
        known = self._references.get(delay)
        if known is None:
            known = references(
                self.recording, scene.robot, self.middles - delay, self.law, self.settings.horizon
            )
            self._references = {delay: known, **dict(list(self._references.items())[:MOST_KNOWN])}
        return known

    def _cut(self, first: float, steps: int, commanded: Array) -> tuple[Segment, ...]:
        """Return the segments that have enough samples."""
        settings, dt = self.settings, self.scene.dt
        length = max(1, round(settings.segment / self.period)) * self.every
        burn = round(settings.burn_in / self.period) * self.every
        found = []
        for begin in range(burn, steps - length // 2, length):
            part = slice(begin - burn, min(begin + length, steps // self.every * self.every))
            times = first + dt * np.array([part.start, begin, part.stop])
            item = self._segment(times.tolist(), part, commanded[:, part.start])
            if item:
                found.append(item)
        return tuple(found)

    def _segment(self, times: list[float], steps: slice, commanded: Array) -> Segment | None:
        """Return a segment; None if it has too few samples."""
        recording, (start, begin, end) = self.recording, times
        begin, end = max(begin, start + self.margin), end - self.margin
        joints, poses = (
            slice(*np.searchsorted(of, [begin - 1e-9, end - 1e-9]))
            for of in (recording.joint_time, recording.pose_time)
        )
        measured = measured_at(recording, start, commanded)
        both = recording.pose_time[poses], recording.joint_time[joints]
        if not measured or min(map(len, both)) < LEAST_SAMPLES:
            return None
        return Segment(
            start, measured, steps, *both,
            recording.position[poses], recording.orientation[poses], recording.joint_angle[joints],
        )  # fmt: skip

    def compile(self, scene: Scene) -> None:
        """Compile what segments of a scene need, by the first one, before threads do."""
        self.residuals(scene, self.segments[:1])

    def residuals(
        self,
        scene: Scene,
        segments: tuple[Segment, ...] | None = None,
        setup: Setup | None = None,
    ) -> list[Residual]:
        """Return the residuals of segments, all of them by default, of another setup if given."""
        return self.residuals_of(scene, [setup or self.setup], segments)[0]

    def residuals_of(
        self,
        scene: Scene,
        setups: Sequence[Setup],
        segments: tuple[Segment, ...] | None = None,
    ) -> list[list[Residual]]:
        """
        Return the residuals of one simulation for each of some setups.

        A segment that is lost where steps are divided as the accuracy asks for is simulated with
        whole steps: after a jump, as at a start, contacts and joints with friction are often not
        solved in short parts of a step.
        """
        commanded, scene = self.references(scene), without_delay(scene)
        scenes = [scene]
        if scene.accuracy > 0.0:
            scenes.append(with_settings(scene, {'accuracy': 0.0}))
        steppers = [make_stepper(each) for each in scenes]
        found: list[list[Residual]] = [[] for _ in setups]
        for item in self.segments if segments is None else segments:
            motions = (self._motion(scene, each, item, commanded) for each in steppers)
            motion = next((each for each in motions if each is not None), None)
            for residuals, setup in zip(found, setups, strict=True):
                residuals.append(self._residual(scene, item, motion, setup))
        return found

    def _residual(
        self, scene: Scene, segment: Segment, motion: CubicHermiteSpline | None, setup: Setup
    ) -> Residual:
        """Return the residuals of a motion; LOST if there is none."""
        if motion is None:
            size = segment.position.shape[:2]
            lost = np.where(np.isnan(segment.joint_angle), np.nan, LOST)
            return Residual(np.full((*size, 6), LOST), lost)
        settings, before = self.settings, self.setup
        poses = segment.pose_time - (setup.poses - before.poses) - segment.start
        joints = segment.joint_time - (setup.joints - before.joints) - segment.start
        q = coordinates_at(motion, poses)
        # Samples of both kinds often have the same times.
        all_q = q if np.array_equal(poses, joints) else coordinates_at(motion, joints)
        links = as_measured(q[:, self.recording.links], setup)
        off = aligned(segment, links, settings.noise_position, settings.noise_angle)
        angle = joint_angles(all_q, scene.robot)
        return Residual(off, (segment.joint_angle - angle) / settings.noise_angle)

    def _motion(
        self,
        scene: Scene,
        stepper: Stepper,
        segment: Segment,
        commanded: tuple[Array, Array],
    ) -> CubicHermiteSpline | None:
        """
        Return the simulated motion since the start of a segment.

        It is None if a step fails or too many do not converge, which ends the simulation.
        """
        start = start_state(scene, segment.measured, is_flat=self.is_flat)
        angle, rate = (array[segment.steps] for array in commanded)
        samples = make_samples(scene, self.every, len(angle) // self.every)
        state, history, unconverged = start, stepper.empty_history(), 0
        most = MOST_UNCONVERGED * len(angle)
        begin, portion = 0, max(1, int(most))
        while begin < len(angle):
            part = slice(begin, begin + portion)
            state, history, report = stepper.advance(
                state, history, angle[part], rate[part], samples.after(begin)
            )
            unconverged += report.unconverged
            if report.failure or unconverged > most:
                return None
            begin += portion
            # Each call takes as long as dozens of steps: there are few where all goes well.
            portion *= 1 if report.unconverged else 2
        q = np.concatenate([start.q[None], samples.q])
        u = np.concatenate([start.u[None], samples.u])
        return motion_of(q, u, self.period)

    def start(self, scene: Scene) -> State:
        """Return the state at the start of the first segment."""
        return start_state(scene, self.segments[0].measured, is_flat=self.is_flat)


def start_effect(replay: Replay) -> tuple[float, list[Residual]]:
    """
    Return how much an error of the starts of segments moves what is simulated after the burn-in.

    The yaw joints are off by START_ERROR in turn to both sides. It is the root mean square change
    of the residuals, in units of the noise: errors of a model are told from it only if larger.
    The residuals without that error are returned, too.
    """
    count = replay.recording.joint_angle.shape[1]
    error = np.zeros((2, count, 2))
    error[0, :, 0] = START_ERROR * np.resize([1.0, -1.0], count)
    starts = [
        item._replace(measured=replace(item.measured, angle=item.measured.angle + error))
        for item in replay.segments
    ]
    here = replay.residuals(replay.scene)
    there = replay.residuals(replay.scene, tuple(starts))
    pairs = zip(here, there, strict=True)
    change = np.concatenate([moved.flat() - item.flat() for item, moved in pairs])
    return float(np.sqrt((change**2).mean())), here


def with_offsets(replay: Replay, streams: Container[str]) -> Replay:
    """
    Return a replay that starts a search for offsets of some streams, `joints` and `poses`.

    It starts at those that fit best with the values of the scene, of some up to FARTHEST_OFFSET.
    """
    recording, scene, rest = replay.given, replay.scene, (replay.settings, replay.law)
    replay = Replay(recording, scene, *rest, AS_STATED)
    count = round(FARTHEST_OFFSET / OFFSET_STEP)
    tried = OFFSET_STEP * np.arange(-count, count + 1)
    costs = np.zeros((len(tried), 2))
    found = replay.residuals_of(scene, [Setup(offset, offset) for offset in tried.tolist()])
    for cost, residuals in zip(costs, found, strict=True):
        for item in residuals:
            cost += np.nansum(item.joints**2), np.nansum(item.poses**2)
    best = tried[costs.argmin(axis=0)]
    pairs = zip(('joints', 'poses'), best.tolist(), strict=True)
    setup = Setup(**{name: offset for name, offset in pairs if name in streams})
    return Replay(recording, scene, *rest, setup)


def on_one_clock(recording: Recording, setup: Setup) -> Recording:
    """Return a recording with its stamps on the clock of the commands."""
    return replace(
        recording,
        joint_time=recording.joint_time - setup.joints,
        pose_time=recording.pose_time - setup.poses,
    )


def as_measured(q: Array, setup: Setup) -> Array:
    """Return the poses (..., 7) that are measured of links with coordinates q."""
    marker, p = np.array([setup.y, setup.z, setup.x]), q[..., 3:]  # along the axes of B
    place = q[..., :3]
    if marker.any():
        place = place + rotation_matrices(p) @ marker
    if setup.roll != 0.0 or setup.pitch != 0.0:
        tilt = product(about(1, setup.pitch), about(0, setup.roll))
        place = place @ rotation_matrices(tilt).T
        p = product(np.broadcast_to(tilt, p.shape), p)
    return np.concatenate([place, p], axis=-1)


def without_delay(scene: Scene) -> Scene:
    """Return a scene whose references take effect at once."""
    if scene.robot.command_delay == 0.0:
        return scene
    return with_settings(scene, {'robot.command_delay': 0.0})


def has_eased(replay: Replay, scene: Scene) -> bool:
    """Return whether a search in a scene begins in an `eased` one."""
    return replay.is_flat and bool(scene.robot.per_joint('friction')[:, 1].any())


def eased(scene: Scene) -> Scene:
    """
    Return a scene of a robot that lies flat in which all segments are solved, and soon.

    Pitch joints have no friction, and steps are not divided. Where friction holds pitch joints,
    the links are one rigid body on many contacts, which are often not solved after the jump at the
    start of a segment. What is found in this scene is near that of the whole one.
    """
    axes, friction = scene.robot.chain.axes, scene.robot.per_joint('friction')
    friction[:, 1] = 0.0
    each = tuple(friction[axes[:, 0], axes[:, 1]].tolist())
    return with_settings(scene, {'robot.joint_friction': each, 'accuracy': 0.0})


def motion_of(q: Array, u: Array, period: float) -> CubicHermiteSpline:
    """
    Return the motion through states, cubic in time, for `coordinates_at`.

    Parameters
    ----------
    q, u : ndarray, shapes (k, n, 7) and (k, n, 6)
        As of `state.State`, a period apart.
    period : float
        [s]

    """
    q = q.copy()
    p = q[..., 3:]  # of which neither sign means anything, if it stays
    signs = np.where((p[1:] * p[:-1]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    p[1:] *= np.cumprod(signs, axis=0)
    omega = np.zeros(p.shape)
    omega[..., 1:] = u[..., 3:] / 2
    rates = np.concatenate([u[..., :3], product(p, omega)], axis=-1)
    return CubicHermiteSpline(period * np.arange(len(q)), q, rates)


def coordinates_at(motion: CubicHermiteSpline, times: Array) -> Array:
    """Return the coordinates of a motion at times since its first state [s], (m, n, 7)."""
    found = np.asarray(motion(times))
    found[..., 3:] /= np.linalg.norm(found[..., 3:], axis=-1, keepdims=True)
    return found


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
    ratio = (noise_position / noise_angle) ** 2
    middle, center = segment.position.mean(axis=(0, 1)), q[..., :3].mean(axis=(0, 1))
    place, measured = q[..., :3] - center, segment.position - middle
    x, y = place[..., 0].ravel(), place[..., 1].ravel()
    a, b = measured[..., 0].ravel(), measured[..., 1].ravel()
    along, across = x @ a + y @ b, x @ b - y @ a
    turn = product(segment.orientation, q[..., 3:] * CONJUGATE)  # from simulated to measured
    turn *= np.where(turn[..., :1] < 0.0, -1.0, 1.0)
    straight, about_z = 2.0 * ratio * turn[..., [0, 3]].sum(axis=(0, 1))
    size = x @ x + y @ y + ratio * len(x)
    heading = 0.0
    for _ in range(TURNS):
        cosine, sine = math.cos(heading), math.sin(heading)
        asked = across * cosine - along * sine
        asked += about_z * math.cos(heading / 2) - straight * math.sin(heading / 2)
        heading += float(asked / size)
    by = about(2, heading)
    off = (measured - place @ rotation_matrices(by).T) / noise_position
    left = product(turn, np.broadcast_to(by * CONJUGATE, turn.shape))
    left *= np.where(left[..., :1] < 0.0, -1.0, 1.0)
    return np.concatenate([off, 2.0 * left[..., 1:] / noise_angle], axis=-1)


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
    settings = {
        'method': 'bdf2', 'dt': PERIOD, 'solver.residual_tolerance': RESIDUAL,
    }  # fmt: skip
    if 'accuracy' not in given:
        settings['accuracy'] = ACCURACY
    return with_settings(scene, settings)


def without_noise(
    recording: Recording,
    scene: Scene,
    state: State,
    law: str,
    horizon: float,
    setup: Setup = AS_STATED,
) -> Recording:
    """
    Return the recording of a scene that follows the commands of a recording.

    Parameters
    ----------
    recording : Recording
        Its commands, its times and what was measured are kept, its measured numbers are not.
    scene : Scene
    state : State
        At the begin of the recording.
    law, horizon
        As of `recorded_motion.references`.
    setup : Setup, optional
        How it is measured.

    Raises
    ------
    ParameterError
        If the simulation diverges.

    """
    recording = on_one_clock(recording, setup)
    begin, dt = recording.begin, scene.dt
    every = max(1, round(PERIOD / dt))
    rows = int(np.ceil((recording.end - begin) / (every * dt) - 1e-6))
    steps = every * rows
    middles = begin + (np.arange(steps) + 0.5) * dt - scene.robot.command_delay
    angle, rate = references(recording, scene.robot, middles, law, horizon)
    simulation, samples = Simulation(without_delay(scene)), make_samples(scene, every, rows)
    simulation.state = state
    report = simulation.advance(angle, rate, samples)
    if report.failure:
        raise ParameterError(report.failure)
    q = np.concatenate([state.q[None], samples.q])
    u = np.concatenate([state.u[None], samples.u])
    motion = motion_of(q, u, every * dt)
    joints, poses = (
        times[(times >= begin) & (times <= recording.end)]
        for times in (recording.joint_time, recording.pose_time)
    )
    kept = np.isin(recording.joint_time, joints)
    missing = np.isnan(recording.joint_angle[kept])
    angle = joint_angles(coordinates_at(motion, joints - begin), scene.robot)
    links = as_measured(coordinates_at(motion, poses - begin)[:, recording.links], setup)
    return replace(
        recording,
        joint_time=joints + setup.joints,
        joint_angle=np.where(missing, np.nan, angle),
        pose_time=poses + setup.poses,
        position=links[..., :3],
        orientation=links[..., 3:],
    )


def with_noise(
    recording: Recording, noise_position: float, noise_angle: float, seed: int
) -> Recording:
    """
    Return a recording with normally distributed noise.

    Parameters
    ----------
    recording : Recording
    noise_position, noise_angle : float
        Standard deviations [m], [rad].
    seed : int

    """
    random = np.random.default_rng(seed)

    def drawn(like: Array, deviation: float) -> Array:
        return deviation * random.standard_normal(like.shape)

    turn = np.ones(recording.orientation.shape)
    turn[..., 1:] = drawn(turn[..., 1:], noise_angle / 2)
    orientation = product(turn, recording.orientation)
    return replace(
        recording,
        joint_angle=recording.joint_angle + drawn(recording.joint_angle, noise_angle),
        position=recording.position + drawn(recording.position, noise_position),
        orientation=orientation / np.linalg.norm(orientation, axis=-1, keepdims=True),
    )
