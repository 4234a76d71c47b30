# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Optimization: known optima are found, constraints hold, and the same comes out every time."""

from dataclasses import fields, replace
from functools import cache
import json
import math
from pathlib import Path
import re

import numpy as np
import pytest
from stopped_commands import rows_of, SLOW, stopped
import yaml

from snake_sim_ros import ParameterError
from snake_sim_ros.commands.main import main
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.methods import with_usual_steps
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.studies import runs, workers
from snake_sim_ros.studies.metrics import METRICS
from snake_sim_ros.studies.optimization import NO_VALUE, optimize
from snake_sim_ros.studies.problem import (
    load_problem,
    problem_from,
    PROBLEM_KEYS,
    robust_of,
    SearchSettings,
    Stop,
)
from snake_sim_ros.studies.searches import front_of, scalar_losses
from snake_sim_ros.studies.table import journal_of

pytest.importorskip('polars')
pytest.importorskip('cma')
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'optimization.md').read_text(encoding='utf-8')
EXAMPLE = ROOT / 'examples' / 'faster_sidewinding.yaml'
# A scene of one sample; what is measured in it are functions of its friction, see `valley`.
SHORT = {'duration': 0.05, 'dt': 0.001, 'robot.link_count': 2}
X, Y = 'friction.longitudinal', 'friction.transversal'
UNIT = {X: {'low': 0.0, 'high': 1.0}, Y: {'low': 0.0, 'high': 1.0}}
# The same as a file, which a process of its own runs.
MODULE = """
def valley(trajectory):
    x, y = trajectory.scene.friction.longitudinal, trajectory.scene.friction.transversal
    return (x - 0.3) ** 2 + 4 * (y - 0.45 - 0.2 * (x - 0.3)) ** 2
"""


def x(trajectory):
    return trajectory.scene.friction.longitudinal


def y(trajectory):
    return trajectory.scene.friction.transversal


def valley(trajectory):
    """Return a function whose least value, 0, is at x = 0.3, y = 0.45."""
    a, b = x(trajectory) - 0.3, y(trajectory) - 0.45
    return a**2 + 4 * (b - 0.2 * a) ** 2


def solved(vary=None, *, evaluations=400, tolerance=1e-4, count=1, **given):
    """
    Return the outcome of an optimization whose metrics depend on nothing but values of a scene.

    All runs are the first one, which takes a quarter of the time.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs._Runner, '_run', lambda _, scene: replace(first_run(), scene=scene))
        return optimize(
            'lateral_undulation', vary or UNIT, workers=workers.threads(count),
            **{'set': SHORT, 'metrics': [x, y, valley],
               'stop': {'evaluations': evaluations, 'tolerance': tolerance}, **given},
        )  # fmt: skip


@cache
def first_run():
    return simulate(with_settings(load_scene('lateral_undulation'), SHORT), rate=20)


def best(outcome):
    """Return the values of the best evaluation."""
    (item,) = outcome.best
    return np.array([item.point.values[name] for name in outcome.problem.bounds])


def table(outcome):
    """Return the history without what differs from run to run."""
    return outcome.history().drop('seconds')


# ---- what is found ------------------------------------------------------------------------------


@pytest.mark.parametrize('goal', [{'minimize': 'valley'}, {'maximize': '3 - 2 * valley'}])
def test_a_known_optimum_is_found(goal):
    # The last samples differ by less than the tolerance; the mean is off by as much as that, and
    # the best of all samples is hardly ever further off than four deviations.
    tolerance = 1e-3
    outcome = solved(tolerance=tolerance, evaluations=1000, **goal)
    assert outcome.stopped == 'tolerance' and len(outcome.evaluations) < 1000
    assert np.abs(best(outcome) - [0.3, 0.45]).max() < 5 * tolerance
    objective, *_ = outcome.objectives_of(outcome.best[0])
    metric = outcome.best[0].metrics['valley']
    assert objective == (metric if 'minimize' in goal else 3 - 2 * metric)


def test_one_value_and_scales_and_followers():
    outcome = solved(
        {X: {'low': 1e-3, 'high': 1.0, 'scale': 'log'}},
        follow={Y: f'0.5 - {X}'}, minimize='(x - 0.03) ** 2 + (y - 0.47) ** 2', tolerance=1e-3,
    )  # fmt: skip
    # A share of the bounds is a ratio of 1000^share.
    assert abs(math.log(best(outcome)[0] / 0.03)) < 5e-3 * math.log(1000)
    for item in outcome.evaluations:
        if item.status == 'refused':  # friction below 0
            assert item.metrics['x'] is None
        else:
            assert item.metrics['y'] == 0.5 - item.metrics['x']


def test_constraints_hold_and_the_bound_is_reached():
    # The largest x + y in the circle is at x = y = 0.5, sqrt(2) 0.5 from the origin.
    circle = 'x ** 2 + y ** 2 <= 0.5'
    outcome = solved(maximize='x + y', constraints=[circle, 'abs(x - y) <= 0.2'], evaluations=500)
    (item,) = outcome.best
    found = item.metrics
    assert found['x'] ** 2 + found['y'] ** 2 <= 0.5 and abs(found['x'] - found['y']) <= 0.2
    # Near the optimum the sum falls with the square of the distance along the circle.
    assert 1.0 - 1e-3 < found['x'] + found['y'] <= 1.0 + 1e-12
    frame = outcome.history()
    holds = (frame['x'] ** 2 + frame['y'] ** 2 <= 0.5) & ((frame['x'] - frame['y']).abs() <= 0.2)
    assert frame['feasible'].to_list() == holds.to_list()
    assert frame.filter('best')['row'].to_list() == [item.point.number]
    assert frame.filter('feasible')['objective'].max() == frame.filter('best')['objective'][0]


def test_the_first_evaluation_is_the_scene_as_it_is():
    outcome = solved(minimize='valley', evaluations=1)
    friction = load_scene('lateral_undulation').friction
    assert best(outcome).tolist() == [friction.longitudinal, friction.transversal]
    # What is out of bounds begins at the nearest one.
    outcome = solved({X: {'low': 0.6, 'high': 0.9}}, minimize='valley', evaluations=1)
    assert best(outcome).tolist() == [0.6]


def test_what_is_refused_or_has_no_value_never_wins():
    def torn(trajectory):
        if x(trajectory) > 0.45:
            raise RuntimeError('torn')
        return math.nan if x(trajectory) > 0.4 else math.inf if x(trajectory) > 0.3 else 1.0

    amplitude = {'gait.yaw.amplitude_deg': {'low': 20, 'high': 60}, X: UNIT[X]}
    outcome = solved(amplitude, metrics=[x, torn], maximize='x * torn', evaluations=120)
    (item,) = outcome.best
    assert 0.2 < item.metrics['x'] <= 0.3 and item.point.values['gait.yaw.amplitude_deg'] <= 45
    frame = outcome.history()
    assert {'converged', 'refused', 'failed'} <= set(frame['status'])
    assert set(frame.filter(frame['status'] == 'converged')['failure']) == {'', NO_VALUE}
    assert 'joint' in frame.filter(frame['status'] == 'refused')['failure'][0]
    assert 'torn' in frame.filter(frame['status'] == 'failed')['failure'][0]
    assert not frame.filter(frame['failure'] != '')['feasible'].any()


def test_a_robust_objective_is_that_of_all_scenes():
    # max(|0.5 x - 0.3|, |1.5 x - 0.3|) is least, 0.15, at x = 0.3; the mean of squares for factors
    # f at x = 0.3 sum(f) / sum(f^2).
    given = {'vary': {X: UNIT[X]}, 'tolerance': 1e-3, 'evaluations': 90}
    factors = [0.5, 1.0, 1.5]
    worst = solved(minimize='abs(x - 0.3)', robust={'over': {X: 0.5}, 'measure': 'worst'}, **given)
    assert abs(best(worst)[0] - 0.3) < 5e-3
    assert worst.best[0].losses[0] == pytest.approx(0.15, abs=5e-3 * 1.5)
    for item in worst.evaluations:
        value = item.point.values[X]
        losses = [abs(value * factor - 0.3) for factor in factors]
        assert item.losses[0] == max(losses) == abs(item.metrics['x'] - 0.3)
    mean = solved(
        minimize='(x - 0.3) ** 2', robust={'over': {X: factors}, 'measure': 'mean'}, **given
    )
    assert abs(best(mean)[0] - 0.3 * 3.0 / 3.5) < 5e-3
    # A constraint holds in every scene.
    outcome = solved(
        maximize='x', constraints='x <= 0.6', robust={'over': {'friction': 0.5}}, **given
    )
    assert 0.39 < best(outcome)[0] <= 0.4


def test_parts_of_a_scene_change_together_and_names_combine():
    scene = load_scene('lateral_undulation')
    robust = robust_of({'over': {'friction': 0.25, 'gait.yaw.amplitude_deg': [0.5, 2]}}, scene)
    found = [robust.settings(scene, {'gait.yaw.amplitude_deg': 20.0}, k) for k in range(6)]
    assert {item['gait.yaw.amplitude_deg'] for item in found} == {10.0, 40.0}
    friction = scene.friction
    pairs = {(item[X], item[Y]) for item in found}
    assert pairs == {
        (factor * friction.longitudinal, factor * friction.transversal)
        for factor in (0.75, 1.0, 1.25)
    }


def test_a_factor_of_friction_leaves_alone_how_it_falls_with_speed():
    falling = {'friction.kinetic_ratio': 0.9, 'friction.stribeck_speed': 0.05}
    scene = with_settings(load_scene('lateral_undulation'), falling)
    robust = robust_of({'over': {'friction': 0.25}}, scene)
    for k, factor in enumerate((0.75, 1.0, 1.25)):
        friction = with_settings(scene, robust.settings(scene, {}, k)).friction
        assert friction.longitudinal == factor * scene.friction.longitudinal
        assert (friction.kinetic_ratio, friction.stribeck_speed) == (0.9, 0.05)


# ---- fronts -------------------------------------------------------------------------------------


def test_a_front_is_sorted_and_nobody_beats_it():
    # Squares of the distances from (0.2, 0.5) and (0.8, 0.5): the front is the way between them,
    # where the distances sum to 0.6.
    outcome = solved(
        objectives=['-(x - 0.2) ** 2 - (y - 0.5) ** 2', '-(x - 0.8) ** 2 - (y - 0.5) ** 2'],
        evaluations=200, check={'dt': 0.025, 'method': 'newton'}, weights=4,
    )  # fmt: skip
    front = np.array([outcome.objectives_of(item) for item in outcome.best])
    assert len(front) > 10
    assert (np.diff(front[:, 0]) > 0).all() and (np.diff(front[:, 1]) < 0).all()
    everything = np.array([outcome.objectives_of(item) for item in outcome.evaluations])
    for point in front:
        assert not ((everything >= point).all(axis=1) & (everything > point).any(axis=1)).any()
    sums = np.sqrt(-front).sum(axis=1)
    assert (sums > 0.6 - 1e-12).all() and np.median(sums) < 0.61
    assert np.sqrt(-front).min(axis=0).max() < 0.05  # both ends are found
    numbers = {item.point.number for item in outcome.best}
    assert set(outcome.checks) == {0, *numbers}
    assert outcome.history()['best'].sum() == len(front) == len(outcome.scenes)


def test_the_best_of_a_scalar_loss_is_on_the_front():
    losses = np.random.default_rng(1).random((200, 2))
    feasible = losses[:, 0] > 0.1
    front = front_of(losses, feasible)
    for weight in np.linspace(0.0, 1.0, 7):
        scalar = scalar_losses(losses, feasible, weight)
        assert np.flatnonzero(feasible)[scalar[feasible].argmin()] in front
    assert front_of(losses[:, :1], feasible) == [np.where(feasible, losses[:, 0], 9).argmin()]
    assert front_of(losses, np.zeros(200, bool)) == []
    twice = np.array([[1.0, 2.0], [1.0, 2.0], [1.0, 3.0], [2.0, 2.0]])
    assert front_of(twice, np.ones(4, bool)) == [0]


# ---- when it stops ------------------------------------------------------------------------------


def test_stop_rules():
    assert len(solved(minimize='valley', evaluations=23).evaluations) == 23
    outcome = solved(minimize='max(valley, 0.05)', stop={'evaluations': 300, 'stagnation': 30})
    assert outcome.stopped == 'stagnation' and 31 <= len(outcome.evaluations) < 300
    outcome = solved(minimize='valley', stop={'evaluations': 300, 'seconds': 1e-9})
    assert outcome.stopped == 'seconds' and len(outcome.evaluations) == 1 + 6
    outcome = solved(minimize='valley', starts=3, population=4, evaluations=1 + 2 * 12)
    searches = [item.point.search for item in outcome.evaluations]
    assert searches == [-1, *[0] * 4, *[1] * 4, *[2] * 4, *[0] * 4, *[1] * 4, *[2] * 4]
    first = [item.point.values[X] for item in outcome.evaluations[1:13]]
    assert len(set(first)) == 12


# ---- the same every time ------------------------------------------------------------------------


def test_the_number_and_kind_of_workers_changes_nothing():
    given = {'constraints': ['x + y <= 0.9'], 'evaluations': 40}
    one = table(solved(minimize='valley', **given))
    assert one.equals(table(solved(minimize='valley', count=3, **given)))
    assert not one.equals(table(solved(minimize='valley', seed=1, **given)))


def study_file(folder, **given):
    """Write an optimization with a module of its own; return its file."""
    (folder / 'valleys.py').write_text(MODULE)
    content = {
        'scene': 'lateral_undulation', 'set': SHORT, 'vary': UNIT, 'minimize': 'valley',
        'metrics': ['valleys:valley', 'distance'], 'constraints': ['distance <= 1'],
        'stop': {'evaluations': 300, 'tolerance': 0}, **given,
    }  # fmt: skip
    path = folder / 'valley.yaml'
    path.write_text(yaml.safe_dump(content))
    return path


def outcome_of(capsys, *arguments):
    """Run the command; return its JSON without times and names of files."""
    assert main(['optimize', *map(str, arguments)]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    varying = ('seconds', 'evaluations_per_second', 'out', 'scenes', 'plot', 'found')
    return {name: value for name, value in found.items() if name not in varying}


def test_processes_and_a_cluster_do_the_same(tmp_path, monkeypatch, capsys):
    pytest.importorskip('distributed')
    monkeypatch.setattr(workers, 'core_count', lambda: 1)  # for the cluster
    path = study_file(tmp_path, stop={'evaluations': 20})
    results = []
    for k, kind in enumerate((['--threads', '1'], ['--processes', '1'], ['--scheduler', 'local'])):
        out = tmp_path / f'{k}.csv'
        results.append(outcome_of(capsys, path, '--out', out, *kind))
        scene = out.with_suffix('.best.yaml').read_bytes()
        results[-1]['scene'] = scene
    assert results[0] == results[1] == results[2]


def test_what_was_killed_goes_on_and_ends_the_same(tmp_path, capsys):
    pytest.importorskip('matplotlib')
    (tmp_path / 'slow.py').write_text(SLOW)
    metrics = {'metrics': ['valleys:valley', 'distance', 'slow:slow']}
    path = study_file(tmp_path, **metrics, stop={'evaluations': 60, 'tolerance': 0})
    whole, out = tmp_path / 'whole.parquet', tmp_path / 'killed.parquet'
    expected = outcome_of(capsys, path, '--out', whole, '--threads', '2')
    command = ['optimize', str(path), '--out', str(out), '--threads', '2']
    journal = journal_of(out)
    stopped(command, tmp_path, journal, rows=10)
    done = rows_of(journal)
    assert 10 <= done < 60 and not out.is_file()
    with journal.open('ab') as file:
        file.write(b'{"row": 3, "key": "ab')  # a line that was not whole
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert done - 2 <= found['found'] <= done
    assert {name: found[name] for name in expected} == expected
    one, other = (file.with_suffix('.best.yaml').read_bytes() for file in (whole, out))
    assert one == other
    polars = pytest.importorskip('polars')
    tables = [polars.read_parquet(file).drop('seconds') for file in (whole, out)]
    assert tables[0].equals(tables[1])
    assert out.with_suffix('.png').is_file()
    # Once more, and further: nothing that is done is run again.
    more = study_file(tmp_path, **metrics, stop={'evaluations': 65, 'tolerance': 0})
    assert main(['optimize', str(more), '--out', str(out)]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (found['evaluations'], found['found']) == (65, 60)


def test_an_interruption_keeps_what_was_done(tmp_path):
    def interrupt(evaluation):
        if evaluation.point.number == 9:
            raise KeyboardInterrupt

    out = tmp_path / 'history.csv'
    given = {'minimize': 'valley', 'evaluations': 20, 'out': out}
    with pytest.raises(KeyboardInterrupt):
        solved(observe=interrupt, **given)
    assert len(out.read_text().splitlines()) == 1 + 1 + 6  # names, the scene, a generation
    outcome = solved(**given)
    assert not outcome.evaluations[8].is_new and outcome.evaluations[19].is_new
    del given['out']
    assert table(outcome).equals(table(solved(**given)))


# ---- the command --------------------------------------------------------------------------------


def test_the_example_runs_and_its_scene_is_one(tmp_path, capsys):
    content = yaml.safe_load(EXAMPLE.read_text(encoding='utf-8'))
    assert content['check'] == {'method': 'newton', 'dt': 0.00025}
    content['set']['duration'] = 0.5
    content['metrics'] = [{'steady': {'of': 'peak_torque', 'begin': 0.25}}]
    content['constraints'] = ['steady <= 100']
    content['stop'] = {'evaluations': 6}
    path, out = tmp_path / 'short.yaml', tmp_path / 'short.csv'
    path.write_text(yaml.safe_dump(content))
    found = outcome_of(capsys, path, '--out', out)
    winner = found['best']
    check = winner['check']
    assert check['feasible'] and check['objective'] != winner['objective']
    assert found['start']['check']['status'] == 'converged'
    scene = load_scene(tmp_path / 'short.best.yaml')
    again = simulate(with_usual_steps(scene, (), 1 / 20), rate=20)
    assert METRICS['speed'](again) == winner['objective']
    steps = {'accuracy': 0.0, **content['check']}
    checked = METRICS['speed'](simulate(with_settings(scene, steps), rate=20))
    assert checked == check['objective']
    assert scene.gait.pitch.angular_frequency == scene.gait.yaw.angular_frequency


def test_the_command_writes_a_front(tmp_path, capsys):
    pytest.importorskip('matplotlib')
    (tmp_path / 'front.front').mkdir()
    for name in ('99.yaml', 'mine.yaml'):
        (tmp_path / 'front.front' / name).touch()
    goals = {'objectives': ['speed', '-valley'], 'stop': {'evaluations': 40}, 'seed': 2}
    path = study_file(tmp_path, **goals)
    content = yaml.safe_load(path.read_text())
    del content['minimize']
    path.write_text(yaml.safe_dump(content))
    out = tmp_path / 'front.parquet'
    found = outcome_of(capsys, path, '--out', out, '--plot', tmp_path / 'picture.svg')
    names = sorted(file.name for file in out.with_suffix('.front').iterdir())
    numbered = [f'{k + 1:02}.yaml' for k in range(len(found['front']))]
    assert names == [*numbered, 'mine.yaml']
    for name, item in zip(numbered, found['front'], strict=True):
        scene = load_scene(out.with_suffix('.front') / name)
        assert scene.friction.longitudinal == item['values'][X]
    assert 'speed' in (tmp_path / 'picture.svg').read_text()


@pytest.mark.parametrize('path', [EXAMPLE, EXAMPLE.with_name('speed_and_cost.yaml')])
def test_examples_are_problems(path):
    problem = load_problem(path)
    assert problem.check and problem.present()[1]['gait.yaw.amplitude_deg'] == pytest.approx(30)


def test_nothing_feasible_is_said(tmp_path, capsys):
    path = study_file(tmp_path, constraints=['distance >= 7'], stop={'evaluations': 8})
    assert main(['optimize', str(path), '--out', str(tmp_path / 'none.csv')]) == 1
    printed = capsys.readouterr()
    assert 'no evaluation holds all constraints' in printed.err
    assert json.loads(printed.out.splitlines()[-1])['best'] is None
    assert not (tmp_path / 'none.best.yaml').exists()


BAD = [
    ({'vary': {X: None}}, 'must have bounds such as'),
    ({'vary': {X: [0.1, 0.2]}}, 'must have bounds such as'),
    ({'vary': {X: {'low': 0.1}}}, 'must have bounds such as'),
    ({'vary': {X: {'low': 0.3, 'high': 0.1}}}, 'high must be above low, 0.3, got 0.1'),
    ({'vary': {X: {'low': math.nan, 'high': 0.1}}}, 'low must be finite, got nan'),
    ({'vary': {X: {'low': 0.1, 'high': math.inf}}}, 'high must be finite, got inf'),
    ({'vary': {X: {'low': -0.1, 'high': 0.1}}}, 'longitudinal must be at least 0'),
    ({'vary': {X: {'low': 0.1, 'high': 0.2, 'count': 3}}}, 'no count of values'),
    ({'vary': {X: {'low': 0.1, 'high': 0.2, 'scal': 'log'}}}, "did you mean 'scale'"),
    ({'vary': {'friction.long': {'low': 0.1, 'high': 0.2}}}, 'did you mean'),
    (
        {'set': {}, 'vary': {'robot.link_count': {'low': 3, 'high': 9}}},
        'only numbers with a fraction',
    ),
    ({'vary': {}}, 'vary must name a value'),
    ({'minimize': 'valey'}, "unknown name 'valey'; did you mean 'valley'"),
    ({'minimize': None}, 'must be an expression'),
    ({'maximize': 'speed'}, 'got maximize and minimize'),
    ({'constraints': ['speed']}, 'must be a comparison'),
    ({'constraints': ['sped <= 1']}, "did you mean 'speed'"),
    ({'constraints': None}, 'must be an expression'),
    ({'stop': {'evaluations': 0}}, 'stop: evaluations must be at least 1, got 0'),
    ({'stop': {'evaluations': math.nan}}, 'evaluations must be a whole number, got nan'),
    ({'stop': {'tolerance': -1}}, 'tolerance must be at least 0'),
    ({'stop': {'second': 1}}, "did you mean 'seconds'"),
    ({'starts': 0}, 'starts must be at least 1'),
    ({'population': 1}, 'population must be at least 2'),
    ({'maximise': 'speed'}, "unknown key 'maximise'; did you mean 'maximize'"),
    ({'follow': {'friction.rolling': 'frictio'}}, 'unknown name'),
    ({'follow': {X: Y}}, 'must not be in set or in vary'),
    ({'robust': 0.3}, 'robust must be like'),
    ({'robust': {'over': {}}}, 'must name a value'),
    ({'robust': {'over': {'friction': 1.5}}}, 'must be a share above 0 and below 1'),
    ({'robust': {'over': {'friction': math.nan}}}, 'must be a share above 0 and below 1'),
    ({'robust': {'over': {'frction': 0.3}}}, 'unknown name'),
    ({'robust': {'over': {'friction.rolling': 0.3}}}, 'is 0 in the scene'),
    ({'robust': {'over': {'method': 0.3}}}, 'no factor changes'),
    ({'robust': {'over': {'friction': 0.3, X: 0.1}}}, 'is given twice'),
    ({'robust': {'over': {X: 0.3}, 'measure': 'least'}}, 'worst or mean'),
    ({'check': {'methd': 'newton'}}, "did you mean 'method'"),
    ({'check': {X: 0.1}}, 'must not vary'),
    ({'check': {'dt': -1}}, 'check: dt must be above 0'),
    ({'metrics': ['valleys:walley']}, "did you mean 'valley'"),
]


@pytest.mark.parametrize(('change', 'message'), BAD)
def test_bad_input_gets_one_sentence(change, message, tmp_path, capsys):
    path = study_file(tmp_path, **change)
    assert main(['optimize', str(path), '--out', str(tmp_path / 'bad.csv')]) == 2
    printed = capsys.readouterr()
    assert message in printed.err and printed.err.count('\n') == 1 and not printed.out
    assert not list(tmp_path.glob('bad*'))


def test_no_other_file_is_written_over(tmp_path, capsys):
    path, out = study_file(tmp_path), tmp_path / 'mine.csv'
    for content in ('', 'row,speed\n1,2\n'):
        out.write_text(content)
        assert main(['optimize', str(path), '--out', str(out)]) == 2
        assert 'is not the history of an optimization' in capsys.readouterr().err
        assert out.read_text() == content


def test_metrics_have_names_of_their_own():
    def best(trajectory):
        return 1.0

    with pytest.raises(ParameterError, match='another column best'):
        solved(metrics=[best], maximize='best')


def test_goals_are_one_or_two():
    given = {'scene': 'sidewinding', 'vary': UNIT}
    for goals, message in [
        ({}, 'got none'),
        ({'objectives': ['speed']}, 'objectives must be two'),
        ({'objectives': 'speed'}, 'objectives must be two'),
    ]:
        with pytest.raises(ParameterError, match=message):
            problem_from(given | goals)


def test_the_page_names_all_keys():
    for name in (
        *PROBLEM_KEYS,
        *(item.name for kind in (SearchSettings, Stop) for item in fields(kind)),
    ):
        assert re.search(rf'^\| `{name}`', PAGE, re.MULTILINE), name


def test_the_program_of_the_page_runs(capsys):
    (program,) = re.findall(r'^```python\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL)
    exec(program, {})
    assert 'gait.yaw.amplitude_deg' in capsys.readouterr().out
