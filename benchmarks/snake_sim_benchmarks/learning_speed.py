# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How many steps a second environments take, and with what error, for the page on learning.

Snakes of a vector environment step on one thread, with the steps of the physics that the task has
by default. Actions are those of the gait of the scene; these and smooth random ones, sine waves of
0.3 of the largest values with random frequencies up to 0.3 Hz and phases; or such waves alone, of
the largest values. The error is the distance of the snakes from where steps of 1/8000 s of
`newton` take them, over the way from their start, both rms over the snakes. The same for steps of
1/4000 s shows how much motions depend on any error. Environments of Gymnasium on MuJoCo step one
by one, as they come.
"""

from collections.abc import Callable
import time
from typing import Any

import gymnasium
import numpy as np

from snake_sim_ros.learning.actions import Angles, GaitParameters, Residuals
from snake_sim_ros.learning.vector import SnakeVectorEnv
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array

NAMES = 'Forward-v0', 'Goal-v0', 'Path-v0', 'Pegs-v0', 'Sidewinding-v0', 'Stairs-v0'
SNAKES, STEPS, TURNS = 64, 100, 3  # of a vector, and how often it steps in each turn
JUDGED, LENGTH = 16, 100  # snakes and actions for the error, 4 s
FINE, LESS_FINE = 1 / 8000, 1 / 4000  # [s]
NEAR = 0.3  # of the largest values, for actions near those of the gait
FASTEST = 0.3  # frequency of random actions at most [Hz]
OF_MUJOCO = 'Swimmer-v5', 'Ant-v5'

Motion = Callable[[float], Array]  # actions (count, k), -1 to 1, at a time [s]


def made(name: str, count: int, **settings: Any) -> SnakeVectorEnv:
    """Return a vector environment, which the package registers when it is imported."""
    found = gymnasium.make_vec(
        f'snake_sim_ros.learning:snake_sim_ros/{name}', num_envs=count,
        vectorization_mode='vector_entry_point', **settings,
    )  # fmt: skip
    assert isinstance(found, SnakeVectorEnv)
    return found


def of_gait(env: SnakeVectorEnv) -> Motion:
    """Return the actions that move all snakes by the gait of their scene."""
    actions, scene = env.snakes.actions, env.snakes.base
    count, period = env.num_envs, env.snakes.period

    def physical(t: float) -> Array:
        if isinstance(actions, Residuals):
            return np.zeros(len(actions.low))
        if isinstance(actions, Angles):
            joints = scene.robot.link_count - 1
            angle = gait.reference(scene.gait, np.array([t + period]), joints)[0][0]
            return np.asarray(actions.signs * angle.reshape(-1)[actions.places])
        assert isinstance(actions, GaitParameters)
        yaw, pitch = scene.gait.yaw, scene.gait.pitch
        parts = [yaw.amplitude, yaw.angular_frequency, yaw.phase_lag, yaw.offset]
        if actions.has_pitch:
            shift = np.remainder(pitch.phase - yaw.phase + np.pi, 2 * np.pi) - np.pi
            parts += [pitch.amplitude, shift]
        return np.array(parts)

    def motion(t: float) -> Array:
        share = 2.0 * (physical(t) - actions.low) / (actions.high - actions.low) - 1.0
        return np.tile(share, (count, 1))

    return motion


def smooth(env: SnakeVectorEnv) -> Motion:
    """Return random actions that change slowly, others for each snake."""
    draws = np.random.default_rng(1)
    shape = env.num_envs, len(env.snakes.actions.low)
    frequency, phase = draws.uniform(0.0, FASTEST, shape), draws.uniform(0.0, 2 * np.pi, shape)
    return lambda t: np.sin(2 * np.pi * frequency * t + phase)


def near_gait(env: SnakeVectorEnv) -> Motion:
    """Return random actions about those of the gait."""
    middle, added = of_gait(env), smooth(env)
    return lambda t: (middle(t) + NEAR * added(t)).clip(-1.0, 1.0)


MOTIONS = {'gait': of_gait, 'near it': near_gait, 'random': smooth}


def rate(env: SnakeVectorEnv, motion: Motion) -> float:
    """Return how many steps the environment takes in a second of processor time, at best."""
    env.reset(seed=0)
    period, t, best = env.snakes.period, 0.0, np.inf
    for _ in range(TURNS):
        actions = [motion(t + k * period) for k in range(STEPS)]
        t += STEPS * period
        begin = time.process_time()
        for each in actions:
            env.step(each)
        best = min(best, time.process_time() - begin)
    return STEPS * env.num_envs / best


def rms(way: Array) -> float:
    """Return the root of the mean square of ways (count, 2) over the snakes [m]."""
    return float(np.sqrt((way**2).sum(axis=1).mean()))


def errors(name: str, motion_of: Callable[[SnakeVectorEnv], Motion]) -> list[str]:
    """Return how far snakes are off at the end, over the way gone; then, in fine steps."""
    ends = []
    for settings in ({}, fine(LESS_FINE), fine(FINE)):
        env = made(name, JUDGED, task='forward', **settings)  # a task that no snake ends
        env.reset(seed=0)
        begun, motion = env.snakes.motion.place, motion_of(env)
        for k in range(LENGTH):
            env.step(motion(k * env.snakes.period))
        ends.append(env.snakes.motion.place - begun)
    *found, true = ends
    return [f'{rms(end - true) / rms(true):.1%}' for end in found]


def fine(dt: float) -> dict[str, Any]:
    """Return the settings of a run that is compared with."""
    return {'method': 'newton', 'dt': dt}


def rate_of_mujoco(name: str, is_random: bool) -> float:
    """Return how many steps a single environment of Gymnasium takes in a second, at best."""
    env = gymnasium.make(name)
    env.reset(seed=0)
    env.action_space.seed(0)
    still, best = np.zeros(env.action_space.shape or ()), np.inf
    for _ in range(TURNS):
        actions = [env.action_space.sample() if is_random else still for _ in range(STEPS * 10)]
        begin = time.process_time()
        for each in actions:
            if any(env.step(each)[2:4]):
                env.reset()
        best = min(best, time.process_time() - begin)
    return STEPS * 10 / best


def main() -> None:
    """Print the table."""
    heads = (f'{motion}: steps/s | error | of 1/4000 s' for motion in MOTIONS)
    print(f'| environment | step | {" | ".join(heads)} |')
    for name in NAMES:
        env = made(name, SNAKES)
        cells = [f'{env.snakes.base.method} 1/{1 / env.snakes.base.dt:.0f} s']
        for motion_of in MOTIONS.values():
            cells += [f'{rate(env, motion_of(env)):.0f}', *errors(name, motion_of)]
        print(f'| {name} | {" | ".join(cells)} |', flush=True)
    for name in OF_MUJOCO:
        still, random = (rate_of_mujoco(name, is_random) for is_random in (False, True))
        print(f'Gymnasium {name}: {still:.0f} steps/s with actions of 0, with random {random:.0f}')


if __name__ == '__main__':
    main()
