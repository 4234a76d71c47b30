# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Environments: the interface, the same bits whatever else runs, rewards, and what is refused."""

import math
from pathlib import Path
import re
import runpy
import warnings

import numpy as np
import pytest

from snake_sim_ros import load_scene, ParameterError, run

gymnasium = pytest.importorskip('gymnasium')
from gymnasium.utils.env_checker import check_env  # noqa: E402

from snake_sim_ros.learning import ENVIRONMENTS, PolicyController, Randomization, SnakeEnv  # noqa: E402

ROOT = Path(__file__).parents[2]
NAMES = list(ENVIRONMENTS)
# Forward with the waves of the scene: 0.52 rad, 1.4 rad/s, -0.87 rad between joints.
WAVES = np.array([2 * math.radians(30) - 1, math.radians(80) / 4, -math.radians(50) / 1.6, 0.0])


@pytest.mark.parametrize('name', NAMES)
def test_gymnasium_finds_and_accepts_it_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        env = gymnasium.make(name, render_mode='rgb_array')
        check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize('action', ['angles', 'residual', 'gait', 'torques'])
def test_an_episode_depends_on_seed_and_actions_alone(action):
    """Alone, after another episode, and among other environments that step in between."""
    random = {'friction': (0.7, 1.3), 'gains': (0.9, 1.1), 'joint_noise': 0.01}
    values = {'task': 'goal', 'action': action, 'randomization': random, 'contacts': True}
    actions = np.random.default_rng(3).uniform(-0.3, 0.3, (12, 20))

    def episode(env, seed, beside=()):
        first, _ = env.reset(seed=seed)
        found = [first]
        for each in actions[:, : env.action_space.shape[0]]:
            observation, reward, *_ = env.step(each)
            for other in beside:
                other.step(other.action_space.sample())
            found.append([*observation, reward])
        return np.concatenate(found)

    alone = episode(SnakeEnv(**values), 5)
    env, other = SnakeEnv(**values), SnakeEnv(**values)
    other.reset(seed=1)
    assert (episode(env, 6) != alone).any()
    assert (episode(env, 5, [other]) == alone).all()


def test_a_push_of_the_scene_is_in_every_episode():
    push = {'pushes': [{'start': 0.2, 'duration': 0.1, 'force': [0.0, 5.0, 0.0]}]}
    pushed, still = SnakeEnv(values=push), SnakeEnv()
    ends = []
    for env in (pushed, pushed, still):
        env.reset(seed=1)
        for _ in range(10):
            env.step(np.zeros(env.action_space.shape))
        ends.append(env.unwrapped.snakes.batch.q[0].copy())
    assert (ends[0] == ends[1]).all()
    assert (ends[0] != ends[2]).any()


@pytest.mark.parametrize(
    ('scene', 'values'),
    [
        ('pegboard', {'controller.name': 'compliance', 'controller.period': 0.04}),
        ('pegboard', {'controller.name': 'obstacle_aided', 'controller.period': 0.04}),
        ('lateral_undulation', {'controller.name': 'oscillators', 'controller.period': 0.04}),
        ('lateral_undulation', {'follow.points': [[0, 0], [-3, -1]], 'follow.period': 0.04}),
    ],
)
def test_a_controller_leads_residuals_with_the_bits_that_it_has_alone(scene, values):
    env = SnakeEnv(action='residual', scene=scene, values=values)
    still = np.zeros(env.action_space.shape)
    for _ in range(2):  # the controller begins anew with each episode
        env.reset(seed=1)
        for _ in range(25):
            env.step(still)
    base = env.unwrapped.snakes.base
    found, alone = env.unwrapped.snakes.batch.q[0].copy(), run(base, duration=1.0, rate=25.0)
    assert (found[:, :3] == alone.position[-1]).all()
    env.reset(seed=1)
    for _ in range(25):
        env.step(still + 0.1)
    assert (env.unwrapped.snakes.batch.q[0] != found).any()


def test_a_controller_has_the_period_of_the_actions():
    with pytest.raises(ParameterError, match=r'period of the controller must be .* 0\.04 s, got'):
        SnakeEnv(action='residual', scene='pegboard', values={'controller.name': 'compliance'})


@pytest.mark.parametrize('threads', [1, 2])
def test_vectors_of_environments_have_the_bits_of_single_ones(threads):
    name, count = 'snake_sim_ros/Goal-v0', 3
    mode = {1: 'sync', 2: 'async'}[threads]
    vector = gymnasium.make_vec(name, num_envs=count, vectorization_mode=mode)
    actions = np.random.default_rng(2).uniform(-1, 1, (6, count, 4))
    found = [vector.reset(seed=10)[0], *(vector.step(each)[0] for each in actions)]
    vector.close()
    for k in range(count):
        env = gymnasium.make(name)
        own = [env.reset(seed=10 + k)[0], *(env.step(each[k])[0] for each in actions)]
        assert (np.array(own) == np.array(found)[:, k]).all()


def test_reward_of_the_way_forward_is_the_way():
    """The gait of the scene as an action moves the robot as the scene does."""
    env = SnakeEnv(action='gait', values={'gait.soft_start': 0.0}, energy_price=0.0)
    env.reset(seed=0)
    total = sum(env.step(WAVES)[1] for _ in range(100))
    moved = run('lateral_undulation', {'gait.soft_start': 0.0}, duration=4.0, dt=1e-3)
    way = moved.position[:, :, :2].mean(axis=1)
    ahead = moved.position[0, 0, :2] - moved.position[0, -1, :2]
    wanted = (way[-1] - way[0]) @ ahead / np.hypot(*ahead)
    # Angles are linear within a period: 1/25 s of waves of 1.4 rad/s, (omega T)^2/8 = 4e-4.
    assert total == pytest.approx(wanted, rel=0.01)
    assert wanted > 0.2


def test_goals_are_reached_and_end_the_episode():
    env = SnakeEnv('goal', action='gait')
    env.reset(seed=0)
    env.snakes.task.goal = env.snakes.motion.place - [0.2, 0.0]
    for _ in range(200):
        _, _, terminated, truncated, info = env.step(WAVES)
        assert not truncated
        if terminated:
            break
    assert info['reward']['reached'] == 1.0
    assert not info['failure']


def test_path_rewards_what_is_covered():
    env = SnakeEnv('path', action='gait', energy_price=0.0)
    env.reset(seed=4)
    begin = env.snakes.task.arc[0]
    terms = [env.step(WAVES)[4]['reward'] for _ in range(100)]
    assert sum(term['covered'] for term in terms) == pytest.approx(env.snakes.task.arc[0] - begin)
    assert env.snakes.task.arc[0] - begin > 0.2


def test_observations_are_labelled_and_in_their_bounds():
    env = SnakeEnv('goal', action='gait', contacts=True)
    seen, _ = env.reset(seed=0)
    assert len(env.observation_labels) == len(seen) == env.observation_space.shape[0]
    assert len(env.action_labels) == env.action_space.shape[0]
    for _ in range(20):
        seen, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(seen)
    weight = sum(
        value
        for label, value in zip(env.observation_labels, seen, strict=True)
        if label.startswith('force z')
    )
    assert weight == pytest.approx(9.81 * env.snakes.base.robot.chain.mass.sum(), rel=0.05)


def test_torques_act_and_nothing_else_does():
    env = SnakeEnv(action='torques', energy_price=0.0)
    env.reset(seed=0)
    for _ in range(10):
        env.step(np.zeros(10))
    still = env.simulation.joint_angle.copy()
    for _ in range(5):
        env.step(np.full(10, 0.3))
    assert np.abs(env.simulation.joint_angle - still).max() > 0.05


def test_randomization_changes_what_it_says():
    base = SnakeEnv().snakes.base
    draws = np.random.default_rng(0)
    random = Randomization(friction=(0.5, 0.5), gains=(2, 2), command_delay=(0.02, 0.02))
    found = random.scene(base, draws)
    assert found.friction.transversal == 0.5 * base.friction.transversal
    assert found.robot.yaw_stiffness == 2 * base.robot.yaw_stiffness
    assert found.robot.command_delay == pytest.approx(0.02)
    assert Randomization().scene(base, draws) is base


def test_policy_moves_a_robot_as_its_environment():
    """The same actions from the same observations, in a run and as a controller by name."""

    def policy(seen):
        return np.tanh(WAVES + np.array([0.1 * seen[0], 0.0, 0.0, seen[-3] * 0.2]))

    env = SnakeEnv('goal', action='gait')
    seen, _ = env.reset(seed=3)
    for _ in range(25):
        seen, *_ = env.step(policy(seen))
    goal = env.snakes.task.goal.copy()
    followed = SnakeEnv('goal', action='gait')
    controller = PolicyController(followed, policy)
    made = run('lateral_undulation', controller=controller, duration=1.0, dt=1e-3, rate=25)
    # The task has drawn another goal; with the same one both are the same.
    assert followed.snakes.task.goal != pytest.approx(goal)
    task = followed.snakes.task
    task.start = lambda row, motion, draws: setattr(task, 'goal', goal)
    made = run('lateral_undulation', controller=controller, duration=1.0, dt=1e-3, rate=25)
    assert made.position[-1] == pytest.approx(env.simulation.state.q[:, :3], abs=1e-9)


def test_policies_of_torques_are_refused():
    with pytest.raises(ParameterError, match='a controller commands angles'):
        PolicyController(SnakeEnv(action='torques'), lambda seen: seen)


def test_the_programs_of_the_page_run():
    page = (ROOT / 'docs' / 'learning.md').read_text(encoding='utf-8')
    blocks = re.findall(r'^```python\n(.*?)^```', page, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    for block in blocks:
        exec(block, {})


def test_page_names_all_environments():
    page = (ROOT / 'docs' / 'learning.md').read_text(encoding='utf-8')
    assert all(f'| `{name}` |' in page for name in NAMES)


def test_example_learns_goals(tmp_path, monkeypatch, capsys):
    pytest.importorskip('cma')
    script = ROOT / 'examples' / 'learn_goals.py'
    few = ['--generations', '1', '--episodes', '1', '--judged', '2', '--out', 'found.npy']
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('sys.argv', [str(script), *few])
    runpy.run_path(str(script), run_name='__main__')
    printed = capsys.readouterr().out
    assert re.fullmatch(
        r'generation 1: best -?\d+\.\d\d\n'
        r'policy: reward -?\d+\.\d\d, \d+ % of the goals reached\n'
        r'gait: reward -?\d+\.\d\d, \d+ % of the goals reached\n',
        printed,
    ), printed
    assert np.load(tmp_path / 'found.npy').shape == (16,)


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'task': 'jump'}, 'task: '),
        ({'action': 'thoughts'}, 'action: '),
        ({'render_mode': 'human'}, 'render_mode: '),
        ({'rate': 0.0}, 'rate must be above 0 Hz and finite, got 0.0'),
        ({'rate': 30.0}, 'period of actions'),
        ({'randomization': {'friction': (1.3, 0.7)}}, 'friction must be two numbers in order'),
        ({'randomization': {'joint_noise': math.nan}}, 'joint_noise must be at least 0 rad'),
        ({'scene': 'concertina', 'action': 'gait'}, 'actions of a gait need a scene whose gait'),
        ({'values': {'friction.transversal': -1.0}}, 'transversal'),
    ],
)
def test_what_is_not_usable_gets_a_sentence(values, sentence):
    with pytest.raises(ParameterError, match=sentence):
        SnakeEnv(**values)


@pytest.mark.parametrize('action', [np.zeros(3), np.full(10, math.nan)])
def test_actions_that_are_none_are_refused(action):
    env = SnakeEnv()
    with pytest.raises(ParameterError, match='an episode begins with reset'):
        env.step(np.zeros(10))
    env.reset(seed=0)
    with pytest.raises(ParameterError, match='an action must be 10 finite numbers'):
        env.step(action)


def test_stairs_are_to_the_left_of_the_start():
    env = SnakeEnv(task='sideways', scene='stairs', action='gait')
    observation, _ = env.reset(seed=1)
    labels = env.observation_labels
    told = {
        name: observation[labels.index(f'{name} of the course')] for name in ('sine', 'cosine')
    }
    assert told['sine'] == pytest.approx(1.0, abs=1e-6)
    assert told['cosine'] == pytest.approx(0.0, abs=1e-6)
    # The robot heads along -x, and the flight rises along -y.
    assert load_scene('stairs').world.stairs[0].heading == pytest.approx(-math.pi / 2)
