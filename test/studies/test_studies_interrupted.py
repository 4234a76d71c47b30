# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Studies that are killed and go on, and a Dask cluster that loses a worker."""

from concurrent.futures import Future
from contextlib import nullcontext
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
from threading import Thread

import pytest
from stopped_commands import DEADLINE, ENVIRONMENT, rows_of, SLOW, stopped, wait_for

from snake_sim_ros import ParameterError
from snake_sim_ros.commands.main import main
from snake_sim_ros.studies import workers
from snake_sim_ros.studies.study import load_study, run_study
from snake_sim_ros.studies.table import journal_of

polars = pytest.importorskip('polars')
# Rows of 0.1 s where they are held, enough for chunks of several sizes.
STUDY = """
scene: lateral_undulation
set: {duration: 0.2, robot.link_count: 3}
vary:
  friction.transversal: {low: 0.2, high: 0.6, count: 30}
  friction.longitudinal: [0.1, 0.15]
metrics: [speed, slip, energy, "slow:slow"]
"""


def write_study(folder):
    """Write the study and the module of its metric; return its file."""
    (folder / 'slow.py').write_text(SLOW)
    (folder / 'my.yaml').write_text(STUDY)
    return folder / 'my.yaml'


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    return load_study(write_study(tmp_path_factory.mktemp('study')))


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
    write_study(tmp_path)
    journal = journal_of(tmp_path / 'my.parquet')
    stopped(['study', 'my.yaml', '--threads', '2'], tmp_path, journal, rows=5)
    done = rows_of(journal)
    assert 5 <= done < len(expected)
    summary, table = go_on(tmp_path, capsys)
    assert (summary['found'], summary['done']) == (done, len(expected))
    assert table.equals(expected)
    assert rows_of(journal) == len(expected)


def test_ctrl_c_keeps_the_rows_that_are_done(tmp_path, expected, capsys):
    write_study(tmp_path)
    journal = journal_of(tmp_path / 'my.parquet')
    command = ['study', 'my.yaml', '--threads', '2']
    status, output, errors = stopped(command, tmp_path, journal, rows=5, by=signal.SIGINT)
    assert status == 130 and 'Traceback' not in errors, errors
    summary = json.loads(output.splitlines()[-1])
    assert summary['rows'] == len(expected)
    assert len(polars.read_parquet(tmp_path / 'my.parquet')) == summary['done']
    # The table may lack the chunk that entered the journal as the signal came.
    done = rows_of(journal)
    assert 5 <= done < len(expected) and 0 < summary['done'] <= done
    again, table = go_on(tmp_path, capsys)
    assert again['found'] == done
    assert table.equals(expected)


@pytest.fixture(scope='module')
def cluster(tmp_path_factory):
    """
    Return a client of a Dask scheduler, and a file that holds its rows.

    It has two workers, each a process of its own.
    """
    distributed = pytest.importorskip('distributed')
    folder = tmp_path_factory.mktemp('cluster')
    (folder / 'slow.py').write_text(SLOW)
    (folder / 'hold').touch()
    environment = {**ENVIRONMENT, 'PYTHONPATH': f'{ENVIRONMENT["PYTHONPATH"]}{os.pathsep}{folder}'}
    worker = ['worker', '--no-dashboard', '--nthreads', '1', '--no-nanny']
    processes = []
    try:
        with distributed.LocalCluster(n_workers=0, dashboard_address=None) as scheduler:
            for number in range(2):
                log = (folder / f'{number}.txt').open('w')
                processes.append(subprocess.Popen(
                    [sys.executable, '-m', 'dask', *worker, scheduler.scheduler_address],
                    cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT,
                ))  # fmt: skip
            with distributed.Client(scheduler.scheduler_address, timeout=DEADLINE) as client:
                client.wait_for_workers(2, timeout=DEADLINE)
                yield client, folder / 'hold'
    finally:
        for process in processes:
            process.kill()
            process.wait(DEADLINE)


def test_a_cluster_loses_a_worker_and_no_row(study, expected, cluster, tmp_path, capsys):
    client, hold = cluster
    address = client.scheduler.address
    pids, killed = client.run(os.getpid), []

    def kill_one(results, is_new):
        """Kill a worker that has runs under way, once some are done."""
        busy = [worker for worker, tasks in client.processing().items() if tasks]
        if is_new and busy and not killed:
            killed.append(pids[busy[0]])
            os.kill(killed[0], signal.SIGKILL)
            hold.unlink()

    table = run_study(study, None, None, workers.cluster(address), kill_one)
    assert killed
    assert len(client.nthreads()) == 1
    assert table.drop('seconds').equals(expected)
    # The worker that is left does a study of the command.
    out = tmp_path / 'out.csv'
    arguments = [str(write_study(tmp_path)), '--scheduler', address, '--out', str(out)]
    assert main(['study', *arguments]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])['done'] == len(expected)
    assert polars.read_csv(out)['speed'].to_list() == expected['speed'].to_list()


def test_a_scheduler_that_is_not_there_is_one_sentence(tmp_path, monkeypatch, capsys):
    pytest.importorskip('distributed')
    monkeypatch.setattr(workers, 'CONNECT_SECONDS', 1)
    write_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(['study', 'my.yaml', '--scheduler', 'tcp://127.0.0.1:1']) == 2
    errors = capsys.readouterr().err.splitlines()
    assert 'no Dask scheduler answers at tcp://127.0.0.1:1' in errors[-1]


def test_a_study_whose_scheduler_is_lost_goes_on(tmp_path, expected, monkeypatch, capsys, caplog):
    pytest.importorskip('distributed')
    monkeypatch.setattr(workers, 'CONNECT_SECONDS', 2)  # in which the client looks for it again
    monkeypatch.chdir(tmp_path)
    write_study(tmp_path)
    (tmp_path / 'hold').touch()
    environment = {
        **ENVIRONMENT, 'PYTHONPATH': f'{ENVIRONMENT["PYTHONPATH"]}{os.pathsep}{tmp_path}'
    }  # fmt: skip
    found, journal = tmp_path / 'scheduler.json', journal_of(tmp_path / 'my.parquet')
    common = '--no-dashboard', '--scheduler-file', str(found)
    commands = ['scheduler', '--port', '0', *common], ['worker', '--no-nanny', *common]
    processes = [
        subprocess.Popen(
            [sys.executable, '-m', 'dask', *command], env=environment,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for command in commands
    ]  # fmt: skip

    def lose_scheduler():
        wait_for(lambda: rows_of(journal) >= 5, 'no rows')
        processes[0].kill()

    try:
        wait_for(lambda: found.is_file() and found.read_text().endswith('}'), 'no scheduler')
        losing = Thread(target=lose_scheduler)
        losing.start()
        address = json.loads(found.read_text())['address']
        assert main(['study', 'my.yaml', '--scheduler', address]) == 2
        losing.join(DEADLINE)
    finally:
        for process in processes:
            process.kill()
            process.wait(DEADLINE)
    errors = capsys.readouterr().err.strip().splitlines()
    assert errors[-1].endswith(workers.GONE)
    assert not any('Traceback' in line for line in [*errors, caplog.text])
    done = rows_of(journal)
    assert 5 <= done < len(expected)
    (tmp_path / 'hold').unlink()
    summary, table = go_on(tmp_path, capsys)
    assert summary['found'] == done
    assert table.equals(expected)


def test_a_cluster_without_workers_is_one_sentence(study, monkeypatch):
    distributed = pytest.importorskip('distributed')
    monkeypatch.setattr(workers, 'WORKER_SECONDS', 0.2)
    with distributed.LocalCluster(n_workers=0, dashboard_address=None) as scheduler:
        pool = workers.cluster(scheduler.scheduler_address)
        with pytest.raises(ParameterError, match=r'has had no worker for 0\.2 s: start one with'):
            run_study(study, workers=pool)


def test_a_module_that_the_cluster_lacks_is_one_sentence(study):
    future = Future()
    future.set_exception(ModuleNotFoundError("No module named 'slow'", name='slow'))
    pool = workers.Workers(lambda plan, rows: future, lambda: 1)
    with pytest.raises(ParameterError, match='has no module slow, which a metric of the study'):
        run_study(study, workers=nullcontext(pool))
