# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A controller of your own: lateral undulation whose joints give way to their torques.

This script draws what that changes. A scene takes the controller by its name:

    ./run run lateral_undulation --set controller=examples/compliant.py:Compliant
"""

import argparse
from collections.abc import Callable

from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros import Measured, run, Scene

JOINT = 5  # whose angle and torque are drawn
# Angles and rates (m, joints, 2), (yaw, pitch) of every joint [rad], [rad/s], at m times [s].
Reference = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Compliant:
    """
    Undulates, and turns each joint back by its torque, as a soft spring between the links would.

    Parameters
    ----------
    softness : float, optional
        Angle by which a joint gives way to a torque [rad/(N m)].
    lag : float, optional
        Time constant with which it does [s].

    """

    period, sees_poses = 0.05, False

    def __init__(self, softness: float = 0.1, lag: float = 0.5) -> None:
        self.softness, self.share = softness, self.period / (self.period + lag)

    def start(self, scene: Scene) -> None:
        """Begin anew with the wave of a scene, and with joints that have not given way."""
        self.wave, self.joint = scene.gait.yaw, np.arange(scene.robot.link_count - 1)
        self.given = np.zeros(len(self.joint))  # [rad]

    def control(self, measured: Measured, time: float) -> Reference:
        """Return angles and rates of the next period; joints give way at a constant rate in it."""
        begin, torque = self.given, measured.joint_torque[::2]  # of yaw
        self.given = begin + self.share * (self.softness * torque - begin)
        wave, slope = self.wave, (self.given - begin) / self.period

        def reference(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            t = times[:, None]
            angle, rate = np.zeros((2, len(times), len(self.joint), 2))
            phase = wave.angular_frequency * t + wave.phase_lag * self.joint
            angle[:, :, 0] = wave.amplitude * np.sin(phase) - begin - slope * (t - time)
            rate[:, :, 0] = wave.amplitude * wave.angular_frequency * np.cos(phase) - slope
            return angle, rate

        return reference


def main() -> None:
    """Print torques and distances of the gait alone and with the controller, and draw a joint."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--duration', type=float, default=15.0, help='s')
    parser.add_argument('--out', default='compliant.png')
    arguments = parser.parse_args()
    figure = Figure(figsize=(9.0, 4.6), layout='constrained')
    panels = figure.subplots(2, 1, sharex=True)
    cases = {'gait alone': (None, '#e69f00'), 'compliant': (Compliant(), '#0072b2')}
    for label, (controller, color) in cases.items():
        moved = run('lateral_undulation', controller=controller, duration=arguments.duration)
        torque, angle = moved.joint_torque[:, ::2], np.degrees(moved.joint_angle[:, ::2])
        print(
            f'{label}: {moved.distance:.2f} m, torques of {np.abs(torque).max():.2f} N m at most, '
            f'{np.sqrt((torque**2).mean()):.2f} N m as root mean square'
        )
        panels[0].plot(moved.time, angle[:, JOINT - 1], color=color, label=label)
        panels[1].plot(moved.time, torque[:, JOINT - 1], color=color)
    panels[0].set(ylabel=f'yaw of joint {JOINT} [degrees]')
    panels[1].set(ylabel='its torque [N m]', xlabel='time [s]')
    figure.legend(frameon=False, loc='outside upper center', ncols=2)
    for axes in panels:
        axes.grid(alpha=0.3)
    figure.savefig(arguments.out, dpi=110)
    print(arguments.out)


if __name__ == '__main__':
    main()
