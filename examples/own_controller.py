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


def draw(times: list[float], turns: list[float], wanted: float, file: str) -> None:
    """Draw by how much the robot has turned [degrees] over time [s]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout='constrained')
    axes = figure.subplots()
    axes.axhline(wanted, color='#e69f00', ls='--', label='wanted')
    axes.plot(times, turns, color='#0072b2', label='from the last link to the first')
    axes.set(xlabel='time [s]', ylabel='turned to the left [degrees]')
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    figure.savefig(file, dpi=110)


def main() -> None:
    """Turn the robot toward a heading and print where it points every second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=10.0, help='s')
    parser.add_argument('--turn', type=float, default=45.0, help='degrees, to the left')
    parser.add_argument('--plot', help='a picture of the heading, such as own_controller.png')
    arguments = parser.parse_args()
    simulation = Simulation('lateral_undulation')
    first, joint = heading(simulation), np.arange(10)
    wanted, printed = first + math.radians(arguments.turn), 0.0
    times, turns = list[float](), list[float]()
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
        times.append(simulation.time)
        turns.append(math.degrees(math.remainder(heading(simulation) - first, math.tau)))
        if simulation.time >= printed + 1.0:
            printed += 1.0
            print(f't = {printed:.0f} s: turned by {turns[-1]:.1f} degrees')
    if arguments.plot:
        draw(times, turns, arguments.turn, arguments.plot)


if __name__ == '__main__':
    main()
