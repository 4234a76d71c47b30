# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands that write, convert and show recorded runs: their results and their errors."""

import csv
import socket
import sys

import numpy as np
import pytest

from snake_sim_ros.commands.main import main
from snake_sim_ros.recording.recorded_runs import read_npz


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """Return the folder of a run in three formats."""
    pytest.importorskip('mcap_ros2')
    folder = tmp_path_factory.mktemp('runs')
    files = [f'--{name}={folder / f"run{end}"}' for name, end in
             (('out', '.npz'), ('csv', '.csv'), ('bag', '.mcap'))]  # fmt: skip
    assert main(['run', 'lateral_undulation', '--duration', '0.1', *files]) == 0
    return folder


def test_formats_agree(recorded, tmp_path):
    trajectory = read_npz(recorded / 'run.npz')
    # The rate is that of `sim`, because one of the files is a bag.
    assert trajectory.time == pytest.approx(np.arange(21) * 0.005, abs=1e-15)
    assert main(['export', str(recorded / 'run.mcap'), '--csv', str(tmp_path / 'bag.csv'),
                 '--out', str(tmp_path / 'bag.npz')]) == 0  # fmt: skip
    assert np.array_equal(read_npz(tmp_path / 'bag.npz').position, trajectory.position)
    rows = {}
    for path in (recorded / 'run.csv', tmp_path / 'bag.csv'):
        with path.open(encoding='utf-8', newline='') as file:
            rows[path.name] = list(csv.reader(file))
    (names, *ours), (same_names, *theirs) = rows.values()
    assert names == same_names
    places = [k for k, name in enumerate(names) if name.endswith('[m]')]
    assert len(places) == 33
    assert all(a[k] == b[k] for a, b in zip(ours, theirs, strict=True) for k in places)


def test_rate_of_a_run_with_a_bag_may_be_another_one(tmp_path):
    pytest.importorskip('mcap_ros2')
    files = ['--out', str(tmp_path / 'run.npz'), '--bag', str(tmp_path / 'run.mcap')]
    assert main(['run', 'lateral_undulation', '--duration', '0.1', '--rate', '50', *files]) == 0
    assert len(read_npz(tmp_path / 'run.npz').time) == 6


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['run', 'step', '--csv', 'run.txt'], '--csv must end in .csv, got run.txt'),
        (['run', 'step', '--gif', 'run.mp4'], '--gif must end in .gif, got run.mp4'),
        (['run', 'step', '--bag', 'run'], '--bag must end in .mcap, got run'),
        (['run', 'step', '--bag', 'nowhere/run.mcap'], '--bag: no folder'),
        (['run', 'step', '--gif', 'a.gif', '--speed', '0'], '--speed must be above 0 and finite'),
        (
            ['run', 'step', '--mp4', 'a.mp4', '--speed', 'nan'],
            '--speed must be above 0 and finite',
        ),
        (['score', 'run.npz', '--controller', 'gait'], '--controller must go with a scene, which'),
        (['export', 'run.npz'], 'nothing to write: give one of --out, --csv, --gif and --mp4'),
        (['export', 'run.npz', '--csv', 'run.csv'], 'no file run.npz'),
        (['export', 'run.db3', '--csv', 'run.csv'], 'ends in .npz or .mcap, or is the folder of'),
        (['view', 'run.npz'], 'no file run.npz'),
        (['view', 'run.mcap'], 'no file run.mcap'),
        (['view', 'run.db3'], 'ends in .npz or .mcap, or is the folder of a bag; got run.db3'),
        (
            ['view', 'sidewnding'],
            "no file sidewnding; did you mean 'sidewinding'? the scenes that come with the ",
        ),
        (['view', '--port', '70000'], 'port must be 0 (any free one) to 65535, got 70000'),
        (['view', '--host', '192.0.2.1'], "host must be an address of this machine, got '192.0"),
    ],
)
def test_what_is_refused(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith('snake-sim: ')
    assert sentence in told
    assert not list(tmp_path.iterdir())


def test_a_bag_is_not_overwritten(tmp_path, capsys):
    path = tmp_path / 'kept.mcap'
    path.write_bytes(b'kept')
    assert main(['run', 'step', '--bag', str(path)]) == 2
    assert f'--bag: {path} exists; name another file' in capsys.readouterr().err
    assert path.read_bytes() == b'kept'


def test_bags_and_runs_that_are_not_usable_are_not_shown(recorded, tmp_path, capsys):
    half, old = tmp_path / 'half.mcap', tmp_path / 'old.npz'
    half.write_bytes((recorded / 'run.mcap').read_bytes()[:5000])
    with np.load(recorded / 'run.npz') as file:
        np.savez(old, **{**{name: file[name] for name in file.files}, 'format': 1})
    for path, sentence in ((half, 'is truncated'), (old, 'is a run in format 1, of another')):
        assert main(['view', str(path), '--no-browser']) == 2
        (told,) = capsys.readouterr().err.splitlines()
        assert told.startswith(f'snake-sim: {path} {sentence}')


def test_port_in_use(recorded, capsys):
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = str(server.getsockname()[1])
        for source in ([str(recorded / 'run.npz')], ['sidewinding'], []):
            assert main(['view', *source, '--port', port, '--no-browser']) == 2
            (told,) = capsys.readouterr().err.splitlines()
            assert f'port {port} of 127.0.0.1 is in use; choose another one' in told


@pytest.mark.parametrize(
    ('module', 'arguments', 'sentence'),
    [
        (
            'snake_sim_ros.nodes.bag_writer',
            ['run', 'step', '--bag', 'a.mcap'],
            '--bag needs ROS 2',
        ),
        (
            'snake_sim_ros.nodes.tools.topic_recorder',
            ['record', 'a.mcap'],
            'record needs ROS 2 and mcap',
        ),
        ('snake_sim_ros.nodes.tools.live_view', ['view'], 'a live view needs ROS 2'),
        (
            'snake_sim_ros.view.animation',
            ['run', 'step', '--gif', 'a.gif'],
            'animations need matplotl',
        ),
        ('mcap.reader', ['export', 'run.mcap', '--csv', 'a.csv'], "'snake_sim_ros[bags]'"),
        ('viser', ['view', 'run.npz', '--no-browser'], "'snake_sim_ros[viewer]'"),
    ],
)
def test_what_is_not_installed(module, arguments, sentence, recorded, monkeypatch, capsys):
    monkeypatch.chdir(recorded)
    monkeypatch.setitem(sys.modules, module, None)
    assert main(arguments) == 2
    told = [line for line in capsys.readouterr().err.splitlines() if 'snake-sim: ' in line]
    assert len(told) == 1
    assert sentence in told[0]
