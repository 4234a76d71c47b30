# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim fit`: the values of a scene that explain a recorded motion."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_ros.commands.options import add_method, given_settings
from snake_sim_ros.commands.study import chart_module
from snake_sim_ros.scene.checked_records import flat_fields, ParameterError
from snake_sim_ros.scene.parameters import load_scene, Scene, with_settings

if TYPE_CHECKING:
    from snake_sim_ros.studies.fit import Fit
    from snake_sim_ros.studies.judgement import Judgement
    from snake_sim_ros.studies.replay import Replay

GLOBAL = 400  # simulations of a global stage
FINER = 4  # times shorter steps of synthetic recordings


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
    command.add_argument('--seed', type=int, default=0, help='of all random numbers, default 0')
    command.add_argument('--threads', type=int, metavar='N', help='default: one for each core')
    command.add_argument(
        '--check', type=int, default=0, metavar='N',
        help='fit N synthetic recordings of the result, and count how often intervals contain it',
    )  # fmt: skip
    command.add_argument('--out', type=Path, metavar='FILE.yaml', help='the scene that was found')
    command.add_argument('--plot', type=Path, metavar='FILE.png', help='picture of the residuals')
    command.add_argument(
        '--force', action='store_true',
        help='print intervals and write the scene even where the recording is not explained',
    )  # fmt: skip


def _add_recording(command: argparse.ArgumentParser) -> None:
    """Add the options that say how a recording is read and cut into segments."""
    from snake_sim_ros.studies.recorded_motion import LAWS
    from snake_sim_ros.studies.replay import ReplaySettings

    command.add_argument('--namespace', default='', help='of the robot, such as /aiko')
    command.add_argument(
        '--pose', default='', metavar='TOPIC', help='default: link_poses, odom or tf'
    )
    command.add_argument(
        '--link', type=int, metavar='N',
        help='link of the pose, from 1; default: all of link_poses, the middle one of others',
    )  # fmt: skip
    command.add_argument(
        '--commands', choices=LAWS, dest='law',
        help='how joints follow commands, default: interpolated in the bag of a run, otherwise '
        'held as by sim',
    )  # fmt: skip
    for name, (default, about) in flat_fields(ReplaySettings()).items():
        command.add_argument(
            f'--{name.replace("_", "-")}', type=float, default=default,
            metavar=about['unit'].upper(),
            help=f'{about["meaning"]} [{about["unit"]}], default {default:g}',
        )  # fmt: skip


def _fit(options: argparse.Namespace) -> int:
    """Run a fit; the last line on standard output is JSON."""
    from snake_sim_ros.studies.fit import fit, unknowns_of
    from snake_sim_ros.studies.judgement import (
        judge,
        lines,
        summary,
        what_is_suggested,
        write_scene,
    )
    from snake_sim_ros.studies.replay import MOST_START, start_effect, START_ERROR

    begin = time.monotonic()
    plot = _plotter(options)
    replay, scene = _replay(options)
    unknowns = unknowns_of(replay.scene, options.free, replay.setup)
    effect, residuals = start_effect(replay)
    if effect > MOST_START:
        print(
            f'the recording tells little: the robot does not forget the start of a segment, an '
            f'error of {START_ERROR:g} rad there is {effect:.2g} times the noise after the '
            f'burn-in of {replay.settings.burn_in:g} s; give a longer --burn-in, and do not rely '
            f'on intervals'
        )
    with _progress('fit') as progress:
        found = fit(
            replay, unknowns, threads=options.threads,
            globally=options.globally, seed=options.seed, progress=progress, known=residuals,
        )  # fmt: skip
    judgement = judge(found, options.seed)
    suggested: tuple[str, ...] = ()
    if judgement.failures:
        with _progress('diagnosis') as progress:
            suggested = what_is_suggested(found, options.threads, progress)
    result = {
        **summary(found, judgement, forced=options.force), 'suggestions': suggested,
        'seconds': time.monotonic() - begin,
    }  # fmt: skip
    print('\n'.join([*lines(found, judgement, forced=options.force), *suggested]))
    if options.out and judgement.failures and not options.force:
        print(f'{options.out} is not written; --force writes it, and prints intervals')
    elif options.out:
        write_scene(found, scene, options.recording, options.out)
        result['out'] = str(options.out)
    if plot:
        plot(found)
        result['plot'] = str(options.plot)
    if options.check:
        result['check'] = _check(options, found)
    print(json.dumps(result))
    return 0 if result['explained'] else 1


@contextmanager
def _progress(stage: str) -> 'Iterator[Callable[[int, float], None]]':
    """Show the simulations of a stage; yields what counts them."""
    with tqdm(desc=stage, unit=' simulations') as bar:
        done = 0  # by fits that have ended

        def progress(count: int, squares: float) -> None:
            nonlocal done
            if done + count < bar.n:
                done = bar.n
            bar.set_postfix_str(f'sum of squares {squares:.6g}', refresh=False)
            bar.update(done + count - bar.n)

        yield progress


def _plotter(options: argparse.Namespace) -> 'Callable[[Fit], None] | None':
    """Check the numbers and files of the options; return what draws, None if nothing is asked."""
    from snake_sim_ros.studies.table import check_file, PICTURES

    for name, least in (('threads', 1), ('globally', 0), ('seed', 0), ('check', 0)):
        number = getattr(options, name)
        if number is not None and number < least:
            option = name.removesuffix('ly')
            raise ParameterError(f'--{option} must be at least {least}, got {number}')
    if options.out:
        check_file(options.out, '--out', ('.yaml', '.yml'))
    if not options.plot:
        return None
    chart = chart_module('--plot')
    check_file(options.plot, '--plot', PICTURES)
    return lambda found: chart.draw_fit(found, options.plot)


def _replay(options: argparse.Namespace) -> 'tuple[Replay, Scene]':
    """Return the recording in segments, and the scene as it was before its steps were chosen."""
    from snake_sim_ros.studies.fit import OFFSETS, SETUP
    from snake_sim_ros.studies.recorded_motion import read_recording
    from snake_sim_ros.studies.replay import Replay, ReplaySettings, with_fit_steps, with_offsets

    names = flat_fields(ReplaySettings())
    settings = ReplaySettings(**{name: getattr(options, name) for name in names})
    given = given_settings(options)
    scene = load_scene(options.scene) if options.scene else None
    recording = read_recording(
        options.recording, scene, namespace=options.namespace, pose=options.pose,
        link=options.link,
    )  # fmt: skip
    scene, links = with_settings(recording.scene, given), recording.scene.robot.link_count
    if scene.robot.link_count != links:
        raise ParameterError(
            f'robot.link_count must be the {links} of the bag, got {scene.robot.link_count}'
        )
    law = options.law or ('interpolated' if recording.is_run else 'held')
    replay = Replay(recording, with_fit_steps(scene, given), settings, law)
    free = {name for item in options.free for name in item.split('=')}
    streams = {SETUP[name][0] for name in free & {*OFFSETS}}
    return with_offsets(replay, streams) if streams else replay, scene


def _check(options: argparse.Namespace, found: 'Fit') -> dict[str, Any]:
    """Fit synthetic recordings of a scene that was found; return how well that went."""
    from snake_sim_ros.studies.fit import fit
    from snake_sim_ros.studies.judgement import coverage, judge
    from snake_sim_ros.studies.replay import on_one_clock, Replay, Setup, with_noise, without_noise

    replay, settings = found.replay, found.replay.settings
    repeats: list[tuple[Fit, Judgement]] = []
    finer = with_settings(found.scene, {'dt': found.scene.dt / FINER})
    start = replay.start(found.scene)
    law, (joints, poses) = (replay.law, settings.horizon), replay.setup[:2]
    here = found.setup._replace(
        joints=found.setup.joints - joints, poses=found.setup.poses - poses
    )
    exact = without_noise(replay.recording, finer, start, *law, here)
    exact = on_one_clock(exact, Setup(-joints, -poses))
    for number in tqdm(range(options.check), unit=' recordings'):
        noisy = with_noise(
            exact, settings.noise_position, settings.noise_angle, options.seed + number
        )
        setup = replay.setup if replay.margin else None
        again = Replay(noisy, replay.scene, settings, replay.law, setup)
        refitted = fit(again, found.unknowns, threads=options.threads)
        repeats.append((refitted, judge(refitted, options.seed + number)))
    result = coverage(found.values, repeats)
    for name, share in result['covered'].items():
        print(f'{name}: {100 * share:.4g} % of {options.check} intervals cover the value')
    return result
