# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many snakes as a vector environment of Gymnasium, which steps them in one compiled call."""

from collections.abc import Sequence
from typing import Any

from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
import numpy as np

from snake_sim_ros.learning.environment import SnakeEnv
from snake_sim_ros.learning.snakes import Snakes
from snake_sim_ros.scene.checked_records import nearest, ParameterError
from snake_sim_ros.scene.parameters import Array


class SnakeVectorEnv(VectorEnv[Array, Array, Array]):
    """
    Snakes with a task, each with an episode of its own.

    What an action and an observation is, and what is in `info`, is as in `SnakeEnv`; an episode
    with a seed is that of a single environment, to the bit.

    Parameters
    ----------
    num_envs : int
        Number of the snakes.
    max_episode_steps : int, optional
        Actions after which an episode is truncated; default: none are.
    autoreset_mode : AutoresetMode or str, optional
        When an episode that has ended is followed by the next one, as Gymnasium has it: in the
        next step, in the same step, or when the user resets it with ``options['reset_mask']``.
    threads : int, optional
        Threads that share the snakes in a step.
    task : str, optional
        As of `SnakeEnv`, which has all other parameters, too.

    Raises
    ------
    ParameterError
        If an argument is not usable; the message says which and why.

    """

    def __init__(
        self, num_envs: int = 1, max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, threads: int = 1,
        task: str = 'forward', **settings: Any,
    ) -> None:  # fmt: skip
        modes = [mode.value for mode in AutoresetMode]
        if isinstance(autoreset_mode, str) and autoreset_mode not in modes:
            raise ParameterError(f'autoreset_mode: {nearest(autoreset_mode, modes)}')
        self.snakes = Snakes(num_envs, threads, task, **settings)
        self.num_envs, self.max_episode_steps = num_envs, max_episode_steps
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**SnakeEnv.metadata, 'autoreset_mode': self.autoreset_mode}
        self.render_mode = self.snakes.render_mode
        self.single_action_space = self.snakes.action_space
        self.single_observation_space = self.snakes.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._ended = np.zeros(num_envs, bool)
        self._draws: list[np.random.Generator | None] = [None] * num_envs

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:  # fmt: skip
        """
        Begin episodes.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Of the first snake, whose followers have the numbers after it, or of each.
        options : dict, optional
            ``reset_mask``, an array (num_envs,) of bool, says of which snakes; default: of all.

        Raises
        ------
        ParameterError
            If seeds or mask have another length.

        """
        count = self.num_envs
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds = [None if seed is None else int(seed) + i for i in range(count)]
        else:
            seeds = list(seed)
        if len(seeds) != count:
            raise ParameterError(f'seed must be one number or {count}, got {len(seeds)}')
        mask = np.asarray((options or {}).get('reset_mask', np.ones(count, bool)))
        if mask.shape != (count,) or mask.dtype != bool or not mask.any():
            raise ParameterError(
                f'reset_mask must be {count} values of bool, at least one of them true, got '
                f'{mask.tolist()}'
            )
        rows = np.flatnonzero(mask).tolist()
        for i in rows:
            if seeds[i] is not None or self._draws[i] is None:
                self._draws[i] = np_random(seeds[i])[0]
        self._begin(rows)
        return self.snakes.seen.copy(), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """
        Take actions, which are clipped to the bounds of their space.

        Raises
        ------
        ParameterError
            If they have another shape or are not finite, before the first reset, or if an episode
            has ended and there is no reset by itself.

        """
        snakes, mode = self.snakes, self.autoreset_mode
        if not snakes.begun.all():
            raise ParameterError('an episode begins with reset')
        shape = self.num_envs, len(snakes.action_labels)
        what = f'actions must be {shape[0]} x {shape[1]} finite numbers'
        taken = snakes.physical(actions, what, shape)
        anew = self._ended if mode == AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, bool)
        if (self._ended & ~anew).any():
            i = int((self._ended & ~anew).argmax())
            raise ParameterError(f'the episode of snake {i} has ended: reset it with reset_mask')
        rows = np.flatnonzero(~anew) if anew.any() else slice(None)
        terms, done = snakes.step(taken, rows)
        reward = np.where(anew, 0.0, sum(terms.values()))
        terminated = (done | snakes.batch.failed) & ~anew
        truncated = np.zeros(self.num_envs, bool)
        if self.max_episode_steps:
            truncated = (snakes.periods >= self.max_episode_steps) & ~anew
        self._ended, stepped = terminated | truncated, ~anew
        begins = anew
        info: dict[str, Any] = {}
        if mode == AutoresetMode.SAME_STEP and self._ended.any():
            begins, last = self._ended, snakes.seen.copy()
            final = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(begins).tolist():
                final[row] = last[row]
            info = {'final_obs': final, '_final_obs': begins.copy()}
            info |= {'final_info': self._info(terms, begins), '_final_info': begins.copy()}
            stepped, self._ended = ~begins, np.zeros(self.num_envs, bool)
        info |= self._info(terms, stepped)
        if begins.any():
            self._begin(np.flatnonzero(begins).tolist())
        return snakes.seen.copy(), reward, terminated, truncated, info

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each snake, (360, 640, 3) of uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        if not self.snakes.begun.all():
            raise ParameterError('an episode begins with reset')
        return tuple(self.snakes.picture(i) for i in range(self.num_envs))

    def _begin(self, rows: list[int]) -> None:
        """Begin episodes of some snakes."""
        self._ended[rows] = False
        self.snakes.begin(rows, [draws for i in rows if (draws := self._draws[i])])

    def _info(self, terms: dict[str, Array], stepped: Array) -> dict[str, Any]:
        """Return what is in `info` of the snakes that have taken a step."""
        if not stepped.any():
            return {}
        reward: dict[str, Array] = {}
        for name, term in terms.items():
            reward |= {name: np.where(stepped, term, 0.0), f'_{name}': stepped.copy()}
        failure = np.where(stepped, '', np.array(None, dtype=object))
        for row in np.flatnonzero(self.snakes.batch.failed & stepped).tolist():
            failure[row] = self.snakes.failure(row)
        unconverged = np.where(stepped, self.snakes.batch.unconverged, 0)
        found: dict[str, Any] = {}
        for key, value in (
            ('reward', reward),
            ('unconverged', unconverged),
            ('failure', failure),
        ):
            found |= {key: value, f'_{key}': stepped.copy()}
        return found
