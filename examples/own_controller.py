# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steer lateral undulation to a heading by measured states, in a loop on Simulation.advance."""

import argparse
import math

import numpy as np

from snake_sim_ros import Simulation

PERIOD = 40  # steps of 1/4000 s: the controller runs at 100 Hz
AMPLITUDE, FREQUENCY, LAG = math.radians(30), math.radians(80), math.radians(-50)
GAIN, MOST = 0.15, 0.2  # yaw offset per error of the heading [1], largest offset [rad]


def heading(simulation: Simulation) -> float:
    """Return the direction from the last link to the first one [rad]."""
    x, y, _ = simulation.state.position[0] - simulation.state.position[-1]
    return math.atan2(y, x)


def main() -> None:
    """Turn the robot toward a heading and print where it points every second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=10.0, help='s')
    parser.add_argument('--turn', type=float, default=45.0, help='degrees, to the left')
    arguments = parser.parse_args()
    simulation = Simulation('lateral_undulation')
    first, joint = heading(simulation), np.arange(10)
    wanted, printed = first + math.radians(arguments.turn), 0.0
    while simulation.time < arguments.duration:
        error = math.remainder(wanted - heading(simulation), math.tau)
        t = simulation.midpoints(PERIOD)[:, None]
        angle, rate = np.zeros((2, PERIOD, 10, 2))
        phase = FREQUENCY * t + LAG * joint
        angle[:, :, 0] = AMPLITUDE * np.sin(phase) - max(-MOST, min(MOST, GAIN * error))
        rate[:, :, 0] = AMPLITUDE * FREQUENCY * np.cos(phase)
        report = simulation.advance(angle, rate)
        if report.failure:
            raise SystemExit(report.failure)
        if simulation.time >= printed + 1.0:
            printed += 1.0
            turned = math.degrees(math.remainder(heading(simulation) - first, math.tau))
            print(f't = {printed:.0f} s: turned by {turned:.1f} degrees')


if __name__ == '__main__':
    main()
