# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contenders of the bench: methods with their settings, time steps and ways to run them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from snake_sim_benchmarks.comparison.baselines.integrators import (
    integrate,
    make_pyramid,
    make_semi_implicit,
    Penalty,
)
from snake_sim_benchmarks.comparison.mujoco_model import MujocoSettings
from snake_sim_benchmarks.comparison.mujoco_runs import run_mujoco
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD
from snake_sim_benchmarks.comparison.timing import energy_error, timed, TimedRun
from snake_sim_ros import ParameterError, Scene
from snake_sim_ros.scene.parameters import steps_in, with_settings
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import METHODS

# Steps a second.
SMALL_STEP_RATES = (16000, 8000, 4000, 2000, 1000)
LARGE_STEP_RATES = (500, 200, 100, 50, 20)
BDF2_RATES = (4000, 1000, 400, 200, 100, 50, 20, 10)
SLOW_METHOD_RATES = (4000, 1000, 200)
MUJOCO_RATES = (4000, 2000, 1000, 500, 200, 120, 60, 40, 30, 20)
INTEGRATOR_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6)
# Law, sliding velocity [m/s], stiffness [N/m], steps a second. The largest steps blow up.
PENALTIES = (
    ('tanh', 1e-2, 1e4, (32000, 16000, 8000, 4000, 2000, 1000, 500, 250)),
    ('tanh', 1e-2, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('tanh', 1e-3, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('tanh', 1e-4, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('rational', 1e-3, 1e5, (32000, 16000, 8000, 4000, 2000, 1000, 500)),
    ('tanh', 1e-3, 1e6, (64000, 32000, 16000, 8000, 4000, 2000)),
    ('tanh', 1e-3, 1e7, (64000, 32000, 16000, 8000)),
)
# Integrators of SciPy for some of PENALTIES; explicit ones take ages on stiff springs.
PENALTY_INTEGRATORS = {
    PENALTIES[2][:3]: ('RK45', 'LSODA', 'Radau', 'BDF'),
    PENALTIES[6][:3]: ('LSODA', 'BDF'),
}
LOOSE_TOLERANCE = {'solver.residual_tolerance': 1e-5}
PRINTED_SETTINGS = {
    'solver.normal_compliance': 0.0,
    'solver.activation_tolerance': 0.0,
    'pd_scheme': 'midpoint',
}
# Wall time of a step [s].
STEP_SECONDS = {'newton_dense': 4e-5, 'gauss_seidel': 8e-5, 'paper': 4e-5, 'mujoco': 6e-5}
QUICK_SETTINGS = {  # method: setting and rates of the quick matrix
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
        Name of a method of `methods.METHODS`, of a baseline, or `mujoco`.
    setting : str
        Name of the setting, different for contenders of the same method and level.
    rates : tuple of float
        Steps a second, or the tolerances of a method that chooses its steps.
    run : callable
        ``run(scene, limit=...)``: a scene run, ended early after that wall time [s]; with a
        ``tolerance``, too, for a method that chooses its steps.
    level : str
        `spatial` or `planar`.
    settings : mapping
        Of the scene, such as ``{'pd_scheme': 'start'}``.
    own_limit : tuple or None
        Name of the model, and the contender that runs it at two rates, the second twice the
        first, from which the limit of small steps is extrapolated. Empty for the model of the
        converged solution; None if no limit is wanted.
    adaptive : bool
        Whether it chooses its steps.

    """

    method: str
    setting: str
    rates: tuple[float, ...]
    run: Callable[..., TimedRun]
    level: str = 'spatial'
    settings: Mapping[str, Any] = field(default_factory=dict)
    own_limit: tuple[Any, ...] | None = ()
    adaptive: bool = False

    def scene(self, scene: Scene, rate: float) -> Scene:
        """Return a scene with the settings of this contender and the time step of a rate."""
        dt = scene.dt if self.adaptive else 1 / rate
        return with_settings(scene, {**self.settings, 'level': self.level, 'dt': dt})

    def seconds(self, scene: Scene) -> float:
        """Return the expected wall time of a run, for progress bars [s]."""
        if self.adaptive:
            return 6.0
        step = STEP_SECONDS.get(self.method, 8e-6) * scene.robot.link_count / 11
        return 0.3 + step * scene.duration / scene.dt


def check_times(scenes: Iterable[Scene], steps: Iterable[float], limit: float) -> None:
    """
    Check the scenes, time steps and time limit that a user asks for.

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
        If runs cannot be sampled every SAMPLING_PERIOD, or the limit is not positive.

    """
    if not limit > 0.0:
        raise ParameterError(f'limit must be above 0 s, got {limit:g} s')
    for scene in scenes:
        samples = scene.duration / SAMPLING_PERIOD
        if round(samples) < 1 or abs(samples - round(samples)) > 1e-9 * samples:
            raise ParameterError(
                f'duration must be a multiple of {SAMPLING_PERIOD:g} s, at which paths are '
                f'compared, got {scene.duration:g} s'
            )
        for dt in steps:
            steps_in(SAMPLING_PERIOD, replace(scene, dt=dt).dt, 'sampling period')


def run_stepper(scene: Scene, limit: float, make: Make | None = None) -> TimedRun:
    """Run a stepper, default that of the scene's method, and compute its energy balance."""
    found = timed(scene, make, limit=limit)
    if found.status == 'diverged' or found.late:
        return found
    return replace(found, energy_error=energy_error(scene, make))


def all_contenders() -> list[Contender]:
    """Return all contenders of the full matrix."""
    return [*ours(), *regularized(), *mujoco()]


def quick_contenders() -> list[Contender]:
    """Return the contenders of the quick matrix, which compile in a minute."""
    return [
        replace(
            contender,
            rates=QUICK_SETTINGS[contender.method][1],
            own_limit=None if contender.own_limit else (),
        )
        for contender in all_contenders()
        if contender.setting == QUICK_SETTINGS.get(contender.method, ('',))[0]
        and (contender.method, contender.level) != ('bdf2', 'planar')
    ]


def ours() -> list[Contender]:
    """Return the methods of `methods.METHODS` that are compiled, at both levels."""
    variants: list[tuple[str, str, tuple[float, ...], dict[str, Any]]] = [
        ('newton', 'default', SMALL_STEP_RATES + LARGE_STEP_RATES, {}),
        ('newton', 'explicit PD', SMALL_STEP_RATES + LARGE_STEP_RATES[:1], {'pd_scheme': 'start'}),
        ('bdf2', 'default', BDF2_RATES, {}),
        ('bdf2', 'residual 1e-5 m/s', BDF2_RATES, LOOSE_TOLERANCE),
        ('newton_dense', 'default', SLOW_METHOD_RATES, {}),
        ('gauss_seidel', 'default', SLOW_METHOD_RATES[:1], {}),
        ('gauss_seidel', 'residual 1e-5 m/s', SLOW_METHOD_RATES, LOOSE_TOLERANCE),
        ('paper', 'selection rule, 1e-7 N s', SLOW_METHOD_RATES, {}),
    ]
    variants += [
        (
            'paper',
            f'as printed, {eps:g} N s',
            SMALL_STEP_RATES[1:],
            {**PRINTED_SETTINGS, 'solver.tolerance': eps},
        )
        for eps in (1e-5, 1e-6, 1e-7, 1e-8)
    ]
    spatial = [
        Contender(method, setting, rates, run_stepper, settings={'method': method, **settings})
        for method, setting, rates, settings in variants
    ]
    printed = next(c for c in spatial if c.setting == 'as printed, 1e-08 N s')
    limit = ('as printed', replace(printed, rates=(4000, 8000)))
    return [
        *(replace(c, own_limit=limit) if 'as printed' in c.setting else c for c in spatial),
        *(
            replace(c, level='planar')
            for c in spatial
            if METHODS[c.method].planar and 'as printed' not in c.setting
        ),
    ]


def regularized() -> list[Contender]:
    """Return the baselines: penalty contact with fixed and adaptive steps, and the pyramid."""
    contenders = []
    for law, eps, k, rates in PENALTIES:
        penalty = Penalty(law=law, sliding_velocity=eps, stiffness=k)
        make = partial(make_semi_implicit, penalty=penalty)
        setting = f'{law} {eps:g} m/s, {k:.0e} N/m'
        run = partial(run_stepper, make=make)
        euler = Contender('semi_implicit_euler', setting, rates, run)
        limit = (setting, replace(euler, rates=(rates[0], 2 * rates[0])))
        contenders.append(replace(euler, own_limit=limit))
        contenders += [
            Contender(
                name.lower(), setting, INTEGRATOR_TOLERANCES,
                partial(integrate, penalty=penalty, integrator=name),
                own_limit=limit, adaptive=True,
            )
            for name in PENALTY_INTEGRATORS.get((law, eps, k), ())
        ]  # fmt: skip
    run = partial(run_stepper, make=make_pyramid)
    pyramid = Contender(
        'pyramid', 'residual 1e-5 m/s', SLOW_METHOD_RATES[:2], run, settings=LOOSE_TOLERANCE
    )
    limit = ('pyramid', replace(pyramid, rates=(2000, 4000)))
    return [*contenders, replace(pyramid, own_limit=limit)]


def mujoco() -> list[Contender]:
    """Return MuJoCo with different contact settings, drives and integrators."""
    contenders = []
    for contact, drive, integrator in (
        ('accurate', 'spring', 'discrete'),  # the first one is used for the runs over links
        ('accurate', 'position', 'implicitfast'),
        ('default', 'torque', 'Euler'),
        ('default', 'position', 'implicitfast'),
        ('default', 'spring', 'discrete'),
        ('fast', 'spring', 'discrete'),
    ):
        settings = MujocoSettings(contact=contact, drive=drive, integrator=integrator)
        run = partial(run_mujoco, settings=settings)
        setting = f'{contact}, {drive}, {integrator}'
        contender = Contender('mujoco', setting, MUJOCO_RATES, run)
        limit = (setting, replace(contender, rates=(4000, 8000)))
        contenders.append(replace(contender, own_limit=limit))
    return contenders
