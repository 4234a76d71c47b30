# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Every command of the README and of the pages that continue it, run in a folder of its own.

Commands and programs run in this process, and nodes in forked ones, but for one of each kind.
"""

import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time

import forks
from programs import next_domain
import pytest
from test_tour import LINES as TOUR

from snake_sim_ros.commands import main as cli

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
# Pages that continue the README. Those of one part, such as studies, have tests of their own.
NAMES = (
    'first_steps', 'installation', 'nodes', 'viewer', 'recording', 'command_line', 'scenes',
    'levels', 'methods', 'controllers', 'gaits',
)  # fmt: skip
PAGES = [README, *((ROOT / f'docs/{name}.md').read_text(encoding='utf-8') for name in NAMES)]


def blocks(language: str, pages: list[str]) -> list[str]:
    pattern = re.compile(rf'^```{language}\n(.*?)^```', re.MULTILINE | re.DOTALL)
    return [block for page in pages for block in pattern.findall(page)]


def lines(pages: list[str]) -> list[str]:
    """Return the commands of some pages, each once, without those of the tour."""
    found = dict.fromkeys(line for block in blocks('sh', pages) for line in block.splitlines())
    return [line for line in found if line not in TOUR]


# Commands of the laboratory, which benchmarks/test runs.
LABORATORY = ('bench', 'stability', 'levels', 'artefacts', 'chart', 'figures', 'pacing')
COMMANDS = [
    line for line in lines(PAGES) if not line.startswith(tuple(f'./run {n}' for n in LABORATORY))
]

# What is added to a command so that it ends soon, or what stands in for a tool that only a ROS 2
# installation has: `ros2 run` starts the launcher of that name.
SHORTENED = {
    './run test': '--collect-only -q test/scene/test_gait.py',
    './run run obstacle_aided': '--duration 0.5',
    './run run pegboard --set controller.name=compliance': '--duration 0.5',
    './run run examples/dense_pegs.yaml --set controller.name=obstacle_aided': '--duration 0.5',
    './run view sidewinding': '--no-browser --port 0',
    './run run sidewinding --out run.npz --csv run.csv --bag run.mcap --gif run.gif': (
        '--duration 0.5'
    ),
    './run run sidewinding --set gait.name=turn_in_place --set gait.side=right '
    '--gif turning.gif': '--duration 0.5',
    './run score lateral_undulation --set "follow={center: [0, -1.5]}" --begin 5 '
    '--plot score.png': '--duration 5.5',
    './run score lateral_undulation --controller oscillators --path "0,0 -5,0" --duration 10': (
        '--duration 1'
    ),
    './run run config/sidewinding.yaml --out run.npz': '--duration 1',
    './run run large_step --duration 40 --out run.npz': '--duration 0.5',
}
# In the same way, for programs in Python.
SHORTER = {'duration=5.0': 'duration=1.0', 'duration=2.0': 'duration=1.0', '40_000': '4_000'}
# What the commands of the README print, if no other test looks at it.
SHOWN = {
    './run test': r'\d+ tests collected',
    './run view sidewinding': r'http://\S+:\d+',
    './run run sidewinding --out run.npz': r'"status": "converged".*"unconverged_steps": 0',
}
# Commands of snake-sim that run in this process, which has compiled the steps already.
OFFLINE = ('run', 'study', 'export', 'score')
BY_LAUNCHER = './run run config/sidewinding.yaml --out run.npz'
BY_ROS = 'ros2 run snake_sim_ros follow --ros-args -p use_sim_time:=true'
# What a command with such a word in it needs, and rosdep does not install.
OPTIONAL = {'study': 'polars', 'mcap': 'mcap_ros2', 'view': 'viser', 'mp4': 'imageio_ffmpeg'}
# Commands that other tests run.
SPAWN = (
    'ros2 service call /sim/spawn_entity simulation_interfaces/srv/SpawnEntity "{name: two, '
    'entity_resource: {uri: snake_robot}, initial_pose: {pose: {position: {y: 1.0, z: 0.0525}}}}"'
)
PATH = (
    'ros2 topic pub --once /path nav_msgs/msg/Path "{header: {frame_id: world}, poses: [{pose: {'
    'position: {x: 0.0}}}, {pose: {position: {x: -1.5, y: -1.5}}}, {pose: {position: {x: -3.0, '
    'y: -1.5}}}]}"'
)
ELSEWHERE = {
    PATH: 'test_follow_node.py',
    SPAWN: 'test_simulation_interfaces.py',
    './run demo': 'test_demo.py',
    './run optimize examples/faster_sidewinding.yaml': 'test_optimization.py',
    './run python examples/learn_goals.py': 'test_environments.py',
    './run record live.mcap': 'test_record.py',
    './run view run.mcap': 'test_viewer.py',
    'ros2 run snake_sim_ros viewer --ros-args -p port:=8081': 'test_viewer.py',
    'colcon build && . install/setup.sh': 'test_installed_layout',
    'ros2 param set /gait scene turn_in_place': 'test_graph_commands.py',
    'ros2 topic echo /joint_states': 'test_sim_node.py',
    'rosdep install --from-paths . -yi': 'test_package.py',
}


@pytest.fixture
def user_environment():
    # The environment of a user does not have the field checks and the import path of the tests.
    drop = ('PYTHONPATH', 'ROS_PYTHON_CHECK_FIELDS')
    kept = {key: value for key, value in os.environ.items() if key not in drop}
    folder = str(Path(sys.executable).parent)
    return {**kept, 'PATH': f'{folder}:{kept["PATH"]}', 'ROS_DOMAIN_ID': str(next_domain())}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a bag of a run, which other commands read."""
    path = tmp_path_factory.mktemp('bag') / 'run.mcap'
    assert cli.main(['run', 'sidewinding', '--duration', '0.2', '--bag', str(path)]) == 0
    return path


def test_commands_that_others_run_are_there():
    for line, name in ELSEWHERE.items():
        assert line in COMMANDS, line
        assert name in globals() or list(ROOT.glob(f'test/**/{name}')), name


@pytest.mark.parametrize('line', [line for line in COMMANDS if line not in ELSEWHERE])
def test_command(line, tmp_path, user_environment, monkeypatch, request, capsys):
    for word, package in OPTIONAL.items():
        if word in line:
            pytest.importorskip(package)
    for name in ('config', 'docs', 'examples'):
        (tmp_path / name).symlink_to(ROOT / name)
    if 'run.mcap' in line and '--bag' not in line:
        (tmp_path / 'run.mcap').symlink_to(request.getfixturevalue('bag'))
    words = shlex.split(f'{line} {SHORTENED.get(line, "")}')
    if words[0] == './run' and words[1] in OFFLINE and line != BY_LAUNCHER:
        monkeypatch.chdir(tmp_path)
        assert cli.main(words[1:]) == 0
        check(line, capsys.readouterr().out, tmp_path)
        return
    if words[:3] == ['ros2', 'run', 'snake_sim_ros'] and line != BY_ROS:
        process = forks.node(words[3], *words[5:], domain=int(user_environment['ROS_DOMAIN_ID']))
        deadline = time.monotonic() + 60
        while not re.search(READY, process.output):
            assert process.popen.poll() is None and time.monotonic() < deadline, process.output
            time.sleep(0.01)
        assert process.stop() == 0, process.output
        check(line, process.output, tmp_path)
        return
    if line == BY_ROS:
        words = [str(ROOT / 'scripts' / words[3]), *words[4:]]
        user_environment['PYTHONPATH'] = str(ROOT)
    else:
        assert words[0] == './run', f'no test for the command {line!r}'
        words = [str(ROOT / 'run'), *words[1:]]
    node = any(word in ('sim', 'gait', 'view') or '/scripts/' in word for word in words[:2])
    output = (
        run_node(words, tmp_path, user_environment)
        if node
        else run(words, tmp_path, user_environment)
    )
    check(line, output, tmp_path)


def check(line, output, folder):
    """Check what a command printed and wrote."""
    assert 'Traceback' not in output, output
    assert re.search(SHOWN.get(line, ''), output), output
    for name in re.findall(r'--(?:out|csv|bag|gif|mp4|plot) (\S+\.\w+)', line):
        assert (folder / name).stat().st_size > 100, name


def test_what_the_commands_of_the_readme_print_is_checked():
    assert set(lines([README])) == {*SHOWN, './run demo', 'colcon build && . install/setup.sh'}


def test_the_table_of_controllers_has_commands_of_its_page():
    page = PAGES[1 + NAMES.index('controllers')]
    found = re.findall(r'^\| \[.+\) \| .+ \| `(.+)` \|$', page, re.MULTILINE)
    assert len(found) == 9
    assert set(found) <= set('\n'.join(blocks('sh', [page])).splitlines())


def run(words, folder, environment):
    done = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


READY = r'physics ready|waiting for a (?:robot|path)|http://'


def run_node(words, folder, environment):
    """Start a node, wait until it says that it is ready, interrupt it; it must end with 0."""
    output = folder / 'output.txt'
    with output.open('w') as stream:
        process = subprocess.Popen(
            words, cwd=folder, env=environment, stdout=stream, stderr=subprocess.STDOUT
        )
    deadline = time.monotonic() + 60
    try:
        while not re.search(READY, output.read_text()):
            assert process.poll() is None and time.monotonic() < deadline, output.read_text()
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0, output.read_text()
    finally:
        process.kill()
    return output.read_text()


@pytest.mark.parametrize('program', blocks('python', PAGES))
def test_python(program, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for text, shorter in SHORTER.items():
        program = program.replace(text, shorter)
    exec(compile(program, 'program.py', 'exec'), {'__name__': '__main__'})
    assert capsys.readouterr().out


def test_installed_layout(tmp_path):
    """After an installation `ros2 run` finds package, executables and scenes."""
    pytest.importorskip('wheel')
    copy, prefix = tmp_path / 'source', tmp_path / 'prefix'
    ignore = shutil.ignore_patterns(
        '.git', '.venv*', 'build', '__pycache__', '*.egg-info', 'docs', 'test', 'benchmarks'
    )
    shutil.copytree(ROOT, copy, symlinks=True, ignore=ignore)
    command = [sys.executable, '-m', 'pip', 'install', '-q', '--no-deps', '--no-build-isolation']
    command += [
        '--no-compile',
        '--ignore-installed',
        '--prefix',
        str(prefix),
    ]  # the environment keeps its own
    environment = {**os.environ, 'SNAKE_SIM_MACHINE_CODE': '0'}  # which test_machine_code tests
    subprocess.run([*command, str(copy)], check=True, timeout=120, env=environment)
    assert (prefix / 'share/ament_index/resource_index/packages/snake_sim_ros').is_file()
    assert (prefix / 'share/snake_sim_ros/package.xml').is_file()
    for name in ('sim', 'gait', 'control', 'follow', 'viewer', 'snake-sim'):
        assert os.access(prefix / 'lib/snake_sim_ros' / name, os.X_OK)
        assert os.access(prefix / 'bin' / name, os.X_OK)
    assert (prefix / 'share/snake_sim_ros/launch/snake.launch.py').is_file()
    scenes = sorted(path.name for path in (ROOT / 'config').glob('*.yaml'))
    installed = next(prefix.glob('lib/python3*/site-packages/snake_sim_ros/config'))
    for folder in (installed, prefix / 'share/snake_sim_ros/config'):
        assert sorted(path.name for path in folder.glob('*.yaml')) == scenes
