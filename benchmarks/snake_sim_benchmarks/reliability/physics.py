# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Random physics: scenes of `random_scenes`, judged by `invariants`, and the least that fails.

Every case is run twice, in other portions, and must end with the same bits. Steps that do not
converge are counted; the laws of contacts are then not judged. A case that breaks an invariant is
made smaller as long as it breaks the same one.
"""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
import time
from typing import Any

import numpy as np
import yaml

from snake_sim_benchmarks.reliability.invariants import of_run, of_step, passive_energy
from snake_sim_benchmarks.reliability.random_scenes import (
    Case,
    FLAT,
    OBSTACLES,
    random_case,
    scene_of,
    start_of,
)
from snake_sim_benchmarks.reliability.trials import Trial
from snake_sim_ros import ParameterError, Simulation, State
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.stepping.samples import make_samples, Samples

Kind = tuple[str, str]  # surroundings and method
METHODS = ('newton', 'bdf2')
KINDS = [(surroundings, method) for surroundings in (FLAT, OBSTACLES) for method in METHODS]
FEW_KINDS, SHORT = 2, 120.0  # these kinds only, if an attack takes less than so many seconds
JUDGED = 3  # steps of a run that are judged one by one
LONGEST_STEP = 1.0  # s; 5000 iterations of 11 links that touch each other take a fifth of it
PASSIVE_ENERGY = 2.0  # most energy of a robot that nothing drives, over that at its start
SMALL_TURN = 0.2  # of a link in a step, with all energy in it, up to which that is judged [rad]
SMALLER = 20.0  # s in which a case is made smaller


@dataclass
class Outcome:
    """What a case came to: the invariants that broke, and what is counted."""

    broken: list[str] = field(default_factory=list)
    steps: int = 0
    unconverged: int = 0
    diverged: int = 0  # runs that a divergence ended
    overflows: int = 0  # steps with more contacts than a world may have
    deepest: float = 0.0  # penetration [m]
    longest: float = 0.0  # time of a step, in the mean of a part of the run [s]


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Attack every kind of scene for its share of the time."""
    kinds = KINDS[:FEW_KINDS] if seconds < SHORT else KINDS
    for number, kind in enumerate(kinds):
        yield attack('physics', kind, seconds / len(kinds), (seed, number))


def attack(part: str, kind: Kind, seconds: float, seed: tuple[int, int]) -> Trial:
    """Attack scenes of a kind for some seconds, as a part of `fuzz`; see `random_case`."""
    surroundings, method = kind
    warm_up(kind)
    begin, tried, refused, total, broken = time.perf_counter(), 0, 0, Outcome(), list[str]()
    smallest, count = '', 0
    while time.perf_counter() - begin < seconds:
        case = random_case(np.random.default_rng((*seed, count)), surroundings, method)
        count += 1
        try:
            found = judged(case)
        except ParameterError:
            refused += 1
            continue
        tried += 1
        total.steps += found.steps
        total.unconverged += found.unconverged
        total.diverged += found.diverged
        total.overflows += found.overflows
        total.deepest = max(total.deepest, found.deepest)
        total.longest = max(total.longest, found.longest)
        broken += found.broken[:1]
        if found.broken and not smallest:
            least = smaller(case)
            smallest = f'{judged(least).broken[0]}; {as_text(least)}'
    names = sorted({sentence.partition(':')[0] for sentence in broken})
    figures = (
        f'{tried / seconds:.0f} scenes a second, {total.steps} steps, unconverged '
        f'{total.unconverged}, runs that ended early {total.diverged}, refused {refused}, '
        f'overflows {total.overflows}, penetration {total.deepest:.2g} m at most'
    )
    return Trial(
        part, f'{surroundings}, {method}', 'scenes', tried, len(broken),
        time.perf_counter() - begin, longest=total.longest, figures=figures,
        first=f'{", ".join(names)}: {smallest}' if smallest else '',
    )  # fmt: skip


def warm_up(kind: Kind) -> None:
    """Compile what a kind of scene needs."""
    for number in range(10):
        try:
            case = random_case(np.random.default_rng(number), *kind)
            Simulation(scene_of(case)).compile()
            judged(case)
            return
        except ParameterError:
            continue


def judged(case: Case) -> Outcome:
    """
    Run a case and judge it.

    Raises
    ------
    ParameterError
        If the program refuses it.

    """
    outcome = Outcome()
    try:
        scene = scene_of(case)
        simulation, again = Simulation(scene), Simulation(scene)
        simulation.state = again.state = start_of(case, scene)
        _run(case, simulation, outcome)
        _repeat(case, again)
    except ParameterError as error:
        if 'must be finite' not in str(error):
            raise
        outcome.broken.append(f'finite: {error}')
        return outcome
    except Exception as error:  # whatever it is, it is no answer
        outcome.broken.append(f'error: {type(error).__name__}: {error}')
        return outcome
    same = all(
        np.array_equal(one, other, equal_nan=True)
        for one, other in (
            (simulation.state.q, again.state.q),
            (simulation.state.u, again.state.u),
            (simulation.history.impulse, again.history.impulse),
        )
    )
    if not same or simulation.report.steps != again.report.steps:
        outcome.broken.append('determinism: other portions of the same run have other bits')
    return outcome


def _happen(part: dict[str, Any], simulation: Simulation) -> None:
    """Push the robot, or change its scene, as a part of a case says."""
    if 'push' in part:
        link, *impulse = part['push']
        simulation.push(link, impulse)
    if 'change' in part:
        simulation.change(with_settings(simulation.scene, part['change']))


def _run(case: Case, simulation: Simulation, outcome: Outcome) -> None:
    """Run all parts of a case, and note what is wrong."""
    depth = 0.0
    for part in case['parts']:
        _happen(part, simulation)
        steps, before = part['steps'], simulation.state
        samples = make_samples(simulation.scene, 1, steps)
        reference = simulation.gait_reference(steps)
        begin, compiled = time.perf_counter(), simulation.compile_seconds
        report = simulation.advance(*reference, samples)
        seconds = time.perf_counter() - begin - (simulation.compile_seconds - compiled)
        outcome.longest = max(outcome.longest, seconds / max(1, report.steps))
        outcome.steps += report.steps
        outcome.unconverged += report.unconverged
        outcome.overflows += report.overflows
        samples = samples.until(report.steps)
        scene = simulation.scene
        outcome.broken += of_run(scene, before, samples, report, depth + 2e-3)
        if seconds / steps > LONGEST_STEP:
            outcome.broken.append(f'time: {steps} steps took {seconds:.3g} s')
        is_spatial = report.planar_steps == 0 and scene.method != 'bdf2'
        if is_spatial and len(samples.q):
            converged = report.unconverged == 0
            outcome.broken += _of_steps(simulation, before, samples, converged=converged)
        outcome.deepest = depth = max(depth, report.penetration_max)
        outcome.broken += _of_energy(simulation, before, reference[0], depth)
        if report.failure:
            outcome.diverged = 1
            return


def _of_steps(
    simulation: Simulation, before: State, samples: Samples, *, converged: bool
) -> Iterator[str]:
    """Judge some steps of a part, the first and the last among them."""
    count = len(samples.q)
    for k in sorted({*np.linspace(0, count - 1, JUDGED).astype(int)}):
        start = before if k == 0 else State(samples.q[k - 1], samples.u[k - 1])
        end = State(samples.q[k], samples.u[k])
        yield from of_step(
            simulation.scene, start, end, samples.torque[k], samples.impulse[k],
            converged=converged,
        )  # fmt: skip


def _of_energy(simulation: Simulation, before: State, angle: Any, depth: float) -> Iterator[str]:
    """
    Judge the energy of a robot that nothing drives, on a floor below it.

    It is above that of the lowest configuration, of contacts that are at the largest depth so far.

    Implicit controllers only take energy, but for what springs store less or more of as a step
    turns links by an angle that is not small, or as torques are limited.
    """
    scene, robot = simulation.scene, simulation.scene.robot
    gx, gy, gz = scene.gravity
    drives = scene.gait.yaw.amplitude != 0.0 or scene.gait.pitch.amplitude != 0.0
    explicit = scene.pd_scheme in ('start', 'midpoint')
    limited = np.isfinite(robot.per_joint('torque_limit')).any()
    if drives or explicit or limited or gx != 0.0 or gy != 0.0 or gz > 0.0 or scene.ground.heights:
        return
    depth = max(depth, -float(gaps(robot, before.q).min()))
    first, last = (passive_energy(scene, s, angle[0], depth) for s in (before, simulation.state))
    inertia = min(
        robot.per_link('inertia_transversal').min(), robot.per_link('inertia_axial').min()
    )
    if scene.dt * np.sqrt(2.0 * max(first, 0.0) / inertia) > SMALL_TURN:
        return
    if last > PASSIVE_ENERGY * first + 1e-6:
        yield f'energy: {last:.6g} J of a robot that nothing drives, {first:.6g} J before'


def _repeat(case: Case, simulation: Simulation) -> None:
    """Run a case in other portions: single steps, then some, then the rest."""
    for part in case['parts']:
        _happen(part, simulation)
        left = part['steps']
        for portion in (1, 1, 1, 5, left):
            count = min(portion, left)
            if count and not simulation.report.failure:
                simulation.advance(*simulation.gait_reference(count))
                left -= count
        if simulation.report.failure:
            return


def smaller(case: Case) -> Case:
    """Return a case with less in it that breaks the same invariant."""
    name, end = _first_broken(case), time.perf_counter() + SMALLER
    changed = True
    while changed:
        changed = False
        for candidate in _with_less(case):
            if time.perf_counter() > end:
                return case
            if _first_broken(candidate) == name:
                case, changed = candidate, True
                break
    return case


def _first_broken(case: Case) -> str:
    """Return the name of the first invariant that a case breaks, or nothing."""
    try:
        broken = judged(case).broken
    except ParameterError:
        return ''
    return broken[0].partition(':')[0] if broken else ''


def _with_less(case: Case) -> Iterator[Case]:
    """Yield cases with one thing less."""
    for k in range(len(case['parts']) - 1, -1, -1):
        if len(case['parts']) > 1:
            yield _without(case, ('parts', k))
        for key in ('push', 'change'):
            if key in case['parts'][k]:
                yield _without(case, ('parts', k, key))
        steps = case['parts'][k]['steps']
        for fewer in {1, steps // 2, steps - 1} - {0, steps}:
            found = deepcopy(case)
            found['parts'][k]['steps'] = fewer
            yield found
    for key in case['start']:
        yield _without(case, ('start', key))
    for key, value in case['scene'].items():
        yield _without(case, ('scene', key))
        for name in value if isinstance(value, dict) else ():
            yield _without(case, ('scene', key, name))


def _without(case: Case, path: tuple[Any, ...]) -> Case:
    found: Any = deepcopy(case)
    place = found
    for key in path[:-1]:
        place = place[key]
    del place[path[-1]]
    return dict(found)


def as_text(case: Case) -> str:
    """Return a case in a line of YAML."""
    return str(yaml.safe_dump(case, default_flow_style=True, width=10**9, sort_keys=False)).strip()
