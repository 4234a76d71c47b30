# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The attack with hostile files itself, and where the program writes: nowhere else."""

import json
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

from snake_sim_benchmarks.reliability.file_corpus import corpus
from snake_sim_benchmarks.reliability.file_readers import Answer, READERS
from snake_sim_benchmarks.reliability.files import content_of, Reader
from snake_sim_ros import ParameterError
from snake_sim_ros.dynamics.code_cache import FOLDER
from snake_sim_ros.recording import recorded_runs
from snake_sim_ros.recording.recorded_runs import load_arrays
from snake_sim_ros.studies.table import Journal

pytest.importorskip('mcap_ros2')  # the corpus has bags

# Prints the names of all files that the command opened to write, made, moved or removed.
WATCHED = """
import json, os, sys
touched = []
def note(event, arguments):
    if event == 'open' and isinstance(arguments[0], (str, bytes, os.PathLike)) and (
        isinstance(arguments[1], str) and set(arguments[1]) & set('wax+')
        or not isinstance(arguments[1], str)
        and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
    ):
        touched.append(os.fspath(arguments[0]))
    elif event in ('os.mkdir', 'os.remove', 'os.rename', 'os.rmdir', 'os.symlink', 'os.truncate'):
        touched.extend(str(item) for item in arguments if isinstance(item, (str, bytes)))
sys.addaudithook(note)
from snake_sim_ros.commands.main import main
code = main(sys.argv[1:])
print(json.dumps([os.path.abspath(str(name)) for name in touched]))
sys.exit(code)
"""


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """A folder of good files, and what makes hostile ones."""
    folder = tmp_path_factory.mktemp('files')
    return folder, corpus(folder)


def test_there_is_a_corpus_of_every_kind(files):
    assert files[1].keys() == READERS.keys()


@pytest.mark.parametrize('name', READERS)
def test_a_number_names_a_file_again(files, name):
    changes = files[1][name]
    contents = [content_of(name, 7, number, changes) for number in range(5)]
    if not name.endswith(('npz', 'mcap')):  # which have the time of their writing in them
        assert contents == [content_of(name, 7, number, changes) for number in range(5)]
    assert len({*contents, (files[0] / name).read_bytes()}) > 3


def test_a_reader_judges_and_is_replaced(files, monkeypatch):
    folder, changes = files
    with Reader('settings.txt', folder) as reader:
        for number in range(20):
            assert not reader.answer(
                content_of('settings.txt', 1, number, changes['settings.txt'])
            ).wrong
        reader._process.kill()
        assert 'the reader died' in reader.answer(b'dt=1').wrong
        assert reader.answer(b'dt=0.001').was_read
        monkeypatch.setattr(reader, '_answer', lambda content: Answer('', True, 6.0, 0.0))
        assert 'it took 6.0 s' in reader.answer(b'').wrong


def test_npz_files_that_unpack_to_very_much_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(recorded_runs, 'USUAL_BYTES', 10_000_000)
    path = tmp_path / 'bomb.npz'
    np.savez_compressed(path, position=np.zeros(20_000_000, dtype=np.uint8))
    with pytest.raises(
        ParameterError, match='would unpack to 20000128 bytes, more than 100 times'
    ):
        load_arrays(path, '')


def test_npz_files_with_objects_of_python_are_refused(tmp_path):
    path = tmp_path / 'objects.npz'
    np.savez(path, position=np.array([{}, []], dtype=object))
    with pytest.raises(ParameterError, match='is not a whole npz file'):
        load_arrays(path, '')


def test_a_command_writes_its_outputs_and_the_cache_only(tmp_path, monkeypatch):
    out, here, temporary = (tmp_path / name for name in ('out', 'here', 'temporary'))
    for folder in (out, here, temporary):
        folder.mkdir()
    monkeypatch.setenv('TMPDIR', str(temporary))
    monkeypatch.setenv('PYTHONDONTWRITEBYTECODE', '1')
    run = [
        *('run', 'lateral_undulation', '--out', str(out / 'run.npz'), '--duration', '0.05'),
        *('--set', 'method=newton', '--set', 'robot.link_count=3', '--set', 'dt=0.0025'),
        *('--accuracy', '0'),
    ]
    for arguments in (run, ['export', str(out / 'run.npz'), '--csv', str(out / 'run.csv')]):
        found = subprocess.run(
            [sys.executable, '-c', WATCHED, *arguments],
            cwd=here, capture_output=True, text=True, check=False, timeout=200,
        )  # fmt: skip
        assert found.returncode == 0, found.stderr
        touched = [Path(name) for name in json.loads(found.stdout.splitlines()[-1])]
        assert any(path.is_relative_to(out) for path in touched)
        for path in touched:
            places = (out, temporary, FOLDER.parent, Path('/dev'), Path('/proc'))
            assert any(path.is_relative_to(place) for place in places), path
    assert not [*here.iterdir(), *temporary.iterdir()]


def test_a_journal_of_hostile_lines_is_read(tmp_path):
    path = tmp_path / 'study.journal'
    run = {
        'key': 'a', 'status': 'diverged', 'failure': '', 'unconverged': 0, 'seconds': 1.0,
        'metrics': {},
    }  # fmt: skip
    broken = [run | {'key': 1}, run | {'metrics': {'speed': [1]}}, {'key': 'a'}]
    lines = '\n'.join(map(json.dumps, [*broken, run]))
    path.write_text(f'{"[" * 100_000}\n{lines}\n[1]\n{"9" * 5000}\n{{"row": 2')
    journal = Journal(path)
    assert journal.runs() == [run]
    journal.close()
