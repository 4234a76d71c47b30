# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show a recorded run or a bag in Rerun: the robot, its contact forces, angles and torques."""

import argparse

import numpy as np
import rerun as rr  # pip install rerun-sdk
from rerun import blueprint

from snake_sim_ros import read_run
from snake_sim_ros.scene.obstacles import PEG_HEIGHT
from snake_sim_ros.scene.surfaces import surfaces_of
from snake_sim_ros.view.frames import bodies_of

ARROW = 0.01  # m for a contact force of 1 N
HEAD, ODD, EVEN = (204, 64, 26), (237, 176, 33), (64, 69, 77)
FORCES, GROUND = (60, 120, 220), (170, 175, 180)
EYE = blueprint.EyeControls3D(position=(0.4, -1.5, 1.1), look_target=(0.0, 0.0, 0.0))
LAYOUT = blueprint.Blueprint(
    blueprint.Horizontal(
        blueprint.Spatial3DView(origin='/', name='Robot', eye_controls=EYE),
        blueprint.Vertical(
            blueprint.TimeSeriesView(origin='/joint_angle', name='Angles of joints [rad]'),
            blueprint.TimeSeriesView(origin='/joint_torque', name='Torques of joints [N m]'),
        ),
        column_shares=[3, 2],
    ),
    collapse_panels=True,
)


def log_robot(run, time):
    """Log the shapes of all links in their own frames, and these frames over time."""
    bodies, chain = bodies_of(run.scene.robot), run.scene.robot.chain
    for i, name in enumerate(chain.link_names):
        mine = bodies.link == i
        axis, half = bodies.axis[mine], bodies.half[mine, None]
        axis = np.where(axis[:, 2:] < 0.0, -axis, axis)
        # A capsule of Rerun is along z, which this turns to its axis.
        turn = np.column_stack([-axis[:, 1], axis[:, 0], np.zeros(len(axis)), 1.0 + axis[:, 2]])
        shapes = rr.Capsules3D(
            lengths=2.0 * half[:, 0],
            radii=bodies.radius[mine],
            translations=bodies.center[mine] - half * axis,
            quaternions=turn / np.linalg.norm(turn, axis=1, keepdims=True),
            colors=HEAD if i == 0 else (ODD, EVEN)[i % 2],
            fill_mode='solid',
        )
        rr.log(f'robot/{name}', shapes, static=True)
        frames = rr.Transform3D.columns(
            translation=run.position[:, i], quaternion=run.orientation[:, i, [1, 2, 3, 0]]
        )
        rr.send_columns(f'robot/{name}', [time], frames)


def log_surroundings(scene):
    """Log pegs and solids of a scene."""
    x, y, radius = np.reshape(scene.pegs.axes, (-1, 3)).T
    height = PEG_HEIGHT * scene.robot.per_link('contact_radius').max()
    centers = np.column_stack([x, y, np.full(len(x), height / 2)])
    lengths = np.full(len(x), height)
    pegs = rr.Cylinders3D(
        lengths=lengths, radii=radius, centers=centers, colors=GROUND, fill_mode='solid'
    )
    rr.log('world/pegs', pegs, static=True)
    for k, (vertices, faces) in enumerate(surfaces_of(scene.world)):
        solid = rr.Mesh3D(vertex_positions=vertices, triangle_indices=faces, albedo_factor=GROUND)
        rr.log(f'world/solids/{k}', solid, static=True)


def log_contacts(run, time):
    """Log contact forces as arrows, as many as each sample has."""
    count = np.bincount(run.contact_sample, minlength=len(run.time))
    arrows = rr.Arrows3D.columns(
        origins=run.contact_point, vectors=ARROW * run.contact_force
    ).partition(count)
    rr.log('contact_forces', rr.Arrows3D.from_fields(colors=FORCES), static=True)
    rr.send_columns('contact_forces', [time], arrows)


def log_joints(run, time):
    """Log angle and torque of each joint axis as curves."""
    for what in ('joint_angle', 'joint_torque'):
        for name, values in zip(run.scene.robot.axis_names, getattr(run, what).T, strict=True):
            rr.send_columns(f'{what}/{name}', [time], rr.Scalars.columns(scalars=values))


def main():
    """Read a run, and show or save it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('run', help='npz file, MCAP file, or folder of a bag')
    parser.add_argument('--save', help='an rrd file instead of the window of Rerun')
    arguments = parser.parse_args()
    run = read_run(arguments.run)
    rr.init('snake_sim_ros', spawn=not arguments.save)
    if arguments.save:
        rr.save(arguments.save)
    rr.send_blueprint(LAYOUT)
    time = rr.TimeColumn('time', duration=run.time)
    log_surroundings(run.scene)
    log_robot(run, time)
    log_contacts(run, time)
    log_joints(run, time)


if __name__ == '__main__':
    main()
