# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learn to reach goals by PPO of Stable-Baselines3, in some minutes of two cores."""

import argparse
from typing import Any

from goal_policy import actions, gait, judge, make, policy, SEES
from gymnasium.spaces import Box
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
import torch

SNAKES, ACTIONS = 64, 32  # at a time, and of each of them before the policy is improved
SHOWN = 10  # improvements from one line to the next


class Snakes(VecEnv):
    """The vector environment as Stable-Baselines3 takes one."""

    def __init__(self, count: int) -> None:
        self.snakes = make(count, autoreset_mode='SameStep')
        bound = self.snakes.single_observation_space.high[-SEES:]
        seen = Box(-bound, bound, dtype=np.float64)
        super().__init__(count, seen, self.snakes.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin episodes, with the seeds that `seed` has set."""
        seen, _ = self.snakes.reset(seed=self._seeds)
        return seen[:, -SEES:]

    def step_async(self, found: np.ndarray) -> None:
        """Take actions of the network."""
        self.taken = actions(found)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return what they lead to."""
        seen, reward, terminated, truncated, info = self.snakes.step(self.taken)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in done]
        for i in np.flatnonzero(done):
            infos[i]['terminal_observation'] = info['final_obs'][i][-SEES:]
            infos[i]['TimeLimit.truncated'] = bool(truncated[i] and not terminated[i])
        return seen[:, -SEES:], reward, done, infos

    def close(self) -> None:
        """Close the environment."""
        self.snakes.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return nothing for each snake: there are no pictures."""
        return [None] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return that no snake is."""
        return [False] * self.num_envs

    def set_attr(self, *arguments: Any, **named: Any) -> None:
        """Refuse: snakes have no environments of their own."""
        raise NotImplementedError

    env_method = set_attr


def main() -> None:
    """Train; print how well the policy does on new goals, beside the gait as it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--steps', type=int, default=400_000, help='actions of all snakes')
    parser.add_argument('--judged', type=int, default=40, help='episodes with new goals')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--out', default='goals.npz', help='file for the network')
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # the network is small: the cores are for the snakes
    model = PPO(
        'MlpPolicy', VecMonitor(Snakes(SNAKES)), n_steps=ACTIONS, batch_size=512, gamma=0.995,
        learning_rate=1e-3, policy_kwargs={'log_std_init': -1.0}, seed=arguments.seed,
        device='cpu',
    )  # fmt: skip
    while model.num_timesteps < arguments.steps:
        model.learn(SHOWN * SNAKES * ACTIONS, reset_num_timesteps=False)
        rewards = [episode['r'] for episode in model.ep_info_buffer]
        print(f'{model.num_timesteps} actions: reward {np.mean(rewards):.2f}', flush=True)
    layers = (
        *model.policy.mlp_extractor.policy_net.parameters(),
        *model.policy.action_net.parameters(),
    )
    np.savez(arguments.out, *(each.detach().numpy() for each in layers))
    print(f'policy: {judge(policy(arguments.out), arguments.judged)}')
    print(f'gait: {judge(gait, arguments.judged)}')


if __name__ == '__main__':
    main()
