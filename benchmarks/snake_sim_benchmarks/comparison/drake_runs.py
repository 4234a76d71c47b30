# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Runs of Drake's CENIC, an integrator with error control for convex contact, in one call.

Drake is an optional dependency, for which there are wheels from Python 3.12 on, and is imported
only when a function needs it. Its friction is isotropic, so that it can run cases B and C.

Contacts are spheres on a half space, as in the paper's model. Between the two axes of a joint is a
body of almost no mass, since Drake refuses bodies without any. Drake 1.58.0 takes the desired
velocity of an actuator with the wrong sign under CENIC, so that it gets the negative one. Under
CENIC references are held within a step; they are those of its end, if it is as long as the mean of
the steps of a run before.
"""

from dataclasses import dataclass
import logging
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.paths import Course, least_seconds, Start
from snake_sim_ros import ParameterError, Scene, State
from snake_sim_ros.scene import gait, obstacles
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import initial_state

BETWEEN_MASS = 1e-6  # of a body between two axes [kg]
REFERENCE_PERIOD = 0.002  # between two points of the joint references, with lines between [s]


@dataclass(frozen=True)
class CenicSettings:
    """
    Settings of CENIC; its longest step is the time step of the scene.

    Attributes
    ----------
    accuracy : float
        Relative error that a step may have; with 0 all steps have the same length.
    stiffness, dissipation : float or None
        Of contacts [N/m], [s/m]; None for Drake's own.

    """

    accuracy: float
    stiffness: float | None = None
    dissipation: float | None = None


def import_drake() -> Any:
    """Return the module `pydrake.all`; raise ParameterError if it is not installed."""
    try:
        import pydrake.all as drake
    except ImportError:
        raise ParameterError(
            'Drake is not installed: pip install drake, with Python 3.12 or newer'
        ) from None
    logging.getLogger('drake').setLevel(logging.ERROR)  # it warns of every half space
    return drake


def cenic_course(scene: Scene, start: Start | None = None, *, settings: CenicSettings) -> Course:
    """
    Return the course of a scene by CENIC, see `courses.Course`, with a point after every step.

    Raises
    ------
    ParameterError
        If Drake is not installed, or for a scene with obstacles, rolling friction or friction that
        depends on the direction.

    """
    friction = scene.friction
    if not obstacles.is_flat(scene) or friction.rolling:
        raise ParameterError('Drake gets a flat floor without rolling friction only')
    if friction.longitudinal != friction.transversal:
        raise ParameterError('friction must be isotropic for Drake, got two coefficients')
    drake = import_drake()
    state, begin = start or (initial_state(scene), 0.0)
    robot = CenicRobot(drake, scene, settings, begin + scene.dt)
    try:
        if settings.accuracy:
            robot.run(state)
            lead = scene.duration / robot.simulator.get_num_steps_taken()
            robot = CenicRobot(drake, scene, settings, begin + lead)
        seconds = robot.run(state)
    except RuntimeError as error:
        return Course(np.zeros(1), state.q[None, robot.middle, :3], math.nan, 0, f'Drake: {error}')
    log = robot.logger.FindLog(robot.simulator.get_context())
    time, kept = np.unique(log.sample_times(), return_index=True)
    return Course(time, log.data()[robot.place].T[kept], seconds, 0, '')


def _simulator_config(drake: Any, settings: CenicSettings, longest: float) -> Any:
    """Return the integrator, its accuracy and its longest step [s] as Drake takes them."""
    config = drake.SimulatorConfig()
    config.integration_scheme, config.max_step_size = 'cenic', longest
    config.use_error_control = settings.accuracy > 0.0
    config.accuracy = settings.accuracy or 1.0
    return config


class CenicRobot:
    """
    The robot of a scene in Drake, its joint references, and a simulator.

    Parameters
    ----------
    drake : module
    scene : Scene
    settings : CenicSettings
    begin : float
        Time of the gait whose references a run gets at its start [s].

    """

    def __init__(self, drake: Any, scene: Scene, settings: CenicSettings, begin: float) -> None:
        self.drake, self.scene, self.middle = drake, scene, scene.robot.middle_link
        builder = drake.DiagramBuilder()
        self.plant, shapes = drake.AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        self.plant.mutable_gravity_field().set_gravity_vector(np.array(scene.gravity))
        links = self.plant.CollectRegisteredGeometries(self._add_links(settings))
        apart = drake.CollisionFilterDeclaration().ExcludeWithin(links)
        shapes.collision_filter_manager().Apply(apart)
        self.plant.Finalize()
        model = self.plant.GetModelInstanceByName('robot')
        source = builder.AddSystem(drake.TrajectorySource(self._references(begin)))
        builder.Connect(source.get_output_port(), self.plant.get_desired_state_input_port(model))
        self.logger = drake.LogVectorOutput(self.plant.get_state_output_port(), builder)
        self.simulator = drake.Simulator(builder.Build())
        place = self.plant.GetJointByName('base').position_start() + 4  # after the quaternion
        self.place = slice(place, place + 3)
        drake.ApplySimulatorConfig(_simulator_config(drake, settings, scene.dt), self.simulator)

    def _add_links(self, settings: CenicSettings) -> list[Any]:
        """Add the floor and all links with their joints; return the links."""
        drake, plant, robot = self.drake, self.plant, self.scene.robot
        model = plant.AddModelInstance('robot')
        mu = self.scene.friction.longitudinal
        properties = drake.ProximityProperties()
        drake.AddContactMaterial(
            properties, dissipation=settings.dissipation, point_stiffness=settings.stiffness,
            friction=drake.CoulombFriction(mu, mu),
        )  # fmt: skip
        floor = drake.HalfSpace()
        plant.RegisterCollisionGeometry(
            plant.world_body(), drake.RigidTransform(), floor, 'floor', properties
        )
        values = {
            name: robot.per_link(name)
            for name in ('link_mass', 'inertia_transversal', 'inertia_axial', 'contact_radius',
                         'contact_offset', 'link_length')
        }  # fmt: skip
        bodies = []
        for i in range(robot.link_count):
            mass, across, along, radius, offset, _ = (array[i] for array in values.values())
            inertia = drake.UnitInertia(across / mass, across / mass, along / mass)
            body = plant.AddRigidBody(
                f'link{i}', model, drake.SpatialInertia(mass, np.zeros(3), inertia)
            )
            for side, z in (('front', offset), ('rear', -offset)):
                plant.RegisterCollisionGeometry(
                    body, drake.RigidTransform(np.array([0.0, 0.0, z])), drake.Sphere(radius),
                    f'{side}{i}', properties,
                )  # fmt: skip
            bodies.append(body)
        root = bodies[self.middle].body_frame()
        plant.AddJoint(drake.QuaternionFloatingJoint('base', plant.world_frame(), root))
        for i, length in enumerate(values['link_length'][:-1]):
            half = length / 2, values['link_length'][i + 1] / 2
            self._add_joint(model, i, bodies[i : i + 2], half)
        return bodies

    def _add_joint(self, model: Any, i: int, links: list[Any], half: tuple[float, float]) -> None:
        """Join links i and i+1 by yaw about e_y and pitch about e_x, with drives."""
        drake, plant, robot = self.drake, self.plant, self.scene.robot
        inertia = drake.SpatialInertia(
            BETWEEN_MASS, np.zeros(3), drake.UnitInertia.SolidSphere(0.01)
        )
        between = plant.AddRigidBody(f'between{i}', model, inertia)
        ends = [drake.RigidTransform(np.array([0.0, 0.0, z])) for z in (half[0], -half[1])]
        gains = [robot.per_joint(name)[i] for name in ('stiffness', 'damping')]
        parts = (
            ('yaw', links[0], ends[0], between, drake.RigidTransform(), np.array([0.0, 1.0, 0.0])),
            ('pitch', between, drake.RigidTransform(), links[1], ends[1], np.array([1.0, 0, 0])),
        )
        for k, (name, parent, on_parent, child, on_child, axis) in enumerate(parts):
            frames = [
                plant.AddFrame(drake.FixedOffsetFrame(f'{name}{i} of {side}', body, end))
                for side, body, end in (('parent', parent, on_parent), ('child', child, on_child))
            ]
            joint = plant.AddJoint(drake.RevoluteJoint(f'{name}{i}', *frames, axis))
            actuator = plant.AddJointActuator(f'{name}{i}', joint)
            actuator.set_controller_gains(
                drake.PdControllerGains(p=float(gains[0][k]), d=float(gains[1][k]))
            )

    def _references(self, begin: float) -> Any:
        """Return desired angles and negative rates of all axes over the time of the run."""
        scene = self.scene
        times = np.arange(0.0, scene.duration + REFERENCE_PERIOD, REFERENCE_PERIOD)
        angle, rate = gait.reference(scene.gait, begin + times, scene.robot.link_count - 1)
        wanted = np.concatenate([angle.reshape(len(times), -1), -rate.reshape(len(times), -1)], 1)
        return self.drake.PiecewisePolynomial.FirstOrderHold(times, wanted.T)

    def generalized(self, state: State) -> tuple[Array, Array]:
        """Return coordinates and velocities of Drake for a state with closed joints."""
        plant, context = self.plant, self.plant.CreateDefaultContext()
        q, u = state.q[self.middle], state.u[self.middle]
        turn = self.drake.Quaternion(q[3:] / np.linalg.norm(q[3:]))
        base = plant.GetJointByName('base')
        base.SetPose(context, self.drake.RigidTransform(turn, q[:3]))
        base.set_angular_velocity(context, rotation_matrices(q[3:]) @ u[3:])
        base.set_translational_velocity(context, u[:3])
        pairs = zip(joint_angles(state.q), joint_rates(state.q, state.u), strict=True)
        for i, (angle, rate) in enumerate(pairs):
            for k, name in enumerate(('yaw', 'pitch')):
                joint = plant.GetJointByName(f'{name}{i}')
                joint.set_angle(context, float(angle[k]))
                joint.set_angular_rate(context, float(rate[k]))
        return plant.GetPositions(context), plant.GetVelocities(context)

    def run(self, state: State) -> float:
        """Run the scene from a state; return the processor time of the shortest run [s]."""
        q, v = self.generalized(state)

        def call() -> None:
            self.start(q, v)
            self.simulator.AdvanceTo(self.scene.duration)

        return least_seconds(call)

    def start(self, q: Array, v: Array) -> None:
        """Put the robot at the start, at time 0."""
        context = self.simulator.get_mutable_context()
        context.SetTime(0.0)
        inside = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetPositions(inside, q)
        self.plant.SetVelocities(inside, v)
        self.logger.FindMutableLog(context).Clear()
        self.simulator.Initialize()
        self.simulator.ResetStatistics()
