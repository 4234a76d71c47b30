# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Good files of every kind, small ones, from which hostile ones are made."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from snake_sim_benchmarks.reliability.mutations import (
    changed_arrays,
    changed_bytes,
    changed_message,
    changed_yaml,
    HOSTILE,
)
from snake_sim_ros.nodes.bag_writer import BagWriter, RunTopics
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.recording.recorded_runs import write_npz
from snake_sim_ros.scene.files import CONFIG
from snake_sim_ros.scene.parameters import load_scene, Robot, with_settings
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.simulation import run, Simulation

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
JOURNAL = '{"row": 1, "speed": 0.25, "status": "done"}\n{"row": 2, "speed": null}\n'


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
    write_npz(run(scene, rate=100.0), folder / 'run.npz')
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
