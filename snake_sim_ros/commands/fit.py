# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim fit`: the values of a scene that explain a recorded motion."""

import argparse
from collections.abc import Callable
import json
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_ros.commands.options import add_method, given_settings
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import load_scene, Scene, with_settings

if TYPE_CHECKING:
    from snake_sim_ros.fitting.fit import Fit
    from snake_sim_ros.fitting.judgement import Judgement
    from snake_sim_ros.fitting.replay import Replay

GLOBAL = 400  # simulations of a global stage
FINER = 4  # shorter steps of synthetic recordings


def add_fit(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('fit')
    command.set_defaults(command=_fit)
    command.add_argument(
        'recording', type=Path, help='bag with commands, joint_states and poses, see docs/fit.md'
    )
    command.add_argument(
        '--free', nargs='+', required=True, metavar='NAME',
        help='values to find, such as friction.transversal; A=B: one value for both',
    )  # fmt: skip
    command.add_argument(
        '--scene', help='where to start from, default: the scene of the run, or of the bag'
    )
    command.add_argument(
        '--set', action='append', default=[], metavar='KEY=VALUE',
        help='any value of the scene, also the start of a free one; may be given often',
    )  # fmt: skip
    _add_recording(command)
    add_method(command)
    command.add_argument(
        '--accuracy', type=float, metavar='ERROR', help='of the simulations, default 3e-4'
    )
    command.add_argument(
        '--global', type=int, dest='globally', nargs='?', const=GLOBAL, default=0, metavar='N',
        help=f'search a wide box first, in at most N simulations, {GLOBAL} if N is not given',
    )  # fmt: skip
    command.add_argument('--seed', type=int, default=0, help='of all that is drawn, default 0')
    command.add_argument('--threads', type=int, metavar='N', help='default: one for each core')
    command.add_argument(
        '--check', type=int, default=0, metavar='N',
        help='fit N synthetic recordings of the result, and tell how often intervals cover it',
    )  # fmt: skip
    command.add_argument('--out', type=Path, metavar='FILE.yaml', help='the scene that was found')
    command.add_argument('--plot', type=Path, metavar='FILE.png', help='picture of the residuals')


def _add_recording(command: argparse.ArgumentParser) -> None:
    """Add the options that say how a recording is read."""
    command.add_argument('--namespace', default='', help='of the robot, such as /aiko')
    command.add_argument(
        '--pose', default='', metavar='TOPIC', help='default: link_poses, odom or tf'
    )
    command.add_argument(
        '--link', type=int, metavar='N',
        help='link of the pose, from 1; default: all of link_poses, the middle one of others',
    )  # fmt: skip
    command.add_argument(
        '--noise-position', type=float, default=1e-3, metavar='M',
        help='standard deviation of positions [m], default 0.001',
    )  # fmt: skip
    command.add_argument(
        '--noise-angle', type=float, default=8.7e-3, metavar='RAD',
        help='standard deviation of angles [rad], default 0.0087, half a degree',
    )  # fmt: skip
    command.add_argument(
        '--segment', type=float, default=4.0, metavar='S', help='length of a segment, default 4 s'
    )
    command.add_argument(
        '--burn-in', type=float, default=2.0, metavar='S',
        help='time before a segment in which its start is forgotten, default 2 s',
    )  # fmt: skip
    command.add_argument(
        '--commands', choices=('held', 'interpolated'), dest='law',
        help='how joints follow commands, default: interpolated in the bag of a run, else held as '
        'by sim',
    )  # fmt: skip
    command.add_argument(
        '--horizon', type=float, default=0.05, metavar='S',
        help='how long a held command is extrapolated with its velocity, default 0.05 s',
    )  # fmt: skip


def _fit(options: argparse.Namespace) -> int:
    """Run a fit; the last line on standard output is JSON."""
    from snake_sim_ros.fitting.fit import fit
    from snake_sim_ros.fitting.judgement import judge
    from snake_sim_ros.fitting.results import lines, summary, write_scene

    begin = time.monotonic()
    plot = _plotter(options)
    replay, scene = _replay(options)
    with _Bar() as bar:
        found = fit(
            replay, _unknowns(options, replay), threads=options.threads,
            globally=options.globally, seed=options.seed, progress=bar,
        )  # fmt: skip
    judgement = judge(found, options.seed)
    told = {**summary(found, judgement), 'seconds': time.monotonic() - begin}
    print('\n'.join(lines(found, judgement)))
    if options.out:
        write_scene(found, scene, options.recording, options.out)
        told['out'] = str(options.out)
    if plot:
        plot(found)
        told['plot'] = str(options.plot)
    if options.check:
        told['check'] = _check(options, found)
    print(json.dumps(told))
    return 0 if told['explained'] else 1


def _plotter(options: argparse.Namespace) -> 'Callable[[Fit], None] | None':
    """Check the numbers and files of the options; return what draws, None if nothing is asked."""
    for name, least in (('threads', 1), ('globally', 0), ('seed', 0), ('check', 0)):
        number = getattr(options, name)
        if number is not None and number < least:
            option = name.removesuffix('ly')
            raise ParameterError(f'--{option} must be at least {least}, got {number}')
    for name in ('out', 'plot'):
        path = getattr(options, name)
        if path and not path.absolute().parent.is_dir():
            raise ParameterError(f'--{name}: no folder {path.absolute().parent}')
    if options.out and options.out.suffix not in ('.yaml', '.yml'):
        raise ParameterError(f'--out must end in .yaml, got {options.out}')
    if not options.plot:
        return None
    try:
        from snake_sim_ros.fitting.chart import draw
        from snake_sim_ros.studies.chart import check_plot
    except ImportError as error:
        raise ParameterError(
            f"--plot needs matplotlib ({error}): pip install 'snake_sim_ros[plots]'"
        ) from None
    check_plot(options.plot, [])
    return lambda found: draw(found, options.plot)


def _replay(options: argparse.Namespace) -> 'tuple[Replay, Scene]':
    """Return the recording in segments, and the scene as it was before its steps were chosen."""
    from snake_sim_ros.fitting.recording import read_recording
    from snake_sim_ros.fitting.replay import Replay, Settings, with_fit_steps

    names = ('noise_position', 'noise_angle', 'segment', 'burn_in', 'horizon')
    settings = Settings(**{name: getattr(options, name) for name in names})
    given = given_settings(options)
    scene = load_scene(options.scene) if options.scene else None
    recording = read_recording(
        options.recording, scene, namespace=options.namespace, pose=options.pose,
        link=options.link,
    )  # fmt: skip
    scene = with_settings(recording.scene, given)
    law = options.law or ('interpolated' if recording.is_run else 'held')
    return Replay(recording, with_fit_steps(scene, given), settings, law), scene


def _unknowns(options: argparse.Namespace, replay: 'Replay') -> Any:
    from snake_sim_ros.fitting.unknowns import unknowns_of

    return unknowns_of(replay.scene, options.free)


class _Bar:
    """A count of simulations, with the sum of squares."""

    def __init__(self) -> None:
        self.bar = tqdm(unit=' simulations')

    def __call__(self, count: int, squares: float) -> None:
        """Show how many simulations are done."""
        self.bar.set_postfix_str(f'sum of squares {squares:.6g}', refresh=False)
        self.bar.update(count - self.bar.n)

    def __enter__(self) -> '_Bar':
        """Return the bar."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the line."""
        self.bar.close()


def _check(options: argparse.Namespace, found: 'Fit') -> dict[str, Any]:
    """Fit synthetic recordings of a scene that was found; return how well that went."""
    from snake_sim_ros.fitting.fit import fit
    from snake_sim_ros.fitting.judgement import judge
    from snake_sim_ros.fitting.replay import Replay
    from snake_sim_ros.fitting.results import coverage
    from snake_sim_ros.fitting.synthetic import with_noise, without_noise

    replay, settings = found.replay, found.replay.settings
    repeats: list[tuple[Fit, Judgement]] = []
    finer = with_settings(found.scene, {'dt': found.scene.dt / FINER})
    start = replay.start(found.scene)
    exact = without_noise(replay.recording, finer, start, replay.law, settings.horizon)
    for number in tqdm(range(options.check), unit=' recordings'):
        noisy = with_noise(
            exact, settings.noise_position, settings.noise_angle, options.seed + number
        )
        again = Replay(noisy, replay.scene, settings, replay.law)
        result = fit(again, found.unknowns, threads=options.threads)
        repeats.append((result, judge(result, options.seed + number)))
    told = coverage(found.values, repeats)
    for name, share in told['covered'].items():
        print(f'{name}: {100 * share:.4g} % of {options.check} intervals cover the value')
    return told
