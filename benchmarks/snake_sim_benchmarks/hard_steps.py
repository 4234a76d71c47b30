# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How long steps of hard scenes take, and which of them are the hardest: the tables of hard_steps.md.

    ./run python benchmarks/snake_sim_benchmarks/hard_steps.py
    ./run python benchmarks/snake_sim_benchmarks/hard_steps.py --store test/data/hard_steps.npz

Each scene is run for 20 000 steps, one by one, and the times and iterations of its steps are
printed: median, 99, 99.9 and 99.99 %, and the largest. A step that took longer than `LONG` is
taken again, `AGAIN` times from the same start, and its least time counts: what else the machine
did meanwhile does not. With `--store`, the hardest steps are written to a file, which
`test/hard_contacts.py` reads.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
import time
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros import Report, Scene, State
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.scene.parameters import Array, load_scene, scene_to_text, with_settings
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import GaitAhead
from snake_sim_ros.stepping.state import History, initial_state

STEPS = 20_000  # of each scene
LONG, AGAIN = 1e-4, 3  # a step that takes longer [s] is taken again, so many times
SHARES = 50.0, 99.0, 99.9, 99.99, 100.0  # percentiles of the tables
KEPT = 20  # steps of each scene of method newton that are stored, those of most iterations


def friction(mu: float, rolling: float = 0.0) -> dict[str, Any]:
    """Return the settings of the same friction of everything."""
    return {
        'friction.longitudinal': mu, 'friction.transversal': mu, 'friction.rolling': rolling,
        'pegs.friction': mu, 'self_contact_friction': mu,
    }  # fmt: skip


def undulation(amplitude: float, lag: float, speed: float = 1.0) -> dict[str, Any]:
    """Return the settings of a lateral gait: amplitude, lag [rad] and frequency [rad/s]."""
    return {
        'gait.yaw.amplitude': amplitude, 'gait.yaw.angular_frequency': speed,
        'gait.yaw.phase_lag': lag, 'gait.soft_start': 1.0,
    }  # fmt: skip


CURLING = {'self_contact': True, **undulation(0.75, 0.05)}
SOFT = {'robot.yaw_stiffness': 5.0, 'robot.pitch_stiffness': 5.0}
ROUGH = np.random.default_rng(1).uniform(0.0, 0.04, (24, 24)).round(3)
CELLS = {'ground.heights': ROUGH.tolist(), 'ground.cell': 0.11, 'ground.origin': [-1.4, -1.3]}
ROWS = np.arange(-1.6, 1.2, 0.19)
WEDGE = {  # between two rows of pegs
    'pegs.x': [*ROWS.tolist(), *(ROWS + 0.07).tolist()],
    'pegs.y': [0.115] * len(ROWS) + [-0.115] * len(ROWS),
    'pegs.radius': 0.03,
    'self_contact': True,
    **undulation(0.7, -0.9, 2.0),
    'start.yaw': 0.0,
}
SCALES = {'friction.longitudinal': 0.7, 'friction.backward': 1.05, 'friction.transversal': 1.4}
DRY = {'robot.joint_friction': 0.1, 'gait.soft_start': 3.0}
LARGE = {'method': 'bdf2', 'dt': 1 / 200}
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    'friction 1.5': ('lateral_undulation', friction(1.5)),
    'friction 5': ('lateral_undulation', friction(5.0)),
    'sinus lifting, friction 1.5': ('sinus_lifting', friction(1.5)),
    'sidewinding, friction 1.5': ('sidewinding', friction(1.5)),
    'rolling friction': ('lateral_undulation', friction(1.0, 0.1)),
    'curled': ('lateral_undulation', CURLING),
    'curled, friction 1': ('lateral_undulation', {**CURLING, **friction(1.0)}),
    'curled, friction 1.5': ('lateral_undulation', {**CURLING, **friction(1.5)}),
    'curled, scales': ('lateral_undulation', {**CURLING, **SCALES}),
    'curled, soft, friction 1.5': (
        'lateral_undulation', {**CURLING, **friction(1.5), **SOFT, 'robot.joint_limit': 1.5,
        'gait.yaw.amplitude': 1.2},
    ),
    'wedged, friction 0.5': ('lateral_undulation', {**WEDGE, **friction(0.5)}),
    'wedged, friction 1.5': ('lateral_undulation', {**WEDGE, **friction(1.5)}),
    'cells, friction 1.5': ('sinus_lifting', {**CELLS, **friction(1.5)}),
    'cells and pegs, curled': (
        'lateral_undulation', {**WEDGE, **CELLS, **friction(1.0), **undulation(0.7, 0.3)},
    ),
    'helix, friction 1': ('rolling_helix', {**friction(1.0), 'self_contact': True}),
    'joint friction': ('lateral_undulation', {**DRY, 'dt': 1 / 1000}),
    'joint friction, friction 1': ('lateral_undulation', {**DRY, **friction(1.0)}),
    'curled, bdf2': ('lateral_undulation', {**CURLING, **friction(1.0), **LARGE}),
    'wedged, bdf2': ('lateral_undulation', {**WEDGE, **friction(1.0), **LARGE}),
    'joint friction, bdf2': ('lateral_undulation', {**DRY, **LARGE}),
}  # fmt: skip


class Step(NamedTuple):
    """A step that was taken."""

    name: str  # of its scene
    number: int
    scene: Scene
    state: State  # before it
    history: History
    angle: Array  # (1, n-1, 2) its joint references [rad]
    rate: Array  # (1, n-1, 2) [rad/s]
    report: Report
    seconds: float  # the least time that it took [s]


def scene_of(name: str) -> Scene:
    """Return one of SCENES."""
    source, settings = SCENES[name]
    return with_settings(load_scene(source), {'level': 'spatial', **settings})


def taken(name: str, count: int) -> Iterator[Step]:
    """Take some steps of one of SCENES, one by one, and yield them."""
    scene = scene_of(name)
    stepper, gait, tick = make_stepper(scene), GaitAhead(scene), tick_seconds()
    state, history = initial_state(scene), stepper.empty_history()
    for number in range(count):
        angle, rate = gait.reference(number, 1)
        end = stepper.advance(state, history, angle, rate)
        seconds = tick * float(np.diff(stepper.cycles[:2])[0])
        for _ in range(AGAIN if seconds > LONG and number else 0):
            stepper.advance(state, history, angle, rate)
            seconds = min(seconds, tick * float(np.diff(stepper.cycles[:2])[0]))
        yield Step(name, number, scene, state, history, angle, rate, end[2], seconds)
        state, history = end[:2]


def tick_seconds() -> float:
    """Return the time between two counts of the processor's counter [s]."""
    cycle_counter()  # the first call compiles it
    begin, ticks = time.perf_counter(), cycle_counter()
    time.sleep(0.1)
    return (time.perf_counter() - begin) / max(1, cycle_counter() - ticks)


def row(name: str, times: Array, iterations: Array, left: int) -> str:
    """Return the line of a table for some steps: times in us, iterations, and unconverged ones."""
    cells = [f'{1e6 * value:.0f}' for value in np.percentile(times, SHARES)]
    cells += [f'{value:.0f}' for value in np.percentile(iterations, SHARES)]
    return f'| {name} | {len(times)} | {" | ".join(cells)} | {left} |'


def store(steps: list[Step], file: Path) -> None:
    """
    Write steps to a file, as `test/hard_contacts.py` reads it.

    Positions are double; all else is single precision, and of the history only closed contacts.
    """
    names = list(dict.fromkeys(step.name for step in steps))
    contacts = [np.flatnonzero(step.history.impulse[:, 0]) for step in steps]
    known = [
        np.stack(step.history[:3], axis=1)[closed]
        for step, closed in zip(steps, contacts, strict=True)
    ]
    single = {
        'turn': [step.state.q[:, 3:] for step in steps],
        'u': [step.state.u for step in steps],
        'angle': [step.angle[0] for step in steps],
        'rate': [step.rate[0] for step in steps],
    }
    arrays: dict[str, Any] = {key: np.array(value, np.float32) for key, value in single.items()}
    np.savez_compressed(
        file,
        name=np.array(names),
        scene=np.array([scene_to_text(scene_of(name)).encode() for name in names]),
        of=np.array([names.index(step.name) for step in steps], np.uint8),
        number=np.array([step.number for step in steps], np.int32),
        position=np.array([step.state.q[:, :3] for step in steps]),
        closed=np.array([len(closed) for closed in contacts], np.uint8),
        contact=np.concatenate(contacts).astype(np.uint16),
        known=np.concatenate(known).astype(np.float32),
        **arrays,
    )


def main() -> None:
    """Run the scenes, print their table, and store the hardest steps if that is asked for."""
    parser = argparse.ArgumentParser()
    parser.add_argument('scene', nargs='*', help='default: all of them')
    parser.add_argument('--steps', type=int, default=STEPS, help='of each scene')
    parser.add_argument('--store', type=Path, metavar='FILE.npz')
    options = parser.parse_args()
    head = [f'{share:g} %' for share in SHARES]
    print(f'| scene | steps | {" | ".join([f"{h} [us]" for h in head] + head)} | unconverged |')
    print('|' + '---|' * (3 + 2 * len(SHARES)))
    every: list[tuple[float, int, int]] = []
    hardest: list[Step] = []
    for name in options.scene or SCENES:
        numbers: list[tuple[float, int, int]] = []
        of_scene: list[Step] = []
        for step in taken(name, options.steps):
            report = step.report
            numbers.append((step.seconds, report.iterations, report.unconverged))
            if options.store and step.scene.method == 'newton' and step.number > 0:
                of_scene = sorted([*of_scene, step], key=hardness)[-KEPT:]
        print(row(name, *columns(numbers)), flush=True)
        every += numbers
        hardest += of_scene
    print(row('all', *columns(every)))
    if options.store:
        store(hardest, options.store)
        print(f'{len(hardest)} steps in {options.store}')


def hardness(step: Step) -> int:
    """Return the iterations of a step."""
    return step.report.iterations


def columns(numbers: list[tuple[float, int, int]]) -> tuple[Array, Array, int]:
    """Return times, iterations and the number of unconverged steps."""
    times, iterations, left = map(np.array, zip(*numbers, strict=True))
    return times, iterations, int(left.sum())


if __name__ == '__main__':
    main()
