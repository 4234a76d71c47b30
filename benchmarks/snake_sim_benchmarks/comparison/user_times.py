# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The part `user` of the bench: what of the speed of the compiled loop is left for a user.

`run` takes turns with the compiled loop alone, which gets all references at once and keeps no
samples, and with a controller in Python that commands the gait at every sample. Its real-time
factor counts everything from the first step to the record. All times are wall times, the shortest
of some rounds.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
import math
import subprocess
import sys
import time

import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.bench_tables import (
    ADVANCE,
    CALL,
    COMMAND,
    CONTROLLED,
    LOOP,
    REFERENCE,
    RUN,
)
from snake_sim_ros import Scene, Simulation
from snake_sim_ros.controllers.controller import going_on, Reference
from snake_sim_ros.scene.parameters import samples_of
from snake_sim_ros.stepping.sampling import Command, Hooks, Keep
from snake_sim_ros.stepping.simulation import sample, simulate

USER_CASES = ('lateral_undulation', 'sidewinding')  # in the plane, and in space
METHODS_OF_USERS = (('newton', 1 / 4000), ('bdf2', 1 / 200))
ROUNDS = 7  # in turns; the shortest counts
RATE = 100.0  # samples a second [Hz]
SMALL_CALLS = 2000


def user(scenes: Mapping[str, Scene]) -> Iterator[Entry]:
    """Yield the times that a user sees, for those of the cases that are in USER_CASES."""
    for case in [case for case in USER_CASES if case in scenes]:
        scene = scenes[case]
        for method, dt in METHODS_OF_USERS:
            own = replace(scene, method=method, dt=dt)
            row = Row(
                part='user', case=case, method=method, level='auto', dt=dt,
                n=scene.robot.link_count, duration=scene.duration,
            )  # fmt: skip
            rows = tuple(
                replace(row, setting=name)
                for name in (LOOP, RUN, CALL, CONTROLLED, ADVANCE, REFERENCE)
            )
            yield Entry(rows, partial(_times, rows, own), 15.0)
        row = Row(part='user', case=case, method='bdf2', setting=COMMAND, duration=scene.duration)
        yield Entry((row,), partial(_command, row), 10.0)


def _times(rows: tuple[Row, ...], scene: Scene) -> list[Row]:
    """Return the rows of a scene: of whole runs, and of calls of one step each."""
    simulation = Simulation(scene)
    simulation.compile(scene.gait)
    reference = simulation.gait_reference(round(scene.duration / scene.dt))
    times: dict[str, list[float]] = {LOOP: [], RUN: [], CALL: [], CONTROLLED: []}
    for _ in range(ROUNDS):
        simulation.reset()
        begin = time.perf_counter()
        simulation.advance(*reference)
        times[LOOP].append(time.perf_counter() - begin)
        begin = time.perf_counter()
        times[RUN].append(simulate(scene, rate=RATE).seconds)
        times[CALL].append(time.perf_counter() - begin)
        times[CONTROLLED].append(_controlled(scene))
    small = _small_calls(scene)
    return [
        replace(row, status='converged', median_us=small[row.setting])
        if row.setting in small
        else replace(
            row,
            status='converged',
            seconds_per_second=min(times[row.setting]) / scene.duration,
        )
        for row in rows
    ]


def _controlled(scene: Scene) -> float:
    """Return the wall time of a run whose controller commands the gait of the scene [s]."""
    simulation = Simulation(scene)
    simulation.compile(scene.gait)

    def follow(simulation: Simulation) -> Reference:
        angle, rate = simulation.gait_reference(1)
        return going_on(simulation.midpoints(1)[0], angle[0], rate[0])

    steps, samples = samples_of(scene, RATE)
    keep = Keep(contacts=True)
    return sample(
        simulation, steps, samples, keep=keep, hooks=Hooks(Command(follow, steps))
    ).seconds


def _small_calls(scene: Scene) -> dict[str, float]:
    """Return the median time of calls of one step each [us]."""
    simulation = Simulation(scene)
    angle, rate = simulation.gait_reference(SMALL_CALLS)
    times: dict[str, list[float]] = {ADVANCE: [], REFERENCE: []}
    for k in range(SMALL_CALLS):
        begin = time.perf_counter()
        simulation.advance(angle[k : k + 1], rate[k : k + 1])
        middle = time.perf_counter()
        simulation.gait_reference(1)
        times[ADVANCE].append(middle - begin)
        times[REFERENCE].append(time.perf_counter() - middle)
    return {name: 1e6 * float(np.median(values)) for name, values in times.items()}


def _command(row: Row) -> list[Row]:
    """Return the row of the command with its wall time from the shell, the shortest of some."""
    command = [sys.executable, '-m', 'snake_sim_ros.commands', 'run', row.case]
    shortest = math.inf
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True)
        shortest = min(shortest, time.perf_counter() - begin)
    return [replace(row, seconds=shortest, status='converged')]
