# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learn to reach goals: CMA-ES finds how to steer a gait, in some minutes of two cores."""

import argparse
from concurrent.futures import ProcessPoolExecutor

import cma
import gymnasium
import numpy as np

import snake_sim_ros.learning

gymnasium.register_envs(snake_sim_ros.learning)
NAME, SEES = 'snake_sim_ros/Goal-v0', 3  # the last three observations say where the goal is


def act(weights: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the action of a policy: parameters of the gait, from -1 to 1."""
    command = np.append(np.clip(seen[-SEES:], -1.0, 1.0), 1.0)
    return np.tanh(weights.reshape(-1, SEES + 1) @ command)


def episode(weights: np.ndarray, seed: int) -> tuple[float, bool]:
    """Return the sum of rewards, and whether the goal was reached."""
    env = gymnasium.make(NAME)
    seen, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        seen, reward, terminated, truncated, info = env.step(act(weights, seen))
        total, over = total + reward, terminated or truncated
    return total, info['reward']['reached'] > 0.0


def score(weights: np.ndarray, seeds: range, pool: ProcessPoolExecutor) -> tuple[float, float]:
    """Return the mean sum of rewards, and the share of goals that are reached."""
    found = np.array(list(pool.map(episode, [weights] * len(seeds), seeds)))
    return float(found[:, 0].mean()), float(found[:, 1].mean())


def main() -> None:
    """Print how well the policy does on goals that it has not seen, beside the gait as it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--generations', type=int, default=15)
    parser.add_argument('--episodes', type=int, default=6, help='of each policy in a generation')
    parser.add_argument(
        '--judged', type=int, default=40, help='episodes with new goals at the end'
    )
    parser.add_argument('--out', default='goals.npy', help='file for the weights of the policy')
    arguments = parser.parse_args()
    options = {'seed': 1, 'verbose': -9, 'popsize': 12}
    search = cma.CMAEvolutionStrategy(gait().ravel(), 0.3, options)
    with ProcessPoolExecutor(2) as pool:
        for generation in range(arguments.generations):
            seeds = range(generation * arguments.episodes, (generation + 1) * arguments.episodes)
            policies = search.ask()
            rewards = [score(weights, seeds, pool)[0] for weights in policies]
            search.tell(policies, [-reward for reward in rewards])
            print(f'generation {generation + 1}: best {max(rewards):.2f}', flush=True)
        new = range(10**6, 10**6 + arguments.judged)
        for name, weights in (('policy', search.mean), ('gait', gait())):
            reward, reached = score(weights, new, pool)
            print(f'{name}: reward {reward:.2f}, {100 * reached:.0f} % of the goals reached')
    np.save(arguments.out, search.mean)


def gait() -> np.ndarray:
    """Return the policy that moves by lateral undulation straight ahead."""
    weights = np.zeros((4, SEES + 1))
    weights[:, -1] = np.arctanh([0.05, 0.35, -0.55, 0.0])  # 0.52 rad, 1.4 rad/s, -0.87 rad
    return weights


if __name__ == '__main__':
    main()
