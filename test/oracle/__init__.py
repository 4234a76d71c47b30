# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The steps in dense NumPy, by which the compiled ones are judged; they are the definition to read.

- `moreau`: the time step of the paper as printed.
- `planar`: the same step for a robot that lies flat.
- `bdf2`: a step of method `bdf2`.

They take the records and constants of the package, but share no algebra with its compiled code. A
scene whose method is ORACLE takes one of the first two, that of its level, by the functions
`make_stepper` and `empty_history` here.
"""

from oracle.moreau import DenseStepper
from oracle.planar import DenseLoop
from snake_sim_ros import Scene
from snake_sim_ros.stepping import levels, methods
from snake_sim_ros.stepping.base import Method, Stepper
from snake_sim_ros.stepping.moreau import where_impulses_acted
from snake_sim_ros.stepping.planar.stepper import PlanarStepper
from snake_sim_ros.stepping.state import History

ORACLE = 'oracle'  # a method of a scene, for tests alone
METHOD = Method(
    spatial=DenseStepper,
    planar=lambda scene: PlanarStepper(scene, DenseLoop(scene)),
    where_impulses_acted=where_impulses_acted,
)


def make_stepper(scene: Scene) -> Stepper:
    """Return the stepper of a scene, as `methods.make_stepper` does; dense if ORACLE asks so."""
    if scene.method != ORACLE:
        return methods.make_stepper(scene)
    if scene.level == 'auto':
        return DenseStepper(scene)  # the planar level only where a scene asks for it
    return levels.stepper_of_level(scene, METHOD)


def empty_history(scene: Scene) -> History:
    """Return the history before the first step of a scene; see `base.Stepper`."""
    return make_stepper(scene).empty_history()
