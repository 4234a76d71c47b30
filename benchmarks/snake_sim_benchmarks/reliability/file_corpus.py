# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Good files of every kind, and random changes of their bytes, values, arrays and messages."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import cache, partial
from io import BytesIO
import json
from pathlib import Path
from random import Random
import struct
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from snake_sim_ros import Robot, Simulation
from snake_sim_ros.nodes.bag_writer import BagWriter, RunTopics
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.recording.recorded_runs import write_npz
from snake_sim_ros.scene.files import CONFIG
from snake_sim_ros.scene.parameters import Array, load_scene, with_settings
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.simulation import simulate

# ---- random changes -----------------------------------------------------------------------------


# Values that YAML may hold and no scene means, each of which once broke a program somewhere.
HOSTILE = (
    *('2001-99-99', '2024-02-30', '!!int abc', '!!bool maybe', '!!float ""', '!!timestamp x'),
    *('0x_', '0o8', '1:60:60', '1_000', '+', '-', '.', '~', 'null', 'true', 'no', '""', '"\\0"'),
    *('.nan', '.inf', '-.inf', '1e999', '1e-310', '5e-324', '1e30', '-1e30', '1e15', '1e-9', '0'),
    *('-1', '1', '2', '3', '199', '200', '201', '1000000', '1e9', '9223372036854775808'),
    *('9' * 5000, '0x' + 'f' * 5000, '1' + ':59' * 300, '"' + 'a' * 256 + '"', 'x' * 20_000),
    *(
        '[' * 3000,
        '[' * 60 + ']' * 60,
        '{a: ' * 60 + '1' + '}' * 60,
        '[]',
        '{}',
        '[[]]',
        '[[1], 2]',
    ),
    *(
        '&a [*a]',
        '&a {a: *a}',
        '*nothing',
        '<<',
        '{<<: 1}',
        '{<<: [{a: 1}]}',
        '{1: 2}',
        '{[1]: 2}',
    ),
    *('!!set {a}', '!!omap [a: 1]', '!!omap 1', '!!pairs [a]', '!!binary x', '!!binary aGVsbG8='),
    *('!!python/object/apply:os.system ["true"]', '!!python/tuple [1]', '!nonsense 1', '!!str 1'),
    *('aiko', 'nowhere', '../../../etc/passwd', '/dev/zero', '/', '.', 'bdf2', 'auto', 'planar'),
    *('[1, 2, 3]', '[1e-310, .nan]', '{low: 1, high: 0}', '{mean: 0, deviation: -1}', '"\\u2028"'),
    '[&b [1, 1, 1, 1, 1, 1, 1, 1, 1, 1], &c [*b, *b, *b, *b, *b, *b, *b, *b, *b, *b], '
    '&d [*c, *c, *c, *c, *c, *c, *c, *c, *c, *c], &e [*d, *d, *d, *d, *d, *d, *d, *d, *d, *d], '
    '&f [*e, *e, *e, *e, *e, *e, *e, *e, *e, *e], [*f, *f, *f, *f, *f, *f, *f, *f, *f, *f]]',
)
TOKENS = (
    *(text.encode() for text in HOSTILE),
    *(b'\x00', b'\xff', b'\xfe\xff', b'\xef\xbb\xbf', b'\r', b'\n---\n', b'\n...\n', b'\t', b'%'),
    *(b'\x85', b'\xe2\x80\xa8', b'"', b"'", b'|', b'>', b'? ', b': ', b'- ', b'#', b'&a ', b'*a'),
    *(struct.pack('<I', 2**32 - 1), struct.pack('<I', 2**31), struct.pack('<q', -1)),
)
NUMBERS = (
    *(np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e308, -1e308, 5e-324, 1e-310, 0.5, 2.0**53),
    *(1e9, 2.0**31, 2.0**63, -(2.0**63)),
)


class Raw(str):
    """A piece of YAML that is written as it is."""

    __slots__ = ()


def changed_bytes(content: bytes, random: Random) -> bytes:
    """Return bytes of which one to five places were changed."""
    found = bytearray(content)
    for _ in range(random.randint(1, 5)):
        at = random.randrange(len(found) + 1)
        until = min(len(found), at + random.choice((1, 2, 8, 64, 512)))
        kind = random.randrange(8)
        if kind == 0 and at < len(found):
            found[at] ^= 1 << random.randrange(8)
        elif kind == 1:
            found[at:until] = random.randbytes(until - at)
        elif kind == 2:
            del found[at:until]
        elif kind == 3:
            found[at:at] = found[at:until] * random.choice((1, 2, 30))
        elif kind == 4:
            found[at:at] = random.choice(TOKENS)
        elif kind == 5:
            found[at:until] = random.choice(TOKENS)
        elif kind == 6:
            del found[at:]
        else:
            there = random.randrange(len(found) + 1)
            found[at:until] = found[there : there + 64]
    return bytes(found)


def changed_yaml(random: Random, text: str) -> bytes:
    """Return YAML whose values were replaced, doubled, nested, moved, tagged, or made aliases."""
    tree = deepcopy(_parsed(text))
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        places = list(_places(tree))
        if not places:
            break
        holder, key = random.choice(places)
        holder[key] = _changed(random, holder[key], [holder[key] for holder, key in places])
        if isinstance(holder, dict) and random.random() < 0.1:
            holder[Raw(random.choice(HOSTILE))] = holder.pop(key)
    return _written(tree).encode(errors='surrogatepass')


@cache
def _parsed(text: str) -> Any:
    return yaml.safe_load(text)


def _changed(random: Random, value: Any, others: list[Any]) -> Any:
    """Return another value for one in a tree."""
    kind = random.randrange(10)
    if kind < 3:
        return Raw(random.choice(HOSTILE))
    if kind == 3:
        return Raw(repr(random.choice((1, -1)) * 10.0 ** random.uniform(-320, 308)))
    if kind == 4:
        return random.choice((1, -1)) * random.getrandbits(random.choice((3, 8, 16, 70)))
    if kind == 5:
        return [deepcopy(value) for _ in range(random.choice((0, 1, 2, 3, 11, 300)))]
    if kind == 6:
        return deepcopy(random.choice(others))
    if kind == 7:
        return Raw(f'&x{random.randrange(9)} {_written(value)}')
    if kind == 8:
        return Raw(f'*x{random.randrange(9)}')
    tag = random.choice(('int', 'float', 'bool', 'null', 'str', 'seq', 'map', 'set', 'omap'))
    return Raw(f'!!{tag} {_written(value)}')


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Yield all that holds a value in a tree, and where."""
    items: Any = ()
    if isinstance(tree, dict):
        items = tree.items()
    elif isinstance(tree, list):
        items = enumerate(tree)
    for key, value in list(items):
        yield tree, key
        yield from _places(value)


def _written(tree: Any) -> str:
    """Return a tree as YAML in one line."""
    if isinstance(tree, Raw):
        return str(tree)
    if isinstance(tree, dict):
        return '{' + ', '.join(f'{_written(k)}: {_written(v)}' for k, v in tree.items()) + '}'
    if isinstance(tree, list):
        return '[' + ', '.join(map(_written, tree)) + ']'
    return json.dumps(tree, default=str)


def changed_arrays(arrays: Mapping[str, Array], random: Random) -> bytes:
    """Return an npz file with arrays of which some have other values, types or shapes, or none."""
    found = dict(arrays)
    for _ in range(random.choice((1, 1, 2, 3))):
        name = random.choice(list(found))
        array, kind = found[name], random.randrange(8)
        if kind == 0 and len(found) > 1:
            del found[name]
        elif kind == 1:
            kinds = ('U', 'O') if array.dtype.kind in 'USO' else ('S', '?', 'i1', 'f4', 'c16', 'O')
            with np.errstate(invalid='ignore'):
                found[name] = array.astype(random.choice(kinds))
        elif kind == 2:
            found[name] = np.resize(
                array, [random.randrange(4) for _ in range(random.randrange(4))]
            )
        elif kind == 3:
            found[name] = np.zeros(random.choice(((0,), (10**6,), (1,) * 30, (3, 0, 7))))
        elif kind == 4:
            found[name] = random.choice(list(found.values()))
        elif kind == 5 and array.dtype.kind == 'U' and not array.shape:
            text = str(array)
            if random.random() < 0.5:
                found[name] = np.array(changed_bytes(text.encode(), random).decode('latin-1'))
            else:
                found[name] = np.array(changed_yaml(random, text).decode(errors='replace'))
        elif array.dtype.kind in 'fi' and array.size:
            with np.errstate(invalid='ignore', over='ignore'):
                other = array.copy()
                other.flat[random.randrange(array.size)] = np.array(random.choice(NUMBERS)).astype(
                    array.dtype
                )
            found[name] = other
    buffer = BytesIO()
    with np.errstate(invalid='ignore'):
        np.savez_compressed(buffer, **found)  # type: ignore[arg-type]
    return buffer.getvalue()


def changed_message(random: Random, content: bytes) -> bytes:
    """Return a serialized message with other numbers, counts or texts."""
    found, kind = bytearray(content), random.randrange(4)
    at = random.randrange(0, max(len(found) - 8, 1), 4)
    if kind == 0:
        found[at : at + 8] = struct.pack('<d', random.choice(NUMBERS))
    elif kind == 1:
        found[at : at + 4] = struct.pack(
            '<I', random.choice((0, 1, 2, 3, 10**6, 2**31, 2**32 - 1))
        )
    elif kind == 2:
        return changed_bytes(content, random)
    else:
        found[at : at + 8] = struct.pack('<d', random.choice(NUMBERS))
        found[at + 8 : at + 16] = struct.pack('<d', random.choice(NUMBERS))
    return bytes(found)


# ---- good files ---------------------------------------------------------------------------------


Change = Callable[[Random], bytes]
SHORT = {
    **{'robot.link_count': 3, 'method': 'newton', 'level': 'spatial'},
    **{'dt': 1 / 400, 'duration': 0.05},
}
STUDY = """
scene: lateral_undulation
set: {duration: 4.5, robot.link_count: 5}
sampling: random
samples: 3
seed: 1
rate: 20
keep: metrics
vary:
  friction.transversal: {low: 0.1, high: 0.7, count: 7}
  gait.yaw.amplitude_deg: [20, 25, 30, 35, 40]
  robot.link_mass: {mean: 0.7, deviation: 0.05}
metrics: [speed, cost_of_transport, slip, peak_torque]
"""
OPTIMIZATION = """
scene: sidewinding
set: {duration: 30, accuracy: 0.01}
vary:
  gait.yaw.amplitude_deg: {low: 15, high: 44}
  gait.yaw.phase_lag_deg: {low: -90, high: -20}
  friction.longitudinal: {low: 0.01, high: 1, scale: log}
follow: {gait.pitch.phase_lag_deg: gait.yaw.phase_lag_deg}
objectives: [speed, -cost_of_transport]
constraints: [cost_of_transport <= 0.5]
stop: {evaluations: 300, seconds: 5}
robust: {over: {friction.transversal: [0.7, 1, 1.3]}, measure: worst}
check: {method: newton, dt: 0.00025}
"""
PARAMETERS = """
/**:
  ros__parameters:
    scene: sidewinding
    publish_rate: 100.0
    blend_time: 2.0
    command_type: joint_state
    gait.yaw.amplitude: 0.3
    robot: {link_count: 11, joint_limit: 0.7}
    gait: {soft_start: 1.0}
"""
SETTINGS = """friction.longitudinal=0.2
gait.yaw.amplitude_deg=30
gravity=[0, 0.1, -9.81]
robot.link_mass=[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]
method=bdf2"""
JOURNAL = (
    '{"status": "converged", "failure": "", "unconverged": 0, "seconds": 0.1, "key": "ab", '
    '"metrics": {"speed": 0.25}}\n{"key": "cd", "metrics": null}\n'
)


def corpus(folder: Path) -> dict[str, list[Change]]:
    """
    Return, by the names of files, functions that return the content of a hostile one.

    A good file of each name is in the folder, and what such files name.
    """
    scenes = [path.read_text(encoding='utf-8') for path in sorted(CONFIG.glob('*.yaml'))]
    robots = [text for text in scenes if 'link_count:' in text and 'gait' not in text]
    texts = {
        'scene.yaml': [text for text in scenes if text not in robots],
        'robot.yaml': robots,
        'study.yaml': [STUDY],
        'optimization.yaml': [OPTIMIZATION],
        'parameters.yaml': [PARAMETERS],
    }
    (folder / 'scene_of_robot.yaml').write_text('robot: robot.yaml\n')
    found: dict[str, list[Change]] = {}
    for name, goods in texts.items():
        (folder / name).write_text(goods[0])
        found[name] = [partial(_changed_text, goods)]
    for name, good in (
        ('settings.txt', SETTINGS.encode()),
        ('robot.urdf', robot_description(Robot(link_count=3)).encode()),
        ('table.csv', _table(Random(0), change=False)),
        ('study.journal', JOURNAL.encode()),
    ):
        (folder / name).write_bytes(good)
        found[name] = [partial(changed_bytes, good)]
    found['settings.txt'].append(_setting)
    found['table.csv'].append(_table)
    return found | _binary(folder)


def _changed_text(texts: Sequence[str], random: Random) -> bytes:
    """Return one of some texts in YAML with other bytes, other values, or both."""
    text, kind = random.choice(texts), random.randrange(4)
    content = changed_yaml(random, text) if kind else text.encode()
    return changed_bytes(content, random) if kind < 2 else content


def _setting(random: Random) -> bytes:
    """Return a line KEY=VALUE with a hostile value or key."""
    key, _, value = random.choice(SETTINGS.split('\n')).partition('=')
    value = random.choice(HOSTILE)
    if random.random() < 0.3:
        key = changed_bytes(key.encode(), random).decode('latin-1')
    return f'{key}={value}'.encode()


def _table(random: Random, change: bool = True) -> bytes:
    """Return a table, with a changed line if it is to change."""
    head = ['# table: bench', '# commit: 1', '# processor: any']
    columns, rows = 'case,dt,seconds', ['A,0.001,1.5', 'B,0.002,']
    if change:
        parts = [head, rows]
        lines = random.choice(parts)
        at = random.randrange(len(lines))
        lines[at] = changed_bytes(lines[at].encode(), random).decode('latin-1')
        if random.random() < 0.3:
            columns = changed_bytes(columns.encode(), random).decode('latin-1')
    return ''.join(f'{line}\n' for line in (*head, columns, *rows)).encode(errors='replace')


def _binary(folder: Path) -> dict[str, list[Change]]:
    """Return the functions for npz files and bags, and write a good one of each."""
    scene = with_settings(load_scene('lateral_undulation'), SHORT)
    write_npz(simulate(scene, rate=100.0), folder / 'run.npz')
    with_queue = {'method': 'bdf2', 'robot.command_delay': 0.01, 'robot.control_rate': 200.0}
    checkpoint.write(Simulation(with_settings(scene, with_queue)), folder / 'checkpoint.npz')
    found: dict[str, list[Change]] = {}
    for name in ('run.npz', 'checkpoint.npz'):
        content = (folder / name).read_bytes()
        with np.load(folder / name) as file:
            arrays = dict(file)
        found[name] = [
            partial(changed_bytes, content),
            partial(changed_arrays, arrays),
            partial(changed_arrays, arrays),
        ]
    messages = _Messages(Simulation(scene), folder / 'bag.mcap')
    content = (folder / 'bag.mcap').read_bytes()
    found['bag.mcap'] = [partial(changed_bytes, content), messages.changed, messages.changed]
    return found


class _Messages:
    """The messages of a bag, which is written anew with some of them changed."""

    def __init__(self, simulation: Simulation, path: Path) -> None:
        self.scene = simulation.scene
        self.topics: dict[str, tuple[Any, Any]] = {}
        self.messages: list[tuple[str, int, bytes]] = []
        noted = self

        class Noting(BagWriter):
            """A writer that notes what it writes."""

            def add_topic(self, topic: str, kind: Any, qos: Any) -> None:
                super().add_topic(topic, kind, qos)
                noted.topics[topic] = kind, qos

            def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
                super().write(topic, nanoseconds, data)
                noted.messages.append((topic, nanoseconds, bytes(data)))

        with Noting(path, self.scene) as bag:
            observe = RunTopics(bag, self.scene).observe
            for _ in range(3):
                observe(simulation)
                simulation.advance(*simulation.gait_reference(4))

    def changed(self, random: Random) -> bytes:
        """Return a whole bag with changed messages, and perhaps another scene or none."""
        scene = random.choice((None, None, self.scene, replace(self.scene, robot=Robot())))
        messages = list(self.messages)
        for _ in range(random.choice((1, 1, 2, 4))):
            at = random.randrange(len(messages))
            topic, time, data = messages[at]
            if random.random() < 0.1:
                topic = random.choice(list(self.topics))
            time = random.choice((time, time, time, 0, 2**63, 10**18))
            messages[at] = topic, time, changed_message(random, data)
        if random.random() < 0.1:
            messages = random.sample(messages, random.randrange(len(messages)))
        with TemporaryDirectory() as folder:
            path = Path(folder) / 'bag.mcap'
            with BagWriter(path, scene) as bag:
                for topic, (kind, qos) in self.topics.items():
                    bag.add_topic(topic, kind, qos)
                for topic, time, data in messages:
                    bag.write(topic, time, data)
            return path.read_bytes()
