# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The services and the action of simulation_interfaces of a real `sim`, with its real types."""

import math

from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from geometry_msgs.msg import PoseArray, PoseStamped, Vector3
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.parameter import Parameter, parameter_value_to_python
from sensor_msgs.msg import JointState
from sim_client import connected, SimClient
from simulation_interfaces import srv
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import (
    Bounds,
    EntityCategory,
    EntityState,
    Resource,
    Result,
    SimulationState,
    SimulatorFeatures,
    SpawnEntity,
    SpawnResult,
)
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectoryPoint

from snake_sim_ros.nodes.messages import LATCHED

ROBOT = 'snake_robot'
PEGS = ['pegs.x:=[1.0, -3.0]', 'pegs.y:=[3.0, 0.5]']
# What each feature that may be announced is served by.
SERVED = {
    'ENTITY_BOUNDS': 'get_entity_bounds',
    'ENTITY_BOUNDS_BOX': 'get_entities',
    'ENTITY_CATEGORIES': 'get_entities',
    'ENTITY_STATE_GETTING': 'get_entity_state',
    'ENTITY_STATE_SETTING': 'set_entity_state',
    'ENTITY_INFO_GETTING': 'get_entity_info',
    'SPAWNING': 'spawn_entity',
    'SPAWNING_RESOURCE_STRING': 'spawn_entity',
    'SPAWNING_ENTITIES': 'spawn_entities',
    'SPAWNABLES': 'get_spawnables',
    'DELETING': 'delete_entity',
    'SIMULATION_RESET_SPAWNED': 'reset_simulation',
    'SIMULATION_RESET': 'reset_simulation',
    'SIMULATION_RESET_TIME': 'reset_simulation',
    'SIMULATION_RESET_STATE': 'reset_simulation',
    'SIMULATION_STATE_GETTING': 'get_simulation_state',
    'SIMULATION_STATE_SETTING': 'set_simulation_state',
    'SIMULATION_STATE_PAUSE': 'set_simulation_state',
    'STEP_SIMULATION_SINGLE': 'step_simulation',
    'STEP_SIMULATION_MULTIPLE': 'step_simulation',
    'STEP_SIMULATION_ACTION': 'simulate_steps/_action/send_goal',
    'WORLD_INFO_GETTING': 'get_current_world',
    'AVAILABLE_WORLDS': 'get_available_worlds',
    'WORLD_LOADING': 'load_world',
    'WORLD_UNLOADING': 'unload_world',
}


class Standard(SimClient):
    """A sim, and its services of the standard."""

    def ask(self, name, /, **fields):
        """Call a service; return its response and the code of its result."""
        kind = getattr(srv, name)
        topic = ''.join('_' + c.lower() if c.isupper() else c for c in name)[1:]
        response = self.graph.call(kind, self.service(topic), kind.Request(**fields))
        return response, getattr(response, 'result', Result(result=Result.RESULT_OK)).result

    def ok(self, name, /, **fields):
        """Call a service that must succeed; return its response."""
        response, code = self.ask(name, **fields)
        assert code == Result.RESULT_OK, response
        return response

    def entity(self, name=ROBOT):
        """Return the state of an entity."""
        return self.ok('GetEntityState', entity=name).state

    def put(self, state, *, pose=False, twist=False, acceleration=False, entity=ROBOT):
        """Set a state; return the code and the sentence of the result."""
        flags = {'set_pose': pose, 'set_twist': twist, 'set_acceleration': acceleration}
        response, code = self.ask('SetEntityState', entity=entity, state=state, **flags)
        return code, response.result.error_message


@pytest.fixture(scope='module')
def sims(make_graph):
    """Return a paused sim at each level, the second one with pegs, and one for other worlds."""
    return connected(
        Standard(make_graph(), 'start_paused:=true', 'level:=planar'),
        Standard(make_graph(), 'start_paused:=true', 'level:=spatial', *PEGS),
        Standard(make_graph(), 'start_paused:=true'),
    )


@pytest.fixture(params=[0, 1], ids=['planar', 'spatial'])
def sim(sims, request):
    sims[request.param].ok('ResetSimulation')
    return sims[request.param]


@pytest.fixture
def spatial(sims):
    sims[1].ok('ResetSimulation')
    return sims[1]


@pytest.fixture
def moved(sims):
    """Return a sim in which robots are spawned, and whose worlds change."""
    sims[2].ok('LoadWorld', world_resource=Resource(uri='lateral_undulation'))
    return sims[2]


def numbers(message):
    names = [name for name in 'xyzw' if hasattr(message, name)]
    return np.array([getattr(message, name) for name in names])


def test_what_is_announced_is_there(spatial):
    features = spatial.ok('GetSimulatorFeatures').features
    assert set(features.features) == {getattr(SimulatorFeatures, name) for name in SERVED}
    assert features.spawn_formats == ['urdf']
    assert 'one link that is a cylinder' in features.custom_info
    offered = dict(spatial.graph.node.get_service_names_and_types())
    for name in SERVED.values():
        assert f'/sim/{name}' in offered


# ---- entities -----------------------------------------------------------------------------------


def test_twist_is_set_without_the_pose_at_both_levels(sim):
    before = sim.entity()
    wanted = EntityState()
    wanted.pose.position.x, wanted.pose.orientation.w = 5.0, 0.0
    wanted.twist.linear.x, wanted.twist.angular.z = 0.4, 0.5
    assert sim.put(wanted, twist=True) == (Result.RESULT_OK, '')
    state = sim.entity()
    assert state.pose == before.pose
    assert numbers(state.twist.linear) == pytest.approx([0.4, 0.0, 0.0])
    assert numbers(state.twist.angular) == pytest.approx([0.0, 0.0, 0.5])
    sim.step()
    # Friction of 0.1 to 0.5 of the weight slows it by at most 25 mm/s in 5 ms.
    assert sim.entity().pose.position.x - before.pose.position.x == pytest.approx(2e-3, rel=0.1)


def test_pose_is_set_without_the_twist_at_both_levels(sim):
    wanted = EntityState()
    wanted.pose.position = sim.entity().pose.position
    wanted.pose.position.x, wanted.pose.position.y = 2.0, -1.0
    half = math.sqrt(0.5)
    wanted.pose.orientation.z = wanted.pose.orientation.w = half
    wanted.twist.linear.x, wanted.acceleration.linear.x = math.nan, 3.0
    assert sim.put(wanted, pose=True) == (Result.RESULT_OK, '')
    state = sim.entity()
    assert numbers(state.pose.position) == pytest.approx(numbers(wanted.pose.position))
    assert abs(numbers(state.pose.orientation) @ [0, 0, half, half]) == pytest.approx(1.0)
    assert not numbers(state.twist.linear).any()
    assert sim.put(wanted) == (Result.RESULT_OK, '')  # nothing


def test_state_that_cannot_be_set_is_refused_with_a_code_and_the_reason(spatial):
    before = spatial.entity()
    codes, unusable = Result, srv.SetEntityState.Response.INVALID_POSE
    twisted, pushed, bad = EntityState(), EntityState(), EntityState()
    twisted.twist.linear.x = 500.0
    pushed.acceleration.linear.z = 1.0
    bad.pose.orientation.w = 2.0
    elsewhere = EntityState()
    elsewhere.header.frame_id = 'map'
    for state, flags, code, said in (
        (twisted, {'twist': True}, codes.RESULT_OPERATION_FAILED, 'at most 100 m/s'),
        (pushed, {'acceleration': True}, codes.RESULT_FEATURE_UNSUPPORTED, '~/push'),
        (bad, {'pose': True}, unusable, 'unit quaternion'),
        (elsewhere, {'pose': True}, codes.RESULT_OPERATION_FAILED, "got 'map'"),
        (twisted, {'twist': True, 'entity': 'peg_1'}, codes.RESULT_OPERATION_FAILED, 'fixed'),
        (twisted, {'twist': True, 'entity': 'door'}, codes.RESULT_NOT_FOUND, "got 'door'"),
    ):
        found, sentence = spatial.put(state, **flags)
        assert found == code and said in sentence
    assert spatial.entity() == before


def test_entities_are_listed_by_name_category_and_bounds(spatial):
    def listed(**filters):
        request = srv.GetEntities.Request()
        for name, value in filters.items():
            setattr(request.filters, name, value)
        states = spatial.ok('GetEntitiesStates', filters=request.filters)
        found = spatial.ok('GetEntities', filters=request.filters).entities
        assert found == states.entities and len(found) == len(states.states)
        return found

    kinds = EntityCategory
    assert listed() == [ROBOT, 'peg_1', 'peg_2']
    assert listed(filter='^peg_[0-9]$') == ['peg_1', 'peg_2']
    assert listed(categories=[kinds(category=kinds.CATEGORY_ROBOT)]) == [ROBOT]
    assert listed(categories=[kinds(category=kinds.CATEGORY_HUMAN)]) == []
    near = Bounds(type=Bounds.TYPE_SPHERE, points=[Vector3(x=1.0, y=2.0), Vector3(x=0.96)])
    assert listed(bounds=near) == ['peg_1']
    box = [Vector3(x=0.1, y=1.0, z=1.0), Vector3(x=-4.0, y=-1.0)]
    assert listed(bounds=Bounds(type=Bounds.TYPE_BOX, points=box)) == [ROBOT, 'peg_2']
    request = srv.GetEntities.Request()
    request.filters.filter = '(['
    assert spatial.ask('GetEntities', filters=request.filters)[1] == Result.RESULT_OPERATION_FAILED
    request = srv.GetEntities.Request()
    request.filters.bounds = Bounds(type=Bounds.TYPE_CONVEX_HULL, points=[Vector3()] * 3)
    response, code = spatial.ask('GetEntities', filters=request.filters)
    assert code == Result.RESULT_FEATURE_UNSUPPORTED and 'box or a sphere' in str(response)


def test_entities_have_a_kind_a_place_and_bounds(spatial):
    info = spatial.ok('GetEntityInfo', entity=ROBOT).info
    assert info.category.category == EntityCategory.CATEGORY_ROBOT
    assert info.description == 'snake robot of 11 links and 20 joint axes'
    info = spatial.ok('GetEntityInfo', entity='peg_2').info
    assert info.category.category == EntityCategory.CATEGORY_STATIC_OBJECT
    assert numbers(spatial.entity('peg_2').pose.position) == pytest.approx([-3.0, 0.5, 0.0])
    assert spatial.ask('GetEntityInfo', entity='door')[1] == Result.RESULT_NOT_FOUND
    bounds = spatial.ok('GetEntityBounds', entity='peg_1').bounds
    high, low = map(numbers, bounds.points)
    assert bounds.type == Bounds.TYPE_BOX
    assert (high - low)[:2] == pytest.approx([0.1, 0.1])
    # Aiko is 10 joints of 12.2 cm and two ends long, and as thick as its spheres; it is bent.
    high, low = map(numbers, spatial.ok('GetEntityBounds', entity=ROBOT).bounds.points)
    assert 1.0 < (high - low)[0] < 1.4
    assert (high - low)[2] == pytest.approx(0.105, abs=2e-3)


POST = """<robot name="post"><link name="post">
  <collision><geometry><cylinder radius="0.2" length="1"/></geometry></collision>
</link></robot>"""


def at(x, y):
    pose = PoseStamped()
    pose.pose.position.x, pose.pose.position.y = x, y
    return pose


def turned(pose, axis, angle):
    """Return a pose turned about an axis [rad]."""
    setattr(pose.pose.orientation, axis, math.sin(angle / 2))
    pose.pose.orientation.w = math.cos(angle / 2)
    return pose


def listed(sim):
    return sim.ok('GetEntities').entities


def test_pegs_are_spawned_deleted_and_gone_after_a_reset(spatial):
    offered = spatial.ok('GetSpawnables').spawnables
    assert [item.entity_resource.uri for item in offered] == ['peg', ROBOT]
    resource = offered[0].entity_resource
    answer = spatial.ok(
        'SpawnEntity', name='post', entity_resource=resource, initial_pose=at(4.0, 2.0)
    )
    assert answer.entity_name == 'post'
    assert listed(spatial) == [ROBOT, 'peg_1', 'peg_2', 'post']
    assert numbers(spatial.entity('post').pose.position) == pytest.approx([4.0, 2.0, 0.0])
    # The robot meets it: a wide one, a hand's breadth before link 1, which moves at it.
    thick = Resource(resource_string=POST)
    start = spatial.entity('link_1').pose.position
    there = at(start.x - 0.4, start.y)
    spatial.ok('SpawnEntity', name='wide', entity_resource=thick, initial_pose=there)
    assert spatial.ok('GetEntityBounds', entity='wide').bounds.points[0].x == pytest.approx(0.2)
    wanted = EntityState()
    wanted.twist.linear.x = -3.0
    assert spatial.put(wanted, twist=True) == (Result.RESULT_OK, '')
    spatial.ok('StepSimulation', steps=40)
    assert spatial.entity('link_1').pose.position.x > start.x - 0.4
    state = spatial.ok('GetEntityState', entity='wide').state
    assert state.header.frame_id == 'world'
    assert state.header.stamp.nanosec == round(1e9 * spatial.now) == 200_000_000
    spatial.ok('DeleteEntity', entity='post')
    assert listed(spatial) == [ROBOT, 'peg_1', 'peg_2', 'wide']
    spatial.ok('ResetSimulation', scope=srv.ResetSimulation.Request.SCOPE_SPAWNED)
    assert listed(spatial) == [ROBOT, 'peg_1', 'peg_2']
    assert spatial.entity('peg_2').pose.position.x == pytest.approx(-3.0)


def test_peg_that_cannot_be_spawned(spatial):
    codes, peg = srv.SpawnEntity.Response, Resource(uri='peg')
    tilted = turned(at(4.0, 0.0), 'x', math.pi / 2)
    for name, resource, pose, code in (
        ('peg_1', peg, at(4.0, 0.0), codes.NAME_NOT_UNIQUE),
        ('', peg, at(4.0, 0.0), codes.NAME_INVALID),
        ('a b', peg, at(4.0, 0.0), codes.NAME_INVALID),
        ('a', peg, at(0.0, 0.0), codes.INVALID_POSE),  # where the robot is
        ('a', peg, at(math.nan, 0.0), codes.INVALID_POSE),
        ('a', peg, tilted, codes.INVALID_POSE),
    ):
        request = {'name': name, 'entity_resource': resource, 'initial_pose': pose}
        response, found = spatial.ask('SpawnEntity', **request)
        assert found == code and response.result.error_message, response
    renamed = {'name': 'peg_1', 'allow_renaming': True, 'entity_resource': peg}
    answer = spatial.ok('SpawnEntity', **renamed, initial_pose=at(4.0, 0.0))
    assert answer.entity_name == 'peg_1_1'
    assert spatial.ask('DeleteEntity', entity=ROBOT)[1] == Result.RESULT_OPERATION_FAILED
    assert spatial.ask('DeleteEntity', entity='door')[1] == Result.RESULT_NOT_FOUND
    several = [SpawnEntity(name=n, entity_resource=peg, initial_pose=at(5.0, 1.0)) for n in 'aa']
    response, code = spatial.ask('SpawnEntities', spawn_requests=several)
    assert code == srv.SpawnEntities.Response.ENTITIES_SPAWN_FAILED
    results = [item.result.result for item in response.results]
    assert results == [Result.RESULT_OK, SpawnResult.NAME_NOT_UNIQUE]
    assert listed(spatial) == [ROBOT, 'peg_1', 'peg_2', 'peg_1_1', 'a']
    spatial.ok('SetSimulationState', state=SimulationState(state=SimulationState.STATE_STOPPED))
    assert listed(spatial) == [ROBOT, 'peg_1', 'peg_2']


def test_urdf_of_a_peg_gives_its_name_and_the_place_of_its_axis(spatial, tmp_path):
    file = tmp_path / 'a post.urdf'
    origin = '<origin xyz="0.5 0 0.5" rpy="0 0 1"/>'
    file.write_text(POST.replace('<geometry>', f'{origin}<geometry>'))
    pose = turned(at(4.0, 2.0), 'z', math.pi / 2)
    # By its file, as a URI and as a path, and as text; the uri counts where both are given.
    for resource, name, place in (
        (Resource(uri=file.as_uri()), 'post', [4.0, 2.5, 0.0]),
        (Resource(uri=str(file), resource_string='<robot'), 'post_1', [4.0, 2.5, 0.0]),
        (Resource(resource_string=POST), 'post_2', [4.0, 2.0, 0.0]),
    ):
        fields = {'entity_resource': resource, 'initial_pose': pose, 'allow_renaming': True}
        assert spatial.ok('SpawnEntity', **fields).entity_name == name
        assert numbers(spatial.entity(name).pose.position) == pytest.approx(place)
        assert spatial.ok('GetEntityBounds', entity=name).bounds.points[0].x == pytest.approx(0.2)
    response, code = spatial.ask(
        'SpawnEntity', entity_resource=Resource(resource_string=POST), initial_pose=pose
    )
    assert code == srv.SpawnEntity.Response.NAME_NOT_UNIQUE and 'post already' in str(response)
    # On its side it is no post, unless the pose stands it up.
    lying = Resource(
        resource_string=POST.replace('<geometry>', '<origin rpy="0 1.5708 0"/><geometry>')
    )
    fields = {'name': 'raised', 'entity_resource': lying, 'initial_pose': at(4.0, -2.0)}
    response, code = spatial.ask('SpawnEntity', **fields)
    assert code == srv.SpawnEntity.Response.INVALID_POSE and 'a tilt of 1.57 rad' in str(response)
    turned(fields['initial_pose'], 'y', math.pi / 2)
    spatial.ok('SpawnEntity', **fields)


def test_resource_that_cannot_be_spawned_is_refused_with_a_code_and_the_reason(spatial, tmp_path):
    codes, missing = srv.SpawnEntity.Response, tmp_path / 'missing.urdf'
    two = POST.replace('</robot>', '<link name="other"/></robot>')
    box = POST.replace('cylinder radius="0.2" length="1"', 'box size="1 1 1"')
    mesh = POST.replace('cylinder radius="0.2" length="1"', 'mesh filename="a.stl"')
    known = 'uri must be peg, snake_robot or a file that ends with .urdf'
    for resource, code, said in (
        (Resource(), codes.NO_RESOURCE, f'{known}, or resource_string a URDF'),
        (Resource(uri='model://post'), codes.UNSUPPORTED_FORMAT, f"{known}, got 'model://post'"),
        (Resource(uri='house.sdf'), codes.UNSUPPORTED_FORMAT, "got 'house.sdf'"),
        (Resource(uri=str(missing)), Result.RESULT_NOT_FOUND, 'there is no file'),
        (Resource(uri='a' * 300 + '.urdf'), Result.RESULT_NOT_FOUND, 'cannot be the name of a'),
        (Resource(resource_string='<sdf/>'), codes.UNSUPPORTED_FORMAT, '<robot>, got <sdf>'),
        (Resource(resource_string='<robot'), codes.RESOURCE_PARSE_ERROR, 'not readable as XML'),
        (Resource(resource_string='post'), codes.RESOURCE_PARSE_ERROR, 'not readable as XML'),
        (Resource(resource_string='<robot/>'), codes.RESOURCE_PARSE_ERROR, 'must have links'),
        (Resource(resource_string=mesh), codes.UNSUPPORTED_ASSETS, 'a cylinder, got a mesh'),
        (Resource(resource_string=box), Result.RESULT_FEATURE_UNSUPPORTED, 'a cylinder, got box'),
        (Resource(resource_string=two), Result.RESULT_FEATURE_UNSUPPORTED, 'got 2 links; further'),
    ):
        request = {'name': 'a', 'entity_resource': resource, 'initial_pose': at(4.0, 0.0)}
        response, found = spatial.ask('SpawnEntity', **request)
        assert found == code and said in response.result.error_message, response
    assert listed(spatial) == [ROBOT, 'peg_1', 'peg_2']


# ---- further robots -----------------------------------------------------------------------------


class Further:
    """A robot that is spawned into a sim, and what it publishes."""

    def __init__(self, sim, pose, name='two', namespace=''):
        self.sim, self.name, space = sim, name, namespace or name
        self.joint_states = sim.graph.record(JointState, f'/{space}/joint_states')
        self.link_poses = sim.graph.record(PoseArray, f'/{space}/link_poses')
        self.commands = sim.graph.node.create_publisher(JointState, f'/{space}/joint_command', 1)
        fields = {'entity_namespace': namespace, 'entity_resource': Resource(uri=ROBOT)}
        sim.ok('SpawnEntity', name=name, initial_pose=pose, **fields)
        sim.graph.until(self.is_connected, 'the topics of a further robot')

    def is_connected(self):
        """Return whether messages pass in both directions."""
        if not (self.joint_states and self.link_poses):
            self.sim.reset()
        return self.commands.get_subscription_count() and self.joint_states and self.link_poses

    @property
    def places(self):
        """Places of all links in the last message, (n, 3) [m]."""
        return np.array([numbers(pose.position) for pose in self.link_poses[-1].poses])


def base_pose_of(sim, *, aside=0.0):
    """Return the pose of the robot of a sim, or one aside of it [m]."""
    pose = PoseStamped(pose=sim.entity().pose)
    pose.pose.position.y += aside
    return pose


def test_further_robot_moves_beside_the_first_by_its_own_commands(moved):
    sim = moved
    other = Further(sim, base_pose_of(sim, aside=1.0))
    assert listed(sim) == [ROBOT, 'two']
    info = sim.ok('GetEntityInfo', entity='two').info
    assert info.category.category == EntityCategory.CATEGORY_ROBOT
    start = other.places
    first = np.array([numbers(pose.position) for pose in sim.link_poses[-1].poses])
    assert start - first == pytest.approx(np.tile([0.0, 1.0, 0.0], (11, 1)))
    other.commands.publish(JointState(name=['joint_1_yaw'], position=[0.2]))
    assert other.commands.wait_for_all_acked(Duration(seconds=10))
    sim.ok('StepSimulation', steps=80)
    sim.graph.until(lambda: sim.now == pytest.approx(0.4), 'the steps')
    sim.graph.until(
        lambda: other.joint_states[-1].header == sim.joint_states[-1].header, 'the same time'
    )
    assert abs(sim.joint_states[-1].position[0]) < 1e-3
    turned = other.joint_states[-1].position[0]
    assert 0.1 < turned < 0.25
    # Each goes back to its start, and the same command moves the first one by the same angle.
    sim.ok('ResetSimulation', scope=srv.ResetSimulation.Request.SCOPE_STATE)
    sim.graph.until(lambda: other.places == pytest.approx(start), 'the other at its start')
    sim.send({'joint_1_yaw': 0.2})
    sim.ok('StepSimulation', steps=80)
    sim.graph.until(lambda: sim.now == pytest.approx(0.8), 'the steps')
    assert sim.joint_states[-1].position[0] == pytest.approx(turned, rel=1e-6)
    # It is set, pushed aside and asked by its name, and its links by theirs.
    wanted = EntityState()
    wanted.twist.linear.y = 0.2
    assert sim.put(wanted, twist=True, entity='two') == (Result.RESULT_OK, '')
    assert sim.entity('two').twist.linear.y == pytest.approx(0.2)
    assert abs(sim.entity().twist.linear.y) < 1e-12
    place = sim.entity('two/link_3').pose.position
    assert sim.entity('link_3').pose.position.y - place.y == pytest.approx(-1.0, abs=0.1)
    assert sim.ask('GetEntityState', entity='three/link_3')[1] == Result.RESULT_NOT_FOUND
    sim.graph.until(lambda: len(sim.diagnostics[-1].status) == 2, 'diagnostics of both')
    assert sim.diagnostics[-1].status[1].name == 'two/sim: physics'
    sim.ok('DeleteEntity', entity='two')
    sim.graph.until(lambda: not other.commands.get_subscription_count(), 'the end of the other')
    assert listed(sim) == [ROBOT]
    sim.ok('StepSimulation', steps=1)


def test_further_robots_stay_until_a_reset_of_what_was_spawned_or_another_world(moved):
    pose = base_pose_of(moved)  # in the first one: they do not touch
    for name in ('two', 'three'):
        fields = {'entity_resource': Resource(uri=ROBOT), 'initial_pose': pose}
        moved.ok('SpawnEntity', name=name, entity_namespace=f'more/{name}', **fields)
    node = moved.graph.node
    moved.graph.until(lambda: node.count_publishers('/more/three/odom'), 'the third robot')
    moved.ok('ResetSimulation', scope=srv.ResetSimulation.Request.SCOPE_STATE)
    assert listed(moved) == [ROBOT, 'two', 'three']
    moved.ok('ResetSimulation', scope=srv.ResetSimulation.Request.SCOPE_SPAWNED)
    assert listed(moved) == [ROBOT]
    moved.ok('SpawnEntity', name='two', **fields)
    moved.ok('LoadWorld', world_resource=Resource(uri='sidewinding'))
    assert listed(moved) == [ROBOT]


def test_deleted_robot_ends_its_goal_and_leaves_its_name_to_another(moved):
    """A node that stayed would take the log of the next one of its name, as rcl warns."""
    graph, fields = moved.graph, {'entity_resource': Resource(uri=ROBOT)}

    def begin(seconds):
        """Send a goal, wait for feedback, and return its result, which may come later."""
        heard, goal = [], FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = ['joint_1_yaw']
        goal.trajectory.points = [JointTrajectoryPoint(positions=[0.1])]
        goal.trajectory.points[0].time_from_start = Duration(seconds=seconds).to_msg()
        future = action.send_goal_async(goal, heard.append)
        graph.until(future.done, 'the answer to a goal')
        result = future.result().get_result_async()
        graph.until(lambda: len(heard) > 1 or result.done(), 'feedback')
        return result

    moved.ok('SetSimulationState', state=SimulationState(state=SimulationState.STATE_PLAYING))
    for _ in range(3):
        moved.ok('SpawnEntity', name='two', initial_pose=base_pose_of(moved, aside=1.0), **fields)
        action = ActionClient(
            graph.node, FollowJointTrajectory, '/two/sim/follow_joint_trajectory'
        )
        graph.until(action.server_is_ready, 'the action')
        # A result that came shows that requests for results arrive; a late one would find no node.
        graph.until(begin(0.2).done, 'the result of a goal')
        result = begin(60.0)
        moved.ok('DeleteEntity', entity='two')
        graph.until(result.done, 'the result of a goal of a robot that is gone')
        assert result.result().status == GoalStatus.STATUS_ABORTED
        assert result.result().result.error_string == 'its robot is gone'
        graph.until(
            lambda: ('sim', '/two') not in graph.node.get_node_names_and_namespaces(), 'its end'
        )
        action.destroy()
    moved.pause(True)
    assert not moved.process.count('already registered')


def test_robot_that_cannot_be_spawned(moved):
    codes, robot, there = srv.SpawnEntity.Response, Resource(uri=ROBOT), base_pose_of(moved)
    moved.ok('SpawnEntity', name='two', entity_resource=robot, initial_pose=there)
    for name, namespace, pose, code, said in (
        ('two', '', there, codes.NAME_NOT_UNIQUE, 'there is two already'),
        ('', '', there, codes.NAME_INVALID, 'needs a name'),
        ('three', '2nd', there, codes.NAMESPACE_INVALID, "'2nd' must be letters"),
        ('three', 'two', there, codes.NAMESPACE_INVALID, 'there is a robot in /two already'),
        ('three', '', at(0.0, 0.0), codes.INVALID_POSE, 'inside the floor'),
    ):
        fields = {'entity_namespace': namespace, 'initial_pose': pose, 'entity_resource': robot}
        response, found = moved.ask('SpawnEntity', name=name, **fields)
        assert found == code and said in response.result.error_message, response
    assert listed(moved) == [ROBOT, 'two']


# ---- time and worlds ----------------------------------------------------------------------------


def test_scopes_of_a_reset(spatial):
    kind = srv.ResetSimulation.Request
    start = spatial.entity().pose.position.x
    wanted = EntityState()
    wanted.twist.linear.x = 1.0
    spatial.put(wanted, twist=True)
    spatial.ok('StepSimulation', steps=4)
    moved = spatial.entity().pose.position.x
    assert moved - start > 0.01 and spatial.now > 0.0
    spatial.ok('ResetSimulation', scope=kind.SCOPE_TIME)
    assert spatial.entity().pose.position.x == moved
    spatial.graph.until(lambda: spatial.now == 0.0, 'time 0')
    spatial.ok('StepSimulation', steps=2)
    spatial.ok('ResetSimulation', scope=kind.SCOPE_STATE)
    assert spatial.entity().pose.position.x == pytest.approx(start)
    spatial.graph.until(lambda: spatial.now == pytest.approx(0.01), 'time going on')
    _, code = spatial.ask('ResetSimulation', scope=8)
    assert code == Result.RESULT_FEATURE_UNSUPPORTED


def test_steps_of_the_action_have_feedback(spatial):
    action = ActionClient(spatial.graph.node, SimulateSteps, '/sim/simulate_steps')
    spatial.graph.until(action.server_is_ready, 'the action')

    def run(steps, cancel_after=None):
        heard = []
        goal = SimulateSteps.Goal(steps=steps)
        future = action.send_goal_async(goal, lambda message: heard.append(message.feedback))
        spatial.graph.until(future.done, 'the answer to a goal')
        if cancel_after is not None:
            spatial.graph.until(lambda: len(heard) >= cancel_after, 'steps')
            future.result().cancel_goal_async()
        result = future.result().get_result_async()
        spatial.graph.until(result.done, 'the result')
        return result.result(), heard

    answer, heard = run(5)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.result.result == Result.RESULT_OK
    # A client of rclpy drops feedback that it reads after the end of its goal: the last may be
    # missing. What it reads before is of all steps.
    told = [(one.completed_steps, one.remaining_steps) for one in heard]
    assert told and told == [(k, 5 - k) for k in range(1, 6)][: len(told)]
    spatial.graph.until(lambda: spatial.now == pytest.approx(0.025), 'five steps')
    answer, heard = run(10**6, cancel_after=3)
    assert answer.status == GoalStatus.STATUS_CANCELED and 3 <= len(heard) < 10**6
    spatial.pause(False)
    answer, heard = run(5)
    assert answer.status == GoalStatus.STATUS_ABORTED and not heard
    assert answer.result.result.result == Result.RESULT_OPERATION_FAILED
    assert 'not paused' in answer.result.result.error_message
    spatial.pause(True)


def test_state_of_the_simulation(spatial):
    states = SimulationState
    spatial.ok('StepSimulation', steps=1)
    assert spatial.ok('GetSimulationState').state.state == states.STATE_PAUSED
    for wanted in (states.STATE_PLAYING, states.STATE_PAUSED, states.STATE_STOPPED):
        spatial.ok('SetSimulationState', state=states(state=wanted))
        assert spatial.ok('GetSimulationState').state.state == wanted
    again = spatial.ask('SetSimulationState', state=states(state=states.STATE_STOPPED))
    assert again[1] == srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE


def test_worlds_are_the_scenes_of_the_package(spatial):
    world = spatial.ok('GetCurrentWorld').world
    assert world.name == 'lateral_undulation'
    assert world.world_resource.uri.endswith('/config/lateral_undulation.yaml')
    worlds = spatial.ok('GetAvailableWorlds').worlds
    assert {'lateral_undulation', 'sidewinding', 'obstacle_aided'} <= {w.name for w in worlds}
    assert 'aiko' not in {w.name for w in worlds}  # a robot


# ---- other worlds -------------------------------------------------------------------------------

OTHER = """
dt: 0.0005
level: spatial
robot: {link_count: 4}
pegs: {x: [2.0], y: [0.0]}
friction: {longitudinal: 0.2}
"""


def test_world_with_another_robot_is_loaded_while_time_runs(moved, tmp_path):
    sim, states, node = moved, SimulationState, moved.graph.node
    file = tmp_path / 'other.yaml'
    file.write_text(OTHER)
    descriptions = []
    node.create_subscription(String, '/robot_description', descriptions.append, LATCHED)
    sim.ok('SetSimulationState', state=states(state=states.STATE_PLAYING))
    sim.graph.until(lambda: sim.now > 0.05, 'time')
    world = sim.ok('LoadWorld', world_resource=Resource(uri=file.as_uri())).world
    assert world.name == 'other' and world == sim.ok('GetCurrentWorld').world
    assert sim.ok('GetSimulationState').state.state == states.STATE_STOPPED
    # Whoever listened hears the state at once: time 0, and fewer joints.
    sim.graph.until(lambda: sim.now == 0.0, 'the start of the other world')
    assert len(sim.joint_states[-1].name) == 6 and len(sim.link_poses[-1].poses) == 4
    assert listed(sim) == [ROBOT, 'peg_1']
    assert sim.entity('peg_1').pose.position.x == 2.0
    sim.graph.until(lambda: 'joint_3_pitch' in descriptions[-1].data, 'the other robot')
    assert 'joint_4_pitch' not in descriptions[-1].data
    request = GetParameters.Request(
        names=['scene', 'dt', 'robot.link_count', 'friction.longitudinal', 'publish_rate']
    )
    found = sim.graph.call(GetParameters, '/sim/get_parameters', request).values
    values = [parameter_value_to_python(value) for value in found]
    assert values == [str(file), 0.0005, 4, 0.2, 200.0]
    value = Parameter('friction.longitudinal', value=0.3).to_parameter_msg()
    request = SetParameters.Request(parameters=[value])
    (changed,) = sim.graph.call(SetParameters, '/sim/set_parameters', request).results
    assert changed.successful, changed.reason
    # It takes commands, and steps of its own length: a period is still 5 ms.
    sim.send({'joint_1_yaw': 0.01})
    sim.ok('StepSimulation', steps=100)
    sim.graph.until(lambda: sim.now == pytest.approx(0.5), 'steps')
    assert 0.005 < sim.joint_states[-1].position[0] < 0.015  # friction of contacts holds it
    sim.send({'joint_10_yaw': 0.01})
    sim.graph.until(lambda: sim.process.count("unknown joint 'joint_10_yaw'"), 'a refusal')


def test_world_that_is_refused_leaves_all_as_it_is(spatial, tmp_path):
    before, codes = spatial.entity(), srv.LoadWorld.Response
    slow, wrong = tmp_path / 'slow.yaml', tmp_path / 'wrong.yaml'
    slow.write_text('dt: 0.003')
    wrong.write_text('frictoin: 1')
    for resource, code, said in (
        (Resource(), codes.NO_RESOURCE, 'must be a scene'),
        (Resource(resource_string=OTHER), codes.UNSUPPORTED_FORMAT, 'uri is needed'),
        (Resource(uri='model://house'), codes.UNSUPPORTED_FORMAT, 'YAML file or a URDF'),
        (Resource(uri='sidwinding'), Result.RESULT_NOT_FOUND, "did you mean 'sidewinding'?"),
        (Resource(uri=str(wrong)), codes.RESOURCE_PARSE_ERROR, 'frictoin'),
        (Resource(uri=str(slow)), Result.RESULT_OPERATION_FAILED, 'publish period'),
    ):
        response, found = spatial.ask('LoadWorld', world_resource=resource)
        assert found == code and said in response.result.error_message, response
    assert spatial.entity() == before
    assert spatial.ok('GetCurrentWorld').world.name == 'lateral_undulation'


def test_without_a_world_time_waits_for_one(moved):
    states, failed = SimulationState, Result.RESULT_OPERATION_FAILED
    for world in moved.ok('GetAvailableWorlds').worlds:
        if world.name == 'sidewinding':
            break
    moved.ok('UnloadWorld')
    assert moved.ask('UnloadWorld')[1] == srv.UnloadWorld.Response.NO_WORLD_LOADED
    assert moved.ask('GetCurrentWorld')[1] == srv.GetCurrentWorld.Response.NO_WORLD_LOADED
    assert moved.ok('GetSimulationState').state.state == states.STATE_NO_WORLD
    playing = states(state=states.STATE_PLAYING)
    answer, code = moved.ask('SetSimulationState', state=playing)
    assert code == srv.SetSimulationState.Response.STATE_TRANSITION_ERROR
    assert 'call ~/load_world' in answer.result.error_message
    for name in ('GetEntities', 'StepSimulation', 'ResetSimulation', 'GetSpawnables'):
        assert moved.ask(name)[1] == failed
    assert not moved.pause(False).success
    moved.ok('LoadWorld', world_resource=world.world_resource)
    moved.ok('SetSimulationState', state=playing)
    moved.graph.until(lambda: 0.02 < moved.now < 1.0, 'time')
    moved.pause(True)
