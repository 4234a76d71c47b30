# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Services and topics that need simulation_interfaces or tf2_msgs, tested with stand-ins.

Neither package is on PyPI. The stand-ins have only the names and numbers of their definitions: the
tests check the content of answers and messages, not their transport.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Accel, Point, Pose, Quaternion, Twist
import numpy as np
import pytest
from std_msgs.msg import Header

from snake_sim_ros import Scene, Simulation
from snake_sim_ros.nodes import sim_services, standard, state_publishers
from snake_sim_ros.nodes.entity_services import serve_entities
from snake_sim_ros.nodes.placing import Placing
from snake_sim_ros.nodes.spawning import Spawning
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.scene.checked_records import cut, ParameterError, quoted
from snake_sim_ros.scene.files import find_file
from snake_sim_ros.scene.rotations import rotation_matrices

pytestmark = pytest.mark.fast


class State:
    STATE_STOPPED, STATE_PLAYING, STATE_PAUSED, STATE_NO_WORLD = 0, 1, 2, 4


class Result:
    RESULT_FEATURE_UNSUPPORTED, RESULT_OK, RESULT_NOT_FOUND = 0, 1, 2
    RESULT_OPERATION_FAILED = 4


class Features:
    ENTITY_STATE_GETTING, ENTITY_STATE_SETTING = 10, 11
    SIMULATION_RESET, SIMULATION_RESET_TIME, SIMULATION_RESET_STATE = 20, 21, 22
    SIMULATION_STATE_GETTING, SIMULATION_STATE_SETTING, SIMULATION_STATE_PAUSE = 24, 25, 26
    STEP_SIMULATION_SINGLE, STEP_SIMULATION_MULTIPLE = 31, 32
    WORLD_LOADING, WORLD_UNLOADING, WORLD_INFO_GETTING, AVAILABLE_WORLDS = 40, 43, 44, 45


class Reset:
    SCOPE_TIME, SCOPE_STATE, SCOPE_SPAWNED, SCOPE_ALL = 1, 2, 4, 255

    def __init__(self, scope):
        self.scope = scope


class Answer:
    ALREADY_IN_TARGET_STATE, STATE_TRANSITION_ERROR = 101, 102
    UNSUPPORTED_FORMAT, NO_RESOURCE, RESOURCE_PARSE_ERROR = 101, 102, 103
    NO_WORLD_LOADED = 101

    def __init__(self):
        self.result = SimpleNamespace(result=None, error_message='')
        self.state = SimpleNamespace(state=None)
        self.features = SimpleNamespace(features=None, custom_info='')
        self.world = World()


def World():
    return SimpleNamespace(name='', world_resource=SimpleNamespace(uri=''))


NAMES = ('GetSimulatorFeatures', 'GetSimulationState', 'SetSimulationState', 'ResetSimulation',
         'StepSimulation', 'GetCurrentWorld', 'LoadWorld', 'UnloadWorld',
         'GetAvailableWorlds')  # fmt: skip


class Node:
    """A node that counts periods of 5 ms, and keeps the requests that it got."""

    def __init__(self):
        self.paused, self.failure, self.waiting, self.seconds = False, '', '', 1.0
        self.world, self.between, self.services, self.told = 'sidewinding', None, {}, []

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

    def load_world(self, source, scene):
        if scene.dt > 0.005:
            raise ParameterError('publish period must be a multiple of dt')
        self.world, self.paused = str(find_file(source, Path()).resolve()), True
        self.seconds = 0.0

    def unload_world(self):
        self.world, self.paused, self.waiting = '', True, standard.NO_WORLD

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


def stand_in(monkeypatch, messages, services):
    for name, module in (('messages', messages), ('services', services), ('actions', None)):
        monkeypatch.setattr(standard, name, module)


@pytest.fixture
def node(monkeypatch):
    messages = SimpleNamespace(
        SimulationState=State, Result=Result, SimulatorFeatures=Features, WorldResource=World
    )
    entities = ('GetEntityState', 'SetEntityState')  # which EntityServices serves
    stand_in(monkeypatch, messages, SimpleNamespace(**dict.fromkeys(NAMES + entities, Answer)))
    node = Node()
    sim_services.serve_simulation(node)
    return node


def test_services_have_the_names_of_the_standard_beside_our_own(node):
    standard = {'get_simulator_features', 'get_simulation_state', 'set_simulation_state',
                'reset_simulation', 'step_simulation', 'get_current_world', 'load_world',
                'unload_world', 'get_available_worlds'}  # fmt: skip
    assert set(node.services) == {f'~/{name}' for name in standard | {'reset', 'pause', 'step'}}


def test_without_the_package_only_our_own_are_served(monkeypatch):
    stand_in(monkeypatch, None, None)
    node = Node()
    sim_services.serve_simulation(node)
    assert set(node.services) == {'~/reset', '~/pause', '~/step'}


def test_features_are_those_that_are_served(node):
    _, answer = node.call('get_simulator_features')
    assert answer.features.features == [10, 11, 20, 21, 22, 24, 25, 26, 31, 32, 40, 43, 44, 45]
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
    node.waiting, node.paused = 'compiling, 12 s so far', True
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


def load(node, uri='', text=''):
    resource = SimpleNamespace(uri=uri, resource_string=text)
    result, answer = node.call('load_world', world_resource=resource)
    return result, answer.result.error_message or answer.world


def test_a_world_is_loaded_by_name_and_by_file(node, tmp_path):
    file = tmp_path / 'my own.yaml'
    file.write_text('friction: {longitudinal: 0.2}')
    for uri, name in (
        ('lateral_undulation', 'lateral_undulation'),
        (str(file), 'my own'),
        (file.as_uri(), 'my own'),  # with %20
    ):
        node.set_state(State.STATE_PLAYING)
        node.seconds = 1.0
        result, world = load(node, uri)
        assert (result, world.name) == (Result.RESULT_OK, name)
        assert world.world_resource.uri == Path(node.world).as_uri()
        assert node.state() == State.STATE_STOPPED
        assert node.call('get_current_world')[1].world == world


def test_what_is_no_world_is_refused_and_nothing_changes(node, tmp_path):
    wrong, slow = tmp_path / 'wrong.yaml', tmp_path / 'slow.yaml'
    wrong.write_text('frictoin: 1')
    slow.write_text('dt: 0.01')
    for uri, code, said in (
        ('', Answer.NO_RESOURCE, 'uri must be a scene'),
        ('latral_undulation', Result.RESULT_NOT_FOUND, "did you mean 'lateral_undulation'?"),
        ('http://a/b.yaml', Answer.UNSUPPORTED_FORMAT, "got 'http://a/b.yaml'"),
        ('house.sdf', Answer.UNSUPPORTED_FORMAT, "got 'house.sdf'"),
        (str(wrong), Answer.RESOURCE_PARSE_ERROR, 'frictoin'),
        (str(slow), Result.RESULT_OPERATION_FAILED, 'a multiple of dt'),
    ):
        result, sentence = load(node, uri)
        assert result == code and said in sentence
    assert load(node, text='dt: 0.001')[0] == Answer.UNSUPPORTED_FORMAT
    node.between = lambda: None  # the steps of a goal
    for result, sentence in (load(node, 'sidewinding'), unload(node)):
        assert result == Result.RESULT_OPERATION_FAILED and 'cancel the goal' in sentence
    assert (node.world, node.paused) == ('sidewinding', False)


def available(node, *sources, keep_on=False):
    request = {'additional_sources': sources, 'filter': SimpleNamespace(tags=[])}
    answer = SimpleNamespace(result=SimpleNamespace(), worlds=[])
    request = SimpleNamespace(**request, continue_on_error=keep_on)
    node.services['~/get_available_worlds'](request, answer)
    names = [world.name for world in answer.worlds]
    return answer.result.result, answer.result.error_message, names


def test_scenes_in_folders_and_files_are_available_too(node, tmp_path, monkeypatch):
    result, _, of_package = available(node)
    assert result == Result.RESULT_OK and 'sidewinding' in of_package
    for name, text in (
        ('second.yaml', 'friction: {longitudinal: 0.2}'),
        ('first.yml', 'start: {height: 1.0}\ngait: {name: rolling}'),
        ('robot.yaml', 'link_count: 3'),
        ('broken.yaml', 'dt: ['),
        ('notes.txt', 'dt: 0.001'),
    ):
        (tmp_path / name).write_text(text)
    found = available(node, tmp_path.as_uri(), str(tmp_path / 'second.yaml'))
    assert found == (Result.RESULT_OK, '', [*of_package, 'first', 'second', 'second'])
    monkeypatch.chdir(tmp_path)
    sources = ['notes.txt', 'http://a', 300 * 'a']
    lacks = '; '.join(f'no scenes in {quoted(cut(source))}' for source in sources)
    assert available(node, *sources) == (Result.RESULT_NOT_FOUND, lacks, [])
    assert available(node, *sources, keep_on=True) == (Result.RESULT_OK, lacks, of_package)


def unload(node):
    result, answer = node.call('unload_world')
    return result, answer.result.error_message


def test_without_a_world_all_is_refused_until_one_is_loaded(node):
    assert unload(node) == (Result.RESULT_OK, '')
    assert node.state() == State.STATE_NO_WORLD
    assert unload(node)[0] == Answer.NO_WORLD_LOADED
    assert node.call('get_current_world')[0] == Answer.NO_WORLD_LOADED
    for wanted in (State.STATE_PLAYING, State.STATE_PAUSED, State.STATE_STOPPED):
        assert node.set_state(wanted)[0] == Answer.STATE_TRANSITION_ERROR
    assert node.call('step_simulation', steps=1)[0] == Result.RESULT_OPERATION_FAILED
    assert node.reset_scope(Reset.SCOPE_ALL) == Result.RESULT_OPERATION_FAILED
    answer = node.services['~/pause'](SimpleNamespace(data=False), SimpleNamespace(success=False))
    assert not answer.success and answer.message == standard.NO_WORLD
    assert not node.told
    node.waiting = ''
    assert load(node, 'sidewinding')[0] == Result.RESULT_OK
    assert node.state() == State.STATE_STOPPED


def entity_state(position=(0.0, 0.0, 0.0), turned=(0.0, 0.0, 0.0, 1.0), speed=0.0, frame=''):
    """Return what has the fields of an EntityState."""
    state = SimpleNamespace(
        header=Header(frame_id=frame), pose=Pose(), twist=Twist(), acceleration=Accel()
    )
    state.pose.position = Point(**dict(zip('xyz', position, strict=True)))
    state.pose.orientation = Quaternion(**dict(zip('xyzw', turned, strict=True)))
    state.twist.linear.x = speed
    return state


class Entities:
    """The services of entities of a simulation, and how often the robot was put elsewhere."""

    def __init__(self, scene):
        self.simulation, self.services, self.moved = Simulation(scene), {}, 0
        handling = SimpleNamespace(placing=Placing(self.simulation, self.count))
        robot = SimpleNamespace(
            simulation=self.simulation,
            handling=handling,
            scene=self.simulation.scene,
            nanoseconds=0,
        )
        self.node = SimpleNamespace(
            world='it is there',
            robots={'snake_robot': robot},
            create_service=lambda kind, name, callback: self.services.update({name: callback}),
        )
        serve_entities(self.node, self.node.robots, Spawning(self.node))

    def count(self):
        self.moved += 1

    def get(self, entity):
        answer = SimpleNamespace(result=SimpleNamespace(), state=entity_state())
        return self.services['~/get_entity_state'](SimpleNamespace(entity=entity), answer)

    def set(self, entity, state, *, pose=True, twist=False, acceleration=False):
        answer = SimpleNamespace(result=SimpleNamespace())
        request = SimpleNamespace(
            entity=entity,
            state=state,
            set_pose=pose,
            set_twist=twist,
            set_acceleration=acceleration,
        )
        result = self.services['~/set_entity_state'](request, answer).result
        return result.result, result.error_message


@pytest.fixture
def entities(monkeypatch):
    kinds = SimpleNamespace(GetEntityState=Answer, SetEntityState=Answer)
    stand_in(monkeypatch, SimpleNamespace(Result=Result), kinds)
    return Entities(Scene())


@pytest.fixture
def undulating(entities):
    return Entities('lateral_undulation')


def test_without_a_world_there_are_no_entities(entities):
    entities.node.world = ''
    answer = entities.get('snake_robot').result
    assert answer.result == Result.RESULT_OPERATION_FAILED
    assert answer.error_message == 'no world is loaded: call ~/load_world first'


def test_an_older_package_has_no_services_of_entities(monkeypatch):
    stand_in(monkeypatch, SimpleNamespace(Result=Result), SimpleNamespace())
    assert not Entities(Scene()).services
    stand_in(monkeypatch, None, None)
    assert not Entities(Scene()).services


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
        ('snake_robot', entity_state(), Result.RESULT_OPERATION_FAILED, 'inside the floor'),
        ('snake_robot', entity_state(frame='map'), Result.RESULT_OPERATION_FAILED, "got 'map'"),
    ):
        result, message = entities.set(entity, state)
        assert result == code
        assert said in message
    assert entities.simulation.state is before
    assert not entities.moved


def test_only_what_is_flagged_is_set(entities):
    simulation = entities.simulation
    before = simulation.state
    # Neither flag: nothing happens, not even to what could not be set.
    lost = entity_state((9.0, 9.0, -5.0), (0.0, 0.0, 0.0, 3.0), speed=1e9)
    assert entities.set('snake_robot', lost, pose=False) == (Result.RESULT_OK, '')
    assert simulation.state is before and not entities.moved
    # A twist alone moves the robot as a rigid body, and does not teleport it.
    moving = entity_state((9.0, 9.0, -5.0), speed=0.5)
    moving.twist.angular.z = 2.0
    assert entities.set('snake_robot', moving, pose=False, twist=True) == (Result.RESULT_OK, '')
    state = simulation.state
    assert (state.q == before.q).all()
    arm = state.q[:, :2] - state.q[5, :2]
    assert state.u[:, 0] == pytest.approx(0.5 - 2.0 * arm[:, 1])
    assert state.u[:, 1] == pytest.approx(2.0 * arm[:, 0])
    twist = entities.get('snake_robot').state.twist
    assert (twist.linear.x, twist.angular.z) == pytest.approx((0.5, 2.0))
    # A pose alone leaves the twist in the world; the links turn with the robot.
    half = float(np.sqrt(0.5))
    turned = entity_state((1.0, 0.0, 0.0525), (0.0, 0.0, half, half), speed=-7.0)
    assert entities.set('snake_robot', turned) == (Result.RESULT_OK, '')
    twist = entities.get('snake_robot').state.twist
    assert (twist.linear.x, twist.linear.y) == pytest.approx((0.5, 0.0))
    assert twist.angular.z == pytest.approx(2.0)
    assert entities.moved == 2


def test_rates_of_joints_stay_when_a_twist_is_set(undulating):
    entities, simulation = undulating, undulating.simulation
    for _ in range(4):
        simulation.advance(*simulation.gait_reference(50))
    rates = simulation.joint_velocity
    assert np.abs(rates).max() > 0.05
    wanted = entity_state(speed=0.2)
    wanted.twist.linear.z, wanted.twist.angular.y = 0.3, -0.4
    assert entities.set('snake_robot', wanted, pose=False, twist=True) == (Result.RESULT_OK, '')
    assert simulation.joint_velocity == pytest.approx(rates, abs=1e-9)
    twist = entities.get('snake_robot').state.twist
    assert (twist.linear.x, twist.linear.z) == pytest.approx((0.2, 0.3))
    assert twist.angular.y == pytest.approx(-0.4)


def test_twist_or_acceleration_that_cannot_be_set_changes_nothing(entities):
    before = entities.simulation.state
    there = (1.0, 2.0, 0.0525)
    fast = entity_state(there, speed=1e3)
    result, message = entities.set('snake_robot', fast, twist=True)
    assert result == Result.RESULT_OPERATION_FAILED and 'at most 100 m/s' in message
    endless = entity_state(there, speed=float('nan'))
    assert 'linear velocity must be finite' in entities.set('snake_robot', endless, twist=True)[1]
    pushed = entity_state(there)
    pushed.acceleration.linear.x = 1.0
    result, message = entities.set('snake_robot', pushed, acceleration=True)
    assert result == Result.RESULT_FEATURE_UNSUPPORTED and '~/push' in message
    assert entities.simulation.state is before and not entities.moved
    # Without its flag it does not matter.
    assert entities.set('snake_robot', pushed) == (Result.RESULT_OK, '')


def test_robot_in_the_plane_takes_a_twist_in_the_plane(undulating):
    entities, simulation = undulating, undulating.simulation
    simulation.change(replace(simulation.scene, level='planar'))
    wanted = entity_state(speed=0.5)
    wanted.twist.angular.z = 1.0
    assert entities.set('snake_robot', wanted, pose=False, twist=True) == (Result.RESULT_OK, '')
    start = simulation.state.q[5, 0]
    simulation.advance(*simulation.gait_reference(4))
    # Friction slows it by 1 mm/s a step at most.
    assert simulation.state.q[5, 0] - start == pytest.approx(4 * 0.5 / 4000, rel=0.02)
    before = simulation.state
    wanted.twist.linear.z = 0.3
    result, message = entities.set('snake_robot', wanted, pose=False, twist=True)
    assert result == Result.RESULT_OPERATION_FAILED
    assert 'level is planar, but then link 1 moves vertically' in message
    assert simulation.state.u == pytest.approx(before.u)


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
