# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The network that comes with the examples: as a policy, in runs, and what is refused."""

from pathlib import Path
import re
import runpy
import shlex

import numpy as np
import pytest

from snake_sim_ros import ParameterError, run
from snake_sim_ros.commands import main as cli

pytest.importorskip('gymnasium')
from snake_sim_ros.learning import PolicyController, SnakeEnv
from snake_sim_ros.learning.tasks import REACHED

SCRIPT = Path(__file__).resolve().parents[2] / 'examples' / 'goal_policy.py'


def test_example_judges_the_network_that_comes_with_it(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    picture = tmp_path / 'ways.png'
    monkeypatch.setattr('sys.argv', [str(SCRIPT), '--judged', '20', '--plot', str(picture)])
    runpy.run_path(str(SCRIPT), run_name='__main__')
    found = re.fullmatch(
        r'policy: reward (\d\.\d\d), (\d+) % of the goals reached\n'
        r'gait: reward -?\d\.\d\d, (\d+) % of the goals reached\n',
        capsys.readouterr().out,
    )
    assert found
    # 1 for the goal and 1.6 m of way to it on average, less the energy.
    assert float(found[1]) > 1.8
    assert int(found[2]) >= 95 > 20 >= int(found[3])
    assert picture.read_bytes().startswith(b'\x89PNG')


def test_command_of_the_page_runs(monkeypatch, capsys):
    page = (SCRIPT.parents[1] / 'docs' / 'learning.md').read_text(encoding='utf-8')
    (line,) = re.findall(r'^./run (run lateral_undulation .*goal_policy.*)$', page, re.MULTILINE)
    monkeypatch.chdir(SCRIPT.parents[1])
    assert cli.main([*shlex.split(line), '--duration', '1']) == 0
    assert 'after 1 s' in capsys.readouterr().out


@pytest.mark.parametrize('goal', [(1.5, 1.0), (-1.2, -0.8)])
def test_controller_by_name_reaches_the_goal_that_it_is_given(goal):
    named = {'name': f'{SCRIPT}:Learned', 'goal': [*goal]}
    made = run('lateral_undulation', controller=named, duration=15.0)
    place = made.position[:, :, :2].mean(axis=1)
    assert np.hypot(*(place - goal).T).min() < REACHED


@pytest.mark.parametrize(
    ('task', 'goal', 'sentence'),
    [
        ('forward', (1.0, 0.0), 'goal: the task of the policy has none'),
        ('goal', (1.0, np.nan), r'goal must be two finite numbers, got \(1.0, nan\)'),
        ('goal', (1.0, 0.0, 0.0), 'goal must be two finite numbers'),
    ],
)
def test_goals_that_are_none_are_refused(task, goal, sentence):
    env = SnakeEnv(task, action='gait')
    with pytest.raises(ParameterError, match=sentence):
        PolicyController(env, lambda seen: np.zeros(4), goal=goal)
