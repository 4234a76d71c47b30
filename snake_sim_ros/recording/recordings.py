"""The commands of snake-sim that make recordings, convert them and show them."""

import argparse
from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from contextlib import ExitStack
import json
import math
from pathlib import Path
import signal
import sys
from typing import Any

from tqdm import tqdm

from snake_sim_ros.recording.bags import read_bag
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.quantities import ParameterError
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.simulation import run
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.trajectory import Trajectory

FORMATS = {'out': '.npz', 'csv': '.csv', 'bag': '.mcap', 'gif': '.gif', 'mp4': '.mp4'}
RATE, BAG_RATE = 100.0, 200.0  # samples a second; as `sim` publishes [Hz]


def add_outputs(command: argparse.ArgumentParser, *, bag: bool) -> None:
    """Add the options that name files to write."""
    texts = {
        'out': 'numbers of everything, for NumPy and for snake-sim view',
        'csv': 'a table with a row for each sample',
        'bag': 'the topics of sim and gait as a ROS 2 bag, 200 states a second unless --rate',
        'gif': 'an animation',
        'mp4': 'an animation',
    }
    for name, suffix in FORMATS.items():
        if bag or name != 'bag':
            command.add_argument(f'--{name}', type=Path, metavar=f'FILE{suffix}', help=texts[name])
    command.add_argument(
        '--speed', type=float, default=1.0,
        help='seconds of the run in a second of an animation, default 1',
    )  # fmt: skip


def title_of(source: str | Path) -> str:
    """Return the name of a scene or a recording in words."""
    return Path(source).stem.replace('_', ' ')


def outputs(options: argparse.Namespace) -> dict[str, Path]:
    """
    Return the files to write, by the names of their options.

    Raises
    ------
    ParameterError
        If a file has another suffix or its folder does not exist, or what draws is not installed.

    """
    files = {name: path for name in FORMATS if (path := getattr(options, name, None))}
    for name, path in files.items():
        if path.suffix != FORMATS[name]:
            raise ParameterError(f'--{name} must end in {FORMATS[name]}, got {path}')
        if not path.absolute().parent.is_dir():
            raise ParameterError(f'--{name}: no folder {path.absolute().parent}')
    if not 0 < options.speed < math.inf:
        raise ParameterError(f'--speed must be above 0 and finite, got {options.speed:g}')
    if {'gif', 'mp4'} & files.keys():
        animator()
    return files


def write(trajectory: Trajectory, files: dict[str, Path], title: str, speed: float) -> None:
    """
    Write a trajectory in every format but that of a bag, which is written as a scene runs.

    Parameters
    ----------
    trajectory : Trajectory
    files : dict
        As `outputs` returns them.
    title : str
        Beside the time in animations.
    speed : float
        Of animations: seconds of the run in a second of them.

    """
    if 'out' in files:
        trajectory.save(files['out'])
    if 'csv' in files:
        trajectory.save_csv(files['csv'])
    for name in ('gif', 'mp4'):
        if name in files:
            animator()(trajectory, files[name], title, speed)


def animator() -> Callable[[Trajectory, Path, str, float], None]:
    """
    Return what draws animations.

    Raises
    ------
    ParameterError
        If matplotlib is not installed.

    """
    try:
        from snake_sim_ros.view.animation import animate
    except ImportError as error:
        raise ParameterError(
            f"animations need matplotlib ({error}): pip install 'snake_sim_ros[plots]'"
        ) from None
    return animate


def run_scene(scene: Scene, options: argparse.Namespace) -> int:
    """Run a scene and write what it did; the last line on standard output is JSON."""
    files = outputs(options)
    make_stepper(scene)
    usual = BAG_RATE if 'bag' in files else RATE
    rate = usual if options.rate is None else options.rate
    print('compiling ...', end='\r', file=sys.stderr, flush=True)
    layout = '{percentage:3.0f} %|{bar}| {n:.2f} of {total:g} s, {remaining} left'
    with ExitStack() as stack:
        keep = _bag(stack, files['bag'], scene) if 'bag' in files else None
        bar = stack.enter_context(tqdm(total=scene.duration, bar_format=layout))

        def observe(simulation: Simulation) -> None:
            if keep:
                with later_interruption():
                    keep(simulation)
            # Rounding may lead to more than all, which tqdm would warn of.
            bar.update(min(simulation.time, bar.total) - bar.n)

        trajectory = run(scene, rate=rate, observe=observe)
    write(trajectory, files, title_of(options.scene), options.speed)
    report, link = trajectory.report, scene.robot.middle_link
    x, y, z = trajectory.position[-1, link]
    print(f'link {link + 1} at ({x:.4f}, {y:.4f}, {z:.4f}) m after {trajectory.time[-1]:g} s')
    if report.failure:
        print(f'diverged: {report.failure}', file=sys.stderr)
    for path in files.values():
        print(f'{len(trajectory.time)} samples in {path}')
    print(json.dumps(summary(trajectory)))
    if report.status is Status.DIVERGED:
        return 1
    return 130 if trajectory.interrupted else 0


def _bag(stack: ExitStack, path: Path, scene: Scene) -> Callable[[Simulation], None]:
    """Open a bag for a run; return what writes a sample to it."""
    try:
        from snake_sim_ros.nodes.bag_writer import BagWriter
        from snake_sim_ros.nodes.bag_writer import RunBag
    except ImportError as error:
        raise ParameterError(
            f'--bag needs ROS 2 and mcap ({error}): source a ROS 2 installation, or ./run run, '
            f"and pip install 'snake_sim_ros[bags]'"
        ) from None
    return RunBag(stack.enter_context(BagWriter(path, scene)), scene).observe


@contextmanager
def later_interruption() -> Iterator[None]:
    """Let an interruption from the keyboard wait until what is inside is done."""
    waiting: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if waiting:
        raise KeyboardInterrupt


def summary(trajectory: Trajectory) -> dict[str, Any]:
    """Return how a run went."""
    scene, report = trajectory.scene, trajectory.report
    return {
        'method': method_of(scene),
        'level': report.level,
        'planar_steps': report.planar_steps,
        'status': report.status.value,
        'steps': report.steps,
        'us_per_step': 1e6 * trajectory.seconds / max(report.steps, 1),
        'real_time_factor': report.steps * scene.dt / max(trajectory.seconds, 1e-9),
        'iterations_per_step': report.iterations / max(report.steps, 1),
        'residual_max': report.residual_max,
        'printed_residual_max': report.printed_residual_max,
        'fallbacks': report.fallbacks,
        'unconverged_steps': report.unconverged,
        'penetration_max': report.penetration_max,
        'joint_gap_max': report.joint_gap_max,
        'joint_twist_max': report.joint_twist_max,
    }


def is_recording(source: str) -> bool:
    """Return whether a source names a recorded run, not a scene."""
    return Path(source).suffix not in ('', '.yaml', '.yml') or Path(source).is_dir()


def load(path: Path, namespace: str | None) -> Trajectory:
    """
    Read a recorded run from an npz file or a bag.

    Raises
    ------
    ParameterError
        If it is neither, or cannot be read.

    """
    if path.suffix == '.npz':
        return Trajectory.load(path)
    if path.suffix == '.mcap' or path.is_dir():
        return read_bag(path, namespace)
    raise ParameterError(
        f'a recorded run ends in .npz or .mcap, or is the folder of a bag; got {path}'
    )


def export(options: argparse.Namespace) -> int:
    """Convert a recorded run."""
    files = outputs(options)
    if not files:
        raise ParameterError('nothing to write: give one of --out, --csv, --gif and --mp4')
    trajectory = load(options.run, options.namespace)
    write(trajectory, files, title_of(options.run), options.speed)
    for path in files.values():
        print(f'{len(trajectory.time)} samples in {path}')
    return 0
