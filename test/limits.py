# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random scenes with events, the same for all methods: pushes, landings, stops, hits of pegs."""

from dataclasses import replace

import numpy as np
from oracle import make_stepper, ORACLE
from scenes import references

from snake_sim_ros import Friction, Gait, Pegs, Robot, Scene, Solver, State, Wave
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping import simulation

TIME = 0.3  # s
KINDS = ('push', 'landing', 'stop', 'peg', 'push and landing')
SEEDS = (0, 25, 30, 16, 31, 36, 2, 7, 12, 18, 23, 33, 4, 14, 24)  # three of each kind
WITHOUT_PEGS = [seed for seed in SEEDS if KINDS[seed % len(KINDS)] != 'peg']


def eventful(seed: int) -> tuple[Scene, State, tuple[int, Array]]:
    """
    Return a scene of 2 to 4 links that crawl, how it starts, and a push after a third of the time.

    Returns
    -------
    scene : Scene
    state : State
    push : tuple of int, ndarray
        Link, and impulse [N s], or none.

    """
    rng, kind = np.random.default_rng([seed, 15]), KINDS[seed % len(KINDS)]
    n = int(rng.integers(2, 5))
    wave = Wave(
        amplitude=rng.uniform(0.2, 0.5), angular_frequency=rng.uniform(3.0, 8.0),
        phase_lag=rng.uniform(-1.0, -0.5), offset=rng.uniform(-0.3, 0.3),
    )  # fmt: skip
    along, across = rng.uniform(0.1, 0.3), rng.uniform(0.3, 0.6)
    scene = Scene(
        robot=Robot(link_count=n),
        friction=Friction(longitudinal=along, transversal=across),
        gait=Gait(yaw=wave, soft_start=0.1),
        level='spatial',
        duration=TIME,
    )
    if kind == 'peg':
        # Beside a link that moves toward it.
        scene = replace(scene, friction=Friction(longitudinal=along / 5, transversal=across / 5))
    state = simulation.initial_state(scene)
    # Sliding as a whole; friction stops it within the time where it is told to.
    fast = {'stop': 0.5, 'peg': 0.3}.get(kind, 0.1)
    direction = rng.uniform(0.3, 1.2)
    state.u[:, 0], state.u[:, 1] = fast * np.cos(direction), fast * np.sin(direction)
    if kind == 'peg':
        end = state.q[int(rng.integers(n)), :2]
        radius = rng.uniform(0.02, 0.04)
        reach = radius + 0.0525 + rng.uniform(0.008, 0.02)
        scene = replace(
            scene, pegs=Pegs(x=(float(end[0]),), y=(float(end[1] + reach),), radius=radius)
        )
    if 'landing' in kind:
        state.q[:, 2] += rng.uniform(2e-3, 1e-2)
    impulse = rng.uniform(-0.3, 0.3, 3) * [1.0, 1.0, 0.0] if 'push' in kind else np.zeros(3)
    return scene, state, (int(rng.integers(n)), impulse)


def path(
    seed: int, method: str, frequency: int, perturbed: float = 0.0, time: float = TIME,
    solver: Solver | None = None,
) -> tuple[Array, int]:  # fmt: skip
    """
    Return link centers at two thirds of a time and its end (2, n, 3), and unconverged steps.

    Parameters
    ----------
    seed : int
        Of `eventful`.
    method : str
    frequency : int
        Steps a second.
    perturbed : float, optional
        Added to the velocities along x and y at the start [m/s].
    time : float, optional
        [s]
    solver : Solver, optional
        In place of that of the scene.

    """
    scene, state, (link, impulse) = eventful(seed)
    scene = replace(scene, method=method, dt=1 / frequency, solver=solver or scene.solver)
    run = simulation.Simulation(scene, make_stepper(scene) if method == ORACLE else None)
    u = state.u.copy()
    u[:, :2] += perturbed
    run.state = State(state.q, u)
    total = round(time * frequency)
    angle, rate = references(scene, total)
    parts = [0, total // 3, 2 * total // 3, total]
    places = []
    for k in range(3):
        report = run.advance(angle[parts[k] : parts[k + 1]], rate[parts[k] : parts[k + 1]])
        assert not report.failure
        if k == 0 and impulse.any():
            run.push(link, impulse)
        places.append(run.state.q[:, :3])
    return np.array(places[1:]), run.report.unconverged
