# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outputs that cannot be written whole leave what was there, as when the disk is full."""

from contextlib import contextmanager
from pathlib import Path
import resource
from types import SimpleNamespace

from gliding import glide
import pytest

from snake_sim_ros import ParameterError, Robot, Scene, Simulation
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.recording.recorded_runs import write_csv, write_npz
from snake_sim_ros.scene.files import whole_file, write_figure, write_whole
from snake_sim_ros.studies import chart as study_chart, judgement, optimization, table
from snake_sim_ros.studies.metrics import METRICS
from snake_sim_ros.view import chart
from snake_sim_ros.view.animation import animate

pytest.importorskip('polars')


ROOM = 64  # bytes, fewer than any output has
SCENE = Scene(robot=Robot(link_count=2))
RUN = glide(samples=3)
FRAME = table.library().DataFrame({'row': range(20), 'dt': range(20), 'speed': range(20)})


def objectives(*names):
    return [SimpleNamespace(expression=SimpleNamespace(text=name)) for name in names]


# What draws, without what it draws, and what was found, without how.
BEST = SimpleNamespace(point=SimpleNamespace(number=3))
OUTCOME = SimpleNamespace(
    problem=SimpleNamespace(
        objectives=[SimpleNamespace(expression=SimpleNamespace(text='speed'))]
    ),
    best=[BEST],
    scenes=[SCENE],
    objectives_of=lambda item: [0.0],
)
FIT = SimpleNamespace(unknowns=[], values=[], x=[])


def scene_of_optimization(path):
    optimization.write_scenes(OUTCOME, path.parent / path.name.replace('.best.yaml', '.csv'))


def picture_of_optimization(path):
    study_chart.draw_optimization(OUTCOME, path)


OUTPUTS = {
    'run.npz': lambda path: write_npz(RUN, path),
    'run.csv': lambda path: write_csv(RUN, path),
    'run.gif': lambda path: animate(RUN, path),
    'run.mp4': lambda path: animate(RUN, path),
    'run.png': lambda path: chart.draw(RUN, path),
    'run.pdf': lambda path: chart.draw(RUN, path),
    'checkpoint.npz': lambda path: checkpoint.write(Simulation(SCENE), path),
    'path.png': lambda path: chart.path_figure(path, '', RUN.time, RUN.position, 0),
    'study.csv': lambda path: table.write(FRAME, path),
    'study.parquet': lambda path: table.write(FRAME, path),
    'study.png': lambda path: study_chart.draw_study(FRAME, ['dt'], {}, [METRICS['speed']], path),
    'gait.best.yaml': scene_of_optimization,
    'gait.png': picture_of_optimization,
    'fit.yaml': lambda path: judgement.write_scene(FIT, SCENE, Path('bag.mcap'), path),
    'fit.png': lambda path: study_chart.draw_fit(FIT, path),
    'table.md': lambda path: write_whole(path, 'a' * 2 * ROOM),
}


@contextmanager
def no_room():
    """Let files have no more than some bytes, which ends a write as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def drawing_nothing(monkeypatch):
    """Let pictures be empty, for which nothing needs to be found, and which take no time."""

    def write_empty(figure, path, **how):
        figure.clear()
        write_figure(figure, path, **how)

    for module in (chart, study_chart):
        monkeypatch.setattr(module, 'write_figure', write_empty)
    for name in ('_draw_growth', '_draw_over_time', '_draw_distribution', '_draw_segments'):
        monkeypatch.setattr(study_chart, name, lambda *_: None)
    for name in ('_path', '_forces', '_joints'):
        monkeypatch.setattr(chart, name, lambda *_: None)


@pytest.mark.usefixtures('drawing_nothing')
@pytest.mark.parametrize('name', OUTPUTS)
def test_what_was_there_survives_a_full_disk(name, tmp_path):
    path, write = tmp_path / name, OUTPUTS[name]
    if path.suffix == '.mp4':
        pytest.importorskip('imageio_ffmpeg')
    write(path)  # what is imported and cached at the first time has room
    path.write_bytes(b'old')
    others = {*tmp_path.iterdir()}
    with no_room(), pytest.raises((OSError, ParameterError)) as caught:
        write(path)
    assert str(path) in str(caught.value) or 'ffmpeg' in str(caught.value)
    assert path.read_bytes() == b'old'
    assert {*tmp_path.iterdir()} == others
    write(path)
    assert len(path.read_bytes()) > ROOM


def test_scenes_of_a_front_survive_a_full_disk(tmp_path):
    found = {'problem': SimpleNamespace(objectives=objectives('speed', 'slip'))}
    found['objectives_of'] = lambda item: [0.0, 1.0]
    outcome = SimpleNamespace(**vars(OUTCOME) | found)
    folder = tmp_path / 'gait.front'
    folder.mkdir()
    for k in (1, 2):
        (folder / f'0{k}.yaml').write_text('old')
    with no_room(), pytest.raises(OSError, match='File too large'):
        optimization.write_scenes(outcome, tmp_path / 'gait.csv')
    assert [path.read_text() for path in sorted(folder.iterdir())] == ['old', 'old']
    optimization.write_scenes(outcome, tmp_path / 'gait.csv')
    (found,) = folder.iterdir()  # what does not belong to the new front is gone
    assert found.read_text() != 'old'


def test_links_and_permissions_stay(tmp_path):
    path, link = tmp_path / 'file', tmp_path / 'link'
    path.write_text('old')
    path.chmod(0o640)
    link.symlink_to(path)
    write_whole(link, 'new')
    assert link.is_symlink() and path.read_text() == 'new'
    assert path.stat().st_mode & 0o777 == 0o640


def test_an_error_of_the_writer_leaves_no_part(tmp_path):
    path = tmp_path / 'file.npz'
    with pytest.raises(ValueError, match='not the disk'), whole_file(path) as part:
        part.write_text('half')
        raise ValueError('not the disk')
    assert part.parent == tmp_path and part.suffix == '.npz' and '.part.' in part.name
    assert not [*tmp_path.iterdir()]
