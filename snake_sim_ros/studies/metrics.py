# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is measured in a run: a number of its trajectory, by a name or a function of the user."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import hashlib
from importlib import import_module
import inspect
import math
from pathlib import Path
import sys
from typing import Any

import numpy as np

from snake_sim_ros.controllers.following import speed_along
from snake_sim_ros.controllers.paths import PlanarPath
from snake_sim_ros.dynamics.force_directions import floor_contact_velocities
from snake_sim_ros.gaits.steering import Stride
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    from_mapping,
    nearest,
    ParameterError,
    quantity,
    quoted,
)
from snake_sim_ros.scene.gait import Gait
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.trajectory import Trajectory

Measure = Callable[[Trajectory], Any]


JAMMED = 0.1  # share of the way of a cycle; one that slips badly makes a third
ROUNDING = 1e-9  # share of a cycle by which the last one may be short
WINDOW_EXAMPLE = '{steady_torque: {of: peak_torque, begin: 1}}'


class MetricError(ParameterError):
    """A metric has no number for a trajectory; the message says which and why."""


@dataclass(frozen=True, kw_only=True)
class Window(CheckedRecord):
    """The part of a run from which a metric is computed, and the share of a maximum."""

    of: str = quantity('', '', 'the metric, by its name or as module:function')
    begin: float = quantity(0.0, 's', 'time at which it begins', minimum=0)
    end: float = quantity(0.0, 's', 'time at which it ends (0 = the end of the run)', minimum=0)
    cycles: int = quantity(0, '1', 'gait cycles up to its end, in place of begin', minimum=0)
    quantile: float = quantity(
        1.0, '1', 'share of the time in which a maximum is not exceeded', above=0, maximum=1
    )

    def __post_init__(self) -> None:
        """Check every field, and that the window has a length."""
        super().__post_init__()
        if 0.0 < self.end <= self.begin:
            raise ParameterError(f'end must be after begin, {self.begin:g} s, got {self.end:g} s')
        if self.cycles and self.begin:
            raise ParameterError(
                f'a window has begin or cycles, got begin {self.begin:g} s and cycles '
                f'{self.cycles}'
            )

    def of_trajectory(self, trajectory: Trajectory) -> Trajectory:
        """
        Return the part of a trajectory; its ends are the nearest samples.

        Raises
        ------
        MetricError
            If the trajectory does not reach so far.

        """
        last = float(trajectory.time[-1])
        end = self.end or last
        begin = end - self.cycles * cycle(trajectory.scene.gait) if self.cycles else self.begin
        rounding = 1e-9 * max(1.0, last)
        if begin < -rounding or end > last + rounding or not begin < end:
            raise MetricError(
                f'the window from {begin:.6g} s to {end:.6g} s is not within the run of {last:g} s'
            )
        part = trajectory.between(begin, end)
        if len(part.time) < 2:
            raise MetricError(
                f'the window from {begin:.6g} s to {end:.6g} s is shorter than a sample: '
                f'raise rate'
            )
        return part


def cycle(gait: Gait) -> float:
    """
    Return the period of a gait, that of its slowest part [s].

    Raises
    ------
    MetricError
        If nothing in it repeats, or its parts do not repeat together.

    """
    waves = [wave for wave in (gait.yaw, gait.pitch) if wave.amplitude and wave.angular_frequency]
    periods = [2.0 * math.pi / abs(wave.angular_frequency) for wave in waves]
    if gait.table.repeat:
        periods.append(gait.table.time[-1] - gait.table.time[0])
    longest = max(periods, default=0.0)
    ratios = [longest / period for period in periods]
    if not periods or any(abs(ratio - round(ratio)) > 1e-6 * ratio for ratio in ratios):
        raise MetricError('the gait has no cycle: name begin and end in place of cycles')
    return longest


@dataclass(frozen=True)
class Metric:
    """
    A number of a trajectory.

    Attributes
    ----------
    name : str
    function : callable
        ``function(trajectory)`` returns the number.
    unit : str
        '1' for a pure number, '' if it is not known.
    contacts : bool
        Whether it needs the contacts of the trajectory.
    joints : bool
        Whether it needs the joints after every step.
    window : Window or None
        From which it is computed; the whole run if there is none.
    digest : str
        Names the source of a function of the user; empty for those of METRICS.

    """

    name: str
    function: Measure
    unit: str = ''
    contacts: bool = True
    digest: str = ''
    joints: bool = True
    window: Window | None = None

    @property
    def identity(self) -> str:
        """The name, with the digest and the window if there are any: what names it for good."""
        return f'{self.name} {self.digest} {self.window or ""}'.strip()

    def __call__(self, trajectory: Trajectory) -> float:
        """
        Return the number.

        Raises
        ------
        MetricError
            If the function raises an error or returns no number.

        """
        try:
            if self.window:
                trajectory = self.window.of_trajectory(trajectory)
            value = self.function(trajectory)
        except MetricError as error:
            raise MetricError(f'metric {self.name}: {error}') from None
        except Exception as error:  # whatever a function of the user raises is a row's failure
            raise MetricError(
                f'metric {self.name} raised {type(error).__name__}: {error}'
            ) from None
        if isinstance(value, (int, float, np.number, np.bool_)) or np.shape(value) == ():
            try:
                return float(value)
            except (TypeError, ValueError):
                pass
        raise MetricError(f'metric {self.name} must return a number, got {quoted(value)}')


def displacement(trajectory: Trajectory) -> Array:
    """Return the horizontal displacement of the center of mass, shape (2,) [m]."""
    mass = trajectory.scene.robot.per_link('link_mass')
    ways = trajectory.position[-1, :, :2] - trajectory.position[0, :, :2]
    return np.asarray(mass @ ways / mass.sum())


def distance(trajectory: Trajectory) -> float:
    """Return the horizontal distance of the center of mass from start to end, |d| [m]."""
    return math.hypot(*displacement(trajectory))


def _heading(trajectory: Trajectory) -> Array:
    """Return the horizontal direction from the last link to the first at the start, (2,)."""
    ahead = trajectory.position[0, 0, :2] - trajectory.position[0, -1, :2]
    length = math.hypot(*ahead)
    return np.asarray(ahead / length) if length > 0.0 else -trajectory.axis[0, 0, :2]


def forward(trajectory: Trajectory) -> float:
    """Return the component of `displacement` along the robot at its start, link 1 ahead [m]."""
    return float(displacement(trajectory) @ _heading(trajectory))


def sideways(trajectory: Trajectory) -> float:
    """Return the component of `displacement` to the left of the robot at its start [m]."""
    (x, y), (ahead_x, ahead_y) = displacement(trajectory), _heading(trajectory)
    return float(ahead_x * y - ahead_y * x)


def speed(trajectory: Trajectory) -> float:
    """Return the magnitude of the mean velocity of the center of mass, |d| / T [m/s]."""
    return distance(trajectory) / float(trajectory.time[-1] - trajectory.time[0])


def direction(trajectory: Trajectory) -> float:
    """
    Return the direction of the mean velocity, atan2(sideways, forward) [rad].

    It is 0 in the direction in which link 1 points at the start, and pi/2 to the left of it.
    """
    return math.atan2(sideways(trajectory), forward(trajectory))


def turning(trajectory: Trajectory) -> float:
    """
    Return the mean turning rate, of the direction from the last link to the first [rad/s].

    It is positive to the left. What the links do within a cycle is left out over whole cycles.
    """
    ahead = trajectory.position[:, 0, :2] - trajectory.position[:, -1, :2]
    angle = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return float((angle[-1] - angle[0]) / (trajectory.time[-1] - trajectory.time[0]))


def energy(trajectory: Trajectory) -> float:
    """
    Return the mechanical work of the joints without recovery, int sum_j |tau_j phi'_j| dt [J].

    The integral is that of the trapezoidal rule over the steps.
    """
    time, _, rate, torque = trajectory.joints
    power = np.abs(torque * rate).sum(axis=1)
    return float(((power[1:] + power[:-1]) * np.diff(time)).sum() / 2)


def cost_of_transport(trajectory: Trajectory) -> float:
    """Return the energy over weight times distance, E / (m g |d|) [1]; inf without a distance."""
    scene, way = trajectory.scene, distance(trajectory)
    weight = float(scene.robot.per_link('link_mass').sum()) * math.hypot(*scene.gravity)
    return energy(trajectory) / (weight * way) if weight * way > 0.0 else math.inf


def slip(trajectory: Trajectory) -> float:
    """
    Return the mean sliding speed of the loaded points on the floor [m/s].

    ``sum_k F_N |gamma_T| / sum_k F_N`` over all samples and contacts with the floor. The
    velocities are those of the sample, the loads those of the step before; 0 in flight.

    Raises
    ------
    MetricError
        If the trajectory has no velocities; files of single runs and bags keep none.

    """
    if not trajectory.velocity.size:
        raise MetricError('slip needs velocities of the links, which this file does not keep')
    robot = trajectory.scene.robot
    floor = trajectory.contact_number < len(robot.chain.spheres.link)
    sample, number = trajectory.contact_sample[floor], trajectory.contact_number[floor]
    load = trajectory.contact_force[floor, 2]
    velocity = floor_contact_velocities(robot, trajectory.coordinates, trajectory.velocity)
    sliding = velocity[sample, number]
    weighted = load * np.hypot(sliding[:, 1], sliding[:, 2])
    return float(weighted.sum() / load.sum()) if load.sum() > 0.0 else 0.0


def peak_torque(trajectory: Trajectory, quantile: float = 1.0) -> float:
    """Return the largest joint torque, max |tau_j| over joints, axes and steps [N m]."""
    return _largest(trajectory.joints.torque, quantile)


def angle_error(trajectory: Trajectory, quantile: float = 1.0) -> float:
    """Return the largest difference of a joint angle from its reference of the gait [rad]."""
    robot, joints = trajectory.scene.robot, trajectory.joints
    wanted, _ = gait.reference(trajectory.scene.gait, joints.time, robot.link_count - 1)
    return _largest(joints.angle - robot.by_axis(wanted), quantile)


def _track(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return arc lengths and cross-track errors of the center of the links [m]."""
    if not trajectory.scene.follow:
        raise MetricError('there is no path: the scene has no follow.points and no follow.center')
    kept = vars(trajectory)  # with the run, as by a `cached_property`: five metrics ask
    if '_track' not in kept:
        centers = trajectory.position[:, :, :2].mean(axis=1)
        kept['_track'] = PlanarPath.of(trajectory.scene.follow).track(centers)
    tracked: tuple[Array, Array] = kept['_track']
    return tracked


def cross_track(trajectory: Trajectory) -> float:
    """Return the root mean square of the cross-track error of the center of the links [m]."""
    return math.sqrt(float((_track(trajectory)[1] ** 2).mean()))


def cross_track_peak(trajectory: Trajectory, quantile: float = 1.0) -> float:
    """Return the largest cross-track error [m]."""
    return _largest(_track(trajectory)[1][:, None], quantile)


def cross_track_mean(trajectory: Trajectory) -> float:
    """Return the mean of the cross-track error, positive to the left of the path [m]."""
    return float(_track(trajectory)[1].mean())


def covered(trajectory: Trajectory) -> float:
    """Return the arc length of the path that the robot has covered [m]."""
    arcs, _ = _track(trajectory)
    return float(arcs[-1] - arcs[0])


def jams(trajectory: Trajectory) -> float:
    """Return the number of gait cycles that cover less than JAMMED of what the speed asks for."""
    (arcs, _), scene, time = _track(trajectory), trajectory.scene, trajectory.time
    period = cycle(scene.gait)
    asked = period * speed_along(scene.follow, scene.gait, Stride.of(scene.gait, scene.friction))
    ends = np.arange(time[0], time[-1] + ROUNDING * period, period)
    return float((np.diff(np.interp(ends, time, arcs)) < JAMMED * asked).sum())


def _largest(values: Array, quantile: float) -> float:
    """Return the value that the largest of a row does not exceed in a share of the rows."""
    largest = np.abs(values).max(axis=1, initial=0.0)
    return float(np.quantile(largest, quantile, method='inverted_cdf'))


MAXIMA = (peak_torque, angle_error, cross_track_peak)  # which take a quantile
METRICS: dict[str, Metric] = {
    function.__name__: Metric(
        function.__name__,
        function,
        unit,
        contacts=function is slip,
        joints=function in (energy, cost_of_transport, peak_torque, angle_error),
    )
    for function, unit in (
        (distance, 'm'),
        (forward, 'm'),
        (sideways, 'm'),
        (speed, 'm/s'),
        (direction, 'rad'),
        (turning, 'rad/s'),
        (energy, 'J'),
        (cost_of_transport, '1'),
        (slip, 'm/s'),
        (peak_torque, 'N m'),
        (angle_error, 'rad'),
        (cross_track, 'm'),
        (cross_track_peak, 'm'),
        (cross_track_mean, 'm'),
        (covered, 'm'),
        (jams, '1'),
    )
}
RUN_METRICS = (
    'distance',
    'speed',
    'direction',
    'energy',
    'cost_of_transport',
    'slip',
    'peak_torque',
)
PATH_METRICS = ('cross_track', 'cross_track_peak', 'cross_track_mean', 'covered', 'jams')
USUAL_METRICS: tuple[str, ...] = (
    *('distance', 'speed', 'direction', 'energy'),
    *('cost_of_transport', 'peak_torque'),
)


def metrics_of_run(trajectory: Trajectory) -> dict[str, float | None]:
    """
    Return the RUN_METRICS of a trajectory; None where it has no finite number.

    If its scene follows a path, the PATH_METRICS are there, too.
    """
    found: dict[str, float | None] = {}
    for name in RUN_METRICS + PATH_METRICS if trajectory.scene.follow else RUN_METRICS:
        try:
            value = METRICS[name](trajectory)
            found[name] = value if math.isfinite(value) else None
        except MetricError:
            found[name] = None
    return found


def metric_of(source: Any, folder: Path | None = None) -> Metric:
    """
    Return a metric.

    Parameters
    ----------
    source : str or callable or Metric or mapping
        A name of METRICS, ``module:function``, a function of a trajectory, or a new name ->
        the fields of its `Window`.
    folder : Path, optional
        Where the module may be, besides the folders of Python's path.

    Raises
    ------
    ParameterError
        If there is no such metric, module or function.

    """
    if isinstance(source, Metric):
        return source
    if callable(source):
        return Metric(getattr(source, '__name__', repr(source)), source, digest=_digest(source))
    if isinstance(source, Mapping):
        return _windowed(source, folder)
    if not isinstance(source, str):
        raise ParameterError(f'metrics must be names or functions, got {quoted(source)}')
    if ':' not in source:
        if source not in METRICS:
            raise ParameterError(
                f'metrics: unknown name {quoted(source)}; {nearest(source, METRICS)} '
                f'A function of your own is module:function'
            )
        return METRICS[source]
    function = _imported(source, folder)
    return Metric(source, function, digest=_digest(function))


def _windowed(source: Mapping[Any, Any], folder: Path | None) -> Metric:
    """Return the metric of a part of a run that a mapping of its name describes."""
    name, given = next(iter(source.items()), ('', None))
    if len(source) != 1 or not isinstance(name, str) or not name.isidentifier():
        raise ParameterError(
            f'metrics: a window must be like {WINDOW_EXAMPLE}, got {quoted(dict(source))}'
        )
    window: Window = from_mapping(Window, given, f'metrics: {name}')
    if name in METRICS or not window.of:
        what = 'needs a name of its own' if window.of else 'has no metric'
        raise ParameterError(f'metrics: {name} {what}; it must be like {WINDOW_EXAMPLE}')
    metric = metric_of(window.of, folder)
    function = metric.function
    if window.quantile < 1.0:
        if function not in MAXIMA:
            *others, last = (item.__name__ for item in MAXIMA)
            maxima = f'{", ".join(others)} and {last}'
            raise ParameterError(
                f'metrics: {name}: quantile is for {maxima}, got quantile {window.quantile:g} of '
                f'{window.of}'
            )
        function = partial(function, quantile=window.quantile)
    return replace(metric, name=name, function=function, window=window)


def metrics_of(sources: Sequence[Any], folder: Path | None = None) -> tuple[Metric, ...]:
    """Return metrics of different names, at least one; see `metric_of`."""
    if isinstance(sources, str) or not isinstance(sources, Sequence) or not sources:
        raise ParameterError(
            f'metrics must be a list such as [speed, cost_of_transport], got {quoted(sources)}'
        )
    metrics = tuple(metric_of(source, folder) for source in sources)
    names = [metric.name for metric in metrics]
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f'metrics: {name} is given twice')
    return metrics


def _imported(source: str, folder: Path | None) -> Measure:
    """Return the function that ``module:function`` names."""
    place, _, name = source.partition(':')
    if folder and str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    try:
        module = import_module(place)
    except Exception as error:  # an error in the module of a user may be any
        raise ParameterError(
            f'metrics: {source}: module {place} cannot be imported: {error}'
        ) from None
    function = getattr(module, name, None)
    if not callable(function):
        known = [key for key, value in vars(module).items() if callable(value)]
        hint = f'; {nearest(name, known)}' if known else ''
        raise ParameterError(
            f'metrics: {source}: module {place} has no function {quoted(name)}{hint}'
        )
    found: Measure = function
    return found


def _digest(function: Any) -> str:
    """Return a digest of the file of a function, or of its code if it is in none."""
    try:
        content = Path(inspect.getsourcefile(function) or '').read_bytes()
    except (OSError, TypeError):
        code = getattr(function, '__code__', None)
        content = repr(
            (code.co_code, code.co_consts, code.co_names) if code else function
        ).encode()
    name = getattr(function, '__qualname__', '')
    return hashlib.sha256(name.encode() + content).hexdigest()[:32]
