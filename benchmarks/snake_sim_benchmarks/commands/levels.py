# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim levels`: the model level of scenes, its time and its error."""

import argparse
import sys
from typing import Any

from tqdm import tqdm

from snake_sim_ros.commands.options import add_method, add_scene_options, CASES, scene_from

SCENES = (*CASES, 'slender_undulation', 'obstacle_aided', 'step')


def add_levels(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('levels')
    command.set_defaults(command=_levels)
    command.add_argument(
        'scene', nargs='*', default=list(SCENES), help=f'default: {", ".join(SCENES)}'
    )
    add_method(command)
    add_scene_options(command)


def _levels(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison import timing

    scenes = {source: scene_from(options, source) for source in options.scene}
    if note := timing.note_on_step_times():
        print(note, file=sys.stderr)
    print(f'{"scene":29} {"level":11} {"step":>8} {"spatial":>8} {"faster":>7} {"error":>9} '
          f'{"spatial":>9} {"converged":>9}')  # fmt: skip
    for source, scene in tqdm(scenes.items(), desc='levels', unit=' scenes', leave=False):
        row = timing.level_row(scene)
        tqdm.write(f'{source:29} {row.level:11} {row.median:5.2f} us {row.spatial_median:5.2f} us '
              f'{row.spatial_median / row.median:5.2f} x {100 * row.error:7.4f} % '
              f'{100 * row.spatial_error:7.4f} % {100 * row.doubt:7.4f} %  {row.why}')  # fmt: skip
    print(
        'step: median at the level that auto takes, and at the spatial one; error: of the path of '
        'the\nmiddle link against the converged path of the spatial level, over the distance '
        'travelled;\nconverged: error of the finer of the two runs that this is extrapolated from'
    )
    return 0
