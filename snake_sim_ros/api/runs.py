# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes by name and value, their runs, and what is measured in them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
import math
from pathlib import Path
import time
from typing import Any

import numpy as np

from snake_sim_ros.controllers.controller import Controller, going_on, Reference
from snake_sim_ros.gaits.blending import check_reach
from snake_sim_ros.recording.recorded_runs import read_run as read_trajectory, write_csv, write_npz
from snake_sim_ros.scene import parameters
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import Gait, Table
from snake_sim_ros.scene.parameters import Array, by_dotted_names, Robot, samples_of, Scene
from snake_sim_ros.stepping.methods import with_usual_steps
from snake_sim_ros.stepping.sampling import Command, command_of, Hooks, Keep
from snake_sim_ros.stepping.simulation import sample, Simulation
from snake_sim_ros.stepping.trajectory import Trajectory
from snake_sim_ros.studies import metrics
from snake_sim_ros.view.compile_bar import compile_with_bar

# ---- gaits as functions of time -----------------------------------------------------------------


ROWS = 200.0  # rows of a table a second; a spline between them is good to 1e-7 rad for waves [Hz]


def table_of(
    function: Callable[[float], Any], duration: float, robot: Robot | None = None
) -> Table:
    """
    Return a function of time as a table, with 200 rows a second and a cubic spline between them.

    Parameters
    ----------
    function : callable
        ``function(t)`` returns joint angles at a time t since the gait began [s], shape
        (axes,) in the order of `Robot.axis_names`, or (n-1, 2), (yaw, pitch) of every joint
        [rad]; or a tuple of angles and their rates [rad/s]. It is called once for each row, in
        order of time.
    duration : float
        Time up to which the table goes [s]; after that the joints hold their angles.
    robot : Robot, optional
        Default: Aiko.

    Raises
    ------
    ParameterError
        If the function returns something else.

    """
    if not 0.0 < duration < math.inf:
        raise ParameterError(f'duration must be above 0 s and finite, got {duration} s')
    time = np.linspace(0.0, duration, max(2, math.ceil(duration * ROWS - 1e-9) + 1))
    robot = robot or Robot()
    found = [references_of(function(t), robot, 'gait(t)') for t in time.tolist()]
    rates = [rate for _, rate in found if rate is not None]
    angles = np.array([angle for angle, _ in found])
    return Table.of(time, angles, np.array(rates) if len(rates) == len(time) else None)


def references_of(returned: Any, robot: Robot, name: str) -> tuple[Array, Array | None]:
    """
    Return angles and rates that a function of the user returned, shape (n-1, 2).

    Parameters
    ----------
    returned : array_like, shape (axes,) or (n-1, 2), or tuple of two such
        Angles [rad], or angles and rates [rad/s].
    robot : Robot
    name : str
        Name of the function, for the error.

    Raises
    ------
    ParameterError
        If it is neither.

    """
    columns, pairs = (len(robot.axis_names),), (robot.link_count - 1, 2)
    shapes = [_shape(part) for part in returned] if isinstance(returned, tuple) else []
    if len(shapes) == 2 and shapes[0] == shapes[1] and shapes[0] in (columns, pairs):
        angle, rate = (_by_joint(part, robot) for part in returned)
        return angle, rate
    if _shape(returned) in (columns, pairs):
        return _by_joint(returned, robot), None
    got = ' and '.join(map(str, shapes)) if len(shapes) == 2 else _shape(returned)
    raise ParameterError(
        f'{name} must return angles [rad] of shape {columns}, one for each joint axis, or '
        f'{pairs}, (yaw, pitch) of every joint, or a tuple of angles and rates of such a shape, '
        f'got {got or type(returned).__name__}'
    )


def _by_joint(values: Any, robot: Robot) -> Array:
    """Return numbers of a user as (yaw, pitch) of every joint, shape (n-1, 2)."""
    array = np.asarray(values, dtype=float)
    return robot.by_joint(array, 0.0) if array.ndim == 1 else array


def _shape(values: Any) -> tuple[int, ...] | None:
    """Return the shape of an array of numbers; None if it is something else."""
    try:
        return np.asarray(values, dtype=float).shape
    except (TypeError, ValueError):
        return None


# ---- runs ---------------------------------------------------------------------------------------


KEPT = Keep(contacts=True)
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Run(Trajectory):
    """
    A run of a scene: its trajectory, with what is measured in it.

    The attributes of the trajectory are arrays over the m samples, of n links, in SI units:

    ================================ ================ =========================================
    attribute                        shape            what
    ================================ ================ =========================================
    time                             (m,)             time of the samples [s]
    position                         (m, n, 3)        link centers in the world, z up [m]
    orientation                      (m, n, 4)        Euler parameters of the links, scalar first
    joint_angle, joint_velocity      (m, axes)        as `scene.robot.axis_names` [rad], [rad/s]
    joint_torque                     (m, axes)        torques of the step before a sample [N m]
    contact_sample, contact_number   (k,)             sample and number of each loaded contact
    contact_point, contact_force     (k, 3)           its place [m] and force [N] in the world
    path                             (m, 3)           center of the middle link [m]
    ================================ ================ =========================================

    `scene` reproduces the run, and `report` says how its steps went: `report.failure` is empty
    unless a step diverged, which ends a run early.
    """

    @property
    def distance(self) -> float:
        """Horizontal displacement of the center of mass from start to end [m]."""
        return metrics.METRICS['distance'](self)

    @property
    def speed(self) -> float:
        """Distance over time [m/s]."""
        return metrics.METRICS['speed'](self)

    @property
    def energy(self) -> float:
        """Mechanical work of all joints, without recovery [J]."""
        return metrics.METRICS['energy'](self)

    @property
    def cost_of_transport(self) -> float:
        """Energy over weight times distance [1]; inf without a distance."""
        return metrics.METRICS['cost_of_transport'](self)

    @property
    def slip(self) -> float:
        """Mean sliding speed of the loaded contacts on the floor [m/s]; not of runs from files."""
        return metrics.METRICS['slip'](self)

    @property
    def metrics(self) -> dict[str, float | None]:
        """What is measured, by name; None if a run has no such number. See docs/studies.md."""
        return metrics.metrics_of_run(self)

    def write(self, path: str | Path) -> None:
        """
        Write the run to a file; `read_run` and `snake-sim view` read npz files.

        Parameters
        ----------
        path : str or Path
            Ends in .npz or .csv.

        """
        writers = {'.npz': write_npz, '.csv': write_csv}
        if Path(path).suffix not in writers:
            raise ParameterError(f'a run is written to .npz or .csv, got {path}')
        writers[Path(path).suffix](self, Path(path))

    def plot(self, path: str | Path) -> None:
        """
        Draw path, joint angles, joint torques and contact forces; this needs matplotlib.

        Parameters
        ----------
        path : str or Path
            Ends in .png, .pdf or .svg.

        Raises
        ------
        ParameterError
            If matplotlib is not installed.

        """
        from snake_sim_ros.view import charts

        charts().draw(self, Path(path))


def load_scene(source: Scene | str | Path, values: Values | None = None, **more: Any) -> Scene:
    """
    Return a scene, with some of its values replaced.

    Values given neither by the scene nor by the caller are those of the robot Aiko in the paper.

    Parameters
    ----------
    source : Scene, str or Path
        A scene, a YAML file, or the name of a scene that comes with the package, such as
        ``'lateral_undulation'`` or ``'sidewinding'``.
    values : mapping, optional
        Names to values in SI units and radians: dotted, as ``{'friction.longitudinal': 0.2}``, or
        nested. The names of angles may end in ``_deg``.
    **more
        Values by the names that a scene has at its top, such as ``duration=3.0``,
        ``friction={'longitudinal': 0.2}``, ``robot=Robot(link_count=5)``. `gait` may also be a
        `Table`, the file of a table, or a function of time; see `run`.

    Returns
    -------
    Scene

    Raises
    ------
    ParameterError
        If there is no such scene, a name is unknown, a value is invalid, or the gait exceeds the
        joint limit. The message says which and why.

    """
    return _scene_and_names(source, values, more)[0]


def run(
    scene: Scene | str | Path, values: Values | None = None, *, rate: float = 100.0,
    controller: Controller | Callable[[Simulation], Any] | str | Values | None = None,
    progress: Callable[[float], object] | None = None, **more: Any,
) -> Run:  # fmt: skip
    """
    Run a scene, and return its trajectory.

    If neither `dt`, `method`, `level` nor `accuracy` is given, here or in the scene, the steps are
    those of an accuracy of 1e-3, as in ``snake-sim run``. The first run on a machine compiles the
    physics, which takes up to a minute or two; a bar on stderr shows its progress.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, a YAML file, or the name of a scene that comes with the package.
    values : mapping, optional
        Values of the scene by dotted names; see `load_scene`.
    rate : float, optional
        Samples a second [Hz].
    controller : Controller, callable, str or mapping, optional
        What commands the joints in place of the gait: a controller, such as a `PathFollower`, with
        a period of its own; the name of one, or its name and values, as a scene has them under
        `controller`; or a function ``controller(simulation)``, which is called at every
        sample but the last. The function returns joint angles of shape (axes,), in the order of
        `Robot.axis_names`, or (n-1, 2), (yaw, pitch) of every joint [rad], or a tuple of angles
        and rates [rad/s]: until the next sample the joints go on from the angles at the rates, or
        hold them. It may also return a function of times (m,) that returns angles and rates
        (m, n-1, 2) up to then.
    progress : callable, optional
        Called several times a second with the elapsed simulated time [s].
    **more
        Values of the scene by keyword, such as ``duration=3.0``; see `load_scene`.
        ``gait=function`` takes a function of time t [s] that returns what a controller returns; it
        is sampled 200 times a second, with a cubic spline between, and becomes the `Table` of the
        scene. The robot starts in its posture at t = 0.

    Returns
    -------
    Run

    Raises
    ------
    ParameterError
        If an argument is invalid; the message says which and why.

    """
    if isinstance(controller, str | Mapping):
        more, controller = {**more, 'controller': controller}, None
    loaded, names = _scene_and_names(scene, values, more)
    if not 0.0 < rate < math.inf:
        raise ParameterError(f'rate must be above 0 Hz and finite, got {rate:g} Hz')
    periods = {'sampling period': 1.0 / rate}
    if isinstance(controller, Controller):
        periods['period of the controller'] = controller.period
    loaded = with_usual_steps(loaded, names, periods)
    steps, samples = samples_of(loaded, rate)
    simulation = Simulation(loaded)
    compile_with_bar(simulation)
    begin, compiled = time.perf_counter(), simulation.compile_seconds
    command = None
    if isinstance(controller, Controller):
        command = command_of(controller, loaded)
    elif controller:
        command = Command(_checked(controller, loaded.robot), steps)
    hooks = Hooks(command, progress=progress)
    trajectory = sample(simulation, steps, samples, keep=KEPT, hooks=hooks)
    compiled = simulation.compile_seconds - compiled
    trajectory = replace(trajectory, seconds=time.perf_counter() - begin - compiled)
    return _run_of(trajectory)


def read_run(path: str | Path, namespace: str | None = None) -> Run:
    """
    Return a recorded run.

    Parameters
    ----------
    path : str or Path
        An npz file of `Run.write` or ``snake-sim run --out``, an MCAP file, or the folder of a ROS
        2 bag. Bags need ``mcap``, but no ROS.
    namespace : str, optional
        Namespace of the robot in a bag; needed if the bag has several robots.

    Raises
    ------
    ParameterError
        If it is none of these, or cannot be read.

    """
    return _run_of(read_trajectory(Path(path), namespace))


def _run_of(trajectory: Trajectory) -> Run:
    return Run(**{item.name: getattr(trajectory, item.name) for item in fields(Trajectory)})


def _checked(
    controller: Callable[[Simulation], Any], robot: Robot
) -> Callable[[Simulation], Reference]:
    """Return a controller of the user as `controlled` expects it."""

    def control(simulation: Simulation) -> Reference:
        returned = controller(simulation)
        if callable(returned):
            return returned  # type: ignore[no-any-return]
        angle, rate = references_of(returned, robot, 'controller(simulation)')
        return going_on(simulation.time, angle, np.zeros_like(angle) if rate is None else rate)

    return control


# ---- values of scenes ---------------------------------------------------------------------------


def _scene_and_names(
    source: Scene | str | Path, values: Values | None, more: Values
) -> tuple[Scene, set[str]]:
    """Return a scene and the dotted names of the values that a caller gave."""
    scene = source if isinstance(source, Scene) else parameters.load_scene(source)
    if not isinstance(values, Mapping | None):
        raise ParameterError(f'values must be a mapping of names to values, got {values!r}')
    twice = sorted({*(values or {})} & {*more})
    if twice:
        raise ParameterError(f'{twice[0]} is given twice, in the mapping and by keyword')
    settings = by_dotted_names({**(values or {}), **more}, scene)
    gait = settings.get('gait')
    if callable(gait) or isinstance(gait, (Table, str, Path)):
        scene = parameters.with_settings(scene, {k: v for k, v in settings.items() if k != 'gait'})
        if callable(gait):
            gait = table_of(gait, scene.duration, scene.robot)
        settings['gait'] = Gait()
        changed = parameters.with_settings(replace(scene, gait=Gait()), {'gait.table': gait})
    else:
        changed = parameters.with_settings(scene, settings)
    check_reach(changed.gait, changed.robot)
    return changed, set(settings)
