# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A network that steers a gait to goals: how good it is, and as a controller, with NumPy alone."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import gymnasium
import numpy as np

from snake_sim_ros import run
import snake_sim_ros.learning
from snake_sim_ros.learning import PolicyController, SnakeEnv

gymnasium.register_envs(snake_sim_ros.learning)
NAME, RATE, EPISODE = 'snake_sim_ros/Goal-v0', 5.0, 100  # actions a second, and of an episode
SEES = 9  # the last observations: phase and parameters of the gait, and where the goal is
# Waves of 0.3 to 1 rad with lags of -1.2 to -0.4 rad. Small waves move no snake, so that nothing
# shows where it ought to go, and all that is learned is that to lie still costs no energy.
LEAST, MOST = np.array([[-0.4, -1.0, -0.75, -1.0], [1.0, 1.0, -0.25, 1.0]])
GAIT = np.array([0.05, 0.35, -0.55, 0.0])  # lateral undulation: 0.52 rad, 1.4 rad/s, -0.87 rad
LEARNED = Path(__file__).with_suffix('.npz')  # by learn_goals_ppo.py


def make(count: int, **settings: object) -> gymnasium.vector.VectorEnv:
    """Return snakes that step in one call."""
    return gymnasium.make_vec(
        NAME, num_envs=count, vectorization_mode='vector_entry_point', threads=2, rate=RATE,
        max_episode_steps=EPISODE, **settings,
    )  # fmt: skip


def actions(found: np.ndarray) -> np.ndarray:
    """Return the actions of the environment for those of a network, shape (..., 4)."""
    return LEAST + 0.5 * (np.clip(found, -1.0, 1.0) + 1.0) * (MOST - LEAST)


def policy(file: str | Path) -> Callable[[np.ndarray], np.ndarray]:
    """Return what acts by the network in an npz file: weights and biases of its layers."""
    with np.load(file) as arrays:
        layers = [arrays[name] for name in arrays]

    def act(seen: np.ndarray) -> np.ndarray:
        """Return actions (..., 4) for observations (..., k)."""
        x = seen[..., -SEES:]
        for weight, bias in zip(layers[:-2:2], layers[1:-2:2], strict=True):
            x = np.tanh(x @ weight.T + bias)
        return actions(x @ layers[-2].T + layers[-1])

    return act


def gait(seen: np.ndarray) -> np.ndarray:
    """Return the actions of lateral undulation straight ahead."""
    return np.tile(GAIT, (len(seen), 1))


def judge(act: Callable[[np.ndarray], np.ndarray], count: int) -> str:
    """Return how well a policy does on goals that are in no training."""
    snakes = make(count)
    seen, _ = snakes.reset(seed=10**6)
    total, reached, going = np.zeros(count), np.zeros(count), np.ones(count, bool)
    while going.any():
        seen, reward, terminated, truncated, info = snakes.step(act(seen))
        total += going * reward
        reached += going * info['reward']['reached']
        going &= ~(terminated | truncated)
    snakes.close()
    return f'reward {total.mean():.2f}, {100 * reached.mean():.0f} % of the goals reached'


def Learned(goal: Sequence[float] = (1.5, 1.0), file: str = str(LEARNED)) -> PolicyController:
    """Return the controller for `run` and the node `control`; the goal is (x, y) [m, frame I]."""
    env = SnakeEnv('goal', action='gait', rate=RATE)
    return PolicyController(env, policy(file), goal=goal)


def draw(file: str, picture: str) -> None:
    """Draw the ways of the middle link to three goals, and where the robot ends."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 5.4), layout='constrained')
    axes = figure.subplots()
    for goal in ((-2.0, 0.0), (-1.5, 1.0), (-1.0, -1.5)):
        moved = run('lateral_undulation', controller=Learned(goal, file), duration=20.0)
        (line,) = axes.plot(*moved.path[:, :2].T, lw=1.2)
        axes.plot(*moved.position[-1, :, :2].T, color=line.get_color(), lw=4.0, alpha=0.5)
        axes.plot(*goal, 'x', color=line.get_color(), ms=10.0, mew=2.5)
    axes.set(aspect='equal', xlabel='x [m]', ylabel='y [m]')
    axes.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)


def main() -> None:
    """Print how well a policy does, beside the gait as it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('file', nargs='?', default=LEARNED, help='of the network')
    parser.add_argument('--judged', type=int, default=40, help='episodes with new goals')
    parser.add_argument('--plot', help='a picture of ways to goals, such as goal_policy.png')
    arguments = parser.parse_args()
    print(f'policy: {judge(policy(arguments.file), arguments.judged)}')
    print(f'gait: {judge(gait, arguments.judged)}')
    if arguments.plot:
        draw(str(arguments.file), arguments.plot)


if __name__ == '__main__':
    main()
