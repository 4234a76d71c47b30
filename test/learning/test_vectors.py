# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Vectors of environments in one call: the bits of single ones, resets, and what is refused."""

from concurrent.futures import ThreadPoolExecutor
import math

import numpy as np
import pytest

from snake_sim_ros import ParameterError

gymnasium = pytest.importorskip('gymnasium')
from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402

from snake_sim_ros.learning import ENVIRONMENTS, SnakeEnv, SnakeVectorEnv  # noqa: E402

COUNT, LENGTH = 3, 7  # snakes, and actions of an episode
FAST = {'method': 'bdf2', 'dt': 0.02}
RANDOM = {'friction': (0.7, 1.3), 'command_delay': (0.0, 0.04), 'joint_noise': 0.01}


def actions_for(env, count, share=1.0):
    """Return random actions for some steps."""
    return np.random.default_rng(2).uniform(-share, share, (count, *env.action_space.shape))


def are_same(one, other):
    """Check that two infos are the same, to the bit and the type."""
    assert one.keys() == other.keys()
    for key, value in one.items():
        if isinstance(value, dict):
            are_same(value, other[key])
            continue
        assert value.dtype == other[key].dtype
        for a, b in zip(value, other[key], strict=True):
            assert np.array_equal(a, b)


@pytest.mark.parametrize('name', ENVIRONMENTS)
def test_make_vec_finds_it_and_has_the_bits_of_single_ones(name):
    vector = gymnasium.make_vec(name, num_envs=COUNT, vectorization_mode='vector_entry_point')
    assert isinstance(vector, SnakeVectorEnv) and vector.max_episode_steps == 500
    actions = actions_for(vector, 6)
    found = [vector.reset(seed=10)[0], *(vector.step(each)[0] for each in actions)]
    for k in range(COUNT):
        env = gymnasium.make(name)
        assert vector.single_observation_space == env.observation_space
        own = [env.reset(seed=10 + k)[0], *(env.step(each[k])[0] for each in actions)]
        assert (np.array(own) == np.array(found)[:, k]).all()


@pytest.mark.parametrize('mode', AutoresetMode)
@pytest.mark.parametrize('action', ['gait', 'residual', 'torques'])
def test_it_is_as_a_vector_of_gymnasium(action, mode):
    """Observations, rewards, ends and infos through several episodes, to the bit."""
    settings = {'task': 'goal', 'action': action, 'values': FAST, 'randomization': RANDOM}

    def single():
        return gymnasium.wrappers.TimeLimit(SnakeEnv(**settings), LENGTH)

    own = SnakeVectorEnv(COUNT, LENGTH, mode, **settings)
    other = SyncVectorEnv([single] * COUNT, autoreset_mode=mode)
    assert own.metadata['autoreset_mode'] == mode
    assert own.observation_space == other.observation_space
    assert own.action_space == other.action_space
    assert (own.reset(seed=[4, 2, 7])[0] == other.reset(seed=[4, 2, 7])[0]).all()
    for k, each in enumerate(actions_for(own, 2 * LENGTH + 3, 0.5)):
        if k == 3:
            # One goal is where the robot is: its episode ends before those of the others.
            place = own.snakes.motion.place[1].copy()
            own.snakes.task.goal[1] = place
            other.envs[1].unwrapped.snakes.task.goal[0] = place
        found, wanted = own.step(each), other.step(each)
        for a, b in zip(found[:4], wanted[:4], strict=True):
            assert a.dtype == b.dtype
            assert (a == b).all()
        are_same(found[4], wanted[4])
        ended = found[2] | found[3]
        if mode == AutoresetMode.DISABLED and ended.any():
            with pytest.raises(ParameterError, match='has ended: reset it with reset_mask'):
                own.step(each)
            masks = [{'reset_mask': ended.copy()} for _ in range(2)]
            again = own.reset(options=masks[0]), other.reset(options=masks[1])
            assert (again[0][0] == again[1][0]).all()
    assert own._draws[0].random() == other.envs[0].unwrapped.np_random.random()


def test_threads_and_other_vectors_change_nothing():
    def episode(threads):
        env = SnakeVectorEnv(5, task='goal', action='gait', values=FAST, threads=threads)
        return [env.reset(seed=1)[0], *(env.step(each)[0] for each in actions_for(env, 12))]

    alone = np.array(episode(1))
    assert (np.array(episode(3)) == alone).all()
    with ThreadPoolExecutor(2) as pool:
        for found in pool.map(episode, [1, 1]):
            assert (np.array(found) == alone).all()


def test_contacts_are_those_of_a_single_one():
    settings = {'contacts': True, 'values': FAST}
    vector, env = SnakeVectorEnv(2, **settings), SnakeEnv(**settings)
    vector.reset(seed=3)
    env.reset(seed=4)
    for each in actions_for(vector, 5, 0.3):
        assert (vector.step(each)[0][1] == env.step(each[1])[0]).all()


def test_motion_that_diverges_ends_its_episode_and_says_why():
    env = SnakeVectorEnv(2, values={'dt': 1e-3, 'gait.soft_start': 0.0})
    env.reset(seed=0)
    env.step(np.zeros((2, 10)))
    state = env.snakes.batch.simulation(1).state
    state.u[:] = 1e9
    _, _, terminated, _, info = env.step(np.zeros((2, 10)))
    assert terminated.tolist() == [False, True]
    assert info['failure'][0] == '' and 'would turn by' in info['failure'][1]
    assert not env.step(np.zeros((2, 10)))[2].any()


def test_pictures_are_of_all():
    env = SnakeVectorEnv(2, render_mode='rgb_array', values=FAST)
    env.reset(seed=0)
    assert [picture.shape for picture in env.render()] == [(360, 640, 3)] * 2


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'num_envs': 0}, 'num_envs must be at least 1, got 0'),
        ({'threads': 0}, 'threads must be at least 1, got 0'),
        ({'autoreset_mode': 'sometimes'}, 'autoreset_mode: '),
    ],
)
def test_what_is_not_usable_gets_a_sentence(values, sentence):
    with pytest.raises(ParameterError, match=sentence):
        SnakeVectorEnv(**values)


@pytest.mark.parametrize(
    ('actions', 'got'),
    [
        (np.zeros((2, 9)), r'shape \(2, 9\)'),
        (np.zeros(10), r'shape \(10,\)'),
        (np.full((2, 10), math.nan), r'nan at \[0, 0\]'),
        (None, r'shape \(\)'),
    ],
)
def test_actions_that_are_none_are_refused(actions, got):
    env = SnakeVectorEnv(2)
    with pytest.raises(ParameterError, match='an episode begins with reset'):
        env.step(np.zeros((2, 10)))
    env.reset()
    with pytest.raises(ParameterError, match=f'actions must be 2 x 10 finite numbers, got {got}'):
        env.step(actions)


@pytest.mark.parametrize(
    ('given', 'sentence'),
    [
        ({'seed': [1, 2, 3]}, 'seed must be one number or 2, got 3'),
        ({'options': {'reset_mask': np.zeros(2, bool)}}, 'reset_mask must be 2 values of bool'),
        ({'options': {'reset_mask': [1, 0]}}, 'reset_mask must be 2 values of bool'),
    ],
)
def test_resets_of_another_form_are_refused(given, sentence):
    with pytest.raises(ParameterError, match=sentence):
        SnakeVectorEnv(2).reset(**given)
