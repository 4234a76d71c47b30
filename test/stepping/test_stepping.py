# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a stepper promises, whatever its method: untouched inputs, reports, refusals."""

from dataclasses import fields, replace
from itertools import product
from operator import attrgetter

import numpy as np
import pytest
from scenes import layout, same_bits

from snake_sim_ros import ParameterError, Report, Robot, Scene, Simulation, Solver, State
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import LEVELS, load_scene, PD_SCHEMES, with_settings
from snake_sim_ros.stepping import levels
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.bdf2.motion import Bdf2Memory
from snake_sim_ros.stepping.bdf2.step import IMPLICIT_SCHEMES
from snake_sim_ros.stepping.methods import empty_history, make_stepper, method_of, METHODS
from snake_sim_ros.stepping.planar import bdf2 as planar_bdf2
from snake_sim_ros.stepping.planar.model import PlanarMemory
from snake_sim_ros.stepping.state import copied, History, initial_state, named_arrays

each_method = pytest.mark.parametrize('method', METHODS)


def problem(method, steps, **solver):
    """Return a stepper and its arguments for the first steps of sidewinding."""
    scene = replace(load_scene('sidewinding'), method=method, solver=Solver(**solver))
    times = (np.arange(steps) + 0.5) * scene.dt
    reference = gait.reference(scene.gait, times, scene.robot.link_count - 1)
    return make_stepper(scene), (initial_state(scene), empty_history(scene), *reference)


def shared(one, other):
    """Return whether any arrays of two histories have memory in common."""
    pairs = product(named_arrays(one).values(), named_arrays(other).values())
    return any(np.shares_memory(*pair) for pair in pairs)


def loop_of(scene):
    """Return the loop of a stepper over its steps, and the types of what is bound to it."""
    loop = make_stepper(scene).loop
    return loop.func, (type(loop.first), *map(type, loop.first))


def test_a_scene_begins_at_rest():
    scene = Scene()
    state = initial_state(scene)
    assert state.q.shape == (11, 7)
    assert state.u.tolist() == [[0.0] * 6] * 11
    history = empty_history(scene)
    assert history.impulse.shape == history.velocity.shape == history.change.shape == (22, 5)
    assert history.settling.shape == (1,)
    assert not any(array.any() for array in named_arrays(history).values())
    assert history.memory.last_span() == 0.0
    assert same_bits(history, make_stepper(scene).empty_history())
    # A history of its own each time, even of one stepper.
    stepper = make_stepper(scene)
    assert not shared(stepper.empty_history(), stepper.empty_history())


def test_unknown_methods_are_refused():
    with pytest.raises(ParameterError) as caught:
        make_stepper(Scene(method='magic'))
    names = ', '.join(sorted(['auto', *METHODS]))
    assert str(caught.value) == f"unknown method 'magic'; choose from: {names}"


@pytest.mark.parametrize(
    ('dt', 'method'), [(1 / 4000, 'newton'), (1e-3, 'newton'), (2e-3, 'bdf2')]
)
def test_auto_takes_the_method_for_the_step(dt, method):
    scene = Scene(method='auto', dt=dt, level='spatial')
    assert method_of(scene) == method
    taken = loop_of(replace(scene, method='auto'))
    assert taken == loop_of(replace(scene, method=method))
    others = {*METHODS} - {method}
    assert all(taken != loop_of(replace(scene, method=name)) for name in others)


@pytest.mark.parametrize('level', LEVELS)
@pytest.mark.parametrize('scheme', PD_SCHEMES)
def test_a_method_of_second_order_refuses_explicit_joint_control(scheme, level):
    scene = Scene(method='bdf2', dt=2e-3, level=level, pd_scheme=scheme)
    if scheme in IMPLICIT_SCHEMES:
        assert make_stepper(scene).level in ('planar', 'spatial')
        return
    with pytest.raises(ParameterError) as caught:
        make_stepper(scene)
    assert str(caught.value) == (
        f'pd_scheme {scheme} is explicit, and method bdf2 takes the controller at the end of a '
        f'step; choose pd_scheme average or end, or method newton'
    )
    # What the choice of the method can do, and what a running scene is told.
    assert method_of(replace(scene, method='auto')) == 'newton'
    simulation = Simulation(replace(scene, pd_scheme='average'))
    with pytest.raises(ParameterError, match=f'pd_scheme {scheme} is explicit'):
        simulation.change(scene)


def test_both_implicit_schemes_are_one_law_of_second_order():
    # bdf2 has the controller at the end of a step, for `average`, too: the same bits.
    scene, ends = replace(load_scene('sidewinding'), method='bdf2', dt=2e-3, level='spatial'), []
    reference = np.full((2, scene.robot.link_count - 1, 2), 0.1)
    for scheme in IMPLICIT_SCHEMES:
        stepper = make_stepper(replace(scene, pd_scheme=scheme))
        ends.append(
            stepper.advance(initial_state(scene), empty_history(scene), reference, reference)
        )
    assert (ends[0][0].q == ends[1][0].q).all()
    assert (ends[0][2].joint_torque == ends[1][2].joint_torque).all()


def test_reports_add_up():
    first = Report(
        steps=2, iterations=30, iterations_max=20, unconverged=1, fallbacks=4, residual_max=1e-6,
        printed_residual_max=2e-6, penetration_max=2e-5, joint_gap_max=1e-9, joint_twist_max=4e-9,
        further_parts=4, contacts=22, overflows=1, joint_torque=np.ones((1, 2)),
    )  # fmt: skip
    later = Report(
        steps=3, iterations=12, iterations_max=5, unconverged=0, fallbacks=1, residual_max=3e-6,
        printed_residual_max=1e-6, penetration_max=1e-5, joint_gap_max=2e-9, joint_twist_max=1e-9,
        further_parts=2, contacts=20, overflows=2, joint_torque=np.zeros((1, 2)),
    )  # fmt: skip
    total = first + later
    # Counters are summed, largest values kept, contacts and torques are those of the last step.
    assert (total.steps, total.iterations, total.iterations_max) == (5, 42, 20)
    assert (total.unconverged, total.fallbacks, total.contacts) == (1, 5, 20)
    assert total.overflows == 3
    assert (total.further_parts, total.parts) == (6, 11)
    assert (total.residual_max, total.penetration_max) == (3e-6, 2e-5)
    assert total.printed_residual_max == 2e-6
    assert (total.joint_gap_max, total.joint_twist_max) == (2e-9, 4e-9)
    assert total.joint_torque is later.joint_torque
    largest = [field.name for field in fields(Report) if field.name.endswith('_max')]
    assert len(largest) == 6
    for name in largest:
        assert getattr(later + first, name) == getattr(total, name)


@pytest.mark.parametrize('level', ['spatial', 'planar'])
@pytest.mark.parametrize(('method', 'parts'), [('newton', 0), ('bdf2', 2)])
def test_parts_of_steps_are_counted(method, parts, level):
    # A bent robot lies still. From a given state bdf2 begins with a quarter of a step. Each part
    # may be twice as long as the one before, if it begins at a multiple of that: two quarters and
    # a half, then whole steps.
    values = {'robot.link_count': 3, 'method': method, 'level': level, 'dt': 1e-3}
    bent = {'start.yaw': 0.5, 'gait.yaw.amplitude': 0.0}
    simulation = Simulation(with_settings(load_scene('lateral_undulation'), values | bent))
    angle = np.tile([0.5, 0.0], (5, 2, 1))
    report = simulation.advance(angle)
    assert (report.steps, report.parts) == (5, 5 + parts)
    assert simulation.advance(angle).parts == 5


def test_status_is_the_worst():
    assert Report(steps=1).status is Status.CONVERGED
    unconverged, failed = Report(unconverged=1), Report(failure='it turned')
    assert unconverged.status is Status.MAX_ITERATIONS
    assert (unconverged + Report()).status is Status.MAX_ITERATIONS
    assert (unconverged + failed).status is Status.DIVERGED
    # The first failure is the cause.
    assert (failed + Report(failure='it turned again')).failure == 'it turned'


# ---- histories ----------------------------------------------------------------------------------

# What each method keeps of a step, at each level.
IN_PLANE = (PlanarMemory, None), (PlanarMemory, planar_bdf2.PlanarBdf2Memory)
MEMORIES = {
    **{(name, 'spatial'): None for name in METHODS},
    **{(name, 'planar'): IN_PLANE[0] for name in METHODS},
    **{(name, 'auto'): (levels.LevelMemory, IN_PLANE[0], None) for name in METHODS},
    ('bdf2', 'spatial'): Bdf2Memory,
    ('bdf2', 'planar'): IN_PLANE[1],
    ('bdf2', 'auto'): (levels.LevelMemory, IN_PLANE[1], Bdf2Memory),
}
each_memory = pytest.mark.parametrize(('method', 'level'), MEMORIES)


def memory_kind(memory):
    """Return the types of a memory as they are in MEMORIES."""
    if isinstance(memory, levels.LevelMemory):
        return levels.LevelMemory, memory_kind(memory.planar), memory_kind(memory.spatial)
    if isinstance(memory, PlanarMemory):
        return PlanarMemory, memory_kind(memory.scheme)
    return None if memory is None else type(memory)


def numbered(method, level):
    """Return a history of three links in which every number is another one."""
    history = make_stepper(scene_at(method, level)).empty_history()
    start = 1.0
    for array in named_arrays(history).values():
        array[:] = np.arange(start, start + array.size).reshape(array.shape)
        start += array.size
    return history


def scene_at(method, level):
    """Return a scene of three links that is planar and that any method can run."""
    return Scene(robot=Robot(link_count=3), method=method, level=level)


@each_memory
def test_a_method_keeps_at_a_level_what_it_keeps(method, level):
    history = make_stepper(scene_at(method, level)).empty_history()
    assert type(history) is History
    assert memory_kind(history.memory) == MEMORIES[method, level]
    assert history.memory is None or history.memory.last_span() == 0.0


@each_memory
def test_names_of_arrays_lead_to_them(method, level):
    history = numbered(method, level)
    arrays = named_arrays(history)
    assert [*arrays][:4] == [f'history.{name}' for name in History._fields[:4]]
    for name, array in arrays.items():
        assert attrgetter(name.removeprefix('history.'))(history) is array
    # All of them: as many as there are, none twice, none that overlaps another one.
    assert len(arrays) == count_of_arrays(history)
    values = np.concatenate([array.ravel() for array in arrays.values()])
    assert (values == np.arange(1.0, len(values) + 1.0)).all()
    renamed = named_arrays(history, 'other')
    assert [*renamed] == [name.replace('history', 'other', 1) for name in arrays]
    assert all(renamed[name.replace('history', 'other', 1)] is arrays[name] for name in arrays)
    assert named_arrays(history.impulse, 'impulse') == {'impulse': history.impulse}
    assert named_arrays(None) == {}


def count_of_arrays(record):
    """Return how many arrays a history has."""
    if isinstance(record, np.ndarray):
        return 1
    return 0 if record is None else sum(map(count_of_arrays, record))


@each_memory
def test_a_copy_is_the_same_and_shares_no_memory(method, level):
    history = numbered(method, level)
    kept = [array.copy() for array in named_arrays(history).values()]
    copy = copied(history)
    assert same_bits(copy, history)
    assert layout(copy) == layout(history)
    assert memory_kind(copy.memory) == MEMORIES[method, level]
    assert not shared(copy, history)
    for array in named_arrays(copy).values():
        array[:] = -1.0
    for array, values in zip(named_arrays(history).values(), kept, strict=True):
        assert (array == values).all()
    assert copied(None) is None


@each_method
def test_inputs_are_left_alone(method):
    stepper, (state, history, angle, rate) = problem(method, 2, iteration_limit=5)
    given = (state.q, state.u, *named_arrays(history).values(), angle, rate)
    copies = [array.copy() for array in given]
    end, end_history, _ = stepper.advance(state, history, angle, rate)
    for array, copy in zip(given, copies, strict=True):
        assert (array == copy).all()
    # Results do not share memory with inputs, nor with what the stepper returns next.
    assert not shared(history, end_history)
    made = (end.q, end.u, *named_arrays(end_history).values())
    kept = [array.copy() for array in made]
    _, last_history, _ = stepper.advance(end, end_history, angle, rate)
    assert not shared(end_history, last_history)
    for array, copy in zip(made, kept, strict=True):
        assert (array == copy).all()


@each_method
def test_a_stepper_has_no_memory(method):
    # The same step again, after another one: the same bits.
    stepper, arguments = problem(method, 2, iteration_limit=20)
    first = stepper.advance(*arguments)
    stepper.advance(first[0], first[1], arguments[2] + 0.01, arguments[3])
    again = stepper.advance(*arguments)
    assert (first[0].q == again[0].q).all()
    assert (first[0].u == again[0].u).all()
    assert same_bits(first[1], again[1])


@each_method
def test_no_references_are_no_steps(method):
    stepper, (state, history, angle, rate) = problem(method, 0)
    end, end_history, report = stepper.advance(state, history, angle, rate)
    assert (end.q == state.q).all()
    assert (end.u == state.u).all()
    assert same_bits(end_history, history)
    assert (report.steps, report.status) == (0, Status.CONVERGED)
    assert np.isfinite(report.joint_torque).all()


@each_method
def test_a_step_that_does_not_converge_says_so(method):
    stepper, arguments = problem(
        method, 2, iteration_limit=3, tolerance=1e-15, residual_tolerance=1e-300
    )
    _, _, report = stepper.advance(*arguments)
    # Two steps; the first of BDF2 has three parts.
    iterations = (12, 9) if method == 'bdf2' else (6, 3)
    assert (report.steps, report.iterations, report.iterations_max) == (2, *iterations)
    assert (report.unconverged, report.status) == (2, Status.MAX_ITERATIONS)
    assert report.residual_max > 0.0


@each_method
def test_a_step_that_diverges_says_so(method):
    stepper, (state, history, angle, rate) = problem(method, 3, iteration_limit=5)
    fast = State(state.q, state.u.copy())
    # 1e5 rad/s are 25 rad a step of 1/4000 s, which says nothing about where the link is.
    fast.u[:, 3] = 1e5
    end, _, report = stepper.advance(fast, history, angle, rate)
    assert report.status is Status.DIVERGED
    assert report.steps == 0
    assert report.failure.startswith('link 1 would turn by ')
    assert (end.q == fast.q).all()
    assert (end.u == fast.u).all()


@each_method
@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_a_state_that_is_not_finite_says_so(method, bad):
    stepper, (state, history, angle, rate) = problem(method, 1, iteration_limit=5)
    state.u[4, 2] = bad
    with np.errstate(invalid='ignore'):
        _, _, report = stepper.advance(state, history, angle, rate)
    assert report.status is Status.DIVERGED
