# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What robots in the lanes of one register would gain, for the page on learning.

Robots in the lanes of a register take the same instructions. Two measurements bound what that
gains over one robot after the other:

- Sweeps over the chain, of which an iteration is made, and inertias of links, as an example of the
  rest, are compiled from the same source for packs of numbers, one of each robot. Their results
  have the same bits. For one robot, sweeps pack numbers of a link.
- Robots wait for each other. In a step of all, iterations and parts are those of the robot that
  has most.

In the same run, each method stands beside `mujoco.rollout` at the error that it makes.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
import operator
import time
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model
from numba.np.arrayobj import populate_array
import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_benchmarks.comparison.bench_tables import (
    cost_at,
    of_step,
    percent,
    point,
    sides,
    speed,
)
from snake_sim_benchmarks.comparison.contenders import LOOSE_TOLERANCE
from snake_sim_benchmarks.comparison.ensembles import entered_rows, family, spread_rows, trial_of
from snake_sim_benchmarks.comparison.entrants import attempts, Entrant, mujoco
from snake_sim_benchmarks.comparison.paths import compiled_course, ConvergedPaths
from snake_sim_benchmarks.comparison.timing import REFERENCE_STEPS
from snake_sim_ros import Simulation
from snake_sim_ros.dynamics.articulated_body import Chain, factor_chain, reset_chain, solve_chain
from snake_sim_ros.dynamics.balance import link_inertia
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.mechanism import Mechanism
from snake_sim_ros.scene.parameters import Array, load_scene, Scene, with_settings
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.model import make_model

CASES = 'lateral_undulation', 'sidewinding', 'sinus_lifting'
OURS = (
    Entrant('newton', 'default', (1000,), compiled_course, {'method': 'newton'}),
    Entrant('bdf2', 'default', (50, 20), compiled_course, {'method': 'bdf2', **LOOSE_TOLERANCE}),
)
LANES = 4  # numbers of a register with AVX2, and robots that step together
ROBOTS = 16
ITERATING = 0.5  # share of a step that is iterations; 0.4 to 0.6 in these cases
BEGIN, TIME = 6.0, 10.0  # after the soft start, steps are counted for TIME [s]
REPEATED, TURNS = 3000, 60

# ---- packs in arrays ----------------------------------------------------------------------------


class LanesType(types.Type):  # type: ignore[misc]
    """The type of a number of each robot, to which a number of all robots converts."""

    def __init__(self) -> None:
        super().__init__(f'{__name__}.Lanes{LANES}')

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """Return how a number becomes one of each robot, see `numba.core.types.Type`."""
        return Conversion.safe if isinstance(other, types.Float) else None


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.DoubleType(), LANES))


OPERATIONS = {
    operator.neg: 'fneg',
    operator.add: 'fadd', operator.iadd: 'fadd', operator.sub: 'fsub', operator.isub: 'fsub',
    operator.mul: 'fmul', operator.imul: 'fmul', operator.truediv: 'fdiv',
}  # fmt: skip


@lower_cast(types.Float, LanesType)  # type: ignore[untyped-decorator]
def _of_all(context: Any, builder: Any, kind: Any, to: Any, number: Any) -> Any:
    vector = cgutils.get_null_value(context.get_value_type(to))
    for k in range(LANES):
        vector = builder.insert_element(vector, number, context.get_constant(types.int32, k))
    return vector


def _define(symbol: Any, name: str) -> None:
    """Define an operation on numbers of each robot."""

    class Operation(AbstractTemplate):  # type: ignore[misc]
        def generic(self, arguments: Any, keywords: Any) -> Any:
            found = [kind for kind in arguments if isinstance(kind, LanesType)]
            return signature(found[0], *[found[0]] * len(arguments)) if found else None

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, name)(*arguments)

    infer_global(symbol)(Operation)
    lower_builtin(symbol, *[LanesType] * (1 if name == 'fneg' else 2))(lower)


for _symbol, _name in OPERATIONS.items():
    _define(_symbol, _name)


@intrinsic  # type: ignore[untyped-decorator]
def in_lanes(context: Any, numbers: Any) -> Any:
    """Return an array (..., LANES) as an array (...) of numbers of each robot."""
    lanes = LanesType()
    kind = types.Array(lanes, numbers.ndim - 1, 'C', aligned=False)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = context.make_array(numbers)(context, builder, arguments[0])
        made = context.make_array(kind)(context, builder)
        pointer = context.get_data_type(lanes).as_pointer()
        populate_array(
            made,
            data=builder.bitcast(given.data, pointer),
            shape=cgutils.unpack_tuple(builder, given.shape)[:-1],
            strides=cgutils.unpack_tuple(builder, given.strides)[:-1],
            itemsize=context.get_constant(types.intp, 8 * LANES),
            meminfo=None,
        )
        return made._getvalue()

    return kind(numbers), generate


# ---- the same work for one robot and for several ------------------------------------------------


@compiled
def sweep(chain: Chain, times: int) -> None:
    """Solve a chain, with all its links anew, a number of times."""
    for _ in range(times):
        reset_chain(chain)
        factor_chain(chain)
        solve_chain(chain, chain.torque)


@compiled
def sweep_together(chains: Chain, times: int) -> None:
    """Do what `sweep` does for chains whose arrays are those of LANES robots side by side."""
    c = chains
    together = Chain(
        c.places, in_lanes(c.axis), in_lanes(c.torque), in_lanes(c.damping), in_lanes(c.bare),
        in_lanes(c.momentum), in_lanes(c.inertia), in_lanes(c.wrench), in_lanes(c.left),
        in_lanes(c.right), in_lanes(c.compliance), in_lanes(c.load), in_lanes(c.rate),
        in_lanes(c.rate_correction), in_lanes(c.residual_torque), in_lanes(c.twist),
        in_lanes(c.correction), c.frame, c.free,
    )  # fmt: skip
    sweep(together, times)


@compiled
def inertias(robot: Mechanism, R: Array, center: Array, inertia: Array, times: int) -> None:
    """Fill the inertias of all links a number of times."""
    for _ in range(times):
        link_inertia(robot, R, center, inertia)


@compiled
def inertias_together(
    robot: Mechanism, R: Array, center: Array, inertia: Array, times: int
) -> None:
    """Do what `inertias` does for arrays of LANES robots side by side."""
    inertias(robot, in_lanes(R), in_lanes(center), in_lanes(inertia), times)


def chain_of(scene: Scene) -> Chain:
    """Return the chain of a robot after some steps of the scene."""
    stepper = METHODS[scene.method].spatial(scene)
    simulation = Simulation(scene, stepper)
    simulation.advance(*simulation.gait_reference(100))
    chain = stepper.work.chain
    assert isinstance(chain, Chain)
    return chain


def side_by_side(chains: list[Chain]) -> Chain:
    """Return a chain whose arrays have those of some robots in their last axis."""
    first: Any = chains[0]
    fields = {
        name: np.ascontiguousarray(np.stack([getattr(chain, name) for chain in chains], -1))
        for name in Chain._fields
        if name not in ('places', 'frame', 'free')
    }
    found: Chain = first._replace(**fields)
    return found


Call = Callable[[int], object]


def gain_of(alone: Call, together: Call) -> float:
    """Return what `together` does for LANES robots in a time over what `alone` does for one."""
    times: dict[Call, float] = {}
    for _ in range(TURNS):
        for call in (alone, together):
            begin = time.process_time()
            call(REPEATED)
            times[call] = min(times.get(call, np.inf), time.process_time() - begin)
    return LANES * times[alone] / times[together]


def gains() -> tuple[float, float]:
    """Return the gains of sweeps and of inertias, whose results must be equal to the bit."""
    scene = with_settings(load_scene('sidewinding'), {'method': 'newton', 'level': 'spatial'})
    chains = [chain_of(other) for other in family(scene, LANES)]
    together = side_by_side(chains)
    sweep_together(together, 1)
    for chain, twist in zip(chains, np.moveaxis(together.twist, -1, 0), strict=True):
        sweep(chain, 1)
        assert (chain.twist == twist).all(), 'results differ'
    of_sweeps = gain_of(partial(sweep, chains[0]), partial(sweep_together, together))
    robot, n = make_model(scene).robot, scene.robot.link_count
    draws = np.random.default_rng(1)
    R, center = draws.normal(size=(n, 3, 3, LANES)), draws.normal(size=(n, 3, LANES))
    found, one = np.zeros((n, 6, 6, LANES)), np.zeros((n, 6, 6))
    inertias_together(robot, R, center, found, 1)
    first = np.ascontiguousarray(R[..., 0]), np.ascontiguousarray(center[..., 0])
    inertias(robot, *first, one, 1)
    assert (one == found[..., 0]).all(), 'results differ'
    return of_sweeps, gain_of(
        partial(inertias, robot, *first, one),
        partial(inertias_together, robot, R, center, found),
    )


# ---- robots that wait for each other ------------------------------------------------------------


def counts_of(scene: Scene) -> Array:
    """Return iterations and parts of the steps of perturbed scenes, (2, ROBOTS, steps)."""
    first, steps = round(BEGIN / scene.dt), round(TIME / scene.dt)
    found = np.zeros((2, ROBOTS, steps))
    for robot, other in enumerate(family(scene, ROBOTS)):
        simulation = Simulation(other)
        angle, rate = simulation.gait_reference(first + steps)
        simulation.advance(angle[:first], rate[:first])
        for k in range(steps):
            now = slice(first + k, first + k + 1)
            report = simulation.advance(angle[now], rate[now])
            found[:, robot, k] = report.iterations, 1 + report.further_parts
    return found


def kept_share(counts: Array, lanes: int = LANES) -> float:
    """Return the mean of counts over that of the largest among as many robots as lanes."""
    together = counts.reshape(-1, lanes, counts.shape[-1]).max(axis=1)
    return float(counts.mean() / together.mean())


def gain_at_most(counts: Array, of_sweeps: float, of_rest: float) -> float:
    """Return the gain of robots that wait for each other, from `counts_of` and `gains`."""
    iterations, parts = (kept_share(values) for values in counts)
    return 1.0 / (ITERATING / (of_sweeps * iterations) + (1.0 - ITERATING) / (of_rest * parts))


# ---- beside MuJoCo ------------------------------------------------------------------------------


def speeds(name: str, paths: ConvergedPaths) -> tuple[list[Row], list[Row]]:
    """Return the rows of OURS and of MuJoCo: errors and times in the same perturbed scenes."""
    scene = load_scene(name)
    field = attempts([*OURS, *mujoco(name, quick=False)], ())
    entered = list(entered_rows('ensemble', name, scene, field))
    rows = spread_rows(entered, (trial_of(each, paths) for each in family(scene, ROBOTS)))
    return sides(rows, 'ensemble', name)


def main() -> None:
    """Print the tables of the page on learning."""
    of_sweeps, of_rest = gains()
    print(
        f'{LANES} robots at once: {of_sweeps:.2f} times the sweeps, {of_rest:.2f} the inertias\n'
    )
    print('| case | method | iterations, largest of 4 | parts, largest of 4 | gain at most |')
    print('|---|---|---|---|---|')
    at_most = {}
    for name in CASES:
        for entrant, rate in attempts(OURS, ()):
            scene = entrant.scene(load_scene(name), 1 / rate)
            counts = counts_of(scene)
            gain = at_most[name, scene.method, scene.dt] = gain_at_most(counts, of_sweeps, of_rest)
            shown = ' | '.join(
                f'{values.mean():.2f}, {values.mean() / kept_share(values):.2f}'
                for values in counts
            )
            print(f'| `{name}` | `{scene.method}`, 1/{rate:g} s | {shown} | {gain:.1f} |')
    print('\n| case | method | RMS error | alone | in lanes, at most | MuJoCo | ratios |')
    print('|---|---|---|---|---|---|---|')
    paths = ConvergedPaths(REFERENCE_STEPS)
    for name in CASES:
        ours, others = speeds(name, paths)
        for row in ours:
            cost, gain = row.seconds_per_second, at_most[name, row.method, row.dt]
            rival = cost_at(map(point, others), row.error_rms)
            ratios = '' if np.isnan(rival) else f'{rival / cost:.1f}, {gain * rival / cost:.1f}'
            cells = [
                f'`{name}`', of_step(row), percent(row.error_rms), speed(cost),
                speed(cost / gain), speed(rival), ratios,
            ]  # fmt: skip
            print(f'| {" | ".join(cells)} |')


if __name__ == '__main__':
    # Compiled code is kept on disk with its types, which are those of the module of this name.
    import_module('snake_sim_benchmarks.lanes').main()
