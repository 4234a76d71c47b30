# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Very long runs, which must stay converged, bounded, flat in memory and time, and repeatable.

Subjects are gaits on the floor, a robot that is thrown, 200 links, and the scenes with worlds.
Each is run for its share of the time, up to `MOST_STEPS` of its method. Memory in use may
grow by `MEMORY_GROWTH` after the first hundredth of the steps. Time per step is compared between
the first and the last third of the run, as medians over seconds of simulated time; each is divided
by the median time of one second of the same scene that is run again and again in between, so that
a machine that becomes slower or busier counts less. In runs of less than `JUDGED_SECONDS` the
growth is not judged. What a run did last is done once more, from a checkpoint in a file.
"""

from collections import deque
from collections.abc import Callable, Iterator
import ctypes
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.soak import EndlessRun, resident_memory, SOAKED_SCENES
from snake_sim_benchmarks.reliability.trials import shares, Trial
from snake_sim_ros import Scene, Simulation, State
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.rotations import product, rotation_matrices
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.state import named_arrays

MOST_STEPS = {'newton': 10**8, 'bdf2': 25 * 10**5}
MEMORY_GROWTH = 5.0  # MB
TIME_GROWTH = 0.05  # of the time per step
JUDGED_SECONDS = 60.0  # of wall time from which on that is judged
PORTIONS = 60  # of a run
KEPT_TIMES = 200  # of the last seconds of each portion
YARDSTICK_SHARE = 0.1  # of the seconds that are run are the same again
MINUTE = 60.0  # s of simulated time from one checkpoint to the next
SPEED = 3.0  # of throws, in each direction [m/s]
SPIN = 8.0  # of throws, about each axis [rad/s]
WORLDS = ('stairs', 'rough', 'gap', 'pole_climb', 'pipe_climb', 'pegboard')  # scenes
WORLD_STEPS = {'newton': 1 / 1000, 'bdf2': 1 / 200}  # s
TURN = 0.1  # of a robot in a world, about the z axis, to either side [rad]
LANDING = 5.0  # m/s, whose way in a step is how deep `newton` lets robots land in worlds


@dataclass(frozen=True)
class Subject:
    """A scene that is soaked; a robot that leaves its surroundings starts again and again."""

    scene: Scene
    deepest: float  # penetration that is allowed [m]
    widest: float  # joint gap that a step may make before it is corrected [m]
    most_steps: int = MOST_STEPS['newton']
    start: Callable[[int], Simulation] | None = None  # see `EndlessRun`


@dataclass(frozen=True)
class Portion:
    """What is known of a part of a run."""

    steps: int  # of the run at its end
    times: list[float]  # of a step, in each of its last seconds [s]
    yardstick: list[float]  # of a step of the same second [s]
    penetration: float  # largest [m]
    gap: float  # largest joint gap [m]
    memory: int  # in use at its end [B]; see `memory_in_use`


def thrown(scene: Scene, seed: int, number: int) -> Simulation:
    """Return the simulation of a robot that is thrown, turned in any way, as one rigid body."""
    rng = np.random.default_rng((seed, number))
    simulation = Simulation(scene)
    q, n = simulation.state.q.copy(), scene.robot.link_count
    turn = rng.standard_normal(4)
    turn /= np.linalg.norm(turn)
    center = q[:, :3].mean(axis=0)
    q[:, :3] = (q[:, :3] - center) @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    u, spin = np.zeros((n, 6)), rng.uniform(-SPIN, SPIN, 3)
    u[:, :3] = rng.uniform(-SPEED, SPEED, 3) + np.cross(spin, q[:, :3])
    u[:, 3:] = np.einsum('iab,a->ib', rotation_matrices(q[:, 3:]), spin)
    radius = float(scene.robot.per_link('contact_radius').max())
    q[:, 2] += 2.0 * radius - q[:, 2].min() + 0.1
    simulation.state = State(q, u)
    return simulation


def subjects(seed: int) -> dict[str, Subject]:
    """
    Return what is soaked, by name.

    Where robots leave their surroundings, they start again after every duration of the scene, in
    worlds each time turned a little about the z axis.
    """
    scene = load_scene('hyper_redundant')
    found = {'hyper_redundant, newton': Subject(scene, 1e-3, 1e-3, 10**6)}
    for method, dt, dt_thrown in (('bdf2', 1 / 100, 1 / 400), ('newton', 1 / 4000, 1 / 4000)):
        settings = {'method': method, 'dt': dt_thrown, 'duration': 3.0}
        scene = with_settings(load_scene('lateral_undulation'), settings)
        start, deepest = partial(thrown, scene, seed), 20.0 * dt_thrown
        found[f'thrown, {method}'] = Subject(scene, deepest, 1e-3, MOST_STEPS[method], start)
        for name, settings in SOAKED_SCENES.items():
            scene = with_settings(load_scene(name), settings | {'method': method, 'dt': dt})
            again = partial(_again, scene) if scene.pegs.x else None
            found[f'{name}, {method}'] = Subject(scene, 1e-3, 1e-3, MOST_STEPS[method], again)
        for name in WORLDS:
            dt = WORLD_STEPS[method]
            scene = with_settings(load_scene(name), {'method': method, 'dt': dt})
            deepest = LANDING * dt if method == 'newton' else 1e-3
            start = partial(turned, scene, seed)
            found[f'{name}, {method}'] = Subject(scene, deepest, 1e-3, MOST_STEPS[method], start)
    return found


def _again(scene: Scene, number: int) -> Simulation:
    return Simulation(scene)


def turned(scene: Scene, seed: int, number: int) -> Simulation:
    """Return the simulation of a scene whose robot starts turned a little about the z axis."""
    turn = float(np.random.default_rng((seed, number)).uniform(-TURN, TURN))
    (x, y), c, s = scene.start.position, np.cos(turn), np.sin(turn)
    start = {
        'start.position': (float(c * x - s * y), float(s * x + c * y)),
        'start.heading': scene.start.heading + turn,
    }
    return Simulation(with_settings(scene, start))


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Soak all subjects, each for its share of the time."""
    for (name, subject), share in shares([*subjects(seed).items()], seconds):
        yield soaked(name, subject, share)


def soaked(name: str, subject: Subject, seconds: float) -> Trial:
    """Soak one subject for some seconds, a part of which repeats the end of the run."""
    run = EndlessRun(subject.scene, subject.start)
    run.simulation.compile()
    with TemporaryDirectory() as folder:
        keeper = Keeper(run, Path(folder), 0.02 * seconds)
        begin = time.perf_counter()
        portions = list(_portions(run, subject.most_steps, 0.9 * seconds, keeper))
        same = run.report.failure or keeper.repeats(subject.start)
        seconds = time.perf_counter() - begin
    growth, is_judged = _memory_growth(portions), run.seconds >= JUDGED_SECONDS
    slower = _time_growth(portions) if is_judged else 0.0
    depth, gap = _thirds(portions, 'penetration'), _thirds(portions, 'gap')
    report = run.report
    found = {
        report.failure: bool(report.failure),
        'a rerun of the end from a checkpoint has other bits': not same,
        f'memory grew by {growth:.1f} MB': growth > MEMORY_GROWTH,
        f'time per step grew by {100 * slower:.1f} %': slower > TIME_GROWTH,
        f'penetration {report.penetration_max:.2g} m': report.penetration_max > subject.deepest,
        f'joint gap {report.joint_gap_max:.2g} m': report.joint_gap_max > subject.widest,
    }
    growth_of_time = f' ({100 * slower:+.1f} % from first to last third)' if is_judged else ''
    broken = [sentence for sentence, is_so in found.items() if is_so]
    figures = (
        f'unconverged {report.unconverged}, {1e6 * run.seconds / report.steps:.2f} us a step'
        f'{growth_of_time}, penetration {depth[0]:.2g} m in the '
        f'first third and {depth[1]:.2g} m in the last, joint gap {gap[0]:.2g} m and '
        f'{gap[1]:.2g} m, rerun {"equal" if same is True else "not equal"}'
    )
    first = f'{name} after {report.steps} steps: {"; ".join(broken)}' if broken else ''
    return Trial(
        'steps', name, 'steps', report.steps, len(broken), seconds, memory=growth,
        figures=figures, first=first,
    )  # fmt: skip


class Keeper:
    """
    Keeps two checkpoints of a run in files, and repeats the run from the older one.

    Parameters
    ----------
    run : EndlessRun
    folder : Path
    period : float
        Wall time after which a checkpoint is written, if `MINUTE` is not over before [s].

    """

    def __init__(self, run: EndlessRun, folder: Path, period: float) -> None:
        self.run, self.folder, self.period = run, folder, period
        self.kept: list[tuple[Path, int, int]] = []  # file, round, steps
        self.write()

    def write(self) -> None:
        """Write a checkpoint, and forget all but the last one before it."""
        self.next_time = time.perf_counter() + self.period
        self.next_steps = self.run.report.steps + round(MINUTE / self.run.simulation.scene.dt)
        path = self.folder / f'{self.run.report.steps}.npz'
        checkpoint.write(self.run.simulation, path)
        self.kept.append((path, self.run.round, self.run.report.steps))
        if len(self.kept) > 2:
            self.kept.pop(0)[0].unlink()

    def look(self) -> None:
        """Write a checkpoint if it is time."""
        steps, is_late = self.run.report.steps, time.perf_counter() >= self.next_time
        if steps >= self.next_steps or (is_late and steps > self.kept[-1][2]):
            self.write()

    def repeats(self, start: Callable[[int], Simulation] | None) -> bool:
        """Run one more second; return whether it has the same bits from the checkpoint on."""
        path, number, steps = self.kept[0]
        again = EndlessRun(self.run.simulation.scene, start)
        again.simulation, again.round = checkpoint.read(path), number
        end = self.run.report.steps
        while again.report.steps < end - steps:
            again.advance(end - steps - again.report.steps)
        return _last_second(self.run) == _last_second(again)


def _last_second(run: EndlessRun) -> dict[str, bytes]:
    """Run one more second, and return the bits of all samples and of the end."""
    samples = make_samples(run.simulation.scene, 1, run.second)
    run.advance(run.second, samples)
    state = run.simulation.state
    arrays = named_arrays(run.simulation.history) | {'q': state.q, 'u': state.u}
    arrays |= {f'samples.{name}': getattr(samples, name) for name in samples._fields[2:]}
    return {name: array.tobytes() for name, array in arrays.items()}


def _portions(
    run: EndlessRun, most_steps: int, seconds: float, keeper: Keeper
) -> Iterator[Portion]:
    """Run for some seconds, and yield what is known of each of `PORTIONS` parts of them."""
    second, taken = _yardstick(run), 1.0
    begin = time.perf_counter()
    for k in range(PORTIONS):
        times, same = deque[float](maxlen=KEPT_TIMES), deque[float](maxlen=KEPT_TIMES)
        depth = gap = 0.0
        end = begin + seconds * (k + 1) / PORTIONS
        while run.report.steps < most_steps and time.perf_counter() < end:
            if run.report.failure:
                break
            keeper.look()
            times.append(run.advance(most_steps - run.report.steps) / max(1, run.latest.steps))
            depth = max(depth, run.latest.penetration_max)
            gap = max(gap, run.latest.joint_gap_max)
            taken += YARDSTICK_SHARE
            if taken >= 1.0:
                taken -= 1.0
                same.append(second())
        if times:
            times_of_both = list(times), list(same)
            yield Portion(run.report.steps, *times_of_both, depth, gap, memory_in_use())


def _yardstick(run: EndlessRun) -> Callable[[], float]:
    """Return a function that runs the same second and returns the time of a step [s]."""
    simulation = Simulation(run.simulation.scene)
    simulation.advance(*simulation.gait_reference(run.second))
    state, history = simulation.state, simulation.history
    reference: Any = simulation.gait_reference(run.second)

    def second() -> float:
        begin = time.perf_counter()
        simulation.stepper.advance(state, history, *reference)
        return (time.perf_counter() - begin) / run.second

    return second


def memory_in_use() -> int:
    """
    Return the resident memory of this process [B], or 0 if the system does not tell it.

    The GNU C library keeps memory that was freed for later, 51 MB with 200 links, of the joint
    references of a second, and not always as much. It is asked to give that back.
    """
    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (AttributeError, TypeError):
        pass  # another C library
    return resident_memory() or 0


def _memory_growth(portions: list[Portion]) -> float:
    """Return by how much memory grew after the first hundredth of the steps [MB]."""
    late = [item.memory for item in portions if item.steps >= 0.01 * portions[-1].steps]
    return (max(late) - late[0]) / 1e6


def _time_growth(portions: list[Portion]) -> float:
    """Return by which share the time per step grew from the first to the last third."""
    first, last = _first_and_last(portions)
    before, after = (
        np.median(np.concatenate([item.times for item in third]))
        / np.median(np.concatenate([item.yardstick for item in third]))
        for third in (first, last)
    )
    return float(after / before - 1.0)


def _thirds(portions: list[Portion], name: str) -> tuple[float, float]:
    """Return the largest value in the first and in the last third of a run."""
    first, last = _first_and_last(portions)
    return max(getattr(item, name) for item in first), max(getattr(item, name) for item in last)


def _first_and_last(portions: list[Portion]) -> tuple[list[Portion], list[Portion]]:
    """Return the first and the last third of a run."""
    third = max(1, len(portions) // 3)
    return portions[:third], portions[-third:]
