"""Who takes part in the bench: methods, their settings and time steps, and how they are run."""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace
from functools import partial
from typing import Any

from snake_sim_ros.comparison.baselines.integrators import integrate
from snake_sim_ros.comparison.baselines.integrators import make_pyramid
from snake_sim_ros.comparison.baselines.integrators import make_semi_implicit
from snake_sim_ros.comparison.baselines.integrators import Penalty
from snake_sim_ros.comparison.course import Course
from snake_sim_ros.comparison.course import SAMPLE
from snake_sim_ros.comparison.mujoco_peer import MujocoSettings
from snake_sim_ros.comparison.mujoco_peer import run_mujoco
from snake_sim_ros.comparison.timing import energy_error
from snake_sim_ros.comparison.timing import timed
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.simulation import steps_in

# Steps a second.
FINE = (16000, 8000, 4000, 2000, 1000)
COARSE = (500, 200, 100, 50, 20)
LARGE = (4000, 1000, 400, 200, 100, 50, 20, 10)
SLOW = (4000, 1000, 200)
PEER = (4000, 2000, 1000, 500, 200, 120, 60, 40, 30, 20)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6)
# Law, sliding velocity [m/s], stiffness [N/m]; steps a second, from below where they blow up on.
PENALTIES = (
    ('tanh', 1e-2, 1e4, (32000, 16000, 8000, 4000, 2000, 1000, 500, 250)),
    ('tanh', 1e-2, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('tanh', 1e-3, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('tanh', 1e-4, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('rational', 1e-3, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('tanh', 1e-3, 1e6, (64000, 32000, 16000, 8000, 4000, 2000)),
    ('tanh', 1e-3, 1e7, (64000, 32000, 16000, 8000)),
)
INTEGRATED = {  # with integrators of SciPy, too; explicit ones take ages on stiff springs
    PENALTIES[2][:3]: ('RK45', 'LSODA', 'Radau', 'BDF'),
    PENALTIES[6][:3]: ('LSODA', 'BDF'),
}
LOOSE = {'solver.residual_tolerance': 1e-5}
AS_PRINTED = {
    'solver.normal_compliance': 0.0,
    'solver.activation_tolerance': 0.0,
    'pd_scheme': 'midpoint',
}
USUAL_STEP = {'newton_dense': 4e-5, 'gauss_seidel': 8e-5, 'paper': 4e-5, 'mujoco': 6e-5}  # s
QUICK = {  # method: setting and rates of the quick matrix
    'newton': ('default', (4000, 1000, 200)),
    'bdf2': ('residual 1e-5 m/s', (400, 100, 20)),
    'paper': ('as printed, 1e-06 N s', (4000, 1000)),
    'semi_implicit_euler': ('tanh 0.01 m/s, 1e+04 N/m', (4000, 2000, 1000)),
    'mujoco': ('accurate, spring, discrete', (1000, 500, 120)),
}
Make = Callable[[Scene], Stepper]


@dataclass(frozen=True)
class Contender:
    """
    A method with its settings.

    Attributes
    ----------
    method : str
        Name of a method of `methods.METHODS`, of a baseline or of a peer.
    setting : str
        What distinguishes it from others of the same method and level.
    rates : tuple of float
        Steps a second; tolerances of a method that chooses its steps.
    run : callable
        ``run(scene, limit=...)``: the course of a scene, which ends early after that wall time
        [s]; with a ``tolerance``, too, for a method that chooses its steps.
    level : str
        `spatial` or `planar`.
    settings : mapping
        Of the scene, such as ``{'pd_scheme': 'start'}``.
    own_limit : tuple or None
        Name of the model, and the contender that runs it with two rates, the second twice the
        first, to extrapolate where small steps lead; empty for the model that the converged
        solution is of. None leaves it out.
    adaptive : bool
        Whether it chooses its steps.

    """

    method: str
    setting: str
    rates: tuple[float, ...]
    run: Callable[..., Course]
    level: str = 'spatial'
    settings: Mapping[str, Any] = field(default_factory=dict)
    own_limit: tuple[Any, ...] | None = ()
    adaptive: bool = False

    def scene(self, scene: Scene, rate: float) -> Scene:
        """Return a scene as this contender runs it, at one of its rates."""
        dt = scene.dt if self.adaptive else 1 / rate
        return with_settings(scene, {**self.settings, 'level': self.level, 'dt': dt})

    def seconds(self, scene: Scene) -> float:
        """Return a guess of the wall time of a run, for progress bars [s]."""
        if self.adaptive:
            return 6.0
        step = USUAL_STEP.get(self.method, 8e-6) * scene.robot.link_count / 11
        return 0.3 + step * scene.duration / scene.dt


def check_times(scenes: Iterable[Scene], steps: Iterable[float], limit: float) -> None:
    """
    Check what a user asks of all runs.

    Parameters
    ----------
    scenes : iterable of Scene
    steps : iterable of float
        Time steps [s].
    limit : float
        Wall time after which a run ends early [s].

    Raises
    ------
    ParameterError
        If courses cannot be sampled every SAMPLE, or the limit is none.

    """
    if not limit > 0.0:
        raise ParameterError(f'limit must be above 0 s, got {limit:g} s')
    for scene in scenes:
        samples = scene.duration / SAMPLE
        if round(samples) < 1 or abs(samples - round(samples)) > 1e-9 * samples:
            raise ParameterError(
                f'duration must be a multiple of {SAMPLE:g} s, at which paths are compared, '
                f'got {scene.duration:g} s'
            )
        for dt in steps:
            steps_in(SAMPLE, replace(scene, dt=dt).dt, 'sampling period')


def run_stepper(scene: Scene, limit: float, make: Make | None = None) -> Course:
    """Run a stepper, default that of the scene's method, and draw up its energy balance."""
    course = timed(scene, make, limit=limit)
    if course.status == 'diverged' or course.late:
        return course
    return replace(course, energy_error=energy_error(scene, make))


def all_contenders() -> list[Contender]:
    """Return all of the full matrix."""
    return [*ours(), *regularized(), *mujoco()]


def quick_contenders() -> list[Contender]:
    """Return those of the quick matrix: few methods and time steps, that compile in a minute."""
    return [
        replace(rival, rates=QUICK[rival.method][1], own_limit=None if rival.own_limit else ())
        for rival in all_contenders()
        if rival.setting == QUICK.get(rival.method, ('',))[0]
        and (rival.method, rival.level) != ('bdf2', 'planar')
    ]


def ours() -> list[Contender]:
    """Return the methods of `methods.METHODS` that are compiled, at both levels."""
    entries: list[tuple[str, str, tuple[float, ...], dict[str, Any]]] = [
        ('newton', 'default', FINE + COARSE, {}),
        ('newton', 'explicit PD', FINE + COARSE[:1], {'pd_scheme': 'start'}),
        ('bdf2', 'default', LARGE, {}),
        ('bdf2', 'residual 1e-5 m/s', LARGE, LOOSE),
        ('newton_dense', 'default', SLOW, {}),
        ('gauss_seidel', 'default', SLOW[:1], {}),
        ('gauss_seidel', 'residual 1e-5 m/s', SLOW, LOOSE),
        ('paper', 'selection rule, 1e-7 N s', SLOW, {}),
    ]
    entries += [
        ('paper', f'as printed, {eps:g} N s', FINE[1:], {**AS_PRINTED, 'solver.tolerance': eps})
        for eps in (1e-5, 1e-6, 1e-7, 1e-8)
    ]
    spatial = [
        Contender(method, setting, rates, run_stepper, settings={'method': method, **settings})
        for method, setting, rates, settings in entries
    ]
    printed = next(c for c in spatial if c.setting == 'as printed, 1e-08 N s')
    limit = ('as printed', replace(printed, rates=(4000, 8000)))
    return [
        *(replace(c, own_limit=limit) if 'as printed' in c.setting else c for c in spatial),
        *(replace(c, level='planar') for c in spatial if 'as printed' not in c.setting),
    ]


def regularized() -> list[Contender]:
    """Return the baselines: penalty contact with fixed and adaptive steps, and the pyramid."""
    entries = []
    for law, eps, k, rates in PENALTIES:
        penalty = Penalty(law=law, sliding_velocity=eps, stiffness=k)
        make = partial(make_semi_implicit, penalty=penalty)
        setting = f'{law} {eps:g} m/s, {k:.0e} N/m'
        run = partial(run_stepper, make=make)
        euler = Contender('semi_implicit_euler', setting, rates, run)
        limit = (setting, replace(euler, rates=(rates[0], 2 * rates[0])))
        entries.append(replace(euler, own_limit=limit))
        entries += [
            Contender(
                name.lower(), setting, TOLERANCES,
                partial(integrate, penalty=penalty, integrator=name),
                own_limit=limit, adaptive=True,
            )
            for name in INTEGRATED.get((law, eps, k), ())
        ]  # fmt: skip
    run = partial(run_stepper, make=make_pyramid)
    pyramid = Contender('pyramid', 'residual 1e-5 m/s', SLOW[:2], run, settings=LOOSE)
    limit = ('pyramid', replace(pyramid, rates=(2000, 4000)))
    return [*entries, replace(pyramid, own_limit=limit)]


def mujoco() -> list[Contender]:
    """Return MuJoCo with its own contacts and those chosen, and its ways to drive."""
    entries = []
    for contact, drive, integrator in (
        ('accurate', 'spring', 'discrete'),  # the first one is that of the runs over links
        ('accurate', 'position', 'implicitfast'),
        ('default', 'torque', 'Euler'),
        ('default', 'position', 'implicitfast'),
        ('default', 'spring', 'discrete'),
        ('fast', 'spring', 'discrete'),
    ):
        settings = MujocoSettings(contact=contact, drive=drive, integrator=integrator)
        run = partial(run_mujoco, settings=settings)
        peer = Contender('mujoco', f'{contact}, {drive}, {integrator}', PEER, run)
        limit = (peer.setting, replace(peer, rates=(4000, 8000)))
        entries.append(replace(peer, own_limit=limit))
    return entries
