"""The command `snake-sim`: scenes without ROS, measurements, and the live demonstration."""

import argparse
from dataclasses import replace
import json
from pathlib import Path
import sys
from typing import Any

from tqdm import tqdm

from snake_sim_ros import __version__
from snake_sim_ros.parameters import load_scene
from snake_sim_ros.parameters import parse_yaml
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import with_settings
from snake_sim_ros.records import ParameterError
from snake_sim_ros.simulation import run
from snake_sim_ros.simulation import Trajectory
from snake_sim_ros.stepping import make_stepper
from snake_sim_ros.stepping import METHODS
from snake_sim_ros.stepping import Status

CASES = ('lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting')

SCENES = (*CASES, 'slender_undulation', 'obstacle_aided', 'step')


def main(args: list[str] | None = None) -> int:
    """
    Run the command.

    Returns
    -------
    int
        0; 1 if a run diverged or a node died; 2 if the input is not usable; 130 after Ctrl-C.

    """
    options = _parser().parse_args(args)
    try:
        return int(options.command(options))
    except (ParameterError, OSError) as error:
        print(f'snake-sim: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='snake-sim', description=__doc__)
    parser.add_argument('--version', action='version', version=__version__)
    commands = parser.add_subparsers(required=True, metavar='COMMAND')

    command = commands.add_parser('run', help='run a scene and record it')
    command.set_defaults(command=_run)
    command.add_argument('scene', help='YAML file, or the name of a scene in config/')
    command.add_argument('--out', type=Path, metavar='FILE.npz', help='where the recording goes')
    command.add_argument('--rate', type=float, default=100.0, help='samples a second [Hz]')
    _add_scene_options(command)

    command = commands.add_parser('bench', help='measure time and error of steps')
    command.set_defaults(command=_bench)
    command.add_argument('scene', nargs='*', default=list(CASES), help='default: cases A to D')
    command.add_argument(
        '--methods', nargs='+', metavar='METHOD', choices=[m for m in METHODS if m != 'reference'],
        help='with --dt all combinations, in place of a table of selected ones',
    )  # fmt: skip
    command.add_argument('--dt', nargs='+', type=float, metavar='S', help='time steps [s]')
    command.add_argument(
        '--no-start-up', action='store_true', help='leave out the start-up times of new processes'
    )
    _add_scene_options(command)

    command = commands.add_parser(
        'levels', help='show the model level that each scene gets, its time and its error'
    )
    command.set_defaults(command=_levels)
    command.add_argument(
        'scene', nargs='*', default=list(SCENES), help=f'default: {", ".join(SCENES)}'
    )
    _add_scene_options(command)

    command = commands.add_parser(
        'demo', help='run a scene live: the nodes sim and gait over ROS 2'
    )
    command.set_defaults(command=_demo)
    command.add_argument('scene', nargs='?', default=CASES[0], help='default: lateral_undulation')
    command.add_argument(
        '--duration', type=float, default=15.0, help='of the gait [s], default 15'
    )
    command.add_argument(
        '--out', type=Path, default=Path('demo.png'), metavar='FILE.png', help='default: demo.png'
    )
    return parser


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    command.add_argument('--duration', type=float, help='instead of that of the scene [s]')
    command.add_argument('--method', help=f'instead of that of the scene: {", ".join(METHODS)}')
    command.add_argument(
        '--set', action='append', default=[], metavar='KEY=VALUE',
        help='any value of the scene, such as friction.longitudinal=0.2; may be given often',
    )  # fmt: skip


def _scene(options: argparse.Namespace, source: str) -> Scene:
    settings: dict[str, Any] = {}
    for item in options.set:
        key, separator, value = item.partition('=')
        if not separator:
            raise ParameterError(f'--set must be KEY=VALUE, got {item!r}')
        try:
            settings[key] = parse_yaml(value)
        except ParameterError as error:
            raise ParameterError(f'--set {key}: {error}') from None
    for key in ('duration', 'method'):
        if getattr(options, key) is not None:
            settings[key] = getattr(options, key)
    return with_settings(load_scene(source), settings)


def _run(options: argparse.Namespace) -> int:
    scene = _scene(options, options.scene)
    make_stepper(scene)
    if options.out and not options.out.absolute().parent.is_dir():
        raise ParameterError(f'--out: no folder {options.out.absolute().parent}')
    print('compiling ...', end='\r', file=sys.stderr, flush=True)
    layout = '{percentage:3.0f} %|{bar}| {n:.2f} of {total:g} s, {remaining} left'
    with tqdm(total=scene.duration, bar_format=layout) as bar:
        trajectory = run(scene, rate=options.rate, progress=bar.update)
    if options.out:
        trajectory.save(options.out)
    report, link = trajectory.report, scene.robot.middle_link
    x, y, z = trajectory.position[-1, link]
    print(f'link {link + 1} at ({x:.4f}, {y:.4f}, {z:.4f}) m after {trajectory.time[-1]:g} s')
    if report.failure:
        print(f'diverged: {report.failure}', file=sys.stderr)
    if options.out:
        print(f'{len(trajectory.time)} samples in {options.out}')
    print(json.dumps(_summary(trajectory)))
    if report.status is Status.DIVERGED:
        return 1
    return 130 if trajectory.interrupted else 0


def _summary(trajectory: Trajectory) -> dict[str, Any]:
    scene, report = trajectory.scene, trajectory.report
    return {
        'method': scene.method,
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


def _bench(options: argparse.Namespace) -> int:
    from snake_sim_ros import bench

    scenes = {source: _scene(options, source) for source in options.scene}
    runs = [(method, 1 / rate) for method, rate in bench.RUNS]
    if options.methods or options.dt or options.method:
        methods = options.methods or [options.method or 'newton']
        runs = [(method, dt) for method in methods for dt in options.dt or [1 / 4000]]
    compiling: dict[str, float] = {}
    levels = {source: {'spatial'} for source in scenes}
    for source, scene in scenes.items():
        expected, doubt = bench.converged_path(scene)
        print(f'{source}: {scene.duration:g} s, converged to {100 * doubt:.2g} %')
        print(f'{"method":13} {"level":7} {"dt":>8} {"median":>9} {"p99":>9} {"units":>6} '
              f'{"real time":>9} {"iter":>6} {"fell back":>9} {"residual":>8} {"printed":>8} '
              f'{"unconv":>7} {"error":>9}')  # fmt: skip
        for method, dt in runs:
            timing = bench.time_steps(replace(scene, method=method, dt=dt))
            compiling.setdefault(method, timing.compile_seconds)
            report, error = timing.report, bench.path_error(timing.path, expected)
            levels[source].add(report.level)
            print(f'{method:13} {report.level:7} {f"1/{1 / dt:g}":>8} {timing.median:6.2f} us '
                  f'{timing.p99:6.1f} us {timing.units:6.1f} {timing.real_time_factor:7.1f} x '
                  f'{report.iterations / max(report.steps, 1):6.2f} {report.fallbacks:9d} '
                  f'{report.residual_max:8.1e} {report.printed_residual_max:8.1e} '
                  f'{report.unconverged:7d} {100 * error:7.4f} %'
                  f'{" " * bool(report.failure)}{report.failure}', flush=True)  # fmt: skip
    print('units: median step over the factorization of a 6x6 matrix, timed beside it; residuals '
          'in m/s, with the selection rule and as printed')  # fmt: skip
    scene = replace(next(iter(scenes.values())), method='newton')
    for level in sorted(levels[next(iter(scenes))]):
        medians, exponent = bench.cost_exponent(
            replace(scene, level=level, duration=min(1.0, scene.duration)), bench.LINK_COUNTS
        )
        print(f'newton, {level}, median step over links: '
              + ', '.join(f'n = {n}: {median:.1f} us' for n, median in medians.items())
              + f'; exponent {exponent:.2f}')  # fmt: skip
    print('newton, median step by what there is to pay for, and its ratio to all contacts:')
    table = bench.situations(min(1.0, scene.duration))
    for name, (median, ratio, iterations, contacts) in table.items():
        print(f'{name:20} {median:6.2f} us {ratio:6.3f} {iterations:6.2f} iter, '
              f'{contacts:2d} contacts at the end')  # fmt: skip
    listed = ', '.join(f'{name} {seconds:.2f} s' for name, seconds in compiling.items())
    print(f'compile time apart, in this process: {listed}')
    if not options.no_start_up:
        for cold in (True, False):
            what = 'nothing compiled before' if cold else 'everything compiled before'
            print(f'start of a new process to its first step, {what}: '
                  f'{bench.start_up_seconds(scene, cold=cold):.2f} s', flush=True)  # fmt: skip
    return 0


def _levels(options: argparse.Namespace) -> int:
    from snake_sim_ros import bench

    scenes = {source: _scene(options, source) for source in options.scene}
    print(f'{"scene":29} {"level":11} {"step":>8} {"spatial":>8} {"faster":>7} {"error":>9} '
          f'{"spatial":>9} {"converged":>9}')  # fmt: skip
    for source, scene in scenes.items():
        row = bench.level_row(scene)
        print(f'{source:29} {row.level:11} {row.median:5.2f} us {row.spatial_median:5.2f} us '
              f'{row.spatial_median / row.median:5.2f} x {100 * row.error:7.4f} % '
              f'{100 * row.spatial_error:7.4f} % {100 * row.doubt:7.4f} %  {row.why}',
              flush=True)  # fmt: skip
    print(
        'step: median at the level that auto takes, and at the spatial one; error: of the path of '
        'the\nmiddle link against the converged path of the spatial level, over the distance '
        'travelled;\nconverged: error of the finer of the two runs that this is extrapolated from'
    )
    return 0


def _demo(options: argparse.Namespace) -> int:
    try:
        from snake_sim_ros.nodes.demo import demo
    except ImportError as error:
        raise ParameterError(
            f'the demo needs ROS 2 ({error}): source a ROS 2 installation, or ./run demo'
        ) from None
    return demo(options.scene, options.duration, options.out)


if __name__ == '__main__':
    sys.exit(main())
