# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Disks without room, deleted caches and too little memory: one sentence that names the file."""

from contextlib import suppress
from pathlib import Path
import shutil

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

pytest.importorskip('mcap_ros2')  # bag_writer needs it
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader

from snake_sim_ros.commands import main as program
from snake_sim_ros.commands.main import main
from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.nodes.bag_writer import BagWriter, STATES

FULL = Path('/dev/full')
pytestmark = pytest.mark.skipif(not FULL.exists(), reason='this system has no /dev/full')


@pytest.mark.parametrize('option', ['out', 'csv'])
def test_a_full_disk_is_one_sentence_with_the_file(option, tmp_path, capsys):
    path = tmp_path / {'out': 'run.npz', 'csv': 'run.csv'}[option]
    path.symlink_to(FULL)
    assert main(['run', 'lateral_undulation', '--duration', '0.1', f'--{option}', str(path)]) == 2
    (line,) = (line for line in capsys.readouterr().err.splitlines() if 'snake-sim' in line)
    assert str(path) in line and 'No space left on device' in line
    assert path.is_symlink()  # what was there stays
    assert FULL.exists()


def test_a_bag_on_a_full_disk_says_how_to_read_it(tmp_path):
    path = tmp_path / 'bag.mcap'
    path.symlink_to(FULL)
    data = serialize_message(Float64MultiArray(data=np.random.default_rng(0).random(2000)))
    with pytest.raises(OSError, match='takes no more: No space left on device') as caught:
        with BagWriter(path) as bag:
            bag.add_topic('a', Float64MultiArray, STATES)
            for k in range(200):
                bag.write('a', k, data)
    assert str(path) in str(caught.value) and 'mcap recover' in str(caught.value)


def messages_in(path):
    """Return how many messages a bag has up to its end, wherever that is."""
    count = 0
    with path.open('rb') as file, suppress(McapError):
        for record in StreamReader(file).records:
            count += isinstance(record, Message)
    return count


def test_a_bag_whose_end_is_missing_has_its_messages(tmp_path):
    path = tmp_path / 'bag.mcap'
    data = serialize_message(Float64MultiArray(data=np.random.default_rng(0).random(2000)))
    with BagWriter(path) as bag:
        bag.add_topic('a', Float64MultiArray, STATES)
        for k in range(300):
            bag.write('a', k, data)
        bag._file.flush()
        shutil.copy(path, tmp_path / 'killed.mcap')
    assert messages_in(path) == 300
    assert 0 < messages_in(tmp_path / 'killed.mcap') < 300


def test_code_runs_although_its_cache_was_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(code_cache, 'FOLDER', tmp_path / 'deleted')

    @compiled
    def twice(x):
        return 2.0 * x

    assert twice(1.5) == 3.0


def test_too_little_memory_is_one_sentence(monkeypatch, capsys):
    def without_memory(_):
        raise MemoryError('Unable to allocate 5.74 GiB')

    monkeypatch.setattr(
        program, '_parser', lambda _: type('P', (), {'parse_args': staticmethod(without_memory)})
    )
    assert main(['run']) == 2
    said = capsys.readouterr().err
    assert said == 'snake-sim: not enough memory: Unable to allocate 5.74 GiB\n'
