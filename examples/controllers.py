# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steer and blend gaits, change oscillators, move by push points, and draw each."""

import argparse
import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros import CentralPatternGenerator, Gait, load_scene, Measured, Run, run, Scene
from snake_sim_ros.controllers.controller import Reference
from snake_sim_ros.gaits.blending import Blend, usual_blend
from snake_sim_ros.gaits.steering import Steering, Stride

DENSE_PEGS = Path(__file__).with_name('dense_pegs.yaml')
BLUE, GREEN, ORANGE = '#0072b2', '#009e73', '#e69f00'
Changes = list[tuple[float, Gait]]  # gaits, and the times at which each begins [s]; the first at 0


class Blended:
    """Blends each gait into the next, as the node `gait` does after `cmd_vel` or a new scene."""

    period, sees_poses = 0.1, False

    def __init__(self, changes: Changes) -> None:
        self.changes = changes

    def start(self, scene: Scene) -> None:
        """Begin with the first gait."""
        duration = usual_blend(scene.robot)
        self.blend = Blend.of(self.changes[0][1], scene.robot.link_count - 1, duration)

    def control(self, measured: Measured, time: float) -> Reference:
        """Return angles and rates as a function of times."""
        gait = last(self.changes, time)
        if gait != self.blend.gait:
            self.blend = self.blend.changed(time, gait)
        return self.blend.reference


class ChangedOscillators(CentralPatternGenerator):
    """Oscillators that are given other waves while they run."""

    def __init__(self, changes: Changes) -> None:
        super().__init__()
        self.changes = changes

    def control(self, measured: Measured, time: float) -> Reference:
        """Return angles and rates as a function of times."""
        gait = last(self.changes, time)
        if gait != self.gait:
            self.change(gait)
        return super().control(measured, time)


def last(changes: Changes, time: float) -> Gait:
    """Return the gait that has begun last at a time [s]."""
    return [gait for begin, gait in changes if begin < time + 1e-6][-1]


def draw_steering(share: float) -> Figure:
    """Ask both gaits for the same course by speeds and turning rates, and draw both courses."""
    figure = Figure(figsize=(9.0, 6.0), layout='constrained')
    panels = figure.subplots(2, 1, sharex=True)
    distance = 6.0 * share
    curvatures = ((0.0, 0.0), (1.0, 0.6), (3.0, -0.6), (5.0, 0.0))  # [1/m], from distances on [m]
    # Sidewinding moves to the left of the heading.
    starts = {'lateral_undulation': (0.15, 0.0), 'sidewinding': (0.1, -math.pi / 2)}
    for axes, (name, (speed, heading)) in zip(panels, starts.items(), strict=True):
        scene = load_scene(name, start={'heading': heading})
        stride = Stride.of(scene.gait, scene.friction)
        changes = []
        for begin, curvature in curvatures:
            steering = Steering(speed, speed * curvature)
            changes.append((begin / speed, steering.gait(scene.gait, scene.robot, stride)[0]))
        moved = run(scene, controller=Blended(changes), duration=distance / speed)
        arcs = np.linspace(0.0, distance, 701)
        begins, bends = np.transpose(curvatures)
        course = math.pi + np.cumsum(bends[np.searchsorted(begins, arcs, 'right') - 1]) * arcs[1]
        asked = np.cumsum([np.cos(course), np.sin(course)], axis=1) * arcs[1]
        centers = moved.position[:, :, :2].mean(axis=1)
        off = math.dist(asked[:, -1], centers[-1])
        print(f'{name}: {off:.2f} m beside the end of a course of {distance:g} m')
        axes.plot(*asked, color=ORANGE, ls='--', label='asked for')
        axes.plot(*centers.T, color=GREEN, label='center of the robot')
        draw_bodies(axes, moved, np.linspace(0.0, moved.time[-1], 5))
        axes.set(ylabel='y [m]', title=f'{name.replace("_", " ")} at {speed} m/s')
    panels[0].legend(frameon=False)
    panels[-1].set_xlabel('x [m]')
    return figure


def draw_bodies(axes: Axes, moved: Run, times: np.ndarray, color: str = BLUE) -> None:
    """Draw the robot from above at some times [s]."""
    for k in np.searchsorted(moved.time, times - 1e-6):
        axes.plot(*moved.position[k, :, :2].T, color=color, lw=2.5, alpha=0.7)
    axes.set_aspect('equal')
    axes.grid(alpha=0.3)


def draw_blending(share: float) -> Figure:
    """Turn a sidewinding robot in place on its way, and draw it and the angles of a joint."""
    times, names = share * np.array([0.0, 10.0, 15.0, 25.0]), ('sidewinding', 'turn_in_place')
    pieces = list(zip(times[:-1], times[1:], (*names, names[0]), strict=True))
    changes = [(begin, load_scene(name).gait) for begin, _, name in pieces]
    moved = run('sidewinding', controller=Blended(changes), duration=times[-1])
    print(f'blending: {moved.distance:.2f} m')
    figure = Figure(figsize=(9.0, 4.6), layout='constrained')
    panels: dict[str, Axes] = figure.subplot_mosaic([['above', 'yaw'], ['above', 'pitch']])
    above, angle = panels['above'], np.degrees(moved.scene.robot.by_joint(moved.joint_angle))
    for begin, end, name in pieces:
        color = BLUE if name == names[0] else ORANGE
        draw_bodies(above, moved, np.linspace(begin, end, 3)[1:], color)
        shown = (moved.time >= begin) & (moved.time <= end)
        for k, axis in enumerate(('yaw', 'pitch')):
            panels[axis].plot(moved.time[shown], angle[shown, 4, k], color=color)
    for name, color in zip(names, (BLUE, ORANGE), strict=True):
        above.plot([], [], color=color, lw=2.5, label=name.replace('_', ' '))
    above.plot(*moved.position[:, :, :2].mean(axis=1).T, color=GREEN, label='center of the robot')
    above.set(xlabel='x [m]', ylabel='y [m]')
    for axis in ('yaw', 'pitch'):
        panels[axis].set(ylabel=f'{axis} of joint 5 [degrees]')
        panels[axis].grid(alpha=0.3)
    panels['yaw'].sharex(panels['pitch'])
    panels['yaw'].tick_params(labelbottom=False)
    panels['pitch'].set_xlabel('time [s]')
    figure.legend(frameon=False, loc='outside upper center', ncols=3)
    return figure


def draw_oscillators(share: float) -> Figure:
    """Give oscillators other waves twice, and draw angles and rates of three joints."""
    slow = {'amplitude_deg': 30, 'angular_frequency_deg': 80, 'phase_lag_deg': -50}
    fast = {**slow, 'amplitude_deg': 20, 'angular_frequency_deg': 160}
    waves = {0.0: slow, 8.0: fast, 14.0: {**fast, 'offset_deg': 15}}
    changes = [
        (share * begin, load_scene('lateral_undulation', gait={'yaw': wave}).gait)
        for begin, wave in waves.items()
    ]
    moved = run(
        'lateral_undulation',
        controller=ChangedOscillators(changes),
        duration=20.0 * share,
    )
    print(f'oscillators: {moved.distance:.2f} m')
    figure = Figure(figsize=(9.0, 4.6), layout='constrained')
    panels = figure.subplots(2, 1, sharex=True)
    for values, axes in zip((moved.joint_angle, moved.joint_velocity), panels, strict=True):
        for joint, color in ((2, BLUE), (5, GREEN), (8, ORANGE)):
            label = f'joint {joint}' if axes is panels[0] else None
            axes.plot(moved.time, np.degrees(values[:, 2 * joint - 2]), color=color, label=label)
        for begin, _ in changes[1:]:
            axes.axvline(begin, color='0.5', ls=':')
        axes.grid(alpha=0.3)
    panels[0].set_ylabel('yaw [degrees]')
    panels[1].set(ylabel='rate of yaw [degrees/s]', xlabel='time [s]')
    figure.legend(frameon=False, loc='outside upper center', ncols=3)
    return figure


def draw_obstacles(share: float) -> Figure:
    """Move between dense pegs by the gait alone and by what torques and contacts tell."""
    figure = Figure(figsize=(9.0, 7.0), layout='constrained')
    names = {'gait': BLUE, 'compliance': ORANGE, 'obstacle_aided': GREEN}
    panels = figure.subplots(len(names), 1, sharex=True)
    for axes, (name, color) in zip(panels, names.items(), strict=True):
        moved = run(DENSE_PEGS, controller=name, duration=20.0 * share)
        print(f'{name}: {moved.distance:.2f} m between pegs')
        pegs = moved.scene.pegs
        axes.add_collection(
            EllipseCollection(
                2 * pegs.radius, 2 * pegs.radius, 0.0, units='xy', facecolors='0.6',
                offsets=np.column_stack([pegs.x, pegs.y]), offset_transform=axes.transData,
            )
        )  # fmt: skip
        draw_bodies(axes, moved, np.linspace(0.0, moved.time[-1], 3), color)
        axes.set(ylabel='y [m]', title=f'{name}: {moved.distance:.2f} m', ylim=(-1.3, 1.3))
    panels[-1].set_xlabel('x [m]')
    return figure


def main() -> None:
    """Write a picture of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--share', type=float, default=1.0, help='of the times and the distance')
    parser.add_argument('--out', type=Path, default=Path(), help='folder of the pictures')
    arguments = parser.parse_args()
    drawn = {
        'steering': draw_steering, 'blending': draw_blending, 'oscillators': draw_oscillators,
        'obstacles': draw_obstacles,
    }  # fmt: skip
    for name, draw in drawn.items():
        path = arguments.out / f'{name}.png'
        draw(arguments.share).savefig(path, dpi=110)
        print(path)


if __name__ == '__main__':
    main()
