"""The command `snake-sim`: scenes without ROS, measurements, and the live demonstration."""

import argparse
from dataclasses import replace
from pathlib import Path
import sys
from typing import Any

from tqdm import tqdm

from snake_sim_ros import __version__
from snake_sim_ros.comparison.csv_tables import mark_unknown
from snake_sim_ros.comparison.csv_tables import plain
from snake_sim_ros.comparison.csv_tables import read_table
from snake_sim_ros.comparison.csv_tables import records_of
from snake_sim_ros.comparison.csv_tables import TableWriter
from snake_sim_ros.recording import recordings
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import parse_yaml
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.scene.quantities import ParameterError
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.methods import AUTO
from snake_sim_ros.stepping.methods import METHODS

CASES = ('lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting')
QUICK_CASES = CASES[::2]
# Of the bench.
PARTS = ('precision', 'links', 'iterations', 'costs', 'start_up', 'agreement', 'soak')
RATES = (50.0, 100.0, 200.0, 500.0)  # Hz, of the pacing
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
    recordings.add_outputs(command, bag=True)
    command.add_argument('--rate', type=float, help='samples a second [Hz], default 100')
    _add_method(command)
    _add_scene_options(command)

    command = commands.add_parser('export', help='convert a recorded run')
    command.set_defaults(command=recordings.export)
    command.add_argument('run', type=Path, help='npz file, MCAP file, or folder of a bag')
    _add_namespace(command)
    recordings.add_outputs(command, bag=False)

    command = commands.add_parser('record', help='record all topics of a live robot as a bag')
    command.set_defaults(command=_record)
    command.add_argument('file', type=Path, metavar='FILE.mcap')

    command = commands.add_parser(
        'view', help='show a robot in the browser: a live one, a scene run live, or a recording'
    )
    command.set_defaults(command=_view)
    command.add_argument(
        'source', nargs='?', metavar='RECORDING|SCENE',
        help='npz file, MCAP file, folder of a bag, or a scene that is run live; default: the '
        'robot on the topics',
    )  # fmt: skip
    command.add_argument('--host', default='127.0.0.1', help='default: 127.0.0.1, this machine')
    command.add_argument('--port', type=int, default=8080, help='default: 8080; 0 is any free one')
    command.add_argument('--no-browser', action='store_true', help='only print the address')
    _add_namespace(command)

    command = commands.add_parser('figures', help="draw the paper's figures anew")
    command.set_defaults(command=_figures)
    command.add_argument(
        '--duration', type=float, default=15.0, help="of every case [s], default 15, the paper's"
    )
    command.add_argument(
        '--out', type=Path, default=Path(), metavar='FOLDER', help='default: this folder'
    )

    command = commands.add_parser(
        'bench', help='measure error, time and much else of all methods: a CSV file'
    )
    command.set_defaults(command=_bench)
    command.add_argument('scene', nargs='*', help='default: cases A to D; with --quick A and C')
    command.add_argument(
        '--out', type=Path, default=Path('bench.csv'), metavar='FILE.csv',
        help='default: bench.csv; rows that it has already are not run again',
    )  # fmt: skip
    command.add_argument('--quick', action='store_true', help='a small matrix, in two minutes')
    command.add_argument(
        '--methods', nargs='+', metavar='METHOD', help='only these, such as newton mujoco'
    )
    command.add_argument(
        '--dt', nargs='+', type=float, metavar='S', help='instead of the steps of the matrix [s]'
    )
    command.add_argument(
        '--parts', nargs='+', metavar='PART', choices=PARTS,
        help=f'default: {", ".join(PARTS)}; with --quick the first two, with scenes, --methods or '
        '--dt the first',
    )  # fmt: skip
    command.add_argument(
        '--limit', type=float, default=20.0, metavar='S',
        help='wall time after which a run counts as too slow [s], default 20',
    )  # fmt: skip
    _add_other_sources(command)
    _add_scene_options(command)

    command = commands.add_parser(
        'artefacts', help='measure what methods without set-valued laws make up: a CSV file'
    )
    command.set_defaults(command=_artefacts)
    command.add_argument(
        '--out', type=Path, default=Path('artefacts.csv'), metavar='FILE.csv',
        help='default: artefacts.csv; rows that it has already are not measured again',
    )  # fmt: skip
    _add_other_sources(command)

    command = commands.add_parser(
        'stability', help='map where methods converge, fail or blow up: a CSV file'
    )
    command.set_defaults(command=_stability)
    command.add_argument(
        '--maps', nargs='+', metavar='MAP', help='only these, such as friction drop_flat'
    )
    command.add_argument('--quick', action='store_true', help='coarse maps, in a minute')
    command.add_argument(
        '--out', type=Path, default=Path('stability.csv'), metavar='FILE.csv',
        help='default: stability.csv; cells that it has already are not run again',
    )  # fmt: skip
    _add_other_sources(command)

    command = commands.add_parser('chart', help='draw what the others measured')
    command.set_defaults(command=_chart)
    command.add_argument('csv', type=Path, nargs='+', metavar='FILE.csv')
    command.add_argument(
        '--out', type=Path, default=Path(), metavar='FOLDER', help='default: this folder'
    )

    command = commands.add_parser(
        'seal', help='mark files that were changed by hand as ones of unknown provenance'
    )
    command.set_defaults(command=_seal)
    command.add_argument('csv', type=Path, nargs='+', metavar='FILE.csv')

    command = commands.add_parser(
        'levels', help='show the model level that each scene gets, its time and its error'
    )
    command.set_defaults(command=_levels)
    command.add_argument(
        'scene', nargs='*', default=list(SCENES), help=f'default: {", ".join(SCENES)}'
    )
    _add_method(command)
    _add_scene_options(command)

    command = commands.add_parser('urdf', help='print the robot of a scene as a URDF')
    command.set_defaults(command=_urdf)
    command.add_argument('scene', nargs='?', default=CASES[0], help='default: lateral_undulation')
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

    command = commands.add_parser(
        'pacing', help='measure how the node sim keeps time over ROS 2, and what that costs'
    )
    command.set_defaults(command=_pacing)
    command.add_argument('--duration', type=float, default=5.0, help='of each part [s], default 5')
    command.add_argument(
        '--rates', nargs='*', type=float, default=RATES, metavar='HZ',
        help='publish rates at which it runs as fast as possible, default 50 100 200 500',
    )  # fmt: skip
    return parser


def _add_namespace(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        '--namespace', metavar='NAME', help='of the robot, where a bag has several'
    )


def _add_other_sources(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        '--other-sources', action='store_true',
        help='go on with a file whose rows are of other sources; new rows have their own head',
    )  # fmt: skip


def _add_method(command: argparse.ArgumentParser) -> None:
    names = ', '.join([AUTO, *METHODS])
    command.add_argument('--method', help=f'instead of that of the scene: {names}')


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    command.add_argument('--duration', type=float, help='instead of that of the scene [s]')
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
        if getattr(options, key, None) is not None:
            settings[key] = getattr(options, key)
    return with_settings(load_scene(source), settings)


def _run(options: argparse.Namespace) -> int:
    return recordings.run_scene(_scene(options, options.scene), options)


def _record(options: argparse.Namespace) -> int:
    if options.file.suffix != '.mcap':
        raise ParameterError(f'the file of a bag must end in .mcap, got {options.file}')
    try:
        from snake_sim_ros.nodes.tools.recorder import record
    except ImportError as error:
        raise ParameterError(
            f'record needs ROS 2 and mcap ({error}): source a ROS 2 installation, or ./run '
            f"record, and pip install 'snake_sim_ros[bags]'"
        ) from None
    return record(options.file)


def _view(options: argparse.Namespace) -> int:
    place = options.host, options.port, not options.no_browser
    if options.source and recordings.is_recording(options.source):
        from snake_sim_ros.view.playback import play

        source = Path(options.source)
        return play(recordings.load(source, options.namespace), source.name, *place)
    try:
        from snake_sim_ros.nodes.tools.live import view
    except ImportError as error:
        raise _needs_ros('a live view', 'view', error) from None
    return view(options.source, *place)


def _figures(options: argparse.Namespace) -> int:
    from snake_sim_ros.paper.figures import draw_figures

    for file in draw_figures(options.out, options.duration):
        print(file)
    return 0


def _bench(options: argparse.Namespace) -> int:
    from snake_sim_ros.comparison import bench
    from snake_sim_ros.comparison import bench_entries as contenders
    from snake_sim_ros.comparison import bench_rows

    names = options.scene or (QUICK_CASES if options.quick else CASES)
    scenes = {source: _scene(options, source) for source in names}
    rivals = contenders.quick_contenders() if options.quick else contenders.all_contenders()
    known = sorted({rival.method for rival in rivals})
    for method in options.methods or []:
        if method not in known:
            raise ParameterError(f'no method {method!r} in the matrix; it has: {", ".join(known)}')
    rivals = [rival for rival in rivals if rival.method in (options.methods or known)]
    contenders.check_times(scenes.values(), options.dt or (), options.limit)
    if options.dt:
        rates = tuple(1 / dt for dt in dict.fromkeys(options.dt))
        rivals = [r if r.adaptive else replace(r, rates=rates) for r in rivals]
    selected = options.scene or options.methods or options.dt
    usual = PARTS[:1] if selected else PARTS[:2] if options.quick else PARTS
    parts = bench.matrix(scenes, rivals, options.limit, quick=options.quick)
    entries = [entry for name in dict.fromkeys(options.parts or usual) for entry in parts[name]]
    writer = TableWriter(
        options.out, 'bench', bench_rows.COLUMNS, options.set, other_sources=options.other_sources
    )
    layout = '{percentage:3.0f} %|{bar}| {elapsed}, about {remaining} left'
    done = {bench_rows.key(row) for row in writer.rows}
    entries = [entry for entry in entries if not entry.is_in(done)]
    total = sum(entry.guess for entry in entries)
    with tqdm(total=total, bar_format=layout, smoothing=0) as bar:
        for entry in entries:
            rows = bench_rows.outcome(entry)
            writer.append(map(plain, rows))
            for row in rows:
                bar.write(bench_rows.line(row))
            bar.update(entry.guess)
    print(f'{options.out} is complete; snake-sim chart {options.out} draws it')
    return 0


def _artefacts(options: argparse.Namespace) -> int:
    from snake_sim_ros.comparison import artefacts

    writer = TableWriter(
        options.out, 'artefacts', artefacts.COLUMNS, other_sources=options.other_sources
    )
    for measure in tqdm(list(artefacts.measurements(writer.rows)), smoothing=0):
        writer.append(map(plain, measure()))
    rows = records_of(read_table(options.out), 'artefacts', artefacts.Row)
    print(artefacts.text_table(rows), end='')
    return 0


def _stability(options: argparse.Namespace) -> int:
    from snake_sim_ros.comparison.stability import runs as stability
    from snake_sim_ros.comparison.stability.maps import MAPS
    from snake_sim_ros.comparison.stability.maps import run_case

    known = [chart.name for chart in MAPS]
    for name in options.maps or []:
        if name not in known:
            raise ParameterError(f'no map {name!r}; choose from: {", ".join(known)}')
    maps = [chart for chart in MAPS if chart.name in (options.maps or known)]
    if options.quick:
        maps = [stability.coarser(chart) for chart in maps]
    writer = TableWriter(
        options.out, 'stability', stability.COLUMNS, other_sources=options.other_sources
    )
    done = {stability.key(row) for row in writer.rows}
    total = sum(
        stability.key(place) not in done for chart in maps for place in stability.places(chart)
    )
    counts = dict.fromkeys((*stability.OUTCOMES, 'failed'), 0)
    with tqdm(total=total, unit=' cells', smoothing=0.05) as bar:
        for chart in maps:
            bar.set_description(chart.name)
            for cell in stability.cells(chart, done, run_case):
                writer.append([plain(cell)])
                counts[cell.outcome] += 1
                bar.update()
    print(', '.join(f'{count} {name}' for name, count in counts.items()))
    print(f'{options.out} is complete; snake-sim chart {options.out} draws it')
    return 0


def _chart(options: argparse.Namespace) -> int:
    from snake_sim_ros.comparison.charts import draw_artefacts
    from snake_sim_ros.comparison.charts import draw_bench
    from snake_sim_ros.comparison.stability.chart import draw_stability

    draw = {'bench': draw_bench, 'stability': draw_stability, 'artefacts': draw_artefacts}
    if not options.out.is_dir():
        raise ParameterError(f'--out: no folder {options.out}')
    for path in options.csv:
        table = read_table(path)
        kind = table.header['table']
        if kind not in draw:
            raise ParameterError(f'{path}: table must be one of {", ".join(draw)}; got {kind!r}')
        try:
            files = draw[kind](table, options.out)
        except ParameterError as error:
            raise ParameterError(f'{path}: {error}') from None
        for file in files:
            print(file)
    return 0


def _seal(options: argparse.Namespace) -> int:
    for path in options.csv:
        changed = mark_unknown(path)
        print(f'{path}: {"sealed, of unknown provenance" if changed else "its seals fit"}')
    return 0


def _levels(options: argparse.Namespace) -> int:
    from snake_sim_ros.comparison import timing

    scenes = {source: _scene(options, source) for source in options.scene}
    print(f'{"scene":29} {"level":11} {"step":>8} {"spatial":>8} {"faster":>7} {"error":>9} '
          f'{"spatial":>9} {"converged":>9}')  # fmt: skip
    for source, scene in scenes.items():
        row = timing.level_row(scene)
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


def _urdf(options: argparse.Namespace) -> int:
    print(robot_description(_scene(options, options.scene).robot))
    return 0


def _needs_ros(what: str, command: str, error: ImportError) -> ParameterError:
    """Return what to raise where ROS 2 is missing."""
    return ParameterError(
        f'{what} needs ROS 2 ({error}): source a ROS 2 installation, or ./run {command}'
    )


def _demo(options: argparse.Namespace) -> int:
    try:
        from snake_sim_ros.nodes.tools.demo import demo
    except ImportError as error:
        raise _needs_ros('the demo', 'demo', error) from None
    return demo(options.scene, options.duration, options.out)


def _pacing(options: argparse.Namespace) -> int:
    try:
        from snake_sim_ros.nodes.tools.pacing import pacing
    except ImportError as error:
        raise _needs_ros('pacing', 'pacing', error) from None
    return pacing(options.duration, options.rates)
