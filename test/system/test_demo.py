# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live demonstration, as a user starts it: three processes, a summary and a picture."""

from io import StringIO
import os
from pathlib import Path
import re
import signal
import sys
import time
from types import SimpleNamespace

from forks import command, Forked, run_command
from programs import next_domain, Process, ROOT
import pytest
from tqdm import tqdm

from snake_sim_ros.commands import main as cli
from snake_sim_ros.nodes.tools import child_nodes
from snake_sim_ros.nodes.tools.demo import _show

PNG = b'\x89PNG\r\n\x1a\n'
RUNNING = 't = '  # of the progress line


def end(process):
    """End a demonstration and its nodes by force."""
    process.kill()
    for pid in nodes_of(process).values():
        if is_alive(pid):
            os.kill(pid, signal.SIGKILL)


LONG = ('--duration', '100')  # s, longer than any test waits


@pytest.fixture
def ended():
    """Return a list of demonstrations that are ended with the test."""
    processes = []
    yield processes
    for process in processes:
        end(process)


# In place of a node: it says nothing of itself, and takes its time to end.
SLOW = """
import signal, sys, time
signal.signal(signal.SIGINT, lambda *_: time.sleep(0.3) or sys.exit())
while True:
    time.sleep(60)
"""


def run_with_slow_nodes(*words):
    """Run a command whose nodes are such programs."""
    popen = child_nodes.subprocess.Popen
    child_nodes.subprocess = SimpleNamespace(**vars(child_nodes.subprocess))
    child_nodes.subprocess.Popen = lambda command, **options: popen(
        [sys.executable, '-S', '-c', SLOW, *command[1:]], **options
    )
    return run_command(*words)


@pytest.fixture
def starting(compiled, ended):
    """Return a demonstration that waits for its first node, which is slow."""
    words = ('demo', 'sidewinding', *LONG)
    ended.append(Forked(run_with_slow_nodes, *words, domain=next_domain()))
    ended[-1].wait_for('starting')
    return ended[-1]


def nodes_of(process):
    """Return the process ids of the nodes that a demonstration started, by name."""
    found = re.findall(r'started (\w+), process (\d+)', process.output)
    return {name: int(pid) for name, pid in found}


def is_alive(pid):
    """Return whether a node with this process id runs."""
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
        return state != 'Z' and 'snake_sim_ros' in Path(f'/proc/{pid}/cmdline').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def assert_no_orphans(process, names=('gait', 'sim')):
    nodes = nodes_of(process)
    assert sorted(nodes) == [*names]
    deadline = time.monotonic() + 5.0
    while (left := [name for name, pid in nodes.items() if is_alive(pid)]) and (
        time.monotonic() < deadline
    ):
        time.sleep(0.01)
    assert not left, f'left running: {left}\n{process.output}'


def test_whole_demonstration(compiled, tmp_path):
    path = f'PATH={Path(sys.executable).parent}:{os.environ["PATH"]}'
    command = ['env', path, str(ROOT / 'run'), 'demo', '--duration', '1', '--out', 'demo.png']
    process = Process(command, next_domain(), tmp_path)
    try:
        assert process.wait(60) == 0, process.output
    finally:
        end(process)
    assert re.search(
        r't = +(?:0\.9|1\.0)\d s   link 6 at \([+-]\d\.\d{3}, [+-]\d\.\d{3}\) m   '
        r'real-time factor \S+   residual \S+ m/s',
        process.output,
    ), process.output
    assert re.search(
        r'link 6 went from \(-?0\.0\d+, -?0\.\d+\) to \(.*\) m in (?:0\.9|1\.0)\d s: 0\.\d+ m',
        process.output,
    ), process.output
    assert re.search(r'^wait for compiler    \d+\.\d s$', process.output, re.MULTILINE)
    for line in (
        'method               newton',
        'unconverged steps    0',
        'rejected commands    0',
    ):
        assert line in process.output
    assert (tmp_path / 'demo.png').read_bytes().startswith(PNG)
    assert_no_orphans(process)


@pytest.mark.parametrize('doing', ['compiling, 3 s so far', 'starting'])
def test_bar_says_what_the_gait_waits_for(doing):
    bar = tqdm(total=15.0, file=StringIO())
    _show(bar, SimpleNamespace(begin=None, doing=doing, values={}), 5)
    assert bar.n == 0.0
    assert doing in bar.desc


def test_bar_says_that_the_gait_waits_for_the_compiler():
    bar = tqdm(total=15.0, file=StringIO())
    doing = 'compiling, 60 s so far: simulated time waits for the spatial level'
    _show(bar, SimpleNamespace(begin=1.0, times=[4.0], doing=doing, values={}), 5)
    assert bar.n == 3.0 and doing in bar.desc


def test_interruption_ends_everything(compiled, ended, tmp_path):
    words = ['demo', 'lateral_undulation', *LONG, '--out', str(tmp_path / 'endless.png')]
    process = command(words, next_domain())
    ended.append(process)
    process.wait_for(RUNNING, 60)
    assert process.stop(signal.SIGINT) == 130, process.output
    assert 'Traceback' not in process.output
    assert 'interrupted' in process.lines
    assert_no_orphans(process)


def test_second_interruption_leaves_no_orphans(starting):
    starting.popen.send_signal(signal.SIGINT)
    time.sleep(0.05)  # while it waits for its node to end
    assert starting.popen.poll() is None
    assert starting.stop(signal.SIGINT) in (1, 130), starting.output
    assert_no_orphans(starting, ['sim'])


def test_death_of_a_node_is_told_in_one_sentence(starting):
    os.kill(nodes_of(starting)['sim'], signal.SIGKILL)
    assert starting.wait() == 1, starting.output
    assert 'Traceback' not in starting.output
    assert starting.count('snake-sim demo: sim ended with status -9') == 1, starting.output
    assert_no_orphans(starting, ['sim'])


def test_unusable_arguments(capsys, tmp_path):
    scene = tmp_path / 'mine.yaml'
    scene.write_text('gait: {yaw: {amplitude: 30}}')
    for arguments, sentence in (
        ((str(scene),), 'mine.yaml: amplitude plus offset of gait.yaw must be within the joint'),
        (('--out', f'{tmp_path}/nowhere/x.png'), f'--out: no folder {tmp_path}/nowhere'),
        (('nowhere',), 'no file nowhere; the scenes that come with the package: '),
        (('--duration', '0'), '--duration must be above 0 s, got 0 s'),
    ):
        assert cli.main(['demo', *arguments]) == 2
        printed = capsys.readouterr()
        assert printed.err.count('\n') == 1 and not printed.out
        assert printed.err.startswith(f'snake-sim: {sentence}')
