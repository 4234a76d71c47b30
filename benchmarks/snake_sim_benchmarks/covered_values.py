# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How often the 95 % intervals of a fit contain the truth: the table of coverage in docs/fit.md.

    ./run python benchmarks/snake_sim_benchmarks/covered_values.py 200

makes so many recordings of one motion, which differ in their noise alone, for each way to measure
it. It fits each, and prints the share of the intervals that contain the truth, from the curvature
and from the bootstrap, and the share of recordings that the tests call explained.
"""

from dataclasses import replace
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from snake_sim_ros import load_scene
from snake_sim_ros.commands.main import main as snake_sim
from snake_sim_ros.scene.checked_records import flat_fields
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.studies.fit import fit, SETUP, unknowns_of
from snake_sim_ros.studies.judgement import coverage, judge
from snake_sim_ros.studies.recorded_motion import read_recording, Recording
from snake_sim_ros.studies.replay import (
    AS_STATED,
    Replay,
    ReplaySettings,
    Setup,
    with_fit_steps,
    with_noise,
    without_noise,
)

ROBOT = {'robot.link_count': 7}  # of lateral undulation
DURATION, RATE = 12.0, 50.0  # [s], [Hz]
SETTINGS = ReplaySettings(segment=2.0, burn_in=2.0)
FINER = 4  # times shorter steps of the recordings
FRICTION = 'friction.longitudinal', 'friction.transversal'
TURNED = Setup(roll=0.02, pitch=-0.03)
MEASURED = {  # links that are measured, None for all, the setup, and what is free
    'all links': (None, AS_STATED, FRICTION),
    'head only': ([0], AS_STATED, FRICTION),
    'all links, turned frame': (None, TURNED, (*FRICTION, 'frame.roll', 'frame.pitch')),
}


def recording_of_run() -> Recording:
    """Return what the bag of a run has, without noise."""
    with TemporaryDirectory() as folder:
        bag = Path(folder) / 'run.mcap'
        values = [text for key, value in ROBOT.items() for text in ('--set', f'{key}={value}')]
        times = ['--duration', f'{DURATION:g}', '--rate', f'{RATE:g}']
        snake_sim(['run', 'lateral_undulation', *times, '--bag', str(bag), *values])
        return read_recording(bag)


def covered(recording: Recording, name: str, count: int) -> dict[str, Any]:
    """Return what `judgement.coverage` does of fits to some recordings with noise."""
    links, setup, free = MEASURED[name]
    if links:
        recording = replace(
            recording,
            links=recording.links[links],
            position=recording.position[:, links],
            orientation=recording.orientation[:, links],
        )
    scene = with_fit_steps(with_settings(load_scene('lateral_undulation'), ROBOT))
    begun = Replay(recording, scene, SETTINGS, 'interpolated')
    finer = with_settings(scene, {'dt': scene.dt / FINER})
    law = 'interpolated', SETTINGS.horizon
    exact = without_noise(begun.recording, finer, begun.start(scene), *law, setup)
    unknowns = unknowns_of(scene, free)
    found = []
    for seed in range(count):
        noisy = with_noise(exact, SETTINGS.noise_position, SETTINGS.noise_angle, seed)
        result = fit(Replay(noisy, scene, SETTINGS, 'interpolated'), unknowns, threads=1)
        found.append((result, judge(result, seed)))
    known = flat_fields(scene)
    truth = [getattr(setup, SETUP[key][0]) if key in SETUP else known[key][0] for key in free]
    return coverage(truth, found)


def rows(name: str, result: dict[str, Any]) -> list[str]:
    """Return the rows of the table for one way to measure."""
    explained = 1.0 - result['failed_tests'] / result['recordings']
    return [
        f'| {name} | {key} | {100 * share:.1f} % | '
        f'{100 * result["covered_by_bootstrap"][key]:.1f} % | {100 * explained:.1f} % |'
        for key, share in result['covered'].items()
    ]


if __name__ == '__main__':
    number = int(sys.argv[1]) if sys.argv[1:] else 200
    run = recording_of_run()
    for way in MEASURED:
        begin = time.process_time()
        print('\n'.join(rows(way, covered(run, way, number))))
        print(f'{time.process_time() - begin:.0f} s of a processor', file=sys.stderr, flush=True)
