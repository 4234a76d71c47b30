# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A robot of a user's own in all parts of the package, and the walk of docs/scenes.md."""

import csv
from dataclasses import replace
from pathlib import Path
import re
import shlex

from modular import modular_robot
import numpy as np
import pytest
from urdf_texts import written_from

from snake_sim_ros import (
    Friction,
    Gait,
    load_robot,
    load_scene,
    ParameterError,
    read_run,
    run,
    Scene,
    Simulation,
    study,
    Wave,
)
from snake_sim_ros.commands.main import main
from snake_sim_ros.gaits.blending import check_limits
from snake_sim_ros.recording.recorded_runs import write_csv
from snake_sim_ros.recording.sensors import recorded_sensors, SensorReader, Sensors
from snake_sim_ros.scene.chain import FixedFrame, roll_pitch_yaw
from snake_sim_ros.scene.parameters import scene_from_text, scene_to_text, with_settings
from snake_sim_ros.scene.posture import from_own_poses, own_poses
from snake_sim_ros.scene.robot_description import robot_description, robot_of
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.view.frames import at_rest, bodies_of, placed

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'scenes.md'
WALK = PAGE.read_text(encoding='utf-8').partition('## Your own robot')[2]
WAVE = Gait(
    yaw=Wave(amplitude=0.5, angular_frequency=3.0, phase_lag=-0.6),
    pitch=Wave(amplitude=0.2, angular_frequency=3.0, phase_lag=-0.6, phase=np.pi / 2),
    soft_start=0.5,
)
SCENE = Scene(
    robot=modular_robot(6), gait=WAVE, friction=Friction(longitudinal=0.3, transversal=0.5),
    method='bdf2', dt=1 / 200, duration=1.0,
)  # fmt: skip
NAMES = tuple(f'servo_{j}' for j in range(5))


@pytest.fixture(scope='module')
def trajectory():
    return simulate(SCENE, rate=50.0)


def test_the_walk_of_the_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r'```(\w+)\n(.*?)```', WALK, re.DOTALL)
    (scene,) = (text for kind, text in blocks if kind == 'yaml')
    lines = [line.strip() for kind, text in blocks if kind == 'sh' for line in text.splitlines()]
    commands = [line.removeprefix('./run ') for line in lines if line.startswith('./run ')]
    Path('my_scene.yaml').write_text(re.sub(r'(?m)^   ', '', scene), encoding='utf-8')
    described, _, target = commands[0].partition(' > ')
    assert main(shlex.split(described)) == 0
    Path(target).write_text(capsys.readouterr().out, encoding='utf-8')
    assert main([*shlex.split(commands[1]), '--duration', '2']) == 0
    assert Path('my_snake.gif').is_file()
    with Path('my_snake.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 201
    assert 'reu_joint_out2in_3 angle [rad]' in rows[0] and 'reu_module_4 x [m]' in rows[0]
    # It is REU but for gains and friction of its joints.
    robot, reu = load_scene('my_scene.yaml').robot, load_scene('reu_sidewinding').robot
    assert robot.axis_names == reu.axis_names and robot.link_names == reu.link_names
    assert robot.yaw_torque_limit == (7.0,) * 16 and robot.joint_limit == reu.joint_limit
    assert np.abs(robot.chain.inertia - reu.chain.inertia).max() < 1e-18
    assert np.abs(robot.chain.places.distal - reu.chain.places.distal).max() < 1e-15


@pytest.mark.parametrize(('name', 'way'), [('reu_sidewinding', 0.87), ('reu_lateral', 1.17)])
def test_reu_travels(name, way):
    check_limits(load_scene(name).gait, load_scene(name).robot)  # as the node `gait` asks for
    found = run(name, duration=20.0)
    assert found.distance == pytest.approx(way, rel=0.1)
    assert not found.report.unconverged and found.report.penetration_max < 1e-5
    # Its sensors carry its weight, and the viewer shows all of its links where they are.
    robot = found.scene.robot
    sensors = Sensors(imu_links=robot.link_names[3], contact_force_links='all')
    measured = recorded_sensors(found, sensors)
    load = measured['contact_wrench'][:, :, 2].sum(axis=1).mean()  # in frames of links that tilt
    assert load == pytest.approx(robot.chain.mass.sum() * 9.81, rel=0.1)
    assert measured['imu_link'].tolist() == [4]
    q, angle = found.coordinates[-1], robot.by_joint(found.joint_angle[-1], 0.0)
    position, orientation = own_poses(robot, q)
    shown = placed(robot, angle, (position[robot.base_link], orientation[robot.base_link]))
    assert np.abs(shown[:, :3] - q[:, :3]).max() < 1e-6
    assert set(bodies_of(robot).link.tolist()) == set(range(robot.link_count))


def test_a_urdf_is_a_robot_wherever_a_robot_is_named(tmp_path):
    text = robot_description(SCENE.robot)
    path = tmp_path / 'snake.urdf'
    path.write_text(text, encoding='utf-8')
    scene = tmp_path / 'scene.yaml'
    scene.write_text('robot: snake.urdf\n', encoding='utf-8')
    robot = load_scene(scene).robot
    assert load_scene(path).robot == robot == load_robot(text) == load_robot(path)
    assert robot.axis_names == NAMES and (robot.axis_signs == SCENE.robot.axis_signs).all()
    scene.write_text('robot: {urdf: snake.urdf, up: [0, 1, 0]}\n', encoding='utf-8')
    rolled = load_scene(scene).robot
    # On its side: what was yaw is pitch.
    assert (rolled.axis_places % 2 == 1 - robot.axis_places % 2).all()
    scene.write_text('robot: {urdf: snake.urdf, base: module_9}\n', encoding='utf-8')
    with pytest.raises(ParameterError, match=r'snake\.urdf: .*module_9'):
        load_scene(scene)
    assert load_robot(text, gains=SCENE.robot).yaw_stiffness == 20.0


def test_a_robot_moves_alike_from_whichever_link_its_urdf_is_written(trajectory):
    gains = {'yaw_stiffness': 20, 'pitch_stiffness': 20}
    free = {'yaw_torque_limit': None, 'pitch_torque_limit': None}

    def controller(simulation):
        return 0.3 * np.sin(3.0 * simulation.time + np.arange(5))

    moved = run(SCENE, controller=controller, rate=50)
    for root in (0, 3, 5):
        given = {'urdf': written_from(SCENE.robot, root), 'head': 'module_0', **gains, **free}
        scene = replace(SCENE, robot=load_robot(given))
        assert scene.robot.axis_names == NAMES and scene.robot.base_link == root
        # Rounding of the frames, 1e-16 m, which contacts make larger by a factor of a few hundred.
        found = simulate(scene, rate=50.0)
        assert np.abs(found.coordinates - trajectory.coordinates).max() < 1e-9
        # A viewer places it by the frame of its root.
        position, orientation = own_poses(scene.robot, found.coordinates[-1])
        angle = scene.robot.by_joint(found.joint_angle[-1], 0.0)
        seen = placed(scene.robot, angle, (position[root], orientation[root]))
        assert np.abs(seen[:, :3] - found.coordinates[-1, :, :3]).max() < 1e-9
        found = run(scene, controller=controller, rate=50)
        assert np.abs(found.joint_angle - moved.joint_angle).max() < 1e-9
        assert np.abs(found.joint_torque - moved.joint_torque).max() < 1e-7  # 20 N m/rad


def test_a_scene_and_a_run_survive_files(tmp_path, trajectory):
    assert scene_from_text(scene_to_text(SCENE)) == SCENE
    found = run(SCENE, rate=50)
    found.write(tmp_path / 'run.npz')
    again = read_run(tmp_path / 'run.npz')
    assert again.scene == SCENE and again.joint_angle.shape == (51, 5)
    assert (again.joint_angle == trajectory.joint_angle).all()
    still = replace(SCENE, gait=Gait())
    scene = with_settings(still, {'gait.table': tmp_path / 'run.npz'})
    by_joint = SCENE.robot.by_joint(found.joint_angle, 0.0)
    assert np.array_equal(np.ravel(scene.gait.table.angle), by_joint.ravel())


def test_axes_and_joints():
    robot, rng = SCENE.robot, np.random.default_rng(0)
    columns = rng.uniform(-1, 1, (3, 5))
    by_joint = robot.by_joint(columns)
    assert np.isnan(by_joint).sum() == 15  # each joint has one axis
    assert (robot.by_axis(by_joint) == columns).all()
    # The third servo is upside down.
    assert (by_joint[:, 2, 0] == -columns[:, 2]).all() and (
        by_joint[:, 1, 1] == columns[:, 1]
    ).all()


def test_a_controller_speaks_of_axes():
    still = run(SCENE, controller=lambda simulation: np.full(5, 0.1), rate=50)
    assert still.joint_angle[-1] == pytest.approx(np.full(5, 0.1), abs=0.02)  # springs under load
    with pytest.raises(
        ParameterError, match=r'shape \(5,\), one for each joint axis, or \(5, 2\)'
    ):
        run(SCENE, controller=lambda simulation: np.zeros(6), rate=50)
    simulation = Simulation(SCENE)
    assert simulation.joint_angle.shape == simulation.joint_torque.shape == (5,)


def test_metrics_and_studies():
    pytest.importorskip('polars')
    frame = study(
        SCENE, {'friction.longitudinal': [0.2, 0.4]}, ['distance', 'energy', 'slip'], rate=50,
    )  # fmt: skip
    assert len(frame['distance']) == 2 and min(frame['distance']) > 0.0
    assert min(frame['energy']) > 0.0 and min(frame['slip']) > 0.0


def test_sensors_have_the_names_of_the_links(trajectory):
    sensors = Sensors(imu_links=('module_2', 4), contact_force_links='all', sensor_rate=50)
    found = recorded_sensors(trajectory, sensors)
    assert found['imu_link'].tolist() == [3, 4]
    assert found['contact_wrench'].shape == (51, 6, 6)
    # At rest on the floor each IMU feels its weight upward.
    rest = simulate(replace(SCENE, gait=Gait(yaw=Wave(offset=0.5)), duration=2.0), rate=50.0)
    found = recorded_sensors(rest, sensors)
    assert found['imu_linear_acceleration'][-1] == pytest.approx(
        np.tile([0.0, 0.0, 9.81], (2, 1)), abs=2e-2
    )
    weight = found['contact_wrench'][-1, :, 2].sum()
    assert weight == pytest.approx(6 * 0.16 * 9.81, abs=1e-2)
    with pytest.raises(
        ParameterError, match="no link 'link_1'; the links are module_0 to module_5"
    ):
        Sensors(imu_links='link_1').links('imu_links', SCENE.robot)


def test_an_imu_at_a_frame_measures_live_what_it_measures_recorded(tmp_path):
    frame = FixedFrame(name='imu', origin=(0.01, 0.0, 0.02), rotation=(np.pi, 0.0, 0.3))
    links = list(SCENE.robot.links)
    links[2] = replace(links[2], frames=(frame, replace(frame, name='camera')))
    scene = replace(SCENE, robot=replace(SCENE.robot, links=tuple(links)), duration=0.2)
    assert scene_from_text(scene_to_text(scene)) == scene
    sensors = Sensors(imu_links=('imu', 'module_2'), sensor_seed=3, imu_acceleration_noise=0.1)
    readings, simulation = [], Simulation(scene)
    reader = SensorReader(simulation, sensors, 4, 50.0)
    for k in range(11):
        if k:
            simulation.advance(*simulation.gait_reference(4))
        readings.append(reader.imus())
    trajectory = simulate(scene, rate=50.0)
    found = recorded_sensors(trajectory, sensors)
    assert found['imu_name'].tolist() == ['module_2', 'imu'] and (found['imu_link'] == 3).all()
    parts = 'orientation', 'angular_velocity', 'linear_acceleration'
    recorded = np.concatenate([found[f'imu_{part}'] for part in parts], axis=-1)
    assert (recorded == np.array(readings)).all()
    # What one sensor measures, and its noise, does not depend on others.
    for k, name in enumerate(('module_2', 'imu')):
        alone = recorded_sensors(trajectory, replace(sensors, imu_links=name))
        assert all(
            (alone[f'imu_{part}'][:, 0] == found[f'imu_{part}'][:, k]).all() for part in parts
        )
    # The rate is that of the link: x y z of the center turned by the rotation of the frame.
    turn = SCENE.robot.chain.frame[2][[2, 0, 1]] @ roll_pitch_yaw(frame.rotation)
    omega = found['imu_angular_velocity']
    assert np.abs(omega[:, 1] - omega[:, 0] @ turn).max() < 1e-14
    write_csv(trajectory, tmp_path / 'run.csv', found)
    with (tmp_path / 'run.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    column = [float(row['imu imu acceleration z [m/s^2]']) for row in rows]
    assert column == found['imu_linear_acceleration'][:, 1, 2].tolist()
    said = "no link 'nose'; the links are module_0 to module_5, their frames imu, camera"
    with pytest.raises(ParameterError, match=said):
        Sensors(imu_links='nose').imus(scene.robot)


def test_frames_of_links_are_their_own(trajectory):
    robot, q = SCENE.robot, trajectory.coordinates
    position, orientation = own_poses(robot, q)
    back = from_own_poses(robot, position, orientation)
    assert np.abs(back[..., :3] - q[..., :3]).max() < 1e-15
    sign = np.sign((back[..., 3:] * q[..., 3:]).sum(axis=-1, keepdims=True))
    assert np.abs(sign * back[..., 3:] - q[..., 3:]).max() < 4e-16
    # The frame of a module is at its rear servo, 6 cm from the next one.
    apart = np.linalg.norm(np.diff(position, axis=1), axis=-1)
    assert apart == pytest.approx(np.full(apart.shape, 0.06), abs=1e-9)


def test_the_viewer_shows_it(trajectory):
    robot = robot_of(robot_description(SCENE.robot))
    assert robot.axis_names == NAMES
    assert at_rest(robot).position.shape == (6, 3)
    bodies = bodies_of(SCENE.robot)
    assert bodies.link.tolist() == [0, 1, 2, 3, 4, 5] and bodies.half[0] == pytest.approx(0.02)
    # A robot that is placed by its base has the poses of the run.
    q = trajectory.coordinates[-1]
    position, orientation = own_poses(SCENE.robot, q)
    angle = SCENE.robot.by_joint(trajectory.joint_angle[-1], 0.0)
    found = placed(SCENE.robot, angle, (position[0], orientation[0]))
    assert np.abs(found[:, :3] - q[:, :3]).max() < 1e-9
