# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Times of the stages of a step of method newton, from time stamps inside of real steps."""

import time

import numpy as np

from snake_sim_benchmarks.comparison.timing import tick_length
from snake_sim_ros.contact.newton import Newton, solve_contacts
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain, solve_chain
from snake_sim_ros.dynamics.compilation import compiled, cycle_counter
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.moreau import begin_step, end_step
from snake_sim_ros.stepping.planar import moreau as planar, solvers as planar_newton
from snake_sim_ros.stepping.planar.stepper import PlanarStepper
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.spatial import SpatialStepper
from snake_sim_ros.stepping.state import without_memory

STAGES = ('kinematics, control, contacts', 'contact laws and chain', 'end of step, drift')
CHAIN_SWEEP = 'one sweep over the chain'  # part of the second stage, about one per iteration
TIMED_STEPS = 1000


@compiled
def spatial_stages(model, work, steps, stamps):
    """Do what `moreau.advance` does, with a time stamp after every stage, and a sweep apart."""
    for k in range(len(steps.angle)):
        stamps[k, 0] = cycle_counter()
        problem = begin_step(model, work, steps, k)
        stamps[k, 1] = cycle_counter()
        outcome = solve_contacts(
            Newton(None), model, problem, steps.history, model.iteration_limit
        )
        stamps[k, 2] = cycle_counter()
        if not end_step(model, work, steps, problem, outcome):
            break
        stamps[k, 3] = cycle_counter()
        reset_chain(work.chain)
        factor_chain(work.chain)
        solve_chain(work.chain, work.chain.torque)
        stamps[k, 4] = cycle_counter()


@compiled
def planar_stages(model, work, steps, stamps):
    """Do what `moreau.advance` does, with a time stamp after every stage."""
    history = without_memory(steps.history)
    for k in range(len(steps.angle)):
        stamps[k, 0] = cycle_counter()
        count = planar.begin_planar_step(model, work, steps, k)
        stamps[k, 1] = cycle_counter()
        closed = work.closed[:count]
        outcome = planar_newton.solve_planar_contacts(
            planar_newton.PlanarNewton(None), model, work, closed, history, model.iteration_limit
        )
        stamps[k, 2] = cycle_counter()
        if not planar.end_planar_step(model, work, steps, count, outcome):
            break
        stamps[k, 3] = cycle_counter()
        stamps[k, 4] = stamps[k, 3]


def stage_times(scene: Scene, level: str) -> dict[str, float]:
    """
    Return the median time of every stage of a step, and at the spatial level of CHAIN_SWEEP [us].

    The median is that of TIMED_STEPS steps after the first second of the scene.

    Parameters
    ----------
    scene : Scene
    level : str
        `spatial` or `planar`.

    """
    stamps = np.zeros((TIMED_STEPS, 5), np.int64)
    stages = planar_stages if level == 'planar' else spatial_stages

    def loop(model, work, steps):  # type: ignore[no-untyped-def]
        stages(model, work, steps, stamps)

    make = PlanarStepper if level == 'planar' else SpatialStepper
    simulation = Simulation(scene, make(scene, loop))
    for steps in [TIMED_STEPS] * (round(1 / scene.dt / TIMED_STEPS) + 1):
        reference = simulation.gait_reference(steps)
        start = time.perf_counter(), cycle_counter()
        simulation.advance(*reference)
        wall, ticks = time.perf_counter() - start[0], cycle_counter() - start[1]
    medians = tick_length(wall, ticks) * np.median(np.diff(stamps, axis=1), axis=0)
    names = (*STAGES, CHAIN_SWEEP) if level == 'spatial' else STAGES
    return {name: float(median) for name, median in zip(names, medians, strict=False)}
