# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What may import what, that the physics imports no ROS and no display, and how it compiles."""

import ast
from fnmatch import fnmatch
from functools import cached_property
import os
from pathlib import Path
import re
from typing import NamedTuple

import numba
import numpy as np
from processes import python
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.dynamics.compilation import compiled, Dispatched

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / 'snake_sim_ros'
# The rooms, and whose modules each may import besides its own. A room stands below those that use
# it; rooms that stand side by side do not use each other.
PHYSICS = {'scene', 'dynamics', 'contact', 'stepping'}
MAY_USE = {
    'scene': set(),
    'dynamics': {'scene'},
    'gaits': {'scene', 'dynamics'},
    'contact': {'scene', 'dynamics'},
    'stepping': {'scene', 'dynamics', 'contact'},
    'recording': PHYSICS,
    'view': PHYSICS,
    'studies': {*PHYSICS, 'gaits', 'recording'},
    'api': {*PHYSICS, 'gaits', 'recording', 'view', 'studies'},
    'optimization': {*PHYSICS, 'gaits', 'recording', 'studies'},
    'fitting': {*PHYSICS, 'gaits', 'recording', 'studies', 'optimization'},
    'comparison': PHYSICS,
    'paper': {*PHYSICS, 'comparison'},
    'nodes': {*PHYSICS, 'gaits', 'recording', 'view', 'comparison'},
    'reliability': {
        *PHYSICS,
        'gaits',
        'recording',
        'view',
        'studies',
        'optimization',
        'fitting',
        'comparison',
        'nodes',
    },
    'commands': {
        *PHYSICS,
        'gaits',
        'recording',
        'view',
        'studies',
        'optimization',
        'fitting',
        'comparison',
        'paper',
        'nodes',
        'reliability',
    },
    '': {*PHYSICS, 'gaits', 'recording', 'view', 'studies', 'api'},
}
ROS = {'rclpy', 'std_srvs', 'tf2_ros', 'launch', 'launch_ros', 'ament_index_python'}
# Packages that only some need, each where it is imported: at the top of these modules, or where
# they say so inside of functions.
OPTIONAL = {
    'PIL': ('comparison/chart*', 'paper/*figure*', 'view/animation'),
    'cma': ('optimization/searches',),
    'distributed': ('studies/workers',),
    'hypothesis': ('nodes/tools/sim_states',),
    'imageio_ffmpeg': ('view/animation',),
    'matplotlib': (
        *('comparison/chart*', 'comparison/stability/chart', 'paper/*figure*', 'view/animation'),
        *('studies/chart', 'optimization/chart', 'fitting/chart', 'view/chart', 'commands/*'),
        'nodes/tools/demo',
    ),
    'mcap': ('recording/bag_reader', 'nodes/bag_writer', 'nodes/tools/*'),
    'mcap_ros2': ('recording/bag_reader', 'nodes/bag_writer', 'nodes/tools/*'),
    'msgspec': ('view/browser_guard', 'reliability/pages'),
    'mujoco': ('comparison/mujoco*',),
    'polars': ('studies/table', 'studies/study', 'studies/chart', 'optimization/optimize'),
    'pydrake': ('comparison/drake_runs',),
    'viser': ('view/page', 'reliability/pages'),
    'websockets': ('view/browser_guard', 'reliability/pages'),
    'zstandard': ('reliability/pages',),
}
COMPILERS = ('compiled', 'inlined', 'merged', 'Dispatched')  # what makes a function compiled
DRAWS = ('api/runs', 'nodes/tools/demo')
LONGEST_MODULE, LONGEST_FUNCTION = 400, 60  # lines


class Module:
    """What a source file of the package imports and defines."""

    def __init__(self, path):
        self.path = path
        parts = path.relative_to(PACKAGE).with_suffix('').parts
        self.place = '/'.join(parts)
        self.name = '.'.join(part for part in parts if part != '__init__')
        self.room = parts[0] if len(parts) > 1 else ''

    @cached_property
    def text(self):
        """The source."""
        return self.path.read_text(encoding='utf-8')

    @cached_property
    def tree(self):
        """The syntax tree, which is made once it is asked for: not to collect tests."""
        return ast.parse(self.text)

    @cached_property
    def nodes(self):
        """All nodes of the tree."""
        return list(ast.walk(self.tree))

    def imported(self, tree=None):
        """Return the dotted names of all that is imported, at the top or inside functions."""
        names = set()
        for node in ast.walk(tree) if tree else self.nodes:
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {f'{node.module}.{alias.name}' for alias in node.names}
        return names

    def packages(self, tree=None):
        """Return the packages of which anything is imported."""
        return {name.partition('.')[0] for name in self.imported(tree)}

    def modules(self, tree=None):
        """Return the modules of this package that are imported."""
        found = set()
        for name in self.imported(tree):
            parts = name.split('.')[1:] if name.startswith('snake_sim_ros.') else []
            longest = [k for k in range(1, len(parts) + 1) if '.'.join(parts[:k]) in NAMES]
            found |= {'.'.join(parts[: longest[-1]])} if longest else set()
        return found

    def functions(self):
        """Yield all functions, nested ones and methods too."""
        for node in self.nodes:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                yield node


MODULES = [Module(path) for path in sorted(PACKAGE.rglob('*.py'))]
NAMES = {module.name for module in MODULES}
each_module = pytest.mark.parametrize('module', MODULES, ids=lambda module: module.place)


# ---- imports ------------------------------------------------------------------------------------


def test_every_room_is_in_the_table():
    assert {module.room for module in MODULES} == {*MAY_USE}
    assert all((PACKAGE / room / '__init__.py').is_file() for room in MAY_USE)


def test_rooms_stand_above_each_other():
    order = list(MAY_USE)
    for room, below in MAY_USE.items():
        assert below <= set(order[: order.index(room)]), room
        for other in below:  # what a room may use, may use no more than the room itself
            assert MAY_USE[other] <= below, (room, other)


@each_module
def test_imports_go_down_only(module):
    rooms = {name.partition('.')[0] for name in module.modules()} & set(MAY_USE)
    assert rooms <= {module.room, *MAY_USE.get(module.room, set())}


def test_there_is_no_circle_of_imports():
    graph = {module.name: module.modules() - {module.name} for module in MODULES}
    circles = list(strongly_connected(graph))
    assert not circles
    graph['scene.rotations'] = {'stepping.moreau'}  # and one is found
    ((*circle,),) = strongly_connected(graph)
    assert {'scene.rotations', 'stepping.moreau'} <= set(circle)


def strongly_connected(graph):
    """Yield the nodes of a graph that lead to each other, in groups of two and more."""
    names = list(graph)
    index = {name: k for k, name in enumerate(names)}
    edges = [(index[a], index[b]) for a in names for b in graph[a]]
    rows, columns = np.array(edges).T
    matrix = coo_array((np.ones(len(edges)), (rows, columns)), shape=(len(names),) * 2)
    count, labels = connected_components(matrix, connection='strong')
    for label in np.flatnonzero(np.bincount(labels, minlength=count) > 1):
        yield [names[k] for k in np.flatnonzero(labels == label)]


@each_module
def test_imports_stand_at_the_top(module):
    # Inside of functions are optional packages only; in `commands`, what takes long to import, as
    # SciPy does for a dense step that hardly anybody takes, for designs of few studies, and for
    # gaits from tables. Pictures are drawn where matplotlib is.
    users = ('stepping/planar/reference', 'studies/variations', 'scene/gait_table')
    rare = {'scipy'} if module.place in users else set()
    for function in module.functions():
        inside = module.packages(function) - set(OPTIONAL) - rare
        assert not inside or module.room == 'commands' or module.place in DRAWS


@each_module
def test_optional_packages_are_imported_where_they_belong(module):
    for package, places in OPTIONAL.items():
        belongs = any(fnmatch(module.place, place) for place in places)
        assert belongs or package not in module.packages()


@each_module
def test_only_nodes_know_ros(module):
    names = set() if module.room == 'nodes' else module.packages()
    assert not names & ROS
    assert not [name for name in names if name.endswith(('_msgs', '_interfaces'))]


def test_the_gait_node_does_not_know_the_simulator():
    graph, found, new = {module.name: module for module in MODULES}, set(), {'nodes.gait_node'}
    while new:
        name = new.pop()
        found.add(name)
        new |= graph[name].modules() - found
    assert 'gaits.blending' in found
    assert {name.partition('.')[0] for name in found} == {'nodes', 'gaits', 'scene'}


def test_physics_imports_without_ros_and_matplotlib():
    drawing = {name for name in NAMES if 'matplotlib' in graph_packages(name)}
    names = [
        f'snake_sim_ros.{module.name}'
        for module in MODULES
        if module.room not in ('', 'nodes', 'reliability', 'commands')
        and module.name not in drawing
    ]
    script = (
        'import importlib, sys\n'
        'sys.modules["rclpy"] = sys.modules["matplotlib"] = sys.modules["viser"] = None\n'
        f'for name in {names}: importlib.import_module(name)\n'
        'print("imported")'
    )
    assert python('-c', script, folder=ROOT) == 'imported\n'


def graph_packages(name):
    """Return the packages that a module imports at its top, itself or by others."""
    modules, found, new, packages = {m.name: m for m in MODULES}, set(), {name}, set()
    while new:
        module = modules[new.pop()]
        found.add(module.name)
        top = ast.Module([n for n in module.tree.body if not isinstance(n, ast.FunctionDef)], [])
        packages |= module.packages(top)
        new |= module.modules(top) - found
    return packages


# ---- compilation --------------------------------------------------------------------------------


def test_the_cache_is_named_after_all_that_is_compiled():
    # Numba would take stale machine code for a change in a file that is not among them.
    compilers = {f'snake_sim_ros.dynamics.compilation.{name}' for name in COMPILERS}
    modules, found = {module.name: module for module in MODULES}, set()
    users = {module.name for module in MODULES if compilers & module.imported()}
    assert len(users) > 20
    while users:
        name = users.pop()
        found.add(name)
        users |= modules[name].modules() - found
    assert {modules[name].room for name in found} <= {*code_cache.ROOMS}


def test_the_cache_is_another_one_for_other_sources_and_settings(monkeypatch, tmp_path):
    monkeypatch.setattr(code_cache, 'PACKAGE', tmp_path)
    found = [code_cache.identity()]
    for name in ('contact/a.py', 'stepping/planar/a.py', 'stepping/b.py', 'nodes/a.py'):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text('# the same\n')
        found.append(code_cache.identity())
    assert len(set(found[:4])) == 4  # places count as much as contents
    assert found[4] == found[3]  # nodes are not compiled
    # A compiler that looks at every index compiles something else.
    monkeypatch.setenv('NUMBA_BOUNDSCHECK', '1')
    assert code_cache.identity() not in found
    monkeypatch.delenv('NUMBA_BOUNDSCHECK')
    monkeypatch.setattr(code_cache.numba, '__version__', '0.1')
    assert code_cache.identity() not in found


@each_module
def test_functions_are_compiled_or_typed(module):
    # Compiled functions take their types from their first call; all others say theirs.
    if 'dynamics.compilation' not in module.modules():
        return
    for node in module.tree.body:
        if not isinstance(node, ast.FunctionDef):
            continue
        marks = {ast.unparse(item).partition('.')[0] for item in node.decorator_list}
        is_compiled = bool(marks & {'compiled', 'inlined', 'merged', 'Dispatched'})
        assert is_compiled != (node.returns is not None), node.name


@each_module
def test_nothing_is_compiled_in_another_way(module):
    # `compiled` alone knows how: options would differ from function to function.
    places = ('dynamics/compilation', 'dynamics/code_cache', 'dynamics/records')
    assert ('numba' in module.packages()) == (module.place in places)
    assert not re.search(r'\bn?jit\(', module.text) or module.place == 'dynamics/compilation'


class Twice(NamedTuple):
    """A way to scale, chosen by its type."""


class Times(NamedTuple):
    factor: float


def test_a_type_chooses_what_is_called():
    @Dispatched
    def scale(way, x):
        """Scale x."""

    @scale.register(Times)
    @compiled
    def by_factor(way, x):
        for i in range(len(x)):
            for _ in range(3):  # Numba once lost all but one of these
                x[i] *= way.factor

    @compiled
    def scale_all(way, x, count):
        for _ in range(count):
            scale(way, x)

    x = np.array([1.0, 2.0])
    scale_all(Times(2.0), x, 2)
    assert (x == [64.0, 128.0]).all()
    scale(Times(0.5), x)
    assert (x == [8.0, 16.0]).all()
    with pytest.raises(numba.core.errors.TypingError):
        scale_all(Twice(), x, 1)
    with pytest.raises(TypeError, match='must be compiled to be registered'):
        scale.register(Twice)(lambda way, x: None)


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
        for name in {*files} - {'.git'}:  # a file in a second work tree
            path = Path(folder) / name
            content = path.read_bytes()
            if b'\0' not in content:
                yield path, content.decode()


HEAD = """\
# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""


def test_every_source_file_says_whose_it_is():
    for path, text in texts():
        if path.suffix == '.py' or text.startswith('#!'):
            first, _, rest = text.partition('\n')
            assert (rest if first.startswith('#!') else text).startswith(HEAD), path


@each_module
def test_no_room_imports_the_public_interface(module):
    # It imports the rooms; what they may know of the package is in `about`.
    assert not any(
        isinstance(node, ast.ImportFrom) and node.module == 'snake_sim_ros'
        for node in module.nodes
    )


@each_module
def test_outputs_are_written_as_a_whole(module):
    # Bags grow, locks are empty, and attacks write their own inputs.
    others = ('scene/whole_files', 'nodes/bag_writer', 'dynamics/code_cache', 'reliability/')
    way = re.compile(r"(\w+)\.(?:(?:write_text|write_bytes|savefig)\(|open\([^)\n]*'[wx])")
    written = {match[1] for match in way.finditer(module.text)}
    assert module.place.startswith(others) or written <= {'part'}


@each_module
def test_modules_are_short(module):
    assert len(module.text.removeprefix(HEAD).splitlines()) <= LONGEST_MODULE


@each_module
def test_functions_are_short(module):
    for function in module.functions():
        assert function.end_lineno - function.lineno < LONGEST_FUNCTION, function.name


def test_modules_have_names_that_say_something():
    empty = {'utils', 'util', 'common', 'helpers', 'misc', 'core', 'manager'}
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
