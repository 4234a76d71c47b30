# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learn to reach goals: CMA-ES finds how to steer a gait, in some minutes of two cores."""

import argparse

import cma
import gymnasium
import numpy as np

import snake_sim_ros.learning

gymnasium.register_envs(snake_sim_ros.learning)
NAME, SEES = 'snake_sim_ros/Goal-v0', 3  # the last three observations say where the goal is


def act(weights: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the actions of policies, one for each snake: parameters of the gait, from -1 to 1."""
    command = np.column_stack([np.clip(seen[:, -SEES:], -1.0, 1.0), np.ones(len(seen))])
    return np.tanh((weights.reshape(len(seen), -1, SEES + 1) @ command[..., None])[..., 0])


def scores(policies: list[np.ndarray], seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean sum of rewards of policies, and the shares of goals that they reach."""
    count = len(policies) * len(seeds)
    snakes = gymnasium.make_vec(
        NAME, num_envs=count, vectorization_mode='vector_entry_point', threads=2
    )
    weights = np.repeat(policies, len(seeds), axis=0)
    seen, _ = snakes.reset(seed=[*seeds] * len(policies))
    total, reached, going = np.zeros(count), np.zeros(count), np.ones(count, bool)
    while going.any():
        seen, reward, terminated, truncated, info = snakes.step(act(weights, seen))
        total += going * reward
        reached += going * info['reward']['reached']
        going &= ~(terminated | truncated)
    snakes.close()
    by_policy = (each.reshape(len(policies), -1).mean(axis=1) for each in (total, reached))
    return next(by_policy), next(by_policy)


def main() -> None:
    """Print how well the policy does on goals that it has not seen, beside the gait as it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--generations', type=int, default=40)
    parser.add_argument('--episodes', type=int, default=8, help='of each policy in a generation')
    parser.add_argument(
        '--judged', type=int, default=40, help='episodes with new goals at the end'
    )
    parser.add_argument('--out', default='goals.npy', help='file for the weights of the policy')
    arguments = parser.parse_args()
    options = {'seed': 1, 'verbose': -9, 'popsize': 16}
    search = cma.CMAEvolutionStrategy(gait().ravel(), 0.3, options)
    for generation in range(arguments.generations):
        seeds = range(generation * arguments.episodes, (generation + 1) * arguments.episodes)
        policies = search.ask()
        rewards, _ = scores(policies, seeds)
        search.tell(policies, list(-rewards))
        print(f'generation {generation + 1}: best {rewards.max():.2f}', flush=True)
    new = range(10**6, 10**6 + arguments.judged)
    for name, *found in zip(
        ('policy', 'gait'), *scores([search.mean, gait().ravel()], new), strict=True
    ):
        print(f'{name}: reward {found[0]:.2f}, {100 * found[1]:.0f} % of the goals reached')
    np.save(arguments.out, search.mean)


def gait() -> np.ndarray:
    """Return the policy that moves by lateral undulation straight ahead."""
    weights = np.zeros((4, SEES + 1))
    weights[:, -1] = np.arctanh([0.05, 0.35, -0.55, 0.0])  # 0.52 rad, 1.4 rad/s, -0.87 rad
    return weights


if __name__ == '__main__':
    main()
