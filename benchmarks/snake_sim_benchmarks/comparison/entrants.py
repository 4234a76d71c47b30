# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The entrants of ensembles and cycles: methods with their settings and steps a second.

Each is run in one compiled call, see `courses`. MuJoCo enters with the settings of its search and
with multiples of the steps a second for which they were found. Drake, whose friction is isotropic,
enters in cases B and C; its steps are the longest that it may take.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import zip_longest
from typing import Any

from snake_sim_benchmarks.comparison.contenders import LOOSE_TOLERANCE
from snake_sim_benchmarks.comparison.drake_runs import cenic_course, CenicSettings
from snake_sim_benchmarks.comparison.mujoco_model import MujocoSettings, searched_for
from snake_sim_benchmarks.comparison.mujoco_runs import rolled_course
from snake_sim_benchmarks.comparison.paths import compiled_course, Runner
from snake_sim_ros import Scene
from snake_sim_ros.scene.parameters import with_settings

# Steps a second.
SECOND_ORDER_RATES = (400, 200, 100, 70, 50, 40, 30, 20, 10)
FIRST_ORDER_RATES = (4000, 1000, 500, 200, 100)
DEFAULT_RATES = (500, 200, 60)  # of MuJoCo with its own contacts
MULTIPLES = (5.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.5)
MOST_STEPS = 2000  # a second, of MuJoCo
# Accuracy, contact stiffness [N/m] and dissipation [s/m], and steps a second at least: of CENIC.
CENIC = (
    (CenicSettings(1e-3), 10),
    (CenicSettings(1e-4), 10),
    (CenicSettings(1e-5), 10),
    (CenicSettings(1e-2, 1e6, 20.0), 50),
    (CenicSettings(1e-2, 3e6, 20.0), 50),
    (CenicSettings(1e-2, 1e7, 20.0), 100),
    (CenicSettings(0.0, 1e6, 20.0), 100),
)
JUDGED_METHODS = {'bdf2', 'newton', 'mujoco', 'drake'}
ISOTROPIC_CASES = ('lateral_undulation_isotropic', 'sidewinding')
QUICK_RATES = {'bdf2': (100, 50, 20), 'newton': (1000, 200)}
QUICK_MULTIPLES = (2.0, 1.0)
QUICK_SETTINGS = ('A 3 %', 'A 1 %', 'C 2 %', 'C 1 %', 'C 0.7 %', 'D 2 %', 'D 1 %')  # of MuJoCo


@dataclass(frozen=True)
class Entrant:
    """
    A method with its settings.

    Attributes
    ----------
    method : str
        Name of a method of `methods.METHODS`, or of a rival.
    setting : str
        Name of the setting, different for entrants of the same method.
    rates : tuple of float
        Steps a second.
    run : Runner
    settings : mapping
        Of the scene, such as ``{'method': 'bdf2'}``.
    level : str
        Level of the scene; ours enter with ``auto``, which users have. MuJoCo and Drake know none.

    """

    method: str
    setting: str
    rates: tuple[float, ...]
    run: Runner
    settings: Mapping[str, Any] = field(default_factory=dict)
    level: str = 'spatial'

    def scene(self, scene: Scene, dt: float) -> Scene:
        """Return a scene with the settings of this entrant and a time step [s]."""
        return with_settings(scene, {**self.settings, 'level': self.level, 'dt': dt})


def entrants(case: str, methods: Iterable[str], *, quick: bool) -> list[Entrant]:
    """
    Return the entrants of a case: of ours and of others in turns.

    Parameters
    ----------
    case : str
    methods : iterable of str
        Only these; empty for all.
    quick : bool
        Whether to take only a few settings and rates.

    """
    wanted = set(methods)
    drakes = drake() if case in ISOTROPIC_CASES and not quick else []
    groups = ours(quick=quick), [*mujoco(case, quick=quick), *drakes]
    turns = [entrant for pair in zip_longest(*groups) for entrant in pair if entrant]
    return [entrant for entrant in turns if entrant.method in wanted or not wanted]


def ours(*, quick: bool) -> list[Entrant]:
    """Return the methods of this package that are meant for use."""
    found = [
        Entrant('bdf2', 'residual 1e-5 m/s', SECOND_ORDER_RATES, compiled_course,
                {'method': 'bdf2', **LOOSE_TOLERANCE}, level='auto'),
        Entrant('newton', 'default', FIRST_ORDER_RATES, compiled_course, {'method': 'newton'},
                level='auto'),
    ]  # fmt: skip
    return [replace(each, rates=QUICK_RATES[each.method]) for each in found] if quick else found


def mujoco(case: str, *, quick: bool) -> list[Entrant]:
    """Return MuJoCo with the settings of its search, and with its own contacts."""
    found = []
    for name, searched in searched_for(case).items():
        run = partial(rolled_course, settings=MujocoSettings(contact=name))
        multiples = QUICK_MULTIPLES if quick else MULTIPLES
        rates = tuple(x * searched.rate for x in multiples if x * searched.rate <= MOST_STEPS)
        found.append(Entrant('mujoco', name, rates, run))
    if quick:
        return [entrant for entrant in found if entrant.setting in QUICK_SETTINGS]
    run = partial(rolled_course, settings=MujocoSettings(contact='default'))
    return [*found, Entrant('mujoco', 'default', DEFAULT_RATES, run)]


def drake() -> list[Entrant]:
    """Return Drake's CENIC over its accuracy, and with fixed steps."""
    found = []
    for settings, rate in CENIC:
        name = f'accuracy {settings.accuracy:g}' if settings.accuracy else 'fixed steps'
        if settings.stiffness:
            name += f', {settings.stiffness:.0e} N/m'
        run = partial(cenic_course, settings=settings)
        found.append(Entrant('drake', name, (rate,), run))
    return found


def attempts(found: Sequence[Entrant], rates: Sequence[float]) -> list[tuple[Entrant, float]]:
    """Return entrants with their rates, or with these rates if there are any, in turns."""
    lists = [[(entrant, rate) for rate in rates or entrant.rates] for entrant in found]
    return [item for turn in zip_longest(*lists) for item in turn if item]
