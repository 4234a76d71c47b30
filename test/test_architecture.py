"""What may import what, and that the physics runs alone: without ROS, nodes, display, compiler."""

import ast
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import numba
import numpy as np
import pytest
from short_run import short_run

from snake_sim_ros.dynamics.compilation import compiled

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / 'snake_sim_ros'
MODULES = sorted(PACKAGE.glob('*.py'))
# Everything else is physics: it does not know who runs it.
SHELL = {
    *('simulation', 'nodes', 'cli', 'charts', 'peers', 'animation'),
    *('artefacts', 'bench', 'bench_rows', 'bench_tables', 'contenders', 'pareto'),
    *('soak', 'stages', 'timing'),
    *('stability', 'stability_scenes', 'stability_maps', 'stability_chart'),
    *('experiments', 'figures', 'paper_tables'),
    *('recordings',),
    *('playback', 'viewer', 'viewer_frames', 'viewer_stage'),
}
DRAWING = {'animation', 'charts', 'figures', 'stability_chart'}
ROS = {'rclpy', 'std_srvs', 'tf2_ros', 'launch', 'launch_ros', 'ament_index_python'}

each_module = pytest.mark.parametrize('path', MODULES, ids=lambda path: path.stem)


def imported(path):
    """Return the dotted names of everything a module imports, at its top or inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f'{node.module}.{alias.name}' for alias in node.names}
    return names


def packages(path):
    """Return the packages that a module imports anything of."""
    return {name.partition('.')[0] for name in imported(path)}


def siblings(path):
    """Return the modules of this package that a module imports."""
    return {name.split('.')[1] for name in imported(path) if name.startswith('snake_sim_ros.')}


def python(*arguments, folder, **environment):
    """Return what a new Python process prints that takes the package from a folder."""
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get('PYTHONPATH')]))
    finished = subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, 'PYTHONPATH': path, **environment},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


# ---- imports ------------------------------------------------------------------------------------


def test_there_is_something_to_check():
    assert {'parameters', 'reference', 'spatial', 'stepping'} <= {path.stem for path in MODULES}


@each_module
def test_only_nodes_know_ros(path):
    names = packages(path)
    assert not names & ROS
    assert not [name for name in names if name.endswith(('_msgs', '_interfaces'))]


@each_module
def test_only_charts_know_matplotlib(path):
    assert ('matplotlib' in packages(path)) == (path.stem in DRAWING)


@each_module
def test_only_the_page_knows_viser(path):
    assert ('viser' in packages(path)) == (path.stem == 'viewer')


@each_module
def test_physics_does_not_know_what_runs_it(path):
    assert path.stem in SHELL or not siblings(path) & SHELL


def test_the_gait_node_does_not_know_the_simulator():
    found, new = set(), {'nodes.gait_node'}
    while new:
        name = new.pop()
        found.add(name)
        imports = imported(PACKAGE / f'{name.replace(".", "/")}.py')
        inner = {item.removeprefix('snake_sim_ros.') for item in imports if 'snake_sim' in item}
        # A module, or a name of a module: all imports are of names.
        new |= {item.rpartition('.')[0] or item for item in inner} - found
    nodes = {
        f'nodes.{name}' for name in ('gait_node', 'command_messages', 'node_parameters', 'running')
    }
    assert found == nodes | {'blending', 'gait', 'parameters', 'records', 'steering'}


def test_physics_imports_without_ros_and_matplotlib():
    names = [f'snake_sim_ros.{path.stem}' for path in MODULES if path.stem not in DRAWING]
    script = (
        'import importlib, sys\n'
        'sys.modules["rclpy"] = sys.modules["matplotlib"] = sys.modules["viser"] = None\n'
        f'for name in {names}: importlib.import_module(name)\n'
        'print("imported")'
    )
    assert python('-c', script, folder=ROOT) == 'imported\n'


# `newton_dense` is made of the same functions; its elimination passes a last bit on with a factor
# of 1e5 and more.
@pytest.mark.parametrize(
    ('level', 'method'), [('spatial', 'newton'), ('spatial', 'paper'), ('auto', 'newton')]
)
def test_physics_runs_without_nodes_and_without_compiler(tmp_path, method, level):
    shutil.copytree(PACKAGE, tmp_path / 'snake_sim_ros', ignore=shutil.ignore_patterns('nodes'))
    program = str(ROOT / 'test' / 'short_run.py')
    printed = python(program, method, level, folder=tmp_path, NUMBA_DISABLE_JIT='1')
    file, q, u, history = json.loads(printed)
    assert Path(file).parent == tmp_path / 'snake_sim_ros'
    end, compiled_history, report = short_run(method, level)
    assert (report.steps, report.planar_steps) == (3, 2 if level == 'auto' else 0)
    if method == 'paper':
        assert report.iterations_max > 3 * 10  # after which the contact problem is condensed
    # Both round as written, but sines and tangents may come from another library: 120 sweeps pass
    # a last bit of them on, with stiff joints, to velocities below 1 m/s and 2 rad/s.
    assert np.abs(end.q - q).max() < 1e-12
    assert np.abs(end.u - u).max() < 1e-12
    assert np.abs(compiled_history - history).max() < 1e-12


@pytest.mark.parametrize(
    ('files', 'passed'),
    [
        ('test_self_contact.py', r'9\d'),
        ('test_change.py', r'2\d\d'),
        ('test_pegs.py test_ground.py', r'2\d\d'),
        ('test_soft_impacts.py test_events.py', r'4\d\d'),
    ],
)
def test_what_is_tested_without_compiler(files, passed):
    # See conftest.py.
    paths = [f'test/{name}' for name in files.split()]
    arguments = ['-m', 'pytest', '-q', '-p', 'no:cacheprovider', *paths]
    printed = python(*arguments, folder=ROOT, NUMBA_DISABLE_JIT='1')
    assert re.search(rf'^{passed} passed(, \d skipped)? in', printed, re.MULTILINE), printed


def test_a_scene_that_changes_stays_in_bounds():
    # A compiler that looks at every index compiles something else: it has a cache of its own.
    program = str(ROOT / 'test' / 'test_change.py')
    cache = f'{numba.config.CACHE_DIR}_in_bounds'
    printed = python(program, folder=ROOT, NUMBA_BOUNDSCHECK='1', NUMBA_CACHE_DIR=cache)
    assert printed == 'all in bounds\n'


# ---- compilation --------------------------------------------------------------------------------

# Modules whose every function runs in the step of a compiled method; elsewhere a function with
# rows of numbers in and out may be compiled and another one not.
HOT = {
    'articulated_body',
    'bdf2',
    'contact_laws',
    'contacts',
    'delassus',
    'gauss_seidel',
    'hinge_chain',
    'interpolation',
    'kinematics',
    'linear_laws',
    'minimal_coordinates',
    'newton',
    'obstacles',
    'penalty',
    'planar',
    'planar_bdf2',
    'planar_newton',
    'planar_pegs',
    'prox_iteration',
    'pyramid',
}


def functions(path):
    """Return the names of the functions at the top of a module, and of the compiled ones."""
    nodes = [
        node
        for node in ast.parse(path.read_text(encoding='utf-8')).body
        if isinstance(node, ast.FunctionDef)
    ]
    marked = [
        node.name
        for node in nodes
        if {'compiled', 'inlined', 'merged'} & set(map(ast.unparse, node.decorator_list))
    ]
    return {node.name for node in nodes}, set(marked)


def test_all_physics_of_a_step_is_compiled():
    assert HOT <= {path.stem for path in MODULES}
    for path in MODULES:
        names, marked = functions(path)
        made = {name for name in names if name.startswith('make_')}
        assert path.stem not in HOT or names == marked | made, path.stem
    # What a step calls of other modules too.
    names, marked = functions(PACKAGE / 'spatial.py')
    assert names - marked == {'make_model', 'make_workspace'}


@each_module
def test_nothing_is_compiled_in_another_way(path):
    # `compiled` is the only place that knows how: options would differ from function to function.
    text = path.read_text(encoding='utf-8')
    assert ('numba' in packages(path)) == (path.stem == 'compilation')
    assert not re.search(r'\bn?jit\(', text) or path.stem == 'compilation'


def makes_an_array(n):
    return np.ones(n).sum()


def copies_an_array(x):
    return x.copy().sum()


def makes_a_list(n):
    return len([n, n])


@pytest.mark.parametrize(
    ('function', 'argument'),
    [(makes_an_array, 3), (copies_an_array, np.ones(3)), (makes_a_list, 3)],
)
def test_functions_that_allocate_do_not_compile(function, argument):
    # A step that allocates may wait for the allocator: the compiler refuses it.
    assert function(argument) > 0
    with pytest.raises(numba.core.errors.NumbaError):
        compiled(function)(argument)


def test_functions_that_only_write_to_arrays_compile():
    def fill(x):
        x[:] = 2.0
        return x[1] + x[1:].sum()

    assert compiled(fill)(np.ones(3)) == 6.0


# ---- files --------------------------------------------------------------------------------------


def texts():
    """Yield the text files of the project, without what is built or hidden."""
    built = {'build', 'install', 'log', '__pycache__'}
    for folder, folders, files in os.walk(ROOT):
        folders[:] = [
            name
            for name in folders
            if name not in built and not name.startswith('.') and not name.endswith('.egg-info')
        ]
        for name in files:
            path = Path(folder) / name
            content = path.read_bytes()
            if b'\0' not in content:
                yield path, content.decode()


def test_modules_are_short():
    long = {
        path.name: lines
        for path in PACKAGE.rglob('*.py')
        if (lines := len(path.read_text(encoding='utf-8').splitlines())) > 450
    }
    assert not long


def test_modules_have_names_that_say_something():
    empty = {'utils', 'util', 'common', 'helpers', 'misc', 'core', 'base', 'manager', 'tools'}
    assert not empty & {path.stem for path in PACKAGE.rglob('*') if path.suffix in ('', '.py')}


def test_no_text_names_a_place_on_somebodys_machine():
    # System folders such as /usr/bin and /opt/ros are the same everywhere.
    place = re.compile(r'(?<![\w.~$}/])/(?:home|root|Users|work|mnt|media|srv|tmp|scratch)/\w')
    found = [
        f'{path.relative_to(ROOT)}: {line.strip()}'
        for path, text in texts()
        for line in text.splitlines()
        if place.search(line)
    ]
    assert not found
