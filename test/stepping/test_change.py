# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Scenes that change while they run: other obstacles, other methods, other levels.

Contacts have numbers that depend on the scene, and methods keep in `history` what they remember,
each in its own way. Without the compiler a number that is out of range is an error:
test_without_compiler.py runs these tests so.
"""

from dataclasses import replace
from itertools import pairwise, permutations, product
import re

import numpy as np
from obstacle_scenes import anywhere
import pytest
from scenes import isotropic, layout, same_bits

from snake_sim_ros import Ground, ParameterError, Pegs, Robot, Scene, Simulation, Solver, State
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.parameters import LEVELS
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS
from snake_sim_ros.stepping.state import carried, copied, initial_state, named_arrays
from snake_sim_ros.stepping.steps import make_steps

# Nothing of it is in reach of a robot that lies at the origin. The first peg of the one scene is
# the second of the other.
PEGS = Pegs(x=(0.0, 0.3), y=(0.4, -0.4), radius=(0.05, 0.02))
OTHER_PEGS = Pegs(x=(0.5, 0.0, 0.6), y=(0.5, 0.4, 0.6), radius=0.05)
GROUND = Ground(heights=((0.0, 0.1), (0.05, 0.0)), cell=0.2, origin=(0.4, 0.4))
OBSTACLES = {
    'flat': {},
    'pegs': {'pegs': PEGS},
    'other pegs': {'pegs': OTHER_PEGS},
    'ground': {'ground': GROUND},
    'self-contact': {'self_contact': True},
    'both': {'pegs': PEGS, 'self_contact': True},
}
ALL_PAIRS = [pair for pair in product(OBSTACLES, repeat=2) if pair[0] != pair[1]]
ROBOT = Robot(link_count=3)
SOLVER = Solver(iteration_limit=300)
DT = 1 / 400
V = np.array([0.1, 0.05, 0.0])  # m/s


def scene_of(name, **settings):
    """Return a robot on a floor without friction, beside some obstacles."""
    given = {'robot': ROBOT, 'solver': SOLVER, 'friction': isotropic(0.0), 'dt': DT}
    return Scene(**given, **OBSTACLES[name], **settings)


def closed_walk(places):
    """Return a walk over all ordered pairs of different places, from the first one and back."""
    walk, left = [places[0]], {pair for pair in product(places, repeat=2) if pair[0] != pair[1]}

    def go(here):
        if not left:
            return True
        for there in places:
            if (here, there) in left:
                left.remove((here, there))
                walk.append(there)
                if go(there):
                    return True
                walk.pop()
                left.add((here, there))
        return False

    assert go(places[0])
    assert {*pairwise(walk)} == {pair for pair in product(places, repeat=2) if pair[0] != pair[1]}
    return walk


# ---- which contacts are the same ----------------------------------------------------------------


@pytest.mark.parametrize(('one', 'two'), [*ALL_PAIRS, *((name, name) for name in OBSTACLES)])
def test_the_same_contacts_are_at_the_same_places(one, two):
    before, after = scene_of(one), scene_of(two)
    old, new = obstacles.same_contacts(before, after)
    assert len({*old.tolist()}) == len(old) and len({*new.tolist()}) == len(new)
    rng, apart = np.random.default_rng(1), ([], [])
    for _ in range(3):
        q = anywhere(rng, 3).q
        q[:, 2] += 2.0  # above all cells
        for scene, places in zip((before, after), apart, strict=True):
            gap, lever, frame = obstacles.contact_geometry(scene, q)
            count = len(gap)
            # On floors of other heights a sphere has another gap, and is the same contact.
            gap[: 2 * ROBOT.link_count] = 0.0
            places.append(np.column_stack([gap, lever, frame.reshape(count, 9)]))
    first, second = (np.hstack(places) for places in apart)
    assert np.array_equal(first[old], second[new])
    # And there are no others, but those that no pose here opens: cells that are not higher.
    rows = {row.tobytes() for row in first if np.isfinite(row).all()}
    common = sum(row.tobytes() in rows for row in second)
    assert common == np.isfinite(second[new]).all(axis=1).sum()


def test_contacts_are_counted():
    # 2 spheres a link; 6 more slots with cells; a slot a peg; 5 contacts of links 1 and 3.
    counts = [len(obstacles.contact_keys(scene_of(name))) for name in OBSTACLES]
    assert counts == [6, 12, 15, 24, 11, 17]
    assert counts == [obstacles.contact_count(scene_of(name)) for name in OBSTACLES]
    shared = [
        len(obstacles.same_contacts(scene_of(one), scene_of(two))[0])
        for one, two in (('pegs', 'other pegs'), ('pegs', 'both'), ('ground', 'both'))
    ]
    assert shared == [9, 12, 6]


def test_cells_of_another_ground_are_others():
    scene = scene_of('ground')
    other = replace(scene, ground=replace(GROUND, origin=(0.3, 0.4)))
    old, new = obstacles.same_contacts(scene, other)
    assert old.tolist() == new.tolist() == list(range(6))


def test_pegs_at_one_place_are_told_apart():
    twice = replace(scene_of('flat'), pegs=Pegs(x=(1.0, 1.0), y=(1.0, 1.0)))
    once = replace(twice, pegs=Pegs(x=(1.0,), y=(1.0,)))
    assert len({*obstacles.contact_keys(twice)}) == obstacles.contact_count(twice) == 12
    assert len(obstacles.same_contacts(twice, once)[0]) == 9


@pytest.mark.parametrize(('one', 'two'), ALL_PAIRS)
def test_what_is_known_of_contacts_is_carried_over_and_nothing_else(one, two):
    before, after = scene_of(one), scene_of(two)
    history, rng = empty_history(before), np.random.default_rng(2)
    for array in named_arrays(history).values():
        array[:] = rng.uniform(0.5, 1.0, array.shape)
    kept, empty = copied(history), empty_history(after)
    taken = carried(history, before, after, 1.5, empty)
    assert same_bits(history, kept)
    assert same_bits(empty, empty_history(after))  # nothing was written to it
    assert layout(taken) == layout(empty)
    old, new = obstacles.same_contacts(before, after)
    assert (taken.impulse[new] == 1.5 * history.impulse[old]).all()
    assert (taken.velocity[new] == history.velocity[old]).all()
    assert (taken.change[new] == np.array([1.5, 1, 1, 1, 1]) * history.change[old]).all()
    assert (taken.settling == history.settling).all()
    taken.impulse[new] = taken.velocity[new] = taken.change[new] = taken.settling[:] = 0.0
    assert same_bits(taken.control, history.control)  # both have the same robot
    taken = taken._replace(control=empty.control)
    assert not any(array.any() for array in named_arrays(taken).values())


# ---- a run goes on ------------------------------------------------------------------------------


def check_walk(scenes):
    """Check that a robot slides on over a floor without friction, two steps in every scene."""
    simulation = Simulation(scenes[0])
    still = np.zeros((2, ROBOT.link_count - 1, 2))
    start = simulation.state
    simulation.state = State(start.q, np.tile([*V, 0.0, 0.0, 0.0], (ROBOT.link_count, 1)))
    weight = 9.81 * ROBOT.per_link('link_mass').sum()
    for scene in scenes:
        before, state = simulation.scene, simulation.state
        _, forces = contact_forces(before, state, simulation.history)
        simulation.change(scene)
        assert simulation.state is state
        assert layout(simulation.history) == layout(empty_history(scene))
        # What carried load still does, whatever the time for which impulses are kept.
        _, same_forces = contact_forces(scene, state, simulation.history)
        assert len(same_forces) == len(forces)
        assert np.abs(same_forces - forces).max(initial=0.0) < 1e-14 * weight
        report = simulation.advance(still, still)
        assert not report.failure and not report.unconverged
        # No force along the floor: it slides on as it did, but for what is left of velocities in
        # every step. The floor gives way by the selection rule: at 1e-4 of what gravity makes in
        # a step, twice that if the rule takes the loads of a step of 2/3 dt.
        bound = 1e-12 + simulation.report.residual_max * simulation.step_count
        assert np.abs(simulation.state.u[:, :2] - V[:2]).max() < bound
        assert np.abs(simulation.state.u[:, 2]).max() < 2e-4 * 9.81 * DT + bound
        way = simulation.state.q[:, :3] - start.q[:, :3]
        assert np.abs(way[:, :2] - V[:2] * simulation.time).max() < bound * simulation.time
        # The floor carries the weight, but for the momentum of these velocities.
        _, forces = contact_forces(scene, simulation.state, simulation.history)
        assert len(forces) == 2 * ROBOT.link_count
        assert abs(forces[:, 2].sum() - weight) < 4e-4 * weight
    return simulation


@pytest.mark.parametrize('level', ['auto', 'spatial'])
@pytest.mark.parametrize('method', METHODS)
def test_a_run_goes_on_with_other_obstacles(method, level):
    walk = closed_walk(list(OBSTACLES))
    check_walk([scene_of(name, method=method, level=level) for name in walk])


@pytest.mark.parametrize(
    ('name', 'level'), [*(('flat', level) for level in LEVELS), ('both', 'spatial')]
)
def test_a_run_goes_on_with_another_method(name, level):
    walk = closed_walk(['auto', *METHODS])
    check_walk([scene_of(name, method=method, level=level) for method in walk])


@pytest.mark.parametrize('method', METHODS)
def test_a_run_goes_on_at_another_level(method):
    walk = closed_walk(list(LEVELS))
    check_walk([scene_of('flat', method=method, level=level) for level in 2 * walk])


def test_a_run_goes_on_under_another_gravity():
    # `auto` is planar on a level floor and spatial on a slope, where bdf2 keeps other numbers.
    # In 10 steps down it gets g_x T of velocity: a constant force is exact but for residuals.
    simulation = Simulation(scene_of('flat', method='bdf2'))
    still = np.zeros((10, ROBOT.link_count - 1, 2))
    simulation.advance(still, still)
    assert simulation.last.planar_steps == 10
    simulation.change(replace(simulation.scene, gravity=(0.5, 0.0, -9.8)))
    simulation.advance(still, still)
    assert simulation.last.level == 'spatial'
    assert np.abs(simulation.state.u[:, 0] - 0.5 * 10 * DT).max() < 1e-8
    # The floor carries the weight, as in check_walk.
    _, forces = contact_forces(simulation.scene, simulation.state, simulation.history)
    weight = 9.8 * ROBOT.per_link('link_mass').sum()
    assert abs(forces[:, 2].sum() - weight) < 4e-4 * weight


# ---- what does not fit --------------------------------------------------------------------------


# What a stepper is given, by its place, and what it says.
BAD = {
    **{
        f'{name} of another scene': (
            f'history.{name}',
            np.zeros((5, 5)),
            rf'history\.{name} must be an array of shape \(6, 5\) of float64, '
            r'got shape \(5, 5\)',
        )
        for name in ('impulse', 'velocity', 'change')
    },
    **{
        f'{name} in integers': (
            f'history.{name}',
            np.zeros((6, 5), int),
            rf'history\.{name} must be an array of shape \(6, 5\) of float64, '
            r'got shape \(6, 5\) of int64',
        )
        for name in ('impulse', 'velocity', 'change')
    },
    'impulses without their components': (
        'history.impulse',
        np.zeros(6),
        r'history\.impulse must be an array of shape \(6, 5\) of float64, got shape \(6,\)',
    ),
    'a list of impulses': (
        'history.impulse',
        [[0.0] * 5] * 6,
        r'history\.impulse must be an array of shape \(6, 5\) of float64, got list',
    ),
    'a number that settles': (
        'history.settling',
        0.0,
        r'history\.settling must be an array of shape \(1,\) of float64, got float',
    ),
    'a settling of two': (
        'history.settling',
        np.zeros(2),
        r'history\.settling must be an array of shape \(1,\) of float64, got shape \(2,\)',
    ),
    'a history in one array': (
        'history',
        np.zeros((7, 6, 5)),
        'history must be a History, got ndarray',
    ),
    'a history without names': (
        'history',
        (*np.zeros((3, 6, 5)), np.zeros(1), None),
        'history must be a History, got tuple',
    ),
    'no history': ('history', None, 'history must be a History, got NoneType'),
    'a state of another robot': (
        'state',
        State(np.zeros((4, 7)), np.zeros((4, 6))),
        r'state\.q must be an array of shape \(3, 7\) of float64, got shape \(4, 7\)',
    ),
    'velocities of another robot': (
        'u',
        np.zeros((4, 6)),
        r'state\.u must be an array of shape \(3, 6\) of float64, got shape \(4, 6\)',
    ),
    'angles of another robot': (
        'angle',
        np.zeros((2, 3, 2)),
        r'angle must be an array of shape \(\d, 2, 2\) of float64, got shape \(\d, 3, 2\)',
    ),
    'fewer rates than angles': (
        'rate',
        np.zeros((1, 2, 2)),
        r'rate must be an array of shape \(2, 2, 2\) of float64, got shape \(1, 2, 2\)',
    ),
    'a list of rates': (
        'rate',
        [[[0.0, 0.0]] * 2] * 2,
        r'rate must be an array of shape \(2, 2, 2\) of float64, got list',
    ),
}


def with_part(record, name, part):
    """Return a history with a part, of a dotted name, in place of its own."""
    first, _, rest = name.partition('.')
    return record._replace(
        **{first: with_part(getattr(record, first), rest, part) if rest else part}
    )


@pytest.mark.parametrize('bad', BAD)
@pytest.mark.parametrize('level', ['spatial', 'planar', 'auto'])
@pytest.mark.parametrize('method', METHODS)
def test_arrays_that_do_not_fit_are_refused(method, level, bad):
    scene = scene_of('flat', method=method, level=level)
    state, still = initial_state(scene), np.zeros((2, 2, 2))
    given = {'state': state, 'history': empty_history(scene), 'angle': still, 'rate': still}
    name, part, sentence = BAD[bad]
    if name == 'u':
        given['state'] = State(state.q, part)
    elif name.startswith('history.'):
        given['history'] = with_part(given['history'], name.removeprefix('history.'), part)
    else:
        given[name] = part
    with pytest.raises(ParameterError, match=sentence):
        make_stepper(scene).advance(**given)


@pytest.mark.parametrize('level', LEVELS)
@pytest.mark.parametrize('method', METHODS)
def test_memories_that_do_not_fit_are_refused(method, level):
    # Each array of it, at any depth.
    scene, still = scene_of('flat', method=method, level=level), np.zeros((2, 2, 2))
    state, stepper = initial_state(scene), make_stepper(scene)
    for name, array in named_arrays(empty_history(scene).memory, 'memory').items():
        for part, said in (
            (np.zeros((*array.shape, 1)), f'shape {(*array.shape, 1)} of float64'),
            (np.zeros((*array.shape[:-1], array.shape[-1] + 1)), ' of float64'),
            (array.astype(np.float32), f'shape {array.shape} of float32'),
            (array.tolist(), 'list'),
            (None, 'NoneType'),
        ):
            history = with_part(empty_history(scene), name, part)
            sentence = f'history.{name} must be an array of shape {array.shape} of float64, got '
            match = rf'^{re.escape(sentence)}.*{re.escape(said)}$'
            with pytest.raises(ParameterError, match=match):
                stepper.advance(state, history, still, still)


# Histories by what methods keep in them, with a word for it; see `state.check_history`.
KINDS = {
    'None': ('newton', 'spatial'),
    'Bdf2Memory': ('bdf2', 'spatial'),
    'PlanarMemory': ('newton', 'planar'),
    'PlanarMemory with PlanarBdf2Memory': ('bdf2', 'planar'),
    'LevelMemory': ('newton', 'auto'),
    'LevelMemory with Bdf2Memory': ('bdf2', 'auto'),
}


@pytest.mark.parametrize(('wanted', 'given'), [*permutations(KINDS, 2)])
def test_the_memory_of_another_method_or_level_is_refused(wanted, given):
    scene, other = (
        scene_of('flat', method=method, level=level)
        for method, level in (KINDS[wanted], KINDS[given])
    )
    still = np.zeros((2, 2, 2))
    state, history, _ = make_stepper(other).advance(
        initial_state(other), empty_history(other), still, still
    )
    kept, stepper = copied(history), make_stepper(scene)
    (outer, _, inner), (other_outer, _, other_inner) = (
        kind.partition(' with ') for kind in (wanted, given)
    )
    place, one, two = 'history.memory', outer, other_outer
    if outer == other_outer:  # what differs is what the method keeps in it
        place += '.scheme' if outer.startswith('Planar') else '.planar.scheme'
        one, two = ('PlanarBdf2Memory' if part else 'None' for part in (inner, other_inner))
    with pytest.raises(ParameterError) as caught:
        stepper.advance(state, history, still, still)
    assert str(caught.value) == (
        f'{place} must be that of this method and level, {one}, got {two}; begin with '
        f'empty_history() of the stepper, or see carried'
    )
    # Nothing was done; what is known of contacts goes on with an empty memory.
    assert same_bits(history, kept)
    report = stepper.advance(
        state, history._replace(memory=stepper.empty_history().memory), still, still
    )[2]
    assert (report.steps, report.status) == (2, Status.CONVERGED)


@pytest.mark.parametrize('level', LEVELS)
def test_the_memory_of_something_else_is_refused(level):
    scene, still = scene_of('flat', method='newton', level=level), np.zeros((2, 2, 2))
    for memory in ({}, 'nothing', np.zeros(3), (np.zeros(1),)):
        history = empty_history(scene)._replace(memory=memory)
        with pytest.raises(ParameterError, match=r'^history\.memory must be that of this method'):
            make_stepper(scene).advance(initial_state(scene), history, still, still)


@pytest.mark.parametrize('level', ['auto', 'spatial'])
@pytest.mark.parametrize('name', ['flat', 'ground'])
@pytest.mark.parametrize('method', METHODS)
def test_places_and_impulses_that_are_not_finite_are_refused(method, name, level):
    # Nothing would have a gap to them, and a step without contacts would seem to converge.
    scene, still = scene_of(name, method=method, level=level), np.zeros((1, 2, 2))
    stepper = make_stepper(scene)
    for bad in (np.nan, np.inf):
        state, history = initial_state(scene), empty_history(scene)
        state.q[1, 0] = bad
        said = rf'^state\.q must be finite, got {bad} at \[1, 0\]$'
        with pytest.raises(ParameterError, match=said):
            stepper.advance(state, history, still, still)
        history.impulse[3, 0] = bad
        said = rf'^history\.impulse must be finite, got {bad} at \[3, 0\]$'
        with pytest.raises(ParameterError, match=said):
            stepper.advance(initial_state(scene), history, still, still)


@pytest.mark.parametrize('level', LEVELS)
@pytest.mark.parametrize('method', METHODS)
def test_nothing_of_a_history_may_be_other_than_finite(method, level):
    scene, still = scene_of('flat', method=method, level=level), np.zeros((1, 2, 2))
    stepper, state = make_stepper(scene), initial_state(scene)
    for name, numbers in named_arrays(stepper.empty_history()).items():
        if numbers.size == 0:  # of a control loop that the scene does not have
            continue
        for bad in (np.nan, np.inf, -np.inf):
            history = stepper.empty_history()
            array = named_arrays(history)[name]
            array.flat[-1] = bad
            place = [length - 1 for length in array.shape]
            with pytest.raises(ParameterError) as caught:
                stepper.advance(state, history, still, still)
            assert str(caught.value) == f'{name} must be finite, got {bad} at {place}'


@pytest.mark.parametrize('level', ['auto', 'spatial'])
@pytest.mark.parametrize('method', METHODS)
def test_references_that_are_not_finite_say_so(method, level):
    scene, angle = scene_of('flat', method=method, level=level), np.zeros((1, 2, 2))
    angle[0, 1, 0] = np.nan
    start = initial_state(scene)
    with np.errstate(all='ignore'):
        end, _, report = make_stepper(scene).advance(
            start, empty_history(scene), angle, np.zeros((1, 2, 2))
        )
    assert report.status is Status.DIVERGED
    assert (end.q == start.q).all()


def test_forces_are_those_of_the_scene_of_the_history():
    simulation, still = Simulation(scene_of('pegs')), np.zeros((1, 2, 2))
    simulation.advance(still, still)
    with pytest.raises(
        ParameterError, match=r'history\.impulse must be an array of shape \(24, 5\)'
    ):
        contact_forces(scene_of('ground'), simulation.state, simulation.history)


def test_a_change_that_is_refused_changes_nothing():
    scene = scene_of('pegs', level='spatial')
    simulation, still = Simulation(scene), np.zeros((2, 2, 2))
    simulation.advance(still, still)
    kept = simulation.stepper, simulation.scene, simulation.history
    for other, sentence in (
        (replace(scene_of('both'), level='planar'), 'level planar: self_contact is true'),
        (replace(scene, robot=replace(ROBOT, link_count=4)), r'robot\.link_count cannot change'),
        (replace(scene, dt=1e-3), 'dt cannot change while a scene runs: 0.0025 to 0.001'),
        (replace(scene, method='magic'), "unknown method 'magic'"),
    ):
        with pytest.raises(ParameterError, match=sentence):
            simulation.change(other)
        assert (simulation.stepper, simulation.scene) == kept[:2]
        assert simulation.history is kept[2]


def test_a_reset_after_a_change_is_that_of_the_new_scene():
    simulation, still = Simulation(scene_of('pegs')), np.zeros((2, 2, 2))
    simulation.change(scene_of('both'))
    simulation.reset()
    assert same_bits(simulation.history, empty_history(scene_of('both')))
    assert not simulation.advance(still, still).failure


@pytest.mark.parametrize('method', METHODS)
def test_an_index_beyond_an_array_is_an_error(method):
    # Nobody looks at indices in compiled code. Here NumPy does, in all runs above.
    scene = scene_of('ground', method=method, level='spatial')
    stepper, state, still = make_stepper(scene), initial_state(scene), np.zeros((1, 2, 2))
    whole, few = stepper.empty_history(), np.zeros((3, 2, 5))  # the scene has more contacts
    history = whole._replace(impulse=few[0], velocity=few[1], change=few[2])
    steps = (state.q.copy(), state.u.copy()), history, (still, still)
    with pytest.raises(IndexError):
        stepper.loop(
            stepper.model,
            stepper.work,
            make_steps(*steps, stepper.record_of(stepper.no_samples)),
        )
