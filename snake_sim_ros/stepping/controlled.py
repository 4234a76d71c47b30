# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of a scene whose joints are commanded by a function in Python, called at every sample."""

from collections.abc import Callable
import time

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.contact_forces import last_span
from snake_sim_ros.stepping.sampling import begun_samples, Keep, trajectory_of
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.trajectory import Trajectory

# Steps between two samples that are taken one by one, in place. More of them are one call, which
# takes as long as some 20 of these to begin.
MOST_SINGLE = 20


def controlled(
    simulation: Simulation, steps: int, samples: int,
    controller: Callable[[Simulation], tuple[Array, Array]], *, keep: Keep,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:  # fmt: skip
    """
    Advance a simulation with a controller, and return samples of its motion.

    Parameters
    ----------
    simulation : Simulation
        Its present state is the first sample.
    steps : int
        Number of steps between two samples.
    samples : int
        Number of samples after the first one; fewer if a step diverges.
    controller : callable
        ``controller(simulation)`` is called at every sample but the last, and returns joint angles
        [rad] and rates [rad/s] of shape (n-1, 2), which hold until the next sample.
    keep : Keep
    progress : callable, optional
        Called with the simulated time that has passed [s] at every sample.

    """
    scene, begin = simulation.scene, time.perf_counter()
    last = simulation.state, simulation.history, simulation.last
    found, start = begun_samples(scene, *last, steps, samples), simulation.step_count
    single = steps <= MOST_SINGLE
    held = np.zeros((2, 1 if single else steps, scene.robot.link_count - 1, 2))
    for row in range(1, samples + 1):
        held[0], held[1] = controller(simulation)
        if single:
            for _ in range(steps):
                simulation.advance(held[0], held[1])
        else:
            simulation.advance(held[0], held[1], found.after((row - 1) * steps))
        if simulation.report.failure:
            break
        if single:
            history, torque = simulation.present_history, simulation.last.joint_torque
            span = last_span(scene, history)
            found.add(row * steps - 1, simulation.state, history, torque, span)
            found.is_planar[row] = simulation.last.level == 'planar'
        if progress:
            progress(row * steps * scene.dt)
    return trajectory_of(
        scene, found.until(simulation.step_count - start), keep, simulation.report,
        time.perf_counter() - begin, interrupted=False,
    )  # fmt: skip
