# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learn to reach goals by PPO in one file, with PyTorch alone, in some minutes of two cores."""

import argparse
from collections.abc import Callable

import gymnasium
import numpy as np
import torch
from torch import nn, Tensor

import snake_sim_ros.learning

gymnasium.register_envs(snake_sim_ros.learning)
NAME, RATE, EPISODE = 'snake_sim_ros/Goal-v0', 5.0, 100  # actions a second, and of an episode
SEES = 9  # the last observations: phase and parameters of the gait, and where the goal is
# Waves of 0.3 to 1 rad with lags of -1.2 to -0.4 rad. Small waves move no snake, so that nothing
# shows where it ought to go, and all that is learned is that to lie still costs no energy.
LEAST, MOST = np.array([[-0.4, -1.0, -0.75, -1.0], [1.0, 1.0, -0.25, 1.0]])
GAIT = np.array([0.05, 0.35, -0.55, 0.0])  # lateral undulation: 0.52 rad, 1.4 rad/s, -0.87 rad

SNAKES, ACTIONS = 64, 32  # at a time, and of each of them before the policy is improved
GAMMA, LAMBDA = 0.995, 0.95  # discount of rewards, and of their generalized advantages
EPOCHS, BATCH, CLIP, RATE_OF_LEARNING = 10, 512, 0.2, 1e-3
VALUES, LONGEST = 0.5, 0.5  # weight of the loss of values, and largest norm of a gradient
SHOWN = 10  # improvements from one line to the next


def network(outputs: int, scale: float) -> nn.Sequential:
    """Return layers whose last one begins small or not."""
    sizes, layers = (SEES, 64, 64, outputs), []
    for k in range(3):
        layer = nn.Linear(sizes[k], sizes[k + 1])
        nn.init.orthogonal_(layer.weight, 2**0.5 if k < 2 else scale)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


class Agent(nn.Module):
    """A policy, whose actions are normally distributed about a mean, and the values of states."""

    def __init__(self) -> None:
        super().__init__()
        self.mean, self.value = network(4, 0.01), network(1, 1.0)
        self.log_deviation = nn.Parameter(torch.full((4,), -1.0))

    def distribution(self, seen: Tensor) -> torch.distributions.Independent:
        """Return that of the actions (m, 4) for observations (m, 9)."""
        normal = torch.distributions.Normal(self.mean(seen), self.log_deviation.exp())
        return torch.distributions.Independent(normal, 1)


def make(count: int, **settings: object) -> gymnasium.vector.VectorEnv:
    """Return snakes that step in one call."""
    return gymnasium.make_vec(
        NAME, num_envs=count, vectorization_mode='vector_entry_point', threads=2, rate=RATE,
        max_episode_steps=EPISODE, **settings,
    )  # fmt: skip


def actions(found: np.ndarray) -> np.ndarray:
    """Return the actions of the environment for those of a network, shape (..., 4)."""
    return LEAST + 0.5 * (np.clip(found, -1.0, 1.0) + 1.0) * (MOST - LEAST)


def tensor(seen: np.ndarray) -> Tensor:
    """Return what a network sees of observations (m, k), shape (m, 9)."""
    return torch.as_tensor(seen[:, -SEES:], dtype=torch.float32)


class Rollout:
    """What happens in some actions of all snakes, which go on where they were."""

    def __init__(self, seed: int) -> None:
        self.snakes = make(SNAKES, autoreset_mode='SameStep')
        self.now = self.snakes.reset(seed=seed)[0]
        self.ended, self.sums = [0.0], np.zeros(SNAKES)  # sums of rewards, of the last episodes

    @torch.no_grad()
    def take(self, agent: Agent) -> list[Tensor]:
        """Return observations, actions, their log densities, advantages and values to learn."""
        shape = ACTIONS, SNAKES
        seen, chosen = torch.zeros(*shape, SEES), torch.zeros(*shape, 4)
        density, reward, value, goes_on = torch.zeros(4, *shape)
        for t in range(ACTIONS):
            seen[t] = tensor(self.now)
            distribution = agent.distribution(seen[t])
            chosen[t] = distribution.sample()
            density[t], value[t] = distribution.log_prob(chosen[t]), agent.value(seen[t])[:, 0]
            step = self.snakes.step(actions(chosen[t].numpy()))
            self.now, rewards, terminated, truncated, info = step
            self._count(rewards, terminated | truncated)
            cut = np.flatnonzero(truncated & ~terminated)
            if len(cut):  # what the episode would have gone on to
                left = agent.value(tensor(np.stack(info['final_obs'][cut])))[:, 0]
                rewards[cut] += GAMMA * left.numpy()
            reward[t] = torch.as_tensor(rewards)
            goes_on[t] = torch.as_tensor(~(terminated | truncated))
        after, advantage = agent.value(tensor(self.now))[:, 0], torch.zeros(*shape)
        gained = torch.zeros(SNAKES)
        for t in reversed(range(ACTIONS)):
            surprise = reward[t] + GAMMA * goes_on[t] * after - value[t]
            gained = surprise + GAMMA * LAMBDA * goes_on[t] * gained
            advantage[t], after = gained, value[t]
        parts = seen, chosen, density, advantage, advantage + value
        return [part.flatten(0, 1) for part in parts]

    def _count(self, rewards: np.ndarray, ends: np.ndarray) -> None:
        """Add to the sums of rewards."""
        self.sums += rewards
        self.ended = [*self.ended, *self.sums[ends]][-100:]
        self.sums[ends] = 0.0


def improve(agent: Agent, optimizer: torch.optim.Optimizer, rollout: list[Tensor]) -> None:
    """Move the policy toward actions that were better than expected, but not far from itself."""
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(rollout[0])).split(BATCH):
            seen, chosen, density, advantage, target = (part[rows] for part in rollout)
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            ratio = (agent.distribution(seen).log_prob(chosen) - density).exp()
            clipped = ratio.clamp(1.0 - CLIP, 1.0 + CLIP)
            gain = torch.minimum(ratio * advantage, clipped * advantage).mean()
            error = (agent.value(seen)[:, 0] - target).square().mean()
            optimizer.zero_grad()
            (VALUES * error - gain).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), LONGEST)
            optimizer.step()


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


def main() -> None:
    """Train; print how well the policy does on new goals, beside the gait as it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--steps', type=int, default=400_000, help='actions of all snakes')
    parser.add_argument('--judged', type=int, default=40, help='episodes with new goals')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--out', default='goals.npz', help='file for the network')
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # the network is small: the cores are for the snakes
    torch.manual_seed(arguments.seed)
    agent, rollout = Agent(), Rollout(arguments.seed)
    optimizer = torch.optim.Adam(agent.parameters(), RATE_OF_LEARNING, eps=1e-5)
    for k in range(1, 1 + -(-arguments.steps // (ACTIONS * SNAKES))):
        improve(agent, optimizer, rollout.take(agent))
        if k % SHOWN == 0:
            mean = np.mean(rollout.ended)
            print(f'{k * ACTIONS * SNAKES} actions: reward {mean:.2f}', flush=True)
    np.savez(arguments.out, *(each.detach().numpy() for each in agent.mean.parameters()))

    @torch.no_grad()
    def act(seen: np.ndarray) -> np.ndarray:
        return actions(agent.mean(tensor(seen)).numpy())

    print(f'policy: {judge(act, arguments.judged)}')
    print(f'gait: {judge(lambda seen: np.tile(GAIT, (len(seen), 1)), arguments.judged)}')


if __name__ == '__main__':
    main()
