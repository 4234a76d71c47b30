# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The library in Python: what its one import offers, its page, and its examples."""

import ast
import json
from pathlib import Path
import re
import runpy
import sys

import numpy as np
from processes import python
import pytest

import snake_sim_ros
from snake_sim_ros import (
    Box,
    Gait,
    HeightField,
    load_scene,
    ParameterError,
    read_run,
    Robot,
    Run,
    run,
    Simulation,
    Table,
    table_of,
    Wave,
    World,
)
from snake_sim_ros.commands import main as cli
from snake_sim_ros.commands.main import COMMANDS
from snake_sim_ros.scene.gait import reference
from snake_sim_ros.stepping.levels import LevelStepper
from snake_sim_ros.studies.metrics import METRICS

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / 'docs' / 'python.md').read_text(encoding='utf-8')
BLOCKS = re.findall(r'^```python\n(.*?)^```', GUIDE, re.MULTILINE | re.DOTALL)
SCENE, SHORT = 'lateral_undulation', 0.2  # s
WAVE = Wave(amplitude=0.5, angular_frequency=1.4, phase_lag=-0.87)


@pytest.fixture(scope='module')
def short():
    return run(SCENE, duration=SHORT)


def undulate(t):
    """Return the angles of WAVE at a time."""
    angle = np.zeros((10, 2))
    angle[:, 0] = 0.5 * np.sin(1.4 * t - 0.87 * np.arange(10))
    return angle


# ---- the import ---------------------------------------------------------------------------------


def test_the_import_is_fast_and_complete():
    script = (
        'import sys, snake_sim_ros as s\n'
        'assert not {"numpy", "numba", "yaml"} & {*sys.modules}\n'
        'assert {*s.__all__} <= {*dir(s)}\n'
        'from snake_sim_ros.api.runs import run\n'
        'assert s.run is run and "numpy" in sys.modules\n'
        'others = {"numba", "rclpy", "matplotlib", "scipy.interpolate", "polars"}\n'
        'assert not others & {*sys.modules}\n'
        'from snake_sim_ros import *\n'
        'print(Simulation.__name__)'
    )
    assert python('-c', script, folder=ROOT) == 'Simulation\n'


def test_help_does_not_load_the_compiler():
    script = (
        'import sys\n'
        'from snake_sim_ros.commands.main import COMMANDS, main\n'
        'try: main(["--help"])\n'
        'except SystemExit: pass\n'
        'print("numba" in sys.modules, "scipy" in sys.modules)'
    )
    *text, loaded = python('-c', script, folder=ROOT).splitlines()
    assert loaded == 'False False'
    assert {*COMMANDS} <= {word for line in text for word in line.split()[:1]}


def test_type_checkers_see_the_names_that_there_are():
    # The stub is the only list; each of its names is re-exported, `as` itself.
    stub = ROOT / 'snake_sim_ros' / '__init__.pyi'
    tree = ast.parse(stub.read_text(encoding='utf-8'))
    items = [item for node in tree.body if isinstance(node, ast.ImportFrom) for item in node.names]
    assert all(item.name == item.asname for item in items)
    names = {item.name for item in items}
    assert names == {'__version__', *snake_sim_ros.__all__}
    with pytest.raises(AttributeError, match="module 'snake_sim_ros' has no attribute 'runn'"):
        _ = snake_sim_ros.runn


@pytest.mark.parametrize('name', snake_sim_ros.__all__)
def test_everything_public_has_a_docstring(name):
    item = getattr(snake_sim_ros, name)
    assert len(item.__doc__) > 40
    assert (item.__doc__.startswith(f'{name}(')) is False  # as a dataclass without one has


def test_annotations_are_installed():
    text = (ROOT / 'setup.py').read_text(encoding='utf-8')
    assert "'py.typed'" in text
    assert "'*.pyi'" in text
    assert (ROOT / 'snake_sim_ros' / 'py.typed').is_file()


# ---- scenes and runs ----------------------------------------------------------------------------


def test_a_run_is_that_of_the_command(short, tmp_path, capsys):
    path = tmp_path / 'run.npz'
    assert cli.main(['run', SCENE, '--duration', str(SHORT), '--out', str(path)]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    read = read_run(path)
    assert isinstance(read, Run)
    for name in ('time', 'position', 'joint_torque', 'contact_force'):
        assert (getattr(read, name) == getattr(short, name)).all()
    assert read.scene == short.scene
    assert {name: told[name] for name in short.metrics} == short.metrics


def test_a_scene_may_be_given_in_any_way(short, tmp_path):
    (tmp_path / 'my.yaml').write_text(f'{{robot: aiko.yaml, duration: {SHORT}}}')
    assert load_scene(tmp_path / 'my.yaml') == load_scene(SCENE, gait=Gait(), duration=SHORT)
    scene = load_scene(SCENE, duration=SHORT)
    assert load_scene(SCENE, {'duration': SHORT}) == load_scene(scene) == scene
    assert (run(scene).position == short.position).all()
    values = {'friction': {'transversal': 0.3}, 'gait.yaw.amplitude_deg': 20}
    changed = load_scene(scene, values, robot={'link_count': 5})
    assert changed.friction.transversal == 0.3
    assert changed.friction.longitudinal == scene.friction.longitudinal
    assert changed.gait.yaw.amplitude == pytest.approx(np.radians(20))
    assert changed.robot == Robot(link_count=5)


def test_steps_that_are_given_are_kept():
    fine = run(SCENE, duration=0.02, dt=1 / 1000)
    assert (fine.scene.dt, fine.scene.method) == (1 / 1000, 'newton')
    assert run(SCENE, duration=0.02, accuracy=0).report.steps == 80


def test_metrics_are_attributes(short):
    names = ('distance', 'speed', 'energy', 'cost_of_transport', 'slip')
    assert set(names) < set(short.metrics)
    for name in names:
        assert getattr(short, name) == METRICS[name](short) == short.metrics[name]
    assert short.speed == pytest.approx(short.distance / SHORT)
    weight = 7.5 * 9.81
    assert short.cost_of_transport == pytest.approx(short.energy / weight / short.distance)


def test_metrics_without_a_number_are_none(short, tmp_path):
    short.write(tmp_path / 'run.npz')
    read = read_run(tmp_path / 'run.npz')
    assert read.metrics == {**short.metrics, 'slip': None}
    with pytest.raises(ParameterError, match='slip needs velocities of the links'):
        _ = read.slip
    still = run(SCENE, duration=0.02, gait=Gait())
    assert still.metrics['cost_of_transport'] is None or still.distance > 0.0


def test_a_run_is_written_and_drawn(short, tmp_path):
    short.write(tmp_path / 'run.csv')
    assert (tmp_path / 'run.csv').read_text().startswith('time [s],')
    with pytest.raises(ParameterError, match=r'a run is written to \.npz or \.csv, got run\.txt'):
        short.write('run.txt')
    pytest.importorskip('matplotlib')
    short.write(tmp_path / 'run.npz')
    assert cli.main(['plot', str(tmp_path / 'run.npz'), '--out', str(tmp_path / 'run.pdf')]) == 0
    assert (tmp_path / 'run.pdf').read_bytes().startswith(b'%PDF')
    with pytest.raises(
        ParameterError, match=r'a plot must end in \.png, \.pdf, \.svg; got a\.gif'
    ):
        short.plot('a.gif')


def test_a_plot_without_matplotlib_is_refused_with_a_sentence(short, monkeypatch):
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    monkeypatch.delitem(sys.modules, 'snake_sim_ros.view.chart', raising=False)
    monkeypatch.delattr(snake_sim_ros.view, 'chart', raising=False)
    with pytest.raises(ParameterError, match=r'plots need matplotlib .*snake_sim_ros\[plots\]'):
        short.plot('run.png')


def test_a_function_of_time_is_a_gait():
    wanted = run(SCENE, gait=Gait(yaw=WAVE), duration=SHORT)
    told = run(SCENE, gait=undulate, duration=SHORT)
    # Rates of the spline are off by A omega (omega/200)^3 = 2e-7 rad/s.
    assert np.abs(told.position - wanted.position).max() < 1e-6

    def with_rates(t):
        rate = np.zeros((10, 2))
        rate[:, 0] = 0.5 * 1.4 * np.cos(1.4 * t - 0.87 * np.arange(10))
        return undulate(t), rate

    told = run(SCENE, gait=with_rates, duration=SHORT)
    assert np.abs(told.position - wanted.position).max() < 1e-6
    assert told.scene.gait.table.rate
    table = table_of(undulate, SHORT)
    again = run(SCENE, gait=table, duration=SHORT)
    with pytest.raises(ParameterError, match=r'plus the largest angle of gait\.table must be'):
        load_scene(SCENE, {'gait.table': table})  # besides the waves of the scene
    assert np.abs(again.position - wanted.position).max() < 1e-6


def test_a_controller_is_called_at_every_sample():
    times = []

    def follow(simulation):
        times.append(simulation.time)
        return undulate(simulation.time), np.zeros((10, 2))

    told = run(SCENE, controller=follow, duration=SHORT, rate=50)
    assert times == pytest.approx(np.arange(10) / 50)
    assert told.time == pytest.approx(np.arange(11) / 50)
    assert not told.report.failure
    # 40 N m/rad hold the joints at what they are told, up to friction of a link at a link's arm.
    late = undulate(times[-1])[:, 0]
    assert np.abs(told.joint_angle[-1, ::2] - late).max() < 0.1


@pytest.mark.parametrize('dt', [1 / 100, 1 / 200, 1 / 4000])  # 1, 2 and 40 steps a sample
def test_a_controller_that_commands_the_gait_is_the_gait(dt, monkeypatch):
    # Angles and rates go on as they are; a reference of times is that of the gait, to the bit.
    count, begun = [0], LevelStepper.advance

    def counted(*arguments):
        count[0] += 1
        return begun(*arguments)

    monkeypatch.setattr(LevelStepper, 'advance', counted)
    values = {'dt': dt, 'method': 'bdf2', 'duration': SHORT}
    steps, samples = round(0.01 / dt), round(SHORT / 0.01)

    def follow(simulation):
        angle, rate = simulation.gait_reference(1)
        return angle[0], rate[0]

    commanded = run(SCENE, values, controller=follow)
    assert count[0] <= 6  # steps go on in place
    other = Simulation(load_scene(SCENE, values))
    for k in range(1, samples + 1):
        (angle, rate), age = other.gait_reference(1), other.midpoints(steps) - other.time
        rate = np.repeat(rate, steps, axis=0)
        other.advance(angle + age[:, None, None] * rate, rate)
        assert (commanded.position[k] == other.state.position).all()
        assert (commanded.joint_torque[k] == other.joint_torque).all()
    assert commanded.report.iterations == other.report.iterations

    def gait(simulation):
        return lambda times: reference(simulation.scene.gait, times, 10)

    commanded, wave = run(SCENE, values, controller=gait), run(SCENE, values)
    for name in ('position', 'orientation', 'joint_torque', 'level'):
        assert (getattr(commanded, name) == getattr(wave, name)).all()
        for name in ('contact_sample', 'contact_number'):
            assert (getattr(commanded, name) == getattr(wave, name)).all()
        assert commanded.contact_force == pytest.approx(wave.contact_force, rel=1e-12, abs=1e-12)


def test_a_loop_of_ones_own():
    simulation = Simulation(SCENE)
    angle, rate = simulation.gait_reference(80)
    report = simulation.advance(angle, rate)
    assert report.steps == 80 and simulation.time == pytest.approx(0.02)
    state = simulation.state
    assert state.position.shape == (11, 3)
    assert np.abs(simulation.joint_angle - angle[-1].ravel()).max() < 0.1
    assert simulation.joint_velocity.shape == simulation.joint_torque.shape == (20,)
    assert simulation.advance(angle[-1:]).steps == 1  # rates of 0


def refused(**given):
    return lambda: run(SCENE, **{'duration': SHORT, **given})


RETURNS = (
    'must return angles [rad] of shape (20,), one for each joint axis, or (10, 2), (yaw, pitch) '
    'of every joint, or a tuple of angles and rates of such a shape, got '
)


@pytest.mark.parametrize(
    ('function', 'sentence'),
    [
        (refused(gait=lambda t: np.zeros(21)), f'gait(t) {RETURNS}(21,)'),
        (refused(gait=lambda t: 'no'), f'gait(t) {RETURNS}str'),
        (
            refused(gait=lambda t: (np.zeros((10, 2)), np.zeros((9, 2)))),
            f'gait(t) {RETURNS}(10, 2) and (9, 2)',
        ),
        (
            refused(controller=lambda s: np.zeros((9, 2))),
            f'controller(simulation) {RETURNS}(9, 2)',
        ),
        (refused(gait=lambda t: np.full((10, 2), np.nan)), 'angle must be finite, got nan rad'),
        (
            refused(gait=lambda t: np.full((10, 2), 1.0)),
            'amplitude plus offset of gait.yaw plus the largest angle of gait.table must be '
            'within the joint limit, +-0.7854 rad, got 1 rad',
        ),
        (refused(gait='no.csv'), 'gait.table: no file no.csv'),
        (refused(gait=5), 'gait must be a mapping of names to values, got 5'),
        (refused(gaits=5), "unknown name 'gaits'; did you mean 'gait'?"),
        (refused(friction={'x': 5}), 'unknown name'),
        (refused(rate=0), 'rate must be above 0 Hz and finite, got 0 Hz'),
        (refused(duration=-1), 'duration must be above 0 s, got -1 s'),
        (lambda: run(SCENE, {'dt': 0.01}, dt=0.01), 'dt is given twice, in the mapping and by'),
        (lambda: run(SCENE, 5), 'values must be a mapping of names to values, got 5'),
        (lambda: run(5), 'a scene must be a Scene, a YAML file or the name of a scene, got 5'),
        (lambda: run('sidewindin'), "no file sidewindin; did you mean 'sidewinding'?"),
        (lambda: Simulation('sidewindin'), "no file sidewindin; did you mean 'sidewinding'?"),
        (
            lambda: Simulation(SCENE).advance(np.zeros((10, 2))),
            'angle must be an array of shape (1, 10, 2) of float64, got shape (10, 2) of float64',
        ),
        (lambda: table_of(undulate, 0.0), 'duration must be above 0 s and finite, got 0.0 s'),
        (lambda: Table.of([0, 1], [1, 2]), 'angle must have the shape (rows, n-1, 2)'),
    ],
)
def test_errors_say_what_is_wrong_in_one_sentence(function, sentence):
    with pytest.raises(ParameterError) as caught:
        function()
    assert str(caught.value).startswith(sentence)
    assert '\n' not in str(caught.value)


# ---- worlds ----


def test_a_world_is_built_of_lists_and_arrays():
    field = HeightField(heights=np.full((3, 4), 0.02), cell=0.5, origin=np.array([-1.0, 2.0]))
    world = World(boxes=[Box(center=(1.0, 0.0, 0.1), grip=2.0)], height_fields=[field])
    as_mapping = {
        'boxes': [{'center': [1.0, 0.0, 0.1], 'grip': 2.0}],
        'height_fields': [{'heights': [[0.02] * 4] * 3, 'cell': 0.5, 'origin': [-1.0, 2.0]}],
    }
    scene = load_scene(SCENE, world=world)
    assert scene == load_scene(SCENE, world=as_mapping) and scene.world == world
    found = run(scene, duration=0.01, accuracy=0)
    assert found.report.overflows == 0 and found.scene.world == world


# ---- the page and the examples ------------------------------------------------------------------


def test_the_page_runs(tmp_path, monkeypatch):
    for package in ('matplotlib', 'polars'):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    assert len(BLOCKS) > 8
    names: dict[str, object] = {}
    for block in BLOCKS:
        exec(compile(block, 'docs/python.md', 'exec'), names)
    assert (tmp_path / 'run.png').is_file()


def test_the_page_names_everything_public():
    assert set(snake_sim_ros.__all__) <= set(re.findall(r'\w+', GUIDE))


def example(name, monkeypatch, capsys, *arguments):
    """Run an example as a script; return what it prints."""
    monkeypatch.setattr(sys, 'argv', [name, *map(str, arguments)])
    capsys.readouterr()
    runpy.run_path(str(ROOT / 'examples' / f'{name}.py'), run_name='__main__')
    return capsys.readouterr().out


def test_example_first_gait(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'gait.png'
    text = example('first_gait', monkeypatch, capsys, '--duration', 0.5, '--out', path)
    assert re.search(r'\d m at 0\.\d+ m/s\ncost of transport \d', text)
    assert path.read_bytes().startswith(b'\x89PNG')


def test_example_named_gaits(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'gaits.png'
    text = example('named_gaits', monkeypatch, capsys, '--duration', 0.5, '--out', path)
    assert len(re.findall(r'\d m, turned by -?\d+ degrees\n', text)) == 8
    assert path.read_bytes().startswith(b'\x89PNG')


def test_example_follow_a_path(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'following.png'
    text = example('follow_a_path', monkeypatch, capsys, '--duration', 1, '--out', path)
    assert len(re.findall(r'm of the path in 1 s, \d+\.\d mm beside it\n', text)) == 2
    assert path.read_bytes().startswith(b'\x89PNG')


def test_example_controllers(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    text = example('controllers', monkeypatch, capsys, '--share', 0.1, '--out', tmp_path)
    assert len(re.findall(r'0\.\d\d m beside the end of a course of 0\.6 m\n', text)) == 2
    for name in ('steering', 'blending', 'oscillators', 'obstacles'):
        assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')


def test_example_compliant(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'compliant.png'
    text = example('compliant', monkeypatch, capsys, '--duration', 5, '--out', path)
    found = re.findall(r'm, torques of \d\.\d\d N m at most, (\d\.\d\d) N m', text)
    alone, compliant = map(float, found)
    assert compliant < 0.9 * alone
    assert path.read_bytes().startswith(b'\x89PNG')


def test_example_own_controller(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'turned.png'
    text = example('own_controller', monkeypatch, capsys, '--duration', 1, '--plot', path)
    assert re.fullmatch(r't = 1 s: turned by -?\d+\.\d degrees\n', text)
    assert path.read_bytes().startswith(b'\x89PNG')


def test_example_own_robot(monkeypatch, capsys, tmp_path):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'ways.png'
    text = example('own_robot', monkeypatch, capsys, '--duration', 0.3, '--plot', path)
    assert path.read_bytes().startswith(b'\x89PNG')
    assert re.findall(r'friction (\S+): 0\.\d{4} m/s, \d\.\d\d J\n', text) == ['0.3', '0.5', '0.7']


def test_example_read_a_bag(monkeypatch, capsys, tmp_path):
    pytest.importorskip('mcap_ros2')
    path = tmp_path / 'run.mcap'
    assert cli.main(['run', SCENE, '--duration', str(SHORT), '--bag', str(path)]) == 0
    text = example('read_a_bag', monkeypatch, capsys, path)
    assert text.startswith('41 samples, 0.20 s, ends at (')
    assert re.search(r'largest torque \d\.\d\d N m, joint_\d+_yaw\ndistance: 0\.\d+', text)
