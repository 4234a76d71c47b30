# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Services and topics that need simulation_interfaces or tf2_msgs, tested with stand-ins.

Neither package is on PyPI. The stand-ins have only the names and numbers of their definitions: the
tests check the content of answers and messages, not their transport.
"""

from dataclasses import replace
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
import numpy as np
import pytest
from std_msgs.msg import Header

from snake_sim_ros import Scene, Simulation
from snake_sim_ros.nodes import sim_services, state_publishers
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.scene.rotations import rotation_matrices

pytestmark = pytest.mark.fast


class State:
    STATE_STOPPED, STATE_PLAYING, STATE_PAUSED = 0, 1, 2


class Result:
    RESULT_FEATURE_UNSUPPORTED, RESULT_OK, RESULT_NOT_FOUND = 0, 1, 2
    RESULT_OPERATION_FAILED = 4


class Features:
    ENTITY_STATE_GETTING, ENTITY_STATE_SETTING = 10, 11
    SIMULATION_RESET, SIMULATION_RESET_TIME, SIMULATION_RESET_STATE = 20, 21, 22
    SIMULATION_STATE_GETTING, SIMULATION_STATE_SETTING, SIMULATION_STATE_PAUSE = 24, 25, 26
    STEP_SIMULATION_SINGLE, STEP_SIMULATION_MULTIPLE = 31, 32


class Reset:
    SCOPE_TIME, SCOPE_STATE, SCOPE_SPAWNED, SCOPE_ALL = 1, 2, 4, 255

    def __init__(self, scope):
        self.scope = scope


class Answer:
    ALREADY_IN_TARGET_STATE, STATE_TRANSITION_ERROR = 101, 102

    def __init__(self):
        self.result = SimpleNamespace(result=None, error_message='')
        self.state = SimpleNamespace(state=None)
        self.features = SimpleNamespace(features=None, custom_info='')


NAMES = ('GetSimulatorFeatures', 'GetSimulationState', 'SetSimulationState', 'ResetSimulation',
         'StepSimulation')  # fmt: skip


class Node:
    """A node that counts periods of 5 ms, and keeps the requests that it got."""

    def __init__(self):
        self.paused, self.failure, self.compiling, self.seconds = False, '', '', 1.0
        self.services, self.told = {}, []

    def create_service(self, kind, name, callback):
        self.services[name] = callback

    def reset(self, *, state=True, time=False):
        self.told.append(('reset', state, time))
        self.failure = ''
        if time:
            self.seconds = 0.0

    def step(self, count=1):
        self.told.append(('step', count))
        self.seconds += 0.005 * count

    def call(self, name, **request):
        answer = self.services[f'~/{name}'](SimpleNamespace(**request), Answer())
        return answer.result.result, answer

    def state(self):
        _, answer = self.call('get_simulation_state')
        return answer.state.state

    def set_state(self, wanted):
        return self.call('set_simulation_state', state=SimpleNamespace(state=wanted))

    def reset_scope(self, scope):
        answer = self.services['~/reset_simulation'](Reset(scope), Answer())
        return answer.result.result


@pytest.fixture
def node(monkeypatch):
    standard = SimpleNamespace(SimulationState=State, Result=Result, SimulatorFeatures=Features)
    services = SimpleNamespace(**dict.fromkeys(NAMES, Answer))
    monkeypatch.setattr(sim_services, 'standard', standard)
    monkeypatch.setattr(sim_services, 'standard_services', services)
    node = Node()
    sim_services.serve_simulation(node)
    return node


def test_services_have_the_names_of_the_standard_beside_our_own(node):
    standard = {'get_simulator_features', 'get_simulation_state', 'set_simulation_state',
                'reset_simulation', 'step_simulation'}  # fmt: skip
    assert set(node.services) == {f'~/{name}' for name in standard | {'reset', 'pause', 'step'}}


def test_without_the_package_only_our_own_are_served(monkeypatch):
    monkeypatch.setattr(sim_services, 'standard', None)
    node = Node()
    sim_services.serve_simulation(node)
    assert set(node.services) == {'~/reset', '~/pause', '~/step'}


def test_features_are_those_that_are_served(node):
    _, answer = node.call('get_simulator_features')
    assert answer.features.features == [10, 11, 20, 21, 22, 24, 25, 26, 31, 32]
    assert 'publish period' in answer.features.custom_info


def test_states_are_played_paused_and_stopped(node):
    assert node.state() == State.STATE_PLAYING
    assert node.set_state(State.STATE_PAUSED)[0] == Result.RESULT_OK
    assert node.paused and node.state() == State.STATE_PAUSED
    assert node.set_state(State.STATE_PAUSED)[0] == Answer.ALREADY_IN_TARGET_STATE
    # The simulation is stopped at the start, at time 0; after a step it is paused.
    assert node.set_state(State.STATE_STOPPED)[0] == Result.RESULT_OK
    assert node.told == [('reset', True, True)]
    assert node.seconds == 0.0 and node.state() == State.STATE_STOPPED
    node.call('step_simulation', steps=1)
    assert node.state() == State.STATE_PAUSED
    assert node.set_state(State.STATE_PLAYING)[0] == Result.RESULT_OK
    assert not node.paused and node.state() == State.STATE_PLAYING
    result, answer = node.set_state(3)
    assert result == Result.RESULT_FEATURE_UNSUPPORTED
    assert answer.result.error_message == 'state must be 0 (stopped), 1 (playing) or 2, got 3'


def test_what_diverged_is_not_played_before_a_reset(node):
    node.failure = 'link 1 would turn'
    assert node.state() == State.STATE_PAUSED
    result, answer = node.set_state(State.STATE_PLAYING)
    assert result == Answer.STATE_TRANSITION_ERROR
    assert answer.result.error_message == 'diverged, reset first: link 1 would turn'
    assert node.reset_scope(Reset.SCOPE_STATE) == Result.RESULT_OK
    assert node.state() == State.STATE_PLAYING


@pytest.mark.parametrize(
    ('scope', 'told'),
    [
        (0, ('reset', True, True)),
        (Reset.SCOPE_ALL, ('reset', True, True)),
        (Reset.SCOPE_TIME, ('reset', False, True)),
        (Reset.SCOPE_STATE, ('reset', True, False)),
    ],
)
def test_a_reset_has_a_scope(node, scope, told):
    assert node.reset_scope(scope) == Result.RESULT_OK
    assert node.told == [told]


def test_what_needs_physics_is_refused_while_that_is_compiled(node):
    node.compiling, node.paused = 'compiling, 12 s so far', True
    assert node.reset_scope(Reset.SCOPE_ALL) == Result.RESULT_OPERATION_FAILED
    result, answer = node.call('step_simulation', steps=1)
    assert result == Result.RESULT_OPERATION_FAILED
    assert answer.result.error_message == 'compiling, 12 s so far'
    assert node.set_state(State.STATE_STOPPED)[0] != Result.RESULT_OK
    assert node.set_state(State.STATE_PLAYING)[0] == Result.RESULT_OK
    assert not node.told and not node.paused


def test_nothing_was_spawned_that_could_be_taken_away(node):
    assert node.reset_scope(Reset.SCOPE_SPAWNED) == Result.RESULT_FEATURE_UNSUPPORTED
    assert not node.told


def test_steps_are_taken_while_paused(node):
    result, answer = node.call('step_simulation', steps=3)
    assert result == Result.RESULT_OPERATION_FAILED
    assert 'not paused' in answer.result.error_message
    node.set_state(State.STATE_PAUSED)
    assert node.call('step_simulation', steps=3)[0] == Result.RESULT_OK
    assert node.told == [('step', 3)]
    node.failure = 'too far'
    result, answer = node.call('step_simulation', steps=1)
    assert (result, answer.result.error_message) == (Result.RESULT_OPERATION_FAILED, 'too far')


def entity_state(position=(0.0, 0.0, 0.0), turned=(0.0, 0.0, 0.0, 1.0), speed=0.0, frame=''):
    """Return what has the fields of an EntityState."""
    state = SimpleNamespace(header=Header(frame_id=frame), pose=Pose(), twist=Twist())
    state.pose.position = Point(**dict(zip('xyz', position, strict=True)))
    state.pose.orientation = Quaternion(**dict(zip('xyzw', turned, strict=True)))
    state.twist.linear.x = speed
    return state


class Entities:
    """The services of entities of a simulation, and how often the robot was put elsewhere."""

    def __init__(self):
        self.simulation, self.services, self.moved = Simulation(Scene()), {}, 0
        node = SimpleNamespace(
            create_subscription=lambda *_, **__: None,
            create_service=lambda kind, name, callback: self.services.update({name: callback}),
        )
        handling = sim_services.Handling(node, self.simulation, Settings(), None, self.count)
        sim_services.serve_entities(node, self.simulation, handling)

    def count(self):
        self.moved += 1

    def get(self, entity):
        answer = SimpleNamespace(result=SimpleNamespace(), state=entity_state())
        return self.services['~/get_entity_state'](SimpleNamespace(entity=entity), answer)

    def set(self, entity, state):
        answer = SimpleNamespace(result=SimpleNamespace())
        request = SimpleNamespace(entity=entity, state=state)
        result = self.services['~/set_entity_state'](request, answer).result
        return result.result, result.error_message


@pytest.fixture
def entities(monkeypatch):
    kinds = SimpleNamespace(GetEntityState=Answer, SetEntityState=Answer)
    monkeypatch.setattr(sim_services, 'standard', SimpleNamespace(Result=Result))
    monkeypatch.setattr(sim_services, 'standard_services', kinds)
    return Entities()


def test_an_older_package_has_no_services_of_entities(monkeypatch):
    monkeypatch.setattr(sim_services, 'standard', SimpleNamespace(Result=Result))
    monkeypatch.setattr(sim_services, 'standard_services', SimpleNamespace())
    assert not Entities().services
    monkeypatch.setattr(sim_services, 'standard', None)
    assert not Entities().services


def test_the_robot_is_where_odom_says(entities):
    simulation = entities.simulation
    velocities = np.random.default_rng(0).normal(size=(11, 6))
    simulation.state = replace(simulation.state, u=velocities)
    messages = StateMessages(simulation.scene.robot)
    messages.fill(0, simulation.state, np.zeros((10, 2)))
    answer = entities.get('snake_robot')
    assert answer.result.result == Result.RESULT_OK
    pose, twist = answer.state.pose, answer.state.twist
    place, turned = pose.position, pose.orientation
    assert [place.x, place.y, place.z] == pytest.approx(messages.base[:3])
    found = np.array([turned.x, turned.y, turned.z, turned.w])
    assert abs(found @ messages.base[3:]) == pytest.approx(1.0)  # the same turn, or its opposite
    q, u = simulation.state.q[5], simulation.state.u[5]
    assert [twist.linear.x, twist.linear.y, twist.linear.z] == u[:3].tolist()
    spin = rotation_matrices(q[3:]) @ u[3:]
    assert [twist.angular.x, twist.angular.y, twist.angular.z] == pytest.approx(spin)
    link = entities.get('link_3').state.pose
    assert [link.position.x, link.position.y, link.position.z] == simulation.state.q[
        2, :3
    ].tolist()
    result = entities.get('tail').result
    assert result.result == Result.RESULT_NOT_FOUND
    said = "entity: no link 'tail'; the links are link_1 to link_11, the robot snake_robot"
    assert result.error_message == said


def test_the_robot_is_put_where_it_is_told(entities):
    half = float(np.sqrt(0.5))
    for wanted in (
        entity_state((1.0, 2.0, 0.0525), (0.0, 0.0, half, half)),
        entity_state((0.0, 0.0, 2.0), (half, 0.0, half, 0.0), frame='world'),
    ):
        assert entities.set('snake_robot', wanted) == (Result.RESULT_OK, '')
        pose = entities.get('snake_robot').state.pose
        there, asked = pose.position, wanted.pose.position
        assert (there.x, there.y, there.z) == pytest.approx((asked.x, asked.y, asked.z))
        there, asked = pose.orientation, wanted.pose.orientation
        turned = there.x * asked.x + there.y * asked.y + there.z * asked.z + there.w * asked.w
        assert abs(turned) == pytest.approx(1.0)  # the same turn, or its opposite
    assert entities.moved == 2
    assert not entities.simulation.state.u.any()


def test_what_cannot_be_set_is_refused(entities):
    before = entities.simulation.state
    for entity, state, code, said in (
        ('link_3', entity_state(), Result.RESULT_NOT_FOUND, 'entity must be snake_robot'),
        ('snake_robot', entity_state(speed=1.0), Result.RESULT_FEATURE_UNSUPPORTED, 'twist'),
        ('snake_robot', entity_state(), Result.RESULT_OPERATION_FAILED, 'inside the floor'),
        ('snake_robot', entity_state(frame='map'), Result.RESULT_OPERATION_FAILED, "got 'map'"),
    ):
        result, message = entities.set(entity, state)
        assert result == code
        assert said in message
    assert entities.simulation.state is before
    assert not entities.moved


def test_transforms_lead_from_world_to_the_base(monkeypatch):
    monkeypatch.setattr(state_publishers, 'TFMessage', lambda transforms: transforms)
    messages = state_publishers.TransformMessages('aiko/')
    (fixed,), (moving,) = messages.fixed, messages.moving
    assert (fixed.header.frame_id, fixed.child_frame_id) == ('world', 'aiko/odom')
    assert (moving.header.frame_id, moving.child_frame_id) == ('aiko/odom', 'aiko/base_link')
    # Both frames are at the same place.
    assert fixed.transform.rotation.w == 1.0 and fixed.transform.translation.x == 0.0
    messages.fill(Time(sec=2, nanosec=5), [1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.9])
    place, turn = moving.transform.translation, moving.transform.rotation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 3.0)
    assert (turn.x, turn.y, turn.z, turn.w) == (0.1, 0.2, 0.3, 0.9)
    assert moving.header.stamp.sec == 2 and fixed.header.stamp.sec == 0
