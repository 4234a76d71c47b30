# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables, charts and figures that cannot be written whole leave what was there."""

from contextlib import contextmanager
import resource

from matplotlib.figure import Figure
import pytest

from snake_sim_benchmarks.comparison import chart_style
from snake_sim_benchmarks.comparison.csv_tables import TableWriter
from snake_sim_benchmarks.paper.figures import save_small

ROOM = 64  # bytes, fewer than any output has
ROW = {'case': 'a' * 2 * ROOM}


@contextmanager
def no_room():
    """Let files have no more than some bytes, which ends a write as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(
    ('name', 'write'),
    [
        ('bench.svg', lambda path: chart_style.save(Figure(), path, {})),
        ('paper.png', lambda path: save_small(Figure(), path)),
    ],
)
def test_pictures_survive_a_full_disk(name, write, tmp_path):
    path = tmp_path / name
    write(path)  # what is imported and cached at the first time has room
    path.write_bytes(b'old')
    others = {*tmp_path.iterdir()}
    with no_room(), pytest.raises(OSError, match=name):
        write(path)
    assert path.read_bytes() == b'old'
    assert {*tmp_path.iterdir()} == others
    write(path)
    assert len(path.read_bytes()) > ROOM


def test_rows_of_a_bench_survive_a_full_disk(tmp_path):
    path = tmp_path / 'bench.csv'
    TableWriter(path, 'bench', ['case']).append([ROW])
    text = path.read_text(encoding='utf-8') + 'a row that was cut short'
    path.write_text(text, encoding='utf-8')
    with no_room(), pytest.raises(OSError, match=r'bench\.csv cannot be written: File too large'):
        TableWriter(path, 'bench', ['case'])
    assert path.read_text(encoding='utf-8') == text
    assert [*tmp_path.iterdir()] == [path]
