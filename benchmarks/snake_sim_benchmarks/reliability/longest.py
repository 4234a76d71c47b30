# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The longest step of very many, against the publish period in which `sim` has to take it.

The time of each step is that between two stamps of the processor's counter. A step that seems to
be the longest so far, or longer than the period, is taken again, `AGAIN` times from the same
state, and its least time counts: what else the machine did meanwhile does not. A friction of 5
jams; robots that curl up touch themselves in many places at once.
"""

from collections.abc import Iterator
import time
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.soak import EndlessRun
from snake_sim_benchmarks.reliability.trials import shares, Trial
from snake_sim_ros import Scene
from snake_sim_ros.nodes.diagnostics import step_times
from snake_sim_ros.scene.parameters import load_scene, with_settings

MOST_STEPS = 10**7
PERIOD = 5e-3  # of publishing at 200 Hz [s]
LONGEST = 1.0  # s, which no step may take
AGAIN = 2
CURLING: dict[str, Any] = {
    'self_contact': True,
    'gait.yaw.amplitude': 0.75,
    'gait.yaw.angular_frequency': 1.0,
    'gait.yaw.phase_lag': 0.05,
    'gait.soft_start': 1.0,
}
SUBJECTS: dict[str, dict[str, Any]] = {  # of scene lateral_undulation
    'lateral_undulation, newton': {'level': 'spatial'},
    'friction 5, newton': {'friction.longitudinal': 5.0, 'friction.transversal': 5.0},
    'curling, newton': CURLING,
    'curling, friction 1, newton': {**CURLING, 'self_contact_friction': 1.0},
    'curling, bdf2': {**CURLING, 'method': 'bdf2', 'dt': 1 / 400},
}


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Look for the longest step of each subject in its share of the time; the seed is not used."""
    for (name, settings), share in shares([*SUBJECTS.items()], seconds):
        scene = with_settings(load_scene('lateral_undulation'), settings)
        yield longest_step(name, scene, share)


def longest_step(name: str, scene: Scene, seconds: float) -> Trial:
    """Run a scene for some seconds, and return its longest step."""
    run = EndlessRun(scene)
    simulation, longest, when, late = run.simulation, 0.0, 0.0, 0
    simulation.compile()
    begin = time.perf_counter()
    while run.report.steps < MOST_STEPS and time.perf_counter() - begin < seconds:
        start, first = (simulation.state, simulation.history), simulation.step_count
        spent = run.advance(MOST_STEPS - run.report.steps)
        steps = run.latest.steps
        if run.report.failure or not steps:
            break
        times = step_times(simulation.stepper.cycles, steps, spent)
        if times.max() > min(longest, PERIOD):
            reference = simulation.gait.reference(first, steps)
            for _ in range(AGAIN):
                again = time.perf_counter()
                simulation.stepper.advance(*start, *reference)
                spent = time.perf_counter() - again
                times = np.minimum(times, step_times(simulation.stepper.cycles, steps, spent))
            if times.max() > longest:
                longest, when = float(times.max()), (first + int(times.argmax())) * scene.dt
        late += int((times > PERIOD).sum())
    report = run.report
    figures = (
        f'unconverged {report.unconverged}, most iterations {report.iterations_max}, '
        f'{1e6 * run.seconds / max(1, report.steps):.2f} us a step in the mean, longest at t = '
        f'{when:.6g} s, {late} steps longer than {1e3 * PERIOD:g} ms'
    )
    broken = [report.failure] if report.failure else []
    if longest > LONGEST:
        broken.append(f'the step at t = {when:.6g} s took {longest:.3g} s')
    return Trial(
        'longest', name, 'steps', report.steps, len(broken), time.perf_counter() - begin,
        longest=longest, figures=figures, first='; '.join(broken),
    )  # fmt: skip
