"""
MuJoCo on the same scene: the robot as an MJCF model, run with the settings that a user can choose.

MuJoCo's contacts are soft on purpose: friction and normal force grow with a velocity and a depth,
so that a robot on a slope creeps and a robot at rest has sunk in. Its model is therefore another
one than the paper's, and comes near it as its contacts are made stiff. Its joints are minimal
coordinates, without gaps.

MuJoCo is an optional dependency: nothing here is imported from it before a function is called.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import math
import time
from typing import Any
from xml.etree import ElementTree

import numpy as np

from snake_sim_ros.comparison.course import Course
from snake_sim_ros.comparison.course import SAMPLE
from snake_sim_ros.dynamics.energy import BALANCE_TIME
from snake_sim_ros.dynamics.energy import imbalance
from snake_sim_ros.scene import gait
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.checked_records import CheckedRecord
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.checked_records import quantity
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.posture import joint_rates
from snake_sim_ros.scene.robot_description import element
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.simulation import steps_in
from snake_sim_ros.stepping.state import State

DRIVES = ('torque', 'position', 'spring')
INTEGRATORS = ('Euler', 'implicit', 'implicitfast', 'RK4', 'discrete')
CONES = ('elliptic', 'pyramidal')
CONTACTS = ('default', 'accurate', 'fast')
GAINS = ('stiffness', 'damping')
START = 0  # number of the key frame
FREE = 7, 6  # coordinates and velocities of the free first link, before those of the joints
ITERATIONS = 100  # MuJoCo's own limit of its solver


@dataclass(frozen=True, kw_only=True)
class MujocoSettings(CheckedRecord):
    """
    What a user of MuJoCo can choose for the robot of a scene.

    The drives are one law, K_p (reference - angle) + K_d (reference rate - rate), computed by
    different parts of MuJoCo: `torque` by the caller before a step, as any controller is,
    `position` by an affine actuator and `spring` by a spring and a damper in the joint. How much
    of the last two is implicit depends on the integrator.
    """

    drive: str = quantity('spring', '', 'what computes the joint torques', choices=DRIVES)
    integrator: str = quantity('discrete', '', "MuJoCo's integrator", choices=INTEGRATORS)
    cone: str = quantity('elliptic', '', 'shape of the friction cone', choices=CONES)
    contact: str = quantity(
        'accurate', '', "MuJoCo's own contacts and solver, or chosen ones", choices=CONTACTS
    )


def _mujoco() -> Any:
    """Return the module `mujoco`; raise ParameterError where it is missing."""
    try:
        import mujoco
    except ImportError:
        raise ParameterError(
            'MuJoCo is not installed: pip install "snake_sim_ros[peers]"'
        ) from None
    return mujoco


def mjcf(scene: Scene, settings: MujocoSettings) -> str:
    """
    Return the robot of a scene on its floor as an MJCF model; its key frame is the start.

    Bodies have the frames B of the links. The hinges of a joint are yaw and pitch as in
    `posture.joint_angles`: about e_y of a link, then about e_x of the next one. Floor and links
    touch as plane and capsules, at the contact points of the paper; MuJoCo lays the first tangent
    of such a contact along the capsule.

    Raises
    ------
    ParameterError
        If there is more than a flat floor, if there is rolling friction, which MuJoCo measures
        in other units, or if a link has no contact radius.

    """
    if not obstacles.is_flat(scene) or scene.friction.rolling:
        got = (
            f'friction.rolling={scene.friction.rolling:g}' if obstacles.is_flat(scene) else 'more'
        )
        raise ParameterError(f'MuJoCo gets a flat floor without rolling friction only, got {got}')
    robot = scene.robot
    lengths = [
        robot.per_link(name) for name in ('link_length', 'contact_radius', 'contact_offset')
    ]
    if not min(lengths[1].min(), lengths[2].min()) > 0:
        raise ParameterError(
            f'contact_radius and contact_offset must be above 0 m for MuJoCo, got '
            f'{lengths[1].min():g} m and {lengths[2].min():g} m'
        )
    root = ElementTree.Element('mujoco')
    element(root, 'compiler', angle='radian', autolimits='true')
    option, pair = _contact_model(scene, settings)
    element(root, 'option', gravity=scene.gravity, timestep=scene.dt, cone=settings.cone,
             integrator=settings.integrator, **option)  # fmt: skip
    world = element(root, 'worldbody')
    element(world, 'geom', name='floor', type='plane', size=(0, 0, 1), contype=0, conaffinity=0)
    contact, actuator = element(root, 'contact'), element(root, 'actuator')
    q, parent = initial_coordinates(scene), world
    inertia = np.column_stack(
        [robot.per_link(f'inertia_{axis}') for axis in ('transversal', 'transversal', 'axial')]
    )
    for i, (length, radius, offset) in enumerate(zip(*lengths, strict=True)):
        if i == 0:
            parent = element(parent, 'body', pos=q[0, :3], quat=q[0, 3:])
            element(parent, 'freejoint')
        else:
            parent = element(parent, 'body', pos=(0, 0, (lengths[0][i - 1] + length) / 2))
            _joints(parent, actuator, scene, settings.drive, i - 1)
        element(parent, 'inertial', pos=(0, 0, 0), mass=robot.per_link('link_mass')[i],
                 diaginertia=inertia[i])  # fmt: skip
        element(parent, 'geom', name=f'link{i}', type='capsule', size=(radius, offset),
                 contype=0, conaffinity=0)  # fmt: skip
        element(contact, 'pair', geom1='floor', geom2=f'link{i}', condim=3,
                 friction=(scene.friction.longitudinal, scene.friction.transversal),
                 **pair)  # fmt: skip
    start = np.concatenate([q[0], joint_angles(q).ravel()])
    element(element(root, 'keyframe'), 'key', name='start', qpos=start)
    return ElementTree.tostring(root, encoding='unicode')


def _joints(
    body: ElementTree.Element, actuator: ElementTree.Element, scene: Scene, drive: str, i: int
) -> None:
    """Append the two hinges of joint i to the body of link i+1, and their drives."""
    half = scene.robot.per_link('link_length')[i + 1] / 2
    gains = zip(*(scene.robot.per_joint(name)[i] for name in GAINS), strict=True)
    for axis, vector, (K_p, K_d) in zip(
        ('yaw', 'pitch'), ((0, 1, 0), (1, 0, 0)), gains, strict=True
    ):
        name = f'{axis}{i}'
        passive = {'stiffness': K_p, 'damping': K_d} if drive == 'spring' else {}
        element(body, 'joint', name=name, type='hinge', pos=(0, 0, -half), axis=vector, **passive)
        affine = {'biastype': 'affine', 'biasprm': (0, -K_p, -K_d)} if drive == 'position' else {}
        element(actuator, 'general', joint=name, **affine)


def _contact_model(
    scene: Scene, settings: MujocoSettings
) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return attributes of the options and of the contact pairs.

    Chosen by trying some hundred settings on cases A, B and C with 60 to 4000 steps a second, the
    integrator `discrete` and springs as drives. MuJoCo's cone lifts what slides, and so gives the
    load to contacts that slide less. `fast` takes that as it is: in case A its error rises and
    falls with the step by chance, and in case B it is large. `accurate` does not lift: in cases A
    and B its errors fall slowly as steps get smaller, in case C they stay at 1 %.
    """
    if settings.contact == 'default':
        return {}, {}
    options: dict[str, dict[str, Any]] = {
        # Friction so soft that normal forces are found without it, and do not lift; then friction
        # once more without softness, within the cones of these forces.
        'accurate': {
            'impratio': 1e-4, 'noslip_iterations': 3, 'solver': 'PGS', 'iterations': 5,
            'tolerance': 1e-5,
        },
        # Friction harder than the normal force, as creep gets smaller by as much; few sweeps.
        'fast': {'impratio': 30, 'solver': 'PGS', 'iterations': 5, 'tolerance': 1e-5},
    }  # fmt: skip
    pair = {
        # Time in which penetration decays, and ratio of damping: the shortest that MuJoCo
        # takes as it is, longer ones are softer.
        'solref': (scene.dt if settings.integrator == 'discrete' else 2 * scene.dt, 1),
        # Soft at the surface, which spreads the load, and hard from a depth of 0.1 mm on.
        'solimp': (0.1, 0.99, 1e-4),
    }
    # Of two equal computations, dense ones are faster at this size.
    return {'jacobian': 'dense', **options[settings.contact]}, pair


def run_mujoco(scene: Scene, settings: MujocoSettings, limit: float) -> Course:
    """
    Return the course of a scene as MuJoCo runs it, its time step that of the scene.

    A time is that of `mj_step` and of setting the controls, or computing them for the drive
    `torque`; references, recording and checks are not in it. The report counts iterations of
    MuJoCo's solver, and as unconverged the steps that reach its own limit; a lower one is a
    setting. Its penetration is that at samples, as reading contacts slows the next step down. It
    holds no residual of the paper's laws, which are not those that MuJoCo solves (nan), and no
    joint gaps, as there are none. A warning of MuJoCo is a failure: it has set the robot back to
    its start, or will.

    Parameters
    ----------
    scene : Scene
    settings : MujocoSettings
    limit : float
        Wall time of all steps after which the run is stopped [s].

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run the scene, see `mjcf`, or if dt does not divide
        the sampling period, or the period the duration.

    """
    mujoco = _mujoco()
    steps = steps_in(SAMPLE, scene.dt, 'sampling period')
    samples = steps_in(scene.duration, SAMPLE, 'duration')
    begin = time.perf_counter()
    model = mujoco.MjModel.from_xml_string(mjcf(scene, settings))
    build_seconds = time.perf_counter() - begin
    data, judge = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, START)
    poses, states, nanoseconds = [_pose(judge, model, data.qpos)], [_state(data)], [0]
    failure, late, depth, balanced = '', False, 0.0, round(BALANCE_TIME / scene.dt)
    count, iterations = data.solver_niter, [0]
    with _warnings(mujoco) as warnings:
        while len(poses) <= samples and not (failure or late):
            reference = _reference(scene, len(nanoseconds) - 1, steps)
            for elapsed in _steps(scene, settings, model, data, reference):
                if warnings:
                    reason = warnings[0].partition('.')[0]
                    failure = f't = {(len(nanoseconds) - 1) * scene.dt:g} s: MuJoCo: {reason}'
                    break
                nanoseconds.append(elapsed)
                iterations.append(count.item(0))  # of the one robot
                if len(states) <= balanced:
                    states.append(_state(data))
            else:
                poses.append(_pose(judge, model, data.qpos))
                depth = max(depth, -float(data.contact.dist.min(initial=0.0)))
            late = sum(nanoseconds) > 1e9 * limit
    position, axis, joint_angle = map(np.array, zip(*poses, strict=True))
    single = np.array(nanoseconds[1:] or [0]) / 1e3
    report = Report(
        steps=len(nanoseconds) - 1,
        iterations=sum(iterations),
        iterations_max=max(iterations),
        unconverged=sum(number >= ITERATIONS for number in iterations),
        residual_max=math.nan,
        printed_residual_max=math.nan,
        penetration_max=depth,
        contacts=int(data.ncon),
        failure=failure,
    )
    return Course(
        position=position,
        axis=axis,
        joint_angle=joint_angle,
        seconds=1e-6 * float(single.sum()),
        median=float(np.median(single)),
        p99=float(np.percentile(single, 99)),
        compile_seconds=build_seconds,
        report=report,
        energy_error=math.nan if failure else _balance_error(scene, model, judge, states),
        late=late and len(poses) <= samples,
    )


def mujoco_states(
    scene: Scene, settings: MujocoSettings, start: State, steps: int, every: int
) -> State:
    """
    Return the states of a robot that holds its posture, as MuJoCo has it from any state on.

    Parameters
    ----------
    scene : Scene
    settings : MujocoSettings
    start : State
        With closed joints.
    steps, every : int
        Steps to take, and those between two states that are returned.

    Returns
    -------
    State
        With q of shape (m, n, 7) and u of shape (m, n, 6), the start among them; only those
        before a step that MuJoCo warned of.

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run the scene, see `mjcf`.

    """
    mujoco = _mujoco()
    model = mujoco.MjModel.from_xml_string(mjcf(scene, settings))
    data, judge = mujoco.MjData(model), mujoco.MjData(model)
    angle = joint_angles(start.q).ravel()
    # Its free joint has the velocities of u: of the center in I, of rotation in B.
    data.qpos[:] = np.concatenate([start.q[0], angle])
    data.qvel[:] = np.concatenate([start.u[0], joint_rates(start.q, start.u).ravel()])
    held = np.tile(angle, (steps, 1)), np.zeros((steps, len(angle)))
    states = [start]
    with _warnings(mujoco) as warnings:
        for step, _ in enumerate(_steps(scene, settings, model, data, held), start=1):
            if warnings:
                break
            if step % every == 0:
                states.append(_link_state(judge, model, data))
    return State(*(np.array([getattr(state, name) for state in states]) for name in 'qu'))


def _link_state(judge: Any, model: Any, data: Any) -> State:
    """Return coordinates and velocities of all links."""
    mujoco = _mujoco()
    judge.qpos[:], judge.qvel[:] = data.qpos, data.qvel
    for part in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
        part(model, judge)
    # Twists in axes of I, with the velocity of the body point at the center of mass of the robot.
    omega, velocity = judge.cvel[1:, :3], judge.cvel[1:, 3:]
    velocity = velocity + np.cross(omega, judge.xpos[1:] - judge.subtree_com[1])
    omega_B = np.einsum('iab,ia->ib', judge.xmat[1:].reshape(-1, 3, 3), omega)
    q = np.concatenate([judge.xpos[1:], judge.xquat[1:]], axis=1)
    return State(q, np.concatenate([velocity, omega_B], axis=1))


def _reference(scene: Scene, first: int, steps: int) -> tuple[Array, Array]:
    """Return angles and rates of all axes at the middle of steps, shapes (steps, 2(n-1))."""
    times = (first + 0.5 + np.arange(steps)) * scene.dt
    angle, rate = gait.reference(scene.gait, times, scene.robot.link_count - 1)
    return angle.reshape(steps, angle[0].size), rate.reshape(steps, rate[0].size)


def _steps(
    scene: Scene, settings: MujocoSettings, model: Any, data: Any, reference: tuple[Array, Array]
) -> Iterator[int]:
    """Take a step for each reference; yield its wall time [ns]."""
    step, clock = _mujoco().mj_step, time.perf_counter_ns
    control, angle, rate = data.ctrl, data.qpos[FREE[0] :], data.qvel[FREE[1] :]
    K_p, K_d = (scene.robot.per_joint(name).ravel() for name in GAINS)
    feed = K_p * reference[0] + K_d * reference[1]
    if settings.drive == 'torque':
        for angle_ref, rate_ref in zip(*reference, strict=True):
            begin = clock()
            control[:] = K_p * (angle_ref - angle) + K_d * (rate_ref - rate)
            step(model, data)
            yield clock() - begin
        return
    for fed in feed:
        begin = clock()
        control[:] = fed
        step(model, data)
        yield clock() - begin


@contextmanager
def _warnings(mujoco: Any) -> Iterator[list[str]]:
    """Collect what MuJoCo warns of, which otherwise goes to the screen and to a file."""
    before = mujoco.get_mju_user_warning()
    collected: list[str] = []
    mujoco.set_mju_user_warning(collected.append)
    try:
        yield collected
    finally:
        mujoco.set_mju_user_warning(before)


def _pose(judge: Any, model: Any, coordinates: Array) -> tuple[Array, Array, Array]:
    """Return link centers, link axes and joint angles of a robot at coordinates of MuJoCo."""
    judge.qpos[:] = coordinates
    _mujoco().mj_kinematics(model, judge)
    axis = judge.xmat[1:].reshape(-1, 3, 3)[:, :, 2]
    return judge.xpos[1:].copy(), axis.copy(), coordinates[FREE[0] :].reshape(-1, 2).copy()


def _state(data: Any) -> tuple[Array, Array, Array]:
    """Return coordinates, velocities and the forces of the contacts in the step before."""
    return data.qpos.copy(), data.qvel.copy(), data.qfrc_constraint.copy()


def _balance_error(scene: Scene, model: Any, judge: Any, states: list[Any]) -> float:
    """
    Return how much energy steps lost or made, over the work that the joints did either way.

    As `energy.balance_error`, by the mean velocities of steps: the work of the contact forces that
    MuJoCo found, and that of the law of the joints with the mean angle and rate of a step.
    """
    q, u, force = map(np.array, zip(*states, strict=True))
    energy = np.array([_energy(scene, model, judge, *state) for state in zip(q, u, strict=True)])
    angle, rate = _reference(scene, 0, len(states) - 1)
    mean = (u[1:] + u[:-1]) / 2
    K_p, K_d = (scene.robot.per_joint(name).ravel() for name in GAINS)
    joint_rate = mean[:, FREE[1] :]
    joint_angle = (q[1:, FREE[0] :] + q[:-1, FREE[0] :]) / 2
    torque = K_p * (angle - joint_angle) + K_d * (rate - joint_rate)
    joints = scene.dt * (torque * joint_rate).sum(axis=1)
    contacts = scene.dt * (force[1:] * mean).sum(axis=1)
    return imbalance(energy, contacts, joints)


def _energy(scene: Scene, model: Any, judge: Any, q: Array, u: Array) -> float:
    """Return kinetic and potential energy of the links, without that of springs [J]."""
    mujoco, momentum = _mujoco(), np.zeros(len(u))
    judge.qpos[:] = q
    for part in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_makeM):
        part(model, judge)
    mujoco.mj_mulM(model, judge, momentum, u)
    potential = -model.body_mass[1:] @ (judge.xipos[1:] @ np.array(scene.gravity))
    return float(u @ momentum / 2 + potential)
