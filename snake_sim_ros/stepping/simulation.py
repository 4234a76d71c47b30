"""A scene run in time: sub-steps, references, recording, and what happens when a step diverges."""

from collections.abc import Callable
from collections.abc import Sequence
import time

import numpy as np

from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Gait
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.contact_forces import loaded_contacts
from snake_sim_ros.stepping.contact_forces import where_impulses_acted
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.state import carried
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.trajectory import Trajectory


def joint_motion(q: Array, u: Array) -> tuple[Array, Array]:
    """
    Return angles and rates of the joints in some states, as the compiled step has them.

    Parameters
    ----------
    q : ndarray, shape (m, n, 7)
    u : ndarray, shape (m, n, 6)
        See `state.State`.

    Returns
    -------
    angle, rate : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad], [rad/s].

    """
    m, n, _ = q.shape
    coordinate = np.empty((m, n - 1, 2, 2))
    kinematics.joint_motions(q, u, np.empty((n, 3, 3)), np.empty((n, 3)), coordinate)
    return coordinate[..., 0], coordinate[..., 1]


def steps_in(period: float, dt: float, name: str) -> int:
    """
    Return how many steps make up a period.

    Raises
    ------
    ParameterError
        If the step does not divide the period.

    """
    steps = round(period / dt)
    if steps < 1 or abs(steps * dt - period) > 1e-9 * period:
        raise ParameterError(f'dt must divide the {name}: got dt={dt:g} s, period={period:g} s')
    return steps


class Simulation:
    """
    The state of a scene as it advances.

    Parameters
    ----------
    scene : Scene
    stepper : Stepper, optional
        A method that has no name in `methods.METHODS`, made for this scene; without it the method
        that the scene names.

    Attributes
    ----------
    state : State
        The last good state.
    step_count : int
        Steps since the simulation was made; a reset does not turn it back.
    report : Report
        Of all steps since the start or the last reset.
    last : Report
        Of the last call of `advance`.

    """

    def __init__(self, scene: Scene, stepper: Stepper | None = None) -> None:
        self.scene, self.given = scene, stepper is not None
        self.stepper = stepper or make_stepper(scene)
        self.step_count = 0
        self.reset()

    def reset(self) -> None:
        """Put the robot back to the start of the scene; time goes on."""
        self.state = initial_state(self.scene)
        self.history = self.stepper.empty_history()
        axes = (self.scene.robot.link_count - 1, 2)
        self.report = self.last = Report(joint_torque=np.zeros(axes))

    def compile(self, wave: Gait | None = None) -> float:
        """
        Take one step and forget it: nothing is compiled later. Return the time it took [s].

        Parameters
        ----------
        wave : Gait, optional
            If given, only the level that its first step needs is compiled; else all levels are.

        """
        begin = time.perf_counter()
        axes = self.scene.robot.link_count - 1
        angles = [np.zeros((1, axes, 2)), np.full((1, axes, 2), 1e-3)]
        steps = [(angle, np.zeros_like(angle)) for angle in angles]
        if wave:
            steps = [gait.reference(wave, self.midpoints(1), axes)]
        for angle, rate in steps:
            self.stepper.advance(self.state, self.history, angle, rate)
        joint_motion(self.state.q[None], self.state.u[None])
        return time.perf_counter() - begin

    def change(self, scene: Scene) -> None:
        """
        Go on with other numbers, such as another gravity, other obstacles or another method.

        Pose and velocities stay, and so do the impulses of contacts that both scenes have; see
        `state.carried`.

        Raises
        ------
        ParameterError
            If the scene has another number of links or another time step, or its method or level
            is not usable, or if the stepper was made by the caller; nothing has changed then.

        """
        if self.given:
            raise ParameterError(
                f'a scene cannot change under a {type(self.stepper).__name__} made by the caller; '
                f'make another Simulation'
            )
        for name, old, new in (
            ('robot.link_count', self.scene.robot.link_count, scene.robot.link_count),
            ('dt', self.scene.dt, scene.dt),
        ):
            if old != new:
                raise ParameterError(f'{name} cannot change while a scene runs: {old} to {new}')
        stepper = make_stepper(scene)
        if scene != self.scene:
            _, span = where_impulses_acted(self.scene, self.state, self.history)
            scale, empty = self.scene.dt / span, stepper.empty_history()
            self.history = carried(self.history, self.scene, scene, scale, empty)
        self.stepper, self.scene = stepper, scene

    def push(self, link: int, impulse: Sequence[float]) -> None:
        """
        Push a link at its center; the joints and contacts of the next step share the momentum.

        Parameters
        ----------
        link : int
            Index of the link, from 0.
        impulse : sequence of float, shape (3,)
            [N s, frame I]

        Raises
        ------
        ParameterError
            If there is no such link, or the impulse is not three finite numbers.

        """
        n, P = self.scene.robot.link_count, np.asarray(impulse, dtype=float)
        if not 0 <= link < n:
            raise ParameterError(f'link must be 0 to {n - 1}, got {link}')
        if P.shape != (3,) or not np.isfinite(P).all():
            raise ParameterError(f'impulse must be 3 finite numbers in N s, got {impulse}')
        u = self.state.u.copy()
        u[link, :3] += P / self.scene.robot.per_link('link_mass')[link]
        self.state = State(self.state.q, u)

    @property
    def compile_seconds(self) -> float:
        """Wall time that went into compiling levels at their first use [s]."""
        return float(getattr(self.stepper, 'compile_seconds', 0.0))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.step_count * self.scene.dt

    def midpoints(self, steps: int) -> Array:
        """Return the times of the middle of the next steps, shape (steps,) [s]."""
        return (self.step_count + 0.5 + np.arange(steps)) * self.scene.dt

    def gait_reference(self, steps: int) -> tuple[Array, Array]:
        """Return angle and rate of the scene's gait at `midpoints`, shape (steps, n-1, 2)."""
        axes = self.scene.robot.link_count - 1
        return gait.reference(self.scene.gait, self.midpoints(steps), axes)

    def advance(self, angle: Array, rate: Array) -> Report:
        """
        Take as many steps as there are references; none once a step has diverged, until `reset`.

        Parameters
        ----------
        angle, rate : ndarray, shape (steps, n-1, 2)
            Joint references at `midpoints` [rad], [rad/s].

        """
        if self.report.failure:
            return self.report
        self.state, self.history, self.last = self.stepper.advance(
            self.state, self.history, angle, rate
        )
        self.step_count += self.last.steps
        if self.last.failure:
            self.last.failure = f't = {self.time:g} s: {self.last.failure}'
        self.report += self.last
        return self.last


def run(
    scene: Scene, *, rate: float = 100.0, observe: Callable[[Simulation], object] | None = None
) -> Trajectory:
    """
    Run a scene with its gait and return what it did.

    Parameters
    ----------
    scene : Scene
    rate : float, optional
        Samples a second [Hz].
    observe : callable, optional
        Called at every sample, the start included. An interruption from the keyboard ends the run
        early; what was recorded is returned.

    Raises
    ------
    ParameterError
        If dt does not divide the sampling period, or the period the duration.

    """
    if not rate > 0:
        raise ParameterError(f'rate must be above 0 Hz, got {rate:g} Hz')
    steps = steps_in(1.0 / rate, scene.dt, 'sampling period')
    samples, rest = divmod(steps_in(scene.duration, scene.dt, 'duration'), steps)
    if rest:
        raise ParameterError(
            f'duration must be a multiple of the sampling period, 1/{rate:g} s; '
            f'got {scene.duration:g} s'
        )
    simulation = Simulation(scene)
    simulation.compile(scene.gait)
    states, torques, seconds = [simulation.state], [simulation.report.joint_torque], 0.0
    levels, contacts = [], [_contacts(simulation)]
    interrupted = False
    try:
        if observe:
            observe(simulation)
        for _ in range(samples):
            begin = time.perf_counter()
            reference = simulation.gait_reference(steps)
            compiled = simulation.compile_seconds
            report = simulation.advance(*reference)
            compiled = simulation.compile_seconds - compiled
            seconds += time.perf_counter() - begin - compiled
            if report.failure:
                break
            contacts.append(_contacts(simulation))
            torques.append(report.joint_torque)
            levels.append(report.level)
            states.append(simulation.state)
            if observe:
                observe(simulation)
    except KeyboardInterrupt:
        interrupted = True
    q, u = np.array([state.q for state in states]), np.array([state.u for state in states])
    joint_angle, joint_velocity = joint_motion(q, u)
    # An interruption may have come between two of the lists.
    m = len(states)
    number, point, force = (np.concatenate(parts) for parts in zip(*contacts[:m], strict=True))
    levels = levels[: m - 1]
    return Trajectory(
        scene=scene,
        time=np.arange(m) * steps * scene.dt,
        position=q[:, :, :3],
        orientation=q[:, :, 3:],
        joint_angle=joint_angle,
        joint_velocity=joint_velocity,
        joint_torque=np.array(torques[:m]),
        contact_sample=np.repeat(np.arange(m), [len(part[0]) for part in contacts[:m]]),
        contact_number=number,
        contact_point=point,
        contact_force=force,
        level=np.array(levels[:1] + levels) if levels else np.array([simulation.report.level]),
        report=simulation.report,
        seconds=seconds,
        interrupted=interrupted,
    )


def _contacts(simulation: Simulation) -> tuple[Array, Array, Array]:
    """Return numbers, points and forces of the contacts that carried load in the last step."""
    scene, state, history = simulation.scene, simulation.state, simulation.history
    return loaded_contacts(history), *contact_forces(scene, state, history)
