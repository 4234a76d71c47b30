# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo on the same scene: its model, its drives, and how its failures are told."""

from dataclasses import replace
import math
import re
import sys

import numpy as np
import pytest
from scenes import G, slope

from snake_sim_benchmarks.comparison.ensembles import perturbed
from snake_sim_benchmarks.comparison.mujoco_model import (
    CONTACTS,
    DRIVES,
    INTEGRATORS,
    mjcf,
    MujocoSettings,
    SEARCHED,
    tree_order,
)
from snake_sim_benchmarks.comparison.mujoco_runs import (
    mujoco_trajectory,
    MujocoRobot,
    rolled_course,
    run_mujoco,
)
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD, Start
from snake_sim_ros import (
    Box,
    EggCrate,
    Friction,
    Gait,
    ParameterError,
    Pegs,
    Pipe,
    Pole,
    Ramp,
    Robot,
    Scene,
    Simulation,
    State,
    Wave,
    World,
)
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.scene.surfaces import surfaces_of
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.state import initial_state

mujoco = pytest.importorskip('mujoco')

GAINS = tuple(
    f'robot.{axis}_{gain}' for axis in ('yaw', 'pitch') for gain in ('stiffness', 'damping')
)
UPWARD = (0.0, 0.0, G)  # gravity that takes the robot off the floor
LONG = 60.0  # s, a limit that no run here reaches
each_drive = pytest.mark.parametrize('drive', DRIVES)


def started(scene, **settings):
    """Return model and data of MuJoCo at the start of a scene, with all positions computed."""
    model = mujoco.MjModel.from_xml_string(mjcf(scene, MujocoSettings(**settings)))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


# ---- model --------------------------------------------------------------------------------------


def test_masses_and_inertias_are_those_of_the_robot():
    robot = Robot(link_count=3, link_mass=(0.5, 0.7, 0.9), inertia='consistent')
    model, _ = started(Scene(robot=robot))
    links, _ = tree_order(3)
    assert np.array_equal(model.body_mass[1:], robot.per_link('link_mass')[links])
    across, along = (robot.per_link(f'inertia_{axis}') for axis in ('transversal', 'axial'))
    expected = np.column_stack([across, across, along])
    assert np.array_equal(model.body_inertia[1:], expected[links])


@pytest.mark.parametrize('name', ['lateral_undulation', 'sinus_lifting', 'slender_undulation'])
def test_links_start_where_the_scene_puts_them(name):
    scene = load_scene(name)
    scene = replace(scene, gait=replace(scene.gait, soft_start=0.0))
    q, (_, data) = initial_coordinates(scene), started(scene)
    q = q[tree_order(scene.robot.link_count)[0]]
    assert np.abs(data.xpos[1:] - q[:, :3]).max() < 1e-9
    axes = data.xmat[1:].reshape(-1, 3, 3)
    assert np.abs(axes - rotation_matrices(q[:, 3:])).max() < 1e-9


def test_the_tree_has_its_root_at_the_middle_link():
    links, axes = tree_order(5)
    assert links.tolist() == [2, 3, 4, 1, 0]
    assert axes.tolist() == [4, 5, 6, 7, 3, 2, 1, 0]
    model, _ = started(Scene(robot=Robot(link_count=5)))
    assert model.body_parentid[1:].tolist() == [0, 1, 2, 1, 4]
    names = [model.joint(j).name for j in range(1, model.njnt)]
    assert names == ['yaw2', 'pitch2', 'yaw3', 'pitch3', 'pitch1', 'yaw1', 'pitch0', 'yaw0']
    assert [model.actuator(a).name for a in range(model.nu)] == [''] * 8
    assert model.actuator_trnid[:, 0].tolist() == list(range(1, model.njnt))


def test_a_state_is_the_same_in_generalized_coordinates():
    # Case C after 2 s of newton, all joints bent and turning: back from MuJoCo it is what it was.
    # Joints of newton have gaps of 1e-8 m. Their velocities fit together in the middle of its last
    # step, from where links of up to 1.2 rad/s turn on for dt/2: up to 1.2^2 dt/2 = 1.8e-4.
    scene = replace(load_scene('sidewinding'), duration=2.0)
    run = sample(Simulation(scene), 8000, 1)
    state = State(run.coordinates[-1], run.velocity[-1])
    found = MujocoRobot(scene, MujocoSettings(), state).state()
    assert np.abs(found.q[:, :3] - state.q[:, :3]).max() < 1e-7
    signs = np.sign((found.q[:, 3:] * state.q[:, 3:]).sum(axis=1))
    assert np.abs(signs[:, None] * found.q[:, 3:] - state.q[:, 3:]).max() < 1e-7
    assert np.abs(state.u).max() > 0.05
    assert np.abs(found.u - state.u).max() < 1.8e-4


def test_first_friction_coefficient_is_along_the_link():
    # Links with many headings: of every contact the first tangent is along its capsule.
    scene = load_scene('lateral_undulation')
    model, data = started(scene)
    data.qpos[2] -= 1e-6  # all of them touch
    mujoco.mj_forward(model, data)
    along = data.xmat[1:].reshape(-1, 3, 3)[data.contact.geom[:, 1] - 1, :, 2]
    tangent = data.contact.frame[:, 3:6]
    assert data.ncon == 2 * scene.robot.link_count
    assert np.abs((along * tangent).sum(axis=1)) == pytest.approx(np.ones(data.ncon), abs=1e-12)
    assert data.contact.friction[:, 0] == pytest.approx(scene.friction.longitudinal)
    assert data.contact.friction[:, 1] == pytest.approx(scene.friction.transversal)


def test_worlds_have_the_same_geometry():
    world = World(
        boxes=(Box(center=(0.2, 3.1, 0.0), size=(0.4, 0.6, 0.2), rpy=(0.1, 0.2, 0.3)),),
        ramps=(Ramp(start=(-2.0, 0.5, 0.0), heading=0.4),),
        poles=(Pole(start=(1.0, 1.0, 0.1), end=(1.5, 1.2, 0.3)),),
        egg_crates=(EggCrate(center=(0.3, -4.0), size=(1.0, 0.6)),),
    )
    friction = Friction(longitudinal=0.3, transversal=0.3)
    model, data = started(Scene(world=world, friction=friction))
    surfaces, hit = surfaces_of(world), np.zeros(1, np.int32)
    for number, rounding in zip((0, 2, 3), (1e-9, 1e-6, 1e-6), strict=True):  # 32 bits
        vertices, faces = surfaces[number]
        a, b, c = vertices[faces].transpose(1, 0, 2)
        top = np.cross(b - a, c - a)[:, 2] > 1e-9
        for point in (0.5 * a + 0.3 * b + 0.2 * c)[top]:
            above = np.array([*point[:2], 9.0])
            down = mujoco.mj_ray(model, data, above, -np.eye(3)[2], None, 1, -1, hit)
            assert abs(9.0 - down - max(point[2], 0.0)) < rounding


@pytest.mark.parametrize(
    ('settings', 'sentence'),
    [
        ({'world': World(pipes=(Pipe(),))}, 'worlds without pipes and meshes, of one friction'),
        ({'pegs': Pegs(x=(9.0,), y=(9.0,))}, 'flat floor .* got more'),
        ({'friction': Friction(rolling=0.1)}, r'got friction\.rolling=0\.1'),
        ({'robot': Robot(contact_offset=0.0)}, 'contact_offset must be above 0 m'),
    ],
)
def test_what_mujoco_does_not_get_is_refused(settings, sentence):
    with pytest.raises(ParameterError, match=sentence):
        mjcf(Scene(**settings), MujocoSettings())


def test_without_mujoco_one_sentence_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    with pytest.raises(ParameterError, match=r'MuJoCo is not installed: pip install'):
        run_mujoco(Scene(), MujocoSettings(), LONG)


# ---- settings -----------------------------------------------------------------------------------


@pytest.mark.parametrize('name', SEARCHED)
def test_searched_settings_are_those_of_the_model(name):
    found = SEARCHED[name].model
    dt = 1 / SEARCHED[name].rate
    model, _ = started(replace(load_scene('sidewinding'), dt=dt), contact=name)
    option = model.opt
    assert mujoco.mjtSolver(option.solver).name == f'mjSOL_{found.solver.upper()}'
    assert (option.iterations, option.ls_iterations) == (found.iterations, found.ls_iterations)
    assert option.tolerance == found.tolerance
    assert mujoco.mjtCone(option.cone).name == f'mjCONE_{found.cone.upper()}'
    assert option.impratio == found.impratio
    assert option.noslip_iterations == found.noslip_iterations
    assert mujoco.mjtIntegrator(option.integrator).name == 'mjINT_DISCRETE'
    assert option.timestep == dt
    off = mujoco.mjtDisableBit
    assert bool(option.disableflags & off.mjDSBL_REFSAFE) != found.refsafe
    assert bool(option.disableflags & off.mjDSBL_ISLAND) != found.islands
    assert not found.islands
    constant = found.time_steps * dt if found.time_constant is None else found.time_constant
    assert model.pair_solref == pytest.approx(np.tile([constant, 1.0], (model.npair, 1)))
    assert model.pair_solimp[:, :3] == pytest.approx(np.tile(found.solimp, (model.npair, 1)))
    # Springs and dampers in the joints are the joint law.
    assert (model.jnt_stiffness[1:] > 0.0).all() and (model.dof_damping[6:] > 0.0).all()


def test_jacobians_are_sparse_where_mujoco_makes_them_so():
    # By default from 60 degrees of freedom on, 6 + 2(n-1); dense ones are faster for the others.
    for n, contact, sparse in (
        (27, 'default', False), (28, 'default', True), (28, 'accurate', False),
        (28, 'C 1 %', False),
    ):  # fmt: skip
        model, _ = started(Scene(robot=Robot(link_count=n)), contact=contact)
        assert mujoco.mj_isSparse(model) == sparse


def test_references_lead_as_a_setting_says():
    scene = replace(load_scene('sidewinding'), dt=0.01)
    for name, times in (('A 3 %', [2.005, 2.015]), ('A 2 %', [2.01, 2.02])):
        robot = MujocoRobot(scene, MujocoSettings(contact=name))
        angle, rate = robot.reference(0, 2, begin=2.0)
        expected = gait.reference(scene.gait, np.array(times), 10)
        assert angle == pytest.approx(expected[0].reshape(2, 20), rel=1e-12)
        assert rate == pytest.approx(expected[1].reshape(2, 20), rel=1e-12)


# ---- runs in one call ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('drive', 'integrator', 'contact'),
    [('spring', 'discrete', 'accurate'), ('position', 'implicitfast', 'default')],
)
def test_a_rollout_takes_the_steps_of_single_calls(drive, integrator, contact):
    scene = replace(load_scene('sidewinding'), dt=0.002, duration=0.5)
    settings = MujocoSettings(drive=drive, integrator=integrator, contact=contact)
    course = rolled_course(scene, settings=settings)
    run = run_mujoco(scene, settings, LONG)
    assert course.failure == '' and course.seconds > 0.0
    assert course.time == pytest.approx(0.1 * np.arange(6))
    assert np.abs(course.path - run.trajectory.path).max() < 1e-12


def test_a_rollout_starts_where_and_when_it_is_told():
    # From 1/3 of a period on: the gait that is so much ahead, from the same state.
    scene = replace(load_scene('sidewinding'), dt=0.01, duration=0.5)
    scene = replace(scene, gait=replace(scene.gait, soft_start=0.0))
    state = initial_state(scene)
    state.q[:, :2] += 3.0
    state.u[:, 0] = 0.1
    settings = MujocoSettings(contact='C 1 %')
    course = rolled_course(scene, Start(state, 1.5), settings=settings)
    assert np.array_equal(course.path[0], state.q[5, :3])
    late = perturbed(scene, friction=1.0, phase=1 / 3, soft_start=0.0)
    same = rolled_course(late, Start(state, 0.0), settings=settings)
    assert np.abs(course.path - same.path).max() < 1e-9
    early = rolled_course(scene, Start(state, 0.0), settings=settings)
    assert np.abs(course.path - early.path).max() > 1e-3


def test_a_rollout_may_have_steps_that_divide_nothing():
    scene = replace(load_scene('sidewinding'), dt=0.03, duration=0.5)
    course = rolled_course(scene, settings=MujocoSettings(contact='C 2 %'))
    assert course.time == pytest.approx([0.0, 0.09, 0.18, 0.27, 0.36, 0.45, 0.48])
    assert course.path.shape == (7, 3)


def test_a_rollout_that_fails_has_no_time():
    # Springs of the caller diverge at such steps with an explicit integrator.
    scene = replace(FLIGHT, dt=1 / 50, gravity=(0.0, 0.0, -G))
    settings = MujocoSettings(drive='position', integrator='Euler', contact='default')
    course = rolled_course(scene, settings=settings)
    assert re.match('MuJoCo: .*Q', course.failure)
    assert math.isnan(course.seconds)


def test_a_rollout_needs_a_drive_of_mujoco():
    with pytest.raises(ParameterError, match='drive must be spring or position'):
        rolled_course(Scene(), settings=MujocoSettings(drive='torque'))


# ---- friction -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('friction', 'direction'),
    [
        (Friction(longitudinal=0.1, transversal=0.5), 0.0),
        (Friction(longitudinal=0.5, transversal=0.1), math.pi / 2),
    ],
    ids=['along', 'across'],
)
@pytest.mark.parametrize('contact', CONTACTS)
def test_link_slides_down_a_slope_as_it_should(friction, direction, contact):
    # T4 of a link that hardly turns: s = g (sin b - mu cos b) t (t + dt)/2, as velocities come
    # before positions. MuJoCo's own softness: while the link sinks in or is lifted, the floor
    # carries less or more than its weight, which takes mu times the change of height off s. The
    # tolerance is that of MuJoCo's solver, 1e-8, with a margin.
    robot = Robot(link_count=1, inertia_axial=10.0, inertia_transversal=10.0)
    b, dt, t = math.atan(0.3), 1 / 1000, 1.0
    scene = Scene(robot=robot, friction=friction, gravity=slope(b, direction), dt=dt, duration=t)
    run = run_mujoco(scene, MujocoSettings(contact=contact), LONG)
    expected = G * (math.sin(b) - 0.1 * math.cos(b)) * t * (t + dt) / 2
    way = run.trajectory.path[-1] - run.trajectory.path[0]
    assert np.linalg.norm(way[:2]) + 0.1 * way[2] == pytest.approx(expected, rel=1e-7)


# ---- drives -------------------------------------------------------------------------------------

# One joint of two links in flight, turning little: links turn by half the joint angle each, and
# their centers keep their height, so that J = Theta_1/2 and J a'' = K_p (r - a) + K_d (r' - a').
WAVE = Wave(amplitude=0.01, angular_frequency=10.0)
TWO_LINKS = Scene(
    robot=Robot(link_count=2), gait=Gait(yaw=WAVE), gravity=UPWARD, dt=1 / 4000, duration=0.5
)


def swinging(times):
    """Return the joint angle of TWO_LINKS once the start has died out (rate K_d/2J = 208/s)."""
    J, w = 9.63e-4 / 2, WAVE.angular_frequency
    K_p, K_d = TWO_LINKS.robot.yaw_stiffness, TWO_LINKS.robot.yaw_damping
    response = (K_p + 1j * w * K_d) / (K_p - J * w**2 + 1j * w * K_d)
    return WAVE.amplitude * np.imag(response * np.exp(1j * w * times))


@each_drive
@pytest.mark.parametrize('integrator', INTEGRATORS)
def test_drives_follow_one_law(drive, integrator):
    # Steps of first order shift the force by half a step against the reference: up to A w dt/2.
    run = run_mujoco(TWO_LINKS, MujocoSettings(drive=drive, integrator=integrator), LONG)
    yaw, times = (
        run.trajectory.joint_angle[:, 0],
        SAMPLING_PERIOD * np.arange(len(run.trajectory.path)),
    )
    shift = WAVE.amplitude * WAVE.angular_frequency * TWO_LINKS.dt / 2
    assert np.abs(yaw - swinging(times))[1:].max() < 1.1 * shift


def test_energy_is_balanced_to_first_order():
    # Case A for 1 s: halving the step halves what is lost or made, nearly.
    scene = replace(load_scene('lateral_undulation'), duration=1.0)
    errors = [
        run_mujoco(replace(scene, dt=dt), MujocoSettings(), LONG).energy_error
        for dt in (1 / 1000, 1 / 2000, 1 / 4000)
    ]
    assert errors[0] < 0.1
    assert errors[0] > 1.5 * errors[1] > 1.5**2 * errors[2]


def test_states_are_those_of_all_links():
    # A limp robot thrown and turning in flight: going on from a state that was read is going on.
    limp = dict.fromkeys(GAINS, 0.0)
    scene = with_settings(load_scene('lateral_undulation'), {**limp, 'dt': 1 / 1000})
    start = initial_state(scene)
    start.q[:, 2] += 1.0
    omega = np.array([0.3, -0.2, 0.5])  # of the whole robot, in I
    R = rotation_matrices(start.q[:, 3:])
    start.u[:, :3] = np.array([1.0, 2.0, 0.0]) + np.cross(omega, start.q[:, :3])
    start.u[:, 3:] = np.einsum('iab,a->ib', R, omega)
    run = mujoco_trajectory(scene, MujocoSettings(), start, steps=4, every=2)
    states = State(run.coordinates, run.velocity)
    assert states.q.shape == (3, 11, 7)
    again = mujoco_trajectory(scene, MujocoSettings(), State(states.q[1], states.u[1]), 2, 2)
    # Angles are read from quaternions and velocities of up to 4 m/s from twists: rounding, which
    # two steps of joints with inertias of 5e-4 kg m^2 against 7.5 kg multiply.
    assert np.abs(again.coordinates[1] - states.q[2]).max() < 1e-12
    assert np.abs(again.velocity[1] - states.u[2]).max() < 1e-10
    # What was put in: the center of mass falls, with the momentum of the start.
    fallen = states.u[:, :, :3].mean(axis=1) - start.u[:, :3].mean(axis=0)
    assert np.abs(fallen[:, 2] + G * scene.dt * np.array([0, 2, 4])).max() < 1e-3
    assert np.abs(fallen[:, :2]).max() < 1e-3


# ---- failures -----------------------------------------------------------------------------------

FLIGHT = replace(load_scene('lateral_undulation'), gravity=UPWARD, duration=0.5)
BY_CALLER = MujocoSettings(drive='torque', integrator='Euler')


def test_torques_of_too_large_steps_are_a_failure():
    # 4 - 2 c dt - w^2 dt^2 > 0 of the stiffest mode: dt < 9.03e-4 s, model_spec 10.2.
    run = run_mujoco(replace(FLIGHT, dt=1 / 500), BY_CALLER, LONG)
    assert run.trajectory.report.status is Status.DIVERGED
    assert re.match(r't = [\d.]+ s: MuJoCo: .*QACC', run.trajectory.report.failure)
    assert run.simulated < FLIGHT.duration


def test_torques_of_small_steps_are_none():
    run = run_mujoco(replace(FLIGHT, dt=1 / 2000), BY_CALLER, LONG)
    assert not run.trajectory.report.failure
    assert run.simulated == FLIGHT.duration


def test_warnings_of_mujoco_go_where_they_went():
    before = mujoco.get_mju_user_warning()
    run_mujoco(replace(FLIGHT, dt=1 / 500), BY_CALLER, LONG)
    assert mujoco.get_mju_user_warning() is before


def test_a_run_that_takes_too_long_is_stopped():
    run = run_mujoco(replace(FLIGHT, dt=1 / 1000), MujocoSettings(), 1e-9)
    assert run.late
    assert run.status == 'too_slow'
    assert run.simulated == pytest.approx(SAMPLING_PERIOD)
