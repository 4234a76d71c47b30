# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command snake-sim, its pictures, and the launchers of the nodes."""

from argparse import Namespace
import json
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time
from xml.etree import ElementTree

import numpy as np
import pytest

from snake_sim_ros import Robot
from snake_sim_ros.commands import scenes
from snake_sim_ros.commands.main import main
from snake_sim_ros.commands.options import scene_from
from snake_sim_ros.recording.bag_reader import read_bag
from snake_sim_ros.scene.parameters import load_scene, scene_from_text
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.view.chart import path_figure

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, 'PYTHONPATH': str(ROOT)}
PNG = b'\x89PNG\r\n\x1a\n'
KEYS = {
    'us_per_step',
    'real_time_factor',
    'residual_max',
    'unconverged_steps',
    'level',
    'method',
}


def test_run_records_and_ends_with_a_line_of_json(tmp_path, capsys):
    path = tmp_path / 'run.npz'
    arguments = [
        '--duration',
        '0.05',
        '--rate',
        '200',
        '--set',
        'friction.longitudinal=0.25',
        '--accuracy',
        '0',
    ]
    assert main(['run', 'lateral_undulation', '--out', str(path), *arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    summary = json.loads(lines[-1])
    assert set(summary) >= KEYS
    assert (summary['level'], summary['method']) == ('planar', 'newton')
    assert 0 <= summary['unconverged_steps'] < 200 == summary['steps']
    assert summary['us_per_step'] > 0
    # Steps of 250 us
    factor = 250 / summary['us_per_step']
    assert summary['real_time_factor'] == pytest.approx(factor, rel=1e-9)
    assert '11 samples in' in lines[-2]
    with np.load(path) as data:
        assert data['position'].shape == (11, 11, 3)
        scene = scene_from_text(str(data['scene']))
    assert scene.friction.longitudinal == 0.25
    assert scene.duration == 0.05


@pytest.mark.parametrize(
    ('arguments', 'accuracy', 'dt', 'method'),
    [
        ([], 1e-3, 1 / 100, 'bdf2'),
        (['--accuracy', '1e-2'], 1e-2, 1 / 50, 'bdf2'),
        (['--set', 'accuracy=0.01'], 1e-2, 1 / 50, 'bdf2'),
        (['--accuracy', '1e-2', '--set', 'dt=0.01'], 1e-2, 1 / 100, 'bdf2'),
        (['--accuracy', '0'], 0.0, 1 / 4000, 'newton'),
        (['--set', 'dt=0.001'], 0.0, 1 / 1000, 'newton'),
        (['--set', 'dt=0.00025'], 0.0, 1 / 4000, 'newton'),
        (['--set', 'level=spatial'], 0.0, 1 / 4000, 'newton'),
        (['--method', 'newton'], 0.0, 1 / 4000, 'newton'),
        (['--set', 'pd_scheme=start'], 0.0, 1 / 4000, 'newton'),
    ],
)
def test_run_chooses_steps_by_accuracy_unless_told_how(
    arguments, accuracy, dt, method, tmp_path, capsys
):
    path = tmp_path / 'run.npz'
    options = ['--duration', '0.02', '--rate', '50', '--out', str(path), *arguments]
    assert main(['run', 'lateral_undulation', *options]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])['method'] == method
    with np.load(path) as data:
        scene = scene_from_text(str(data['scene']))
    assert (scene.accuracy, scene.dt, scene.method) == (accuracy, pytest.approx(dt), method)


def test_numbers_in_settings_are_written_as_usual(capsys):
    arguments = ['--duration', '0.001', '--rate', '1000', '--set', 'solver.tolerance=1e-8']
    assert main(['run', 'lateral_undulation', *arguments]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (
            ['lateral_undulation', '--set', 'friction.longitudnal=0.2'],
            "unknown name 'friction.longitudnal'; did you mean 'longitudinal'?",
        ),
        (
            ['lateral_undulation', '--set', 'friction.longitudinal'],
            "--set must be KEY=VALUE, got 'friction.longitudinal'",
        ),
        (
            ['lateral_undulation', '--set', 'friction.longitudinal=much'],
            "friction.longitudinal must be a number, got 'much'",
        ),
        (
            ['lateral_undulation', '--set', 'friction.longitudinal=-0.1'],
            'friction.longitudinal must be at least 0, got -0.1',
        ),
        (['lateral_undulation', '--set', 'gravity=[0, 0'], 'gravity'),
        (['lateral_undulation', '--accuracy', '-1'], 'accuracy must be at least 0, got -1'),
        (['lateral_undulation', '--accuracy', 'nan'], 'accuracy must be finite, got nan'),
        (['lateral_undulation', '--accuracy', '0.5'], 'accuracy must be at most 0.1, got 0.5'),
        (
            ['lateral_undulation', '--accuracy', '1e-3', '--method', 'newton'],
            'accuracy 0.001 needs method bdf2, which divides steps, or auto; got method newton',
        ),
        (
            ['lateral_undulation', '--accuracy', '1e-3', '--set', 'pd_scheme=start'],
            'pd_scheme start is explicit',
        ),
        (
            ['lateral_undulation', '--set', 'gait.yaw.amplitude=30'],
            'amplitude plus offset of gait.yaw must be within the joint limit, +-0.7854 rad, got '
            '30 rad; for degrees say gait.yaw.amplitude_deg',
        ),
        (['lateral_undulation', '--set', 'friction.rolling_deg=3'], 'friction.rolling_deg: rol'),
        (['aiko'], 'aiko is a robot, not a scene; scenes say "robot: aiko"'),
        (['sidewindin'], "no file sidewindin; did you mean 'sidewinding'? the scenes that come"),
        (['nowhere.yaml'], 'no file nowhere.yaml; the scenes that come with the package: '),
        (
            ['lateral_undulation', '--rate', '300', '--set', 'dt=0.00025'],
            'dt must divide the sampling period',
        ),
        (['lateral_undulation', '--rate', '0'], 'rate must be above 0 Hz and finite, got 0 Hz'),
        (['lateral_undulation', '--duration', '-1'], 'duration must be above 0 s, got -1 s'),
        (['lateral_undulation', '--duration', '1e9'], 'samples need more memory than there is'),
        (['lateral_undulation', '--out', 'nowhere/run.npz'], '--out: no folder'),
        (
            ['lateral_undulation', '--set', 'robot=aika'],
            '--set: robot: no file aika; did you mean',
        ),
        (
            ['lateral_undulation', '--set', 'friction={transversl: 1}'],
            "unknown name 'friction.transversl'; did you mean 'transversal'?",
        ),
        (
            ['lateral_undulation', '--method', 'magic'],
            "unknown method 'magic'; choose from: auto, bdf2, newton, paper",
        ),
        (
            ['lateral_undulation', '--method', 'bdf2', '--set', 'pd_scheme=start'],
            'pd_scheme start is explicit, and method bdf2 takes the controller at the end of a '
            'step; choose pd_scheme average or end, or method newton',
        ),
    ],
)
def test_unusable_arguments_of_run(arguments, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(scenes, 'compile_with_bar', lambda _: pytest.fail('it compiled'))
    assert main(['run', *arguments]) == 2
    told = [line for line in capsys.readouterr().err.splitlines() if 'snake-sim: ' in line]
    assert len(told) == 1
    assert sentence in told[0]


def test_set_takes_what_a_file_takes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'scene.yaml'
    path.write_text(
        'robot: slender\nfriction: {transversal: 0.3}\ngait: {yaw: {amplitude_deg: 20}}\n'
    )
    given = ['robot=slender', 'friction={transversal: 0.3}', 'gait={yaw: {amplitude_deg: 20}}']
    options = Namespace(set=given)
    (tmp_path / 'empty.yaml').write_text('{}')
    assert scene_from(options, 'empty') == load_scene(path)


def test_run_that_diverges_says_so_and_saves_what_was_good(tmp_path, capsys):
    path = tmp_path / 'run.npz'
    settings = [
        '--set',
        'robot.yaw_damping=5.0',
        '--set',
        'pd_scheme=start',
        '--duration',
        '0.05',
        '--rate',
        '2000',
    ]
    assert main(['run', 'lateral_undulation', '--out', str(path), *settings]) == 1
    output = capsys.readouterr()
    assert 'diverged: t = ' in output.err

    def refuse(constant):
        raise AssertionError(f'{constant} is no JSON')

    assert json.loads(output.out.splitlines()[-1], parse_constant=refuse)['status'] == 'diverged'
    with np.load(path) as data:
        assert np.isfinite(data['position']).all()


def test_ctrl_c_saves_what_was_recorded(tmp_path):
    pytest.importorskip('mcap_ros2')
    path, bag = tmp_path / 'run.npz', tmp_path / 'run.mcap'
    command = [
        sys.executable,
        '-u',
        '-m',
        'snake_sim_ros.commands',
        'run',
        'lateral_undulation',
    ]
    process = subprocess.Popen(
        [*command, '--duration', '10000', '--out', str(path), '--bag', str(bag)],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        told = b''
        begin = time.monotonic()
        # The bar shows simulated seconds once they pass.
        while b'| 0.00 of' in told[-400:] or b' of 10000 s' not in told:
            told += process.stderr.read1()
            assert time.monotonic() < begin + 60, told
        process.send_signal(signal.SIGINT)
        out, rest = process.communicate(timeout=20)
    finally:
        process.kill()
    assert b'Traceback' not in rest
    with np.load(path) as data:
        samples = len(data['time'])
        assert 2 <= samples == len(data['position']) < 1_000_000
    times = read_bag(bag).time
    assert len(times) - samples in (0, 1)  # The signal may come between the two.
    assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.005), abs=1e-9)
    assert set(json.loads(out.splitlines()[-1])) >= KEYS
    # The documentation of the command promises this status.
    assert process.returncode == 130


@pytest.mark.parametrize('samples', [1, 2, 50])
def test_path_figure(tmp_path, samples):
    rng = np.random.default_rng(0)
    path = tmp_path / 'path.png'
    path_figure(path, 'title', np.arange(samples) * 0.1, rng.random((samples, 11, 3)), 5)
    assert path.read_bytes().startswith(PNG)


def test_robot_of_a_scene_is_printed_as_a_urdf(capsys):
    assert main(['urdf', 'slender_undulation']) == 0
    robot = load_scene('slender_undulation').robot
    assert capsys.readouterr().out == robot_description(robot) + '\n'


@pytest.mark.parametrize(
    ('arguments', 'interfaces'),
    [([], ['position']), (['position', 'velocity'], ['position', 'velocity'])],
)
def test_urdf_has_a_controlled_system_where_asked_for(capsys, arguments, interfaces):
    assert main(['urdf', '--ros2-control', *arguments]) == 0
    system = ElementTree.fromstring(capsys.readouterr().out).find('ros2_control')
    joints = system.findall('joint')
    assert [joint.get('name') for joint in joints] == list(Robot().axis_names)
    for joint in joints:
        assert [item.get('name') for item in joint.findall('command_interface')] == interfaces
        states = [item.get('name') for item in joint.findall('state_interface')]
        assert states == ['position', 'velocity', 'effort']
    plugin = system.find('hardware/plugin').text
    assert plugin == 'joint_state_topic_hardware_interface/JointStateTopicSystem'


@pytest.mark.parametrize(
    ('interface', 'said'),
    [
        ('torque', "command interfaces are position, velocity, effort, got 'torque'"),
        ('effort', 'needs a robot that takes torques: robot.effort_commands is false'),
    ],
)
def test_command_interface_that_a_robot_does_not_have(capsys, interface, said):
    assert main(['urdf', '--ros2-control', interface]) != 0
    assert said in capsys.readouterr().err


def test_launcher_prints_the_urdf():
    command = ['sh', 'scripts/snake-sim', 'urdf']
    folder = Path(sys.executable).parent
    environment = {**ENVIRONMENT, 'PATH': f'{folder}{os.pathsep}{os.environ["PATH"]}'}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == robot_description(load_scene('lateral_undulation').robot) + '\n'


def test_missing_scene_ends_the_launchers_with_a_sentence():
    folder = Path(sys.executable).parent
    environment = {**ENVIRONMENT, 'PATH': f'{folder}{os.pathsep}{os.environ["PATH"]}'}
    processes = [
        subprocess.Popen(
            ['sh', f'scripts/{name}', '--ros-args', '-p', 'scene:=nowhere'],
            cwd=ROOT,
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in ('sim', 'gait')
    ]
    for process in processes:
        _, told = process.communicate(timeout=60)
        assert process.returncode == 2, told
        assert told.startswith('error: no file nowhere; the scenes that come with the package: ')
        assert 'Traceback' not in told


# Python without ROS 2: it is not found, whatever is installed.
WITHOUT_ROS = """
import sys

class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in ('rclpy', 'std_srvs', 'sensor_msgs'):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, Nothing())
"""
AS_MODULE = "import runpy; runpy.run_module('snake_sim_ros.nodes', run_name='__main__')"
AS_SCRIPT = 'from snake_sim_ros.nodes import __main__; sys.exit(getattr(__main__, name)())'
ONE_BY_ONE = """
for name in sys.argv[1:]:
    sys.argv[1:] = [name]
    try:
        {0}
    except SystemExit as end:
        print(name, end.code)
"""


@pytest.mark.parametrize('start', [AS_MODULE, AS_SCRIPT])
def test_nodes_say_that_they_need_ros(start):
    names = ['sim', 'gait', 'control', 'follow', 'viewer']
    done = subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS + ONE_BY_ONE.format(start), *names],
        env=ENVIRONMENT, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.stdout.splitlines() == [f'{name} 2' for name in names]
    for name, line in zip(names, done.stderr.splitlines(), strict=True):
        assert re.fullmatch(
            rf"error: {name} needs ROS 2 \(No module named '[\w.]+'\): source a ROS 2 "
            rf'installation, or ./run {name}',
            line,
        )


def test_without_ffmpeg_no_run_begins(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    monkeypatch.setattr(shutil, 'which', lambda name: None)
    monkeypatch.setattr(scenes, 'simulate', None)  # it would be called
    file = str(tmp_path / 'run.mp4')
    assert main(['run', 'lateral_undulation', '--mp4', file]) == 2
    assert 'an .mp4 needs ffmpeg' in capsys.readouterr().err
