# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fit of a recording of live nodes: `sim` and `gait`, recorded through ROS."""

import json
import signal
import sys

from programs import background, Process
import pytest
from sensor_msgs.msg import JointState

from snake_sim_ros.commands.main import main

pytest.importorskip('mcap_ros2')

DURATION = 7.0  # s of simulated time
TRIES = 3  # recordings, on a machine that is too busy for one
RECORD = [sys.executable, '-m', 'snake_sim_ros.commands', 'record']
TRUTH = {'friction.longitudinal': 0.15, 'friction.transversal': 0.4, 'robot.yaw_stiffness': 30.0}


def record_a_run(graph, path):
    """Record seven seconds of the robot with the true values, at half the speed of the clock."""
    with background():
        recorder = Process([*RECORD, str(path)], graph.domain)
    recorder.wait_for('recording all topics')
    values = {**TRUTH, 'real_time_factor': 0.5}
    graph.start('sim', *(f'-p {name}:={value}' for name, value in values.items()))
    graph.start('gait', '-p use_sim_time:=true')
    states = graph.record(JointState, 'joint_states')
    graph.until(lambda: states and states[-1].header.stamp.sec >= DURATION, 'seven seconds')
    recorder.popen.send_signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.output
    for process in graph.processes:
        process.stop()


def test_a_live_recording_tells_the_values_of_the_simulator(make_graph, tmp_path, capsys):
    # The robot waits for its first command; the burn-in is long enough for that. The robot that
    # the bag describes has no friction and no gains: the fit starts from defaults.
    noise = ['--noise-position', '0.005', '--noise-angle', '0.02']
    options = [*noise, '--segment', '1.5', '--burn-in', '2', '--free', *TRUTH]
    for attempt in range(TRIES):
        path = tmp_path / f'live_{attempt}.mcap'
        record_a_run(make_graph(), path)
        # A fit says if the model does not explain a recording, as when commands came late.
        if main(['fit', str(path), *options]) == 0:
            break
        assert 'the model does not explain the recording' in capsys.readouterr().out
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    # The steps of 1/4000 s of the simulator shift all values by 0.4 %. What else is not exact is
    # when commands reach the simulator: two periods after their stamps, or more while other
    # programs work. On a busy machine that was 1.4 mm and 2.1 %, hence the stated noise.
    for name, value in TRUTH.items():
        assert told['values'][name]['value'] == pytest.approx(value, rel=0.05), name
    assert told['values']['friction.transversal']['start'] == 0.5
