# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands on a recorded run: `snake-sim record`, `export`, `score`, `plot` and `view`."""

import argparse
from dataclasses import replace
import json
import os
from pathlib import Path
from typing import Any

from snake_sim_ros.nodes.programs import handled, missing_ros
from snake_sim_ros.scene.checked_records import ParameterError, quoted

# ---- record -------------------------------------------------------------------------------------


def add_record(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('record')
    command.set_defaults(command=_record)
    command.add_argument('file', type=Path, metavar='FILE.mcap')


def _record(options: argparse.Namespace) -> int:
    if options.file.suffix != '.mcap':
        raise ParameterError(f'the file of a bag must end in .mcap, got {options.file}')
    try:
        # An exception of a handler may be lost in an import.
        with handled(lambda *_: os._exit(130)):
            from snake_sim_ros.nodes.tools.topic_recorder import record_topics
    except ImportError as error:
        raise ParameterError(
            f'record needs ROS 2 and mcap ({error}): source a ROS 2 installation, or ./run '
            f"record, and pip install 'snake_sim_ros[bags]'"
        ) from None
    return record_topics(options.file)


# ---- export -------------------------------------------------------------------------------------


def add_export(subparsers: Any) -> None:
    """Add the command."""
    from snake_sim_ros.commands.options import add_namespace, add_outputs

    command = subparsers.add_parser('export')
    command.set_defaults(command=_export)
    command.add_argument('run', type=Path, help='npz file, MCAP file, or folder of a bag')
    add_namespace(command)
    add_outputs(command, bag=False)


def _export(options: argparse.Namespace) -> int:
    from snake_sim_ros.commands.options import outputs, print_outputs, title_of, write_outputs
    from snake_sim_ros.recording.recorded_runs import read_run

    files = outputs(options)
    if not files:
        raise ParameterError('nothing to write: give one of --out, --csv, --gif and --mp4')
    trajectory = read_run(options.run, options.namespace)
    write_outputs(trajectory, files, title_of(options.run), options.speed)
    print_outputs(trajectory, files)
    return 0


# ---- score --------------------------------------------------------------------------------------


def add_score(subparsers: Any) -> None:
    """Add the command."""
    from snake_sim_ros.commands.options import add_namespace, add_scene_options

    command = subparsers.add_parser('score')
    command.set_defaults(command=_score)
    command.add_argument(
        'source',
        metavar='RECORDING|SCENE',
        help='npz file, MCAP file, folder of a bag, or a scene',
    )
    command.add_argument(
        '--begin', type=float, default=0.0, metavar='S', help='leave out what is before [s]'
    )
    command.add_argument('--plot', type=Path, metavar='FILE', help='a PNG, PDF or SVG file')
    command.add_argument(
        '--controller', metavar='NAME', help='the controller of a scene, as controller.name'
    )
    command.add_argument(
        '--path', metavar='"X,Y X,Y"', help='points of the path [m], as follow.points'
    )
    add_namespace(command)
    add_scene_options(command)


def _score(options: argparse.Namespace) -> int:
    """Print the metrics of the path as JSON, and draw it."""
    from snake_sim_ros.api.runs import read_run, run
    from snake_sim_ros.commands.options import given_settings, scene_from, title_of
    from snake_sim_ros.recording.recorded_runs import names_a_recorded_run
    from snake_sim_ros.scene.parameters import with_settings
    from snake_sim_ros.studies.metrics import metrics_of_run

    if options.path:
        options.set += [f'follow.points={[_point(each) for each in options.path.split()]}']
    if options.controller:
        options.set += [f'controller.name={options.controller}']
    if names_a_recorded_run(options.source):
        if options.controller:
            raise ParameterError(
                f'--controller must go with a scene, which is run; {options.source} is recorded'
            )
        found = read_run(options.source, options.namespace)
        found = replace(found, scene=with_settings(found.scene, given_settings(options)))
    else:
        found = run(scene_from(options, options.source))
    if not found.scene.follow:
        raise ParameterError(
            'there is no path to score: give one by --path "0,0 2,0", or by follow.points or '
            'follow.center'
        )
    if not 0.0 <= options.begin < found.time[-1]:
        raise ParameterError(
            f'--begin must be within the run of {found.time[-1]:g} s, got {options.begin:g}'
        )
    part = found.between(options.begin, float(found.time[-1]))
    if options.plot:
        from snake_sim_ros.view import charts

        charts().draw(part, options.plot, title_of(options.source))
    print(json.dumps(metrics_of_run(part)))
    return 1 if found.report.failure else 0


def _point(text: str) -> list[float]:
    """Return the point that a text says."""
    try:
        x, y = map(float, text.split(','))
    except ValueError:
        raise ParameterError(f'--path must be points X,Y [m], got {quoted(text)}') from None
    return [x, y]


# ---- plot ---------------------------------------------------------------------------------------


def add_plot(subparsers: Any) -> None:
    """Add the command."""
    from snake_sim_ros.commands.options import add_namespace

    command = subparsers.add_parser('plot')
    command.set_defaults(command=_plot)
    command.add_argument('run', type=Path, help='npz file, MCAP file, or folder of a bag')
    add_namespace(command)
    command.add_argument(
        '--out', type=Path, metavar='FILE',
        help='a PNG, PDF or SVG file; default: the run with the suffix .png',
    )  # fmt: skip


def _plot(options: argparse.Namespace) -> int:
    from snake_sim_ros.commands.options import title_of
    from snake_sim_ros.recording.recorded_runs import read_run
    from snake_sim_ros.view import charts

    chart = charts()
    path = options.out or options.run.with_suffix('.png')
    chart.check_plot(path)
    chart.draw(read_run(options.run, options.namespace), path, title_of(options.run))
    print(path)
    return 0


# ---- view ---------------------------------------------------------------------------------------


def add_view(subparsers: Any) -> None:
    """Add the command."""
    from snake_sim_ros.commands.options import add_namespace

    command = subparsers.add_parser('view')
    command.set_defaults(command=_view)
    command.add_argument(
        'source', nargs='?', metavar='RECORDING|SCENE',
        help='npz file, MCAP file, folder of a bag, or a scene to run live; default: the robot '
        'on the topics',
    )  # fmt: skip
    command.add_argument('--host', default='127.0.0.1', help='default: 127.0.0.1, this machine')
    command.add_argument('--port', type=int, default=8080, help='default: 8080; 0 = any free port')
    command.add_argument('--no-browser', action='store_true', help='print the address only')
    add_namespace(command)


def _view(options: argparse.Namespace) -> int:
    from snake_sim_ros.recording.recorded_runs import names_a_recorded_run, read_run

    place = options.host, options.port, not options.no_browser
    if options.source and names_a_recorded_run(options.source):
        from snake_sim_ros.view.playback import play

        source = Path(options.source)
        return play(read_run(source, options.namespace), source.name, *place)
    try:
        from snake_sim_ros.nodes.tools.live_view import view_live
    except ImportError as error:
        raise missing_ros('a live view', 'view', error) from None
    return view_live(options.source, *place)
