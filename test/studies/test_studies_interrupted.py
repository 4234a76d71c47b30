# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Studies that are killed and go on, and a Dask cluster that loses a worker."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest
from stopped_commands import DEADLINE, ENVIRONMENT, rows_of, stopped, wait_for

from snake_sim_ros.commands.main import main
from snake_sim_ros.studies import workers
from snake_sim_ros.studies.study import load_study, run_study
from snake_sim_ros.studies.table import journal_of

polars = pytest.importorskip('polars')
# Rows of some 20 ms, enough for chunks of several sizes.
STUDY = """
scene: lateral_undulation
set: {duration: 5.0}
vary:
  friction.transversal: {low: 0.2, high: 0.6, count: 50}
  friction.longitudinal: [0.1, 0.15]
metrics: [speed, slip, energy]
"""


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp('study') / 'my.yaml'
    path.write_text(STUDY)
    return load_study(path)


@pytest.fixture(scope='module')
def expected(study):
    """Return the table of one thread."""
    return run_study(study, workers=workers.threads(1)).drop('seconds')


def go_on(folder, capsys):
    """Start a study again in this process; return its summary and its table."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        assert main(['study', 'my.yaml']) == 0
    finally:
        os.chdir(before)
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    return summary, polars.read_parquet(folder / 'my.parquet').drop('seconds')


def test_a_killed_study_goes_on(tmp_path, expected, capsys):
    (tmp_path / 'my.yaml').write_text(STUDY)
    journal = journal_of(tmp_path / 'my.parquet')
    stopped(['study', 'my.yaml', '--threads', '2'], tmp_path, journal, rows=5)
    done = rows_of(journal)
    assert 5 <= done < len(expected)
    summary, table = go_on(tmp_path, capsys)
    assert (summary['found'], summary['done']) == (done, len(expected))
    assert table.equals(expected)
    assert not journal.exists()


def test_ctrl_c_keeps_the_rows_that_are_done(tmp_path, expected, capsys):
    (tmp_path / 'my.yaml').write_text(STUDY)
    journal = journal_of(tmp_path / 'my.parquet')
    command = ['study', 'my.yaml', '--threads', '2']
    status, output, errors = stopped(command, tmp_path, journal, rows=5, by=signal.SIGINT)
    assert status == 130 and 'Traceback' not in errors, errors
    summary = json.loads(output.splitlines()[-1])
    assert 5 <= summary['done'] < summary['rows'] == len(expected)
    assert len(polars.read_parquet(tmp_path / 'my.parquet')) == summary['done']
    assert not journal.exists()
    again, table = go_on(tmp_path, capsys)
    assert again['found'] == summary['done']
    assert table.equals(expected)


@pytest.fixture(scope='module')
def cluster(tmp_path_factory):
    """Return a client of a Dask scheduler with two workers, each a process of its own."""
    distributed = pytest.importorskip('distributed')
    folder = tmp_path_factory.mktemp('cluster')
    file = folder / 'scheduler.json'
    common = ['--scheduler-file', str(file), '--no-dashboard', '--host', '127.0.0.1']
    commands = [
        ['scheduler', *common, '--port', '0'],
        *[['worker', *common, '--nthreads', '1', '--no-nanny']] * 2,
    ]
    processes = []
    try:
        for number, command in enumerate(commands):
            log = (folder / f'{number}.txt').open('w')
            processes.append(subprocess.Popen(
                [sys.executable, '-m', 'dask', *command],
                cwd=folder, env=ENVIRONMENT, stdout=log, stderr=subprocess.STDOUT,
            ))  # fmt: skip
            wait_for(file.exists, (folder / '0.txt').read_text())
        with distributed.Client(scheduler_file=str(file), timeout=DEADLINE) as client:
            client.wait_for_workers(2, timeout=DEADLINE)
            yield client
    finally:
        for process in processes:
            process.kill()
            process.wait(DEADLINE)


def test_a_cluster_loses_a_worker_and_no_row(study, expected, cluster, tmp_path, capsys):
    address = cluster.scheduler.address
    pids, killed = cluster.run(os.getpid), []

    def kill_one(results, is_new):
        """Kill a worker that has runs under way, once some are done."""
        busy = [worker for worker, tasks in cluster.processing().items() if tasks]
        if is_new and busy and not killed:
            killed.append(pids[busy[0]])
            os.kill(killed[0], signal.SIGKILL)

    table = run_study(study, None, None, workers.cluster(address), kill_one)
    assert killed
    assert len(cluster.nthreads()) == 1
    assert table.drop('seconds').equals(expected)
    # The worker that is left does a study of the command.
    (tmp_path / 'my.yaml').write_text(STUDY)
    out = tmp_path / 'out.csv'
    arguments = [str(tmp_path / 'my.yaml'), '--scheduler', address, '--out', str(out)]
    assert main(['study', *arguments]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])['done'] == len(expected)
    assert polars.read_csv(out)['speed'].to_list() == expected['speed'].to_list()


def test_a_scheduler_that_is_not_there_is_one_sentence(tmp_path, monkeypatch, capsys):
    pytest.importorskip('distributed')
    monkeypatch.setattr(workers, 'CONNECT_SECONDS', 1)
    (tmp_path / 'my.yaml').write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    assert main(['study', 'my.yaml', '--scheduler', 'tcp://127.0.0.1:1']) == 2
    errors = capsys.readouterr().err.splitlines()
    assert 'no Dask scheduler answers at tcp://127.0.0.1:1' in errors[-1]
