# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What sensors measure: closed forms, noise from a seed, and the same bits live and recorded."""

import csv
import dataclasses
from dataclasses import replace
from pathlib import Path
import re

from modular import modular_robot
import numpy as np
import pytest
from scenes import DT, EPS, every_method, isotropic, MASS, ROBOT, slope
from schemes import press_of
from scipy.spatial.transform import Rotation

from snake_sim_ros import Gait, ParameterError, Pegs, Robot, Scene, Simulation, Solver, State
from snake_sim_ros.commands.main import main
from snake_sim_ros.recording.from_messages import TO_WIRE
from snake_sim_ros.recording.recorded_runs import read_npz
from snake_sim_ros.recording.sensors import (
    imu_noise,
    link_index,
    Noise,
    recorded_sensors,
    SensorReader,
    Sensors,
)
from snake_sim_ros.scene.chain import FixedFrame, roll_pitch_yaw
from snake_sim_ros.scene.obstacles import contact_count, contact_links
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import from_own_poses
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.exact_sensors import (
    ACCELERATION,
    ANGULAR_VELOCITY,
    imu_readings,
    ORIENTATION,
    wrenches_on_links,
)
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.sampling import joint_motion
from snake_sim_ros.stepping.simulation import simulate

PAGE = (Path(__file__).parents[2] / 'docs' / 'sensors.md').read_text(encoding='utf-8')
G, STEPS = 9.81, 4
EXACT = Solver(tolerance=1e-12, residual_tolerance=1e-10)
ALL = Sensors(imu_links=(1, 'link_2', 3), contact_force_links='all')


def still(method, dt, **values):
    """Return the scene of three links that hold a straight posture."""
    robot = replace(ROBOT, link_count=3)
    return Scene(robot=robot, gait=Gait(), method=method, dt=dt, solver=EXACT, **values)


def read(scene, periods, start=None, sensors=ALL):
    """Return the readings of the IMUs after each of some periods of STEPS steps, from rest."""
    simulation = Simulation(scene)
    if start is not None:
        simulation.state = start
    reader = SensorReader(simulation, sensors, STEPS, 1 / (STEPS * scene.dt))
    found = [reader.imus()]
    for _ in range(periods):
        simulation.advance(*simulation.gait_reference(STEPS))
        assert not simulation.report.failure
        found.append(reader.imus())
    return simulation, np.array(found)


def residual_speed(scene):
    """
    Return a bound of the velocity that solvers leave of a robot at rest [m/s].

    A sweep takes a twentieth of an error away at least, from 12 components of friction and normal
    impulses of 3 links of 0.68 kg; other solvers stop at a residual in m/s. The selection rule may
    press a contact into the floor.
    """
    sweeps = 20 * 12 * scene.solver.tolerance / MASS
    return sweeps + 12 * scene.solver.residual_tolerance + press_of(scene)


# ---- imu ----------------------------------------------------------------------------------------


@every_method
@pytest.mark.parametrize('angle', [0.0, 0.2])
def test_at_rest_it_measures_what_carries_it(method, angle):
    # Friction of 1 holds the robot on a slope of 0.2.
    dt = DT
    scene = still(method, dt, gravity=slope(angle), friction=isotropic(1.0))
    _, found = read(scene, 5)
    expected = -np.array(scene.gravity)  # links lie along x of I: its axes are those of messages
    bound = 2 * residual_speed(scene) / (STEPS * dt)
    assert np.abs(found[0, :, ACCELERATION] - expected).max() < 1e-12  # nothing has moved yet
    assert np.abs(found[1:, :, ACCELERATION] - expected).max() < bound
    assert np.linalg.norm(expected) == pytest.approx(G)
    assert np.abs(found[..., ORIENTATION] - [0, 0, 0, 1]).max() < 1e-6


@every_method
def test_in_free_fall_it_measures_nothing(method):
    dt = DT
    scene = still(method, dt)
    q = Simulation(scene).state.q + np.array([0, 0, 1.0, 0, 0, 0, 0])
    simulation, found = read(scene, 5, State(q, np.zeros((3, 6))))
    # The change of a velocity up to g t is rounded, and so is the solution for three links.
    fallen = G * simulation.time
    assert np.abs(found[1:, :, ACCELERATION]).max() < 1e3 * EPS * fallen / (STEPS * dt)
    assert found[0, :, ACCELERATION] == pytest.approx(np.tile([0, 0, G], (3, 1)))


@every_method
def test_in_a_turn_it_measures_the_centripetal_acceleration(method):
    # Three links turn about the middle one in the air: w^2 L toward the center.
    w, dt = 2.0, 1 / 4000
    scene = replace(still(method, dt, gravity=(0.0, 0.0, 0.0)), level='spatial')
    q, u = Simulation(scene).state.q.copy(), np.zeros((3, 6))
    q[:, 2] += 1.0
    u[:, 4] = w  # about e_y of B, which is up
    length = scene.robot.link_length
    u[0, 1], u[2, 1] = -w * length, w * length
    _, found = read(scene, 5, State(q, u))
    # x points from link 1 to link 3. In a period the frame turns by a = w T; the mean of the
    # acceleration over it lags by a/2, and is shorter by a^2/24.
    a = w * STEPS * dt
    size = w**2 * length * np.sin(a / 2) / (a / 2)
    expected = size * np.array([np.cos(a / 2), -np.sin(a / 2), 0.0])
    # Velocities of the paper's step fit the joints at its middle: they lag by half a step, but for
    # those of the start. Both formulas have errors of second order in an angle over a period.
    lag = 0.0 if method == 'bdf2' else size * w * dt / 2
    bound = lag + size * 10 * (w * dt) ** 2 / a + 1e-9 / (STEPS * dt)
    assert np.abs(found[2:, 0, ACCELERATION] - expected).max() < bound < 1e-2 * size
    assert np.abs(found[2:, 2, ACCELERATION] + expected).max() < bound
    assert np.abs(found[2:, 1, ACCELERATION]).max() < bound
    # Each of 20 steps may change the velocity by that square.
    assert np.abs(found[..., ANGULAR_VELOCITY] - [0, 0, w]).max() < 20 * w * (w * dt) ** 2


@every_method
def test_specific_force_and_gravity_make_the_velocity(method):
    scene = with_settings(load_scene('sidewinding'), {'robot.link_count': 5, 'dt': 1 / 400})
    simulation = Simulation(replace(scene, method=method, level='spatial'))
    simulation.advance(*simulation.gait_reference(200))
    reader = SensorReader(simulation, Sensors(imu_links=(4,)), STEPS, 100.0)
    reader.imus()
    v = simulation.state.u[3, :3].copy()
    for _ in range(10):
        simulation.advance(*simulation.gait_reference(STEPS))
        reading = reader.imus()[0]
        R = rotation_matrices(simulation.state.q[3, 3:])[:, [2, 0, 1]]
        v += (R @ reading[ACCELERATION] + scene.gravity) * STEPS * scene.dt
        omega = R @ reading[ANGULAR_VELOCITY]
        B = rotation_matrices(simulation.state.q[3, 3:])
        assert omega == pytest.approx(B @ simulation.state.u[3, 3:], abs=1e-12)
    assert v == pytest.approx(simulation.state.u[3, :3], abs=1e-12)
    assert np.abs(v).max() > 0.01


def test_at_a_frame_of_a_turning_link_it_measures_centripetal_and_tangential_acceleration():
    # A link whose frame turns about an axis a of the world through a point c, by the angle
    # w t + b t^2/2: the IMU at rho from c has the acceleration b a x rho + w^2 a x (a x rho).
    frame = FixedFrame(name='imu', origin=(0.05, -0.02, 0.03), rotation=(0.4, -1.1, 2.0))
    robot = modular_robot(3)
    first, second, third = robot.links
    robot = replace(robot, links=(first, replace(second, frames=(frame,)), third))
    imus = Sensors(imu_links='imu').imus(robot)
    assert imus.names == imus.frames == ('imu',) and imus.link.tolist() == [1]
    a, c, w, b = np.array([0.6, 0.0, 0.8]), np.array([0.3, -0.1, 0.2]), 3.0, 7.0
    place, start = np.array([0.4, 0.1, 0.5]), Rotation.from_rotvec([0.3, 0.7, -0.2])
    gravity = np.array([1.0, 2.0, -9.0])

    def motion(t):
        """Return coordinates and velocities, of which but those of link 2 are of use."""
        turn, omega = Rotation.from_rotvec((w * t + b * t**2 / 2) * a), (w + b * t) * a
        own = (turn * start).as_quat()[[3, 0, 1, 2]]
        position = np.tile(c + turn.apply(place - c), (3, 1))
        q = from_own_poses(robot, position, np.tile(own, (3, 1)))
        R = rotation_matrices(q[:, 3:])
        u = np.hstack([np.cross(omega, q[:, :3] - c), np.einsum('nij,i->nj', R, omega)])
        return q, u

    T, t = 1e-6, 0.2
    _, before = imus.moves(*motion(t - T))
    found = imu_readings(gravity, *imus.moves(*motion(t)), before[:, :3], T)[0]
    turn, speed = Rotation.from_rotvec((w * t + b * t**2 / 2) * a), w + b * t
    rho = turn.apply(place - c + start.apply(frame.origin))
    axes = turn * start * Rotation.from_matrix(roll_pitch_yaw(frame.rotation))
    expected = b * np.cross(a, rho) + speed**2 * np.cross(a, np.cross(a, rho)) - gravity
    # The mean acceleration lags by T/2, and the difference of velocities of 2 m/s is rounded.
    jerk = (3 * b * speed + speed**3) * np.linalg.norm(rho)
    bound = jerk * T + 20 * EPS / T
    assert np.abs(found[ACCELERATION] - axes.inv().apply(expected)).max() < bound < 1e-4
    assert np.abs(found[ANGULAR_VELOCITY] - axes.inv().apply(speed * a)).max() < 1e-14
    wanted = axes.as_quat()
    assert np.abs(found[ORIENTATION] - wanted * np.sign(wanted[3])).max() < 1e-15


def test_orientation_is_that_of_link_poses():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(50, 7))
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1, keepdims=True)
    found = imu_readings((0, 0, -G), q, np.zeros((50, 6)), np.zeros((50, 3)), 1.0)[:, ORIENTATION]
    expected = q[:, 3:] @ TO_WIRE
    expected *= np.where(expected[:, 3:] < 0, -1.0, 1.0)
    assert np.abs(found - expected).max() < 4 * EPS
    assert (found[:, 3] >= 0).all()


# ---- contact forces -----------------------------------------------------------------------------


@every_method
@pytest.mark.parametrize('level', ['planar', 'spatial'])
def test_at_rest_wrenches_carry_the_weight(method, level):
    dt = DT
    scene = replace(still(method, dt), level=level)
    simulation = Simulation(scene)
    reader = SensorReader(simulation, ALL, STEPS, 1 / (STEPS * dt))
    assert (reader.wrenches() == 0.0).all()  # before the first step
    simulation.advance(*simulation.gait_reference(20))
    wrench, mass = reader.wrenches(), scene.robot.per_link('link_mass')
    # Links lie flat along x: frames of messages are parallel to I.
    bound = mass.sum() * residual_speed(scene) / dt
    assert wrench[:, :3].sum(axis=0) == pytest.approx([0, 0, G * mass.sum()], abs=bound)
    # About the middle link no torque is left, and none about any axis along it.
    arm = simulation.state.q[:, 0] - simulation.state.q[1, 0]
    torque = wrench[:, 4] - arm * wrench[:, 2]  # y of r x F + T
    assert torque.sum() == pytest.approx(0.0, abs=bound * 2 * arm.max())
    assert np.abs(wrench[:, [3, 5]]).max() < bound


def test_wrenches_are_sums_of_forces_and_their_moments():
    # Of a robot that sidewinds, whose links are not parallel to anything.
    scene = load_scene('sidewinding')
    simulation = Simulation(scene)
    simulation.advance(*simulation.gait_reference(3000))
    reader = SensorReader(simulation, ALL, 20, 200.0)
    wrench, q = reader.wrenches(), simulation.state.q
    points, forces = contact_forces(scene, simulation.state, simulation.history)
    axes = rotation_matrices(q[:, 3:])[:, :, [2, 0, 1]]
    force = np.einsum('nij,nj->ni', axes, wrench[:, :3])
    torque = np.einsum('nij,nj->ni', axes, wrench[:, 3:]) + np.cross(q[:, :3], force)
    assert force.sum(axis=0) == pytest.approx(forces.sum(axis=0), abs=1e-12)
    assert torque.sum(axis=0) == pytest.approx(np.cross(points, forces).sum(axis=0), abs=1e-12)
    assert (np.abs(wrench).max(axis=1) > 0).any()
    assert (np.abs(wrench).max(axis=1) == 0).any()  # links in the air


@pytest.mark.parametrize('method', METHODS)
def test_a_robot_at_a_peg_feels_it(method):
    # On a slope without friction it leans with its first link against a peg: m g sin.
    angle, dt = 0.1, 1 / 400
    gravity = (-G * np.sin(angle), 0.0, -G * np.cos(angle))
    start = Simulation(still(method, dt)).state.q[0, 0]
    reach = ROBOT.contact_offset + ROBOT.contact_radius + 0.05 + 1e-4
    scene = still(
        method, dt, gravity=gravity, friction=isotropic(0.0),
        pegs=Pegs(x=(float(start - reach),), y=(0.0,), radius=0.05, friction=0.0),
    )  # fmt: skip
    simulation = Simulation(scene)
    reader = SensorReader(simulation, ALL, STEPS, 1 / (STEPS * dt))
    simulation.advance(*simulation.gait_reference(120))
    wrench = reader.wrenches()
    weight = G * np.sin(angle) * scene.robot.per_link('link_mass').sum()
    bound = scene.robot.per_link('link_mass').sum() * residual_speed(scene) / dt
    assert wrench[0, 0] == pytest.approx(weight, abs=bound)
    assert np.abs(wrench[1:, 0]).max() < bound


def test_links_that_touch_feel_opposite_forces():
    scene = Scene(self_contact=True)
    q = Simulation(scene).state.q[None]
    number = np.array([contact_count(scene) - 1])
    point, force = np.array([[0.1, 0.2, 0.3]]), np.array([[1.0, -2.0, 3.0]])
    i, j = contact_links(scene)[number[0]]
    found = wrenches_on_links(scene, q, np.array([0]), number, point, force)[0]
    axes = rotation_matrices(q[0, :, 3:])[:, :, [2, 0, 1]]
    world = np.einsum('nij,nj->ni', axes, found[:, :3])
    assert world[i] == pytest.approx(force[0])
    assert world[j] == pytest.approx(-force[0])
    total = world + 0.0
    moments = np.einsum('nij,nj->ni', axes, found[:, 3:]) + np.cross(q[0, :, :3], total)
    assert np.abs(moments.sum(axis=0)).max() < 1e-14
    assert np.count_nonzero(found.any(axis=1)) == 2


# ---- noise --------------------------------------------------------------------------------------

NOISY = Sensors(
    imu_links=('link_2', 3),
    contact_force_links=(1, 2, 3, 'link_8'),
    sensor_seed=7,
    imu_angular_velocity_noise=0.01,
    imu_acceleration_noise=0.1,
    imu_acceleration_bias=(0.1, 0.2, 0.3),
    imu_angular_velocity_bias=0.05,
    contact_force_noise=0.5,
    contact_torque_noise=0.2,
    joint_position_noise=1e-3,
    joint_velocity_noise=1e-2,
    joint_effort_noise=1e-1,
)


def test_noise_has_its_mean_and_deviation():
    noise, count = imu_noise(NOISY, 1), 100_000
    drawn = noise.added_to_all(np.zeros((count, 6)))
    deviation, bias = np.repeat([0.01, 0.1], 3), [0.05, 0.05, 0.05, 0.1, 0.2, 0.3]
    # Five deviations of the mean and of the deviation of so many draws.
    assert (np.abs(drawn.mean(axis=0) - bias) < 5 * deviation / np.sqrt(count)).all()
    assert (np.abs(drawn.std(axis=0) / deviation - 1) < 5 / np.sqrt(2 * count)).all()
    assert np.abs(np.corrcoef(drawn.T) - np.eye(6)).max() < 5 / np.sqrt(count)


def test_noise_depends_on_seed_sensor_and_number_of_the_sample_alone():
    deviation, none = np.ones(4), np.zeros(4)
    whole = Noise(3, 5, deviation, none).added_to_all(np.zeros((300, 4)))
    noise = Noise(3, 5, deviation, none)
    for row in (0, 0, 1, 2, 2, 17, 299, 5, 5, 6):  # republished, left out, and back
        assert (noise.added(np.zeros(4), row) == whole[row]).all()
    spawned = np.random.Generator(np.random.PCG64(np.random.SeedSequence(3).spawn(6)[5]))
    assert (whole == spawned.standard_normal((300, 4))).all()
    for other in (Noise(4, 5, deviation, none), Noise(3, 6, deviation, none)):
        assert not np.isin(other.added_to_all(np.zeros((300, 4))), whole).any()


def test_without_noise_there_are_no_draws():
    reading = np.arange(6.0)
    noise = imu_noise(Sensors(), 0)
    assert noise.is_exact
    assert noise.added(reading, 3) is reading


# ---- live and recorded --------------------------------------------------------------------------


def measured_live(scene, sensors, rate, wrenches=True):
    """Return what `recorded_sensors` does, read as the scene advances."""
    simulation = Simulation(scene)
    steps = round(1 / rate / scene.dt)
    reader = SensorReader(simulation, sensors, steps, rate)
    found = {'sensor_time': [], 'imu': [], 'contact_wrench': [], 'joints': []}

    def observe(simulation):
        if reader.is_due():
            found['sensor_time'].append(simulation.time)
            found['imu'].append(reader.imus())
            if wrenches:
                found['contact_wrench'].append(reader.wrenches())
        state = simulation.state
        angle, rate = joint_motion(simulation.scene.robot, state.q[None], state.u[None])
        joints = angle[0].ravel(), rate[0].ravel(), simulation.joint_torque.copy()
        reader.add_noise(*joints)
        found['joints'].append(joints)

    simulate(scene, rate=rate, observe=lambda other: follow(simulation, other, observe))
    return {name: np.array(values) for name, values in found.items()}


def follow(simulation, other, observe):
    """Advance a simulation to the step of another one, then observe it."""
    if count := other.step_count - simulation.step_count:
        simulation.advance(*simulation.gait_reference(count))
    observe(simulation)


@pytest.mark.parametrize('case', ['lateral_undulation', 'sidewinding', 'obstacle_aided'])
@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize(
    'sensors', [ALL, replace(NOISY, sensor_rate=50.0)], ids=['exact', 'noisy']
)
def test_recorded_and_live_have_the_same_bits(case, method, sensors):
    dt = 1 / 400 if method == 'bdf2' else DT
    scene = replace(load_scene(case), duration=0.5, method=method, dt=dt)
    live = measured_live(scene, sensors, 100.0)
    found = recorded_sensors(simulate(scene, rate=100.0), sensors)
    assert (found['sensor_time'] == live['sensor_time']).all()
    assert (found['imu_orientation'] == live['imu'][..., ORIENTATION]).all()
    assert (found['imu_angular_velocity'] == live['imu'][..., ANGULAR_VELOCITY]).all()
    assert (found['imu_linear_acceleration'] == live['imu'][..., ACCELERATION]).all()
    assert (found['contact_wrench'] == live['contact_wrench']).all()
    assert np.abs(found['contact_wrench']).max() > 1.0
    assert len(found['sensor_time']) == (51 if sensors is ALL else 26)
    if sensors is ALL:
        assert 'measured_joint_angle' not in found
    else:
        names = ('angle', 'velocity', 'torque')
        measured = np.stack([found[f'measured_joint_{name}'] for name in names], axis=1)
        assert (measured == live['joints']).all()


def test_files_have_no_velocities_for_an_imu():
    trajectory = simulate(replace(load_scene('sidewinding'), duration=0.05))
    read_again = replace(trajectory, velocity=np.zeros(0))
    assert set(recorded_sensors(read_again, Sensors(contact_force_links=(1,)))) == {
        'sensor_time',
        'contact_link',
        'contact_wrench',
    }
    assert recorded_sensors(read_again, Sensors()) == {}
    with pytest.raises(ParameterError, match='an IMU needs the velocities of a run'):
        recorded_sensors(read_again, ALL)


# ---- bad values ---------------------------------------------------------------------------------


def test_links_have_names_and_numbers_from_1():
    assert [link_index(name, Robot(), 'x') for name in ('link_6', 6, '6')] == [5, 5, 5]
    assert Sensors(imu_links='link_6').links('imu_links', Robot()) == [5]
    assert Sensors(contact_force_links=6).links('contact_force_links', Robot()) == [5]
    assert Sensors(imu_links='all').links('imu_links', Robot(link_count=3)) == [0, 1, 2]
    assert Sensors().links('imu_links', Robot(link_count=3)) == []
    assert Sensors(imu_links=[3, 'link_3', 1]).links('imu_links', Robot()) == [0, 2]
    for name in ('link_0', 'link_12', 0, -1, 12, 'head', 'link_', 'link_6_end', '²'):
        said = rf'^imu_links: no link {name!r}; the links are link_1 to link_11$'
        with pytest.raises(ParameterError, match=said):
            Sensors(imu_links=(name,)).links('imu_links', Robot())


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({'imu_links': 1.5}, 'imu_links must be names or numbers of links, got 1.5'),
        ({'contact_force_links': (1, None)}, 'must be names or numbers of links'),
        ({'imu_acceleration_noise': -1.0}, 'imu_acceleration_noise must be at least 0 m/s^2'),
        ({'imu_acceleration_noise': float('nan')}, 'imu_acceleration_noise must be finite'),
        ({'imu_acceleration_bias': (1.0, 2.0)}, 'must be one number or three, got 2'),
        ({'sensor_rate': -5.0}, 'sensor_rate must be at least 0 Hz'),
        ({'sensor_seed': -1}, 'sensor_seed must be at least 0'),
        ({'sensor_seed': 0.5}, 'sensor_seed must be a whole number'),
    ],
)
def test_values_that_are_not_usable_are_refused(values, said):
    with pytest.raises(ParameterError) as caught:
        Sensors(**values)
    assert said in str(caught.value)


def test_rates_that_do_not_divide_are_refused():
    assert Sensors(sensor_rate=50.0).states_in_sample(200.0) == 4
    assert Sensors().states_in_sample(200.0) == 1
    for rate in (70.0, 400.0):
        with pytest.raises(ParameterError, match='sensor_rate must divide the rate of the states'):
            Sensors(sensor_rate=rate).states_in_sample(200.0)


# ---- files and docs/sensors.md ------------------------------------------------------------------


def test_a_run_writes_its_sensors(tmp_path, capsys):
    out, table = tmp_path / 'run.npz', tmp_path / 'run.csv'
    options = ['--imu', '2', '--imu', 'link_1', '--contact-forces', 'all', '--rate', '100']
    options += [f'--sensor={key}' for key in ('sensor_rate=50', 'joint_velocity_noise=0.01')]
    options += ['--method', 'newton', '--duration', '0.1']
    assert main(['run', 'sidewinding', *options, '--out', str(out), '--csv', str(table)]) == 0
    sensors = Sensors(
        imu_links=(1, 2), contact_force_links='all', sensor_rate=50, joint_velocity_noise=0.01
    )
    scene = replace(load_scene('sidewinding'), method='newton', duration=0.1)
    expected = recorded_sensors(simulate(scene, rate=100.0), sensors)
    with np.load(out) as found:
        assert expected.keys() <= set(found.files)
        assert all((found[name] == expected[name]).all() for name in expected)
    assert len(read_npz(out).time) == 11  # and it is still a run
    with table.open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 11
    column = [row['link_2 imu acceleration z [m/s^2]'] for row in rows]
    readings = expected['imu_linear_acceleration'][:, 1, 2]
    assert [float(cell) for cell in column[::2]] == readings.tolist()
    assert set(column[1::2]) == {''}
    column = [row['link_11 contact torque y [N m]'] for row in rows]
    assert [float(cell) for cell in column[::2]] == expected['contact_wrench'][:, 10, 4].tolist()
    column = [float(row['joint_10_pitch measured velocity [rad/s]']) for row in rows]
    assert column == expected['measured_joint_velocity'][:, 19].tolist()
    capsys.readouterr()


def test_a_run_without_sensors_has_files_as_before(tmp_path, capsys):
    out, table = tmp_path / 'run.npz', tmp_path / 'run.csv'
    options = ['--method', 'newton', '--duration', '0.1', '--out', str(out), '--csv', str(table)]
    assert main(['run', 'sidewinding', *options]) == 0
    with np.load(out) as found:
        assert not [name for name in found.files if 'imu' in name or 'measured' in name]
        assert 'sensor_time' not in found.files
    with table.open(encoding='utf-8') as file:
        assert next(csv.reader(file))[-1] == 'level'
    capsys.readouterr()


@pytest.mark.parametrize(
    ('options', 'said'),
    [
        (['--imu', 'head'], "imu_links: no link 'head'; the links are link_1 to link_11"),
        (['--contact-forces', '12'], 'contact_force_links: no link 12; the links are'),
        (['--sensor', 'imu_noise=1'], "--sensor: unknown key 'imu_noise'"),
        (['--sensor', 'sensor_rate'], "--sensor must be KEY=VALUE, got 'sensor_rate'"),
        (['--sensor', 'sensor_rate=70'], 'sensor_rate must divide the rate of the states, 100 Hz'),
        (['--imu', '3', '--sensor', 'imu_links=[2]'], 'by --imu and by --sensor imu_links'),
    ],
)
def test_unusable_options_of_sensors(options, said, capsys):
    assert main(['run', 'sidewinding', *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_the_page_has_every_parameter_and_every_array():
    names = set(re.findall(r'`(\w+)`', PAGE))
    fields = {item.name for item in dataclasses.fields(Sensors)}
    assert fields <= names
    sensors = replace(NOISY, imu_links=(1,))
    scene = replace(load_scene('sidewinding'), duration=0.05)
    assert recorded_sensors(simulate(scene), sensors).keys() <= names


def test_the_programs_of_the_page_run(capsys):
    programs = re.findall(r'^```python\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL)
    assert len(programs) == 2
    for program in programs:
        exec(compile(program, 'docs/sensors.md', 'exec'), {'__name__': 'example'})
    assert len(capsys.readouterr().out.split()) > 6
