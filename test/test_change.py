"""
Scenes that change while they run: other obstacles, other methods, other levels.

Contacts have numbers that depend on the scene, and methods keep in `history` what they remember,
each in its own way. Without the compiler a number that is out of range is an error, with it only
if the compiler is told to look: test_architecture.py runs these tests without it, and this file as
a program with it.
"""

from dataclasses import replace
from itertools import pairwise
from itertools import product

import numpy as np
from obstacle_scenes import anywhere
import pytest
from scenes import isotropic

from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Ground
from snake_sim_ros.scene.parameters import LEVELS
from snake_sim_ros.scene.parameters import Pegs
from snake_sim_ros.scene.parameters import Robot
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import Solver
from snake_sim_ros.stepping.base import PREVIOUS
from snake_sim_ros.stepping.base import SETTLING
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.methods import empty_history
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.report import REPORT_SIZE
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import carried
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.state import State

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
    # 2 spheres a link; 6 more slots with cells; a slot a peg; 4 contacts of links 1 and 3.
    counts = [len(obstacles.contact_keys(scene_of(name))) for name in OBSTACLES]
    assert counts == [6, 12, 15, 24, 10, 16]
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
    history = np.random.default_rng(2).uniform(0.5, 1.0, empty_history(before).shape)
    kept = history.copy()
    taken = carried(history, before, after, 1.5)
    assert (history == kept).all()
    assert taken.shape == empty_history(after).shape
    old, new = obstacles.same_contacts(before, after)
    scale = np.ones((PREVIOUS, 1, 5))
    scale.impulse = 1.5
    scale.change[:, 0] = 1.5
    assert (taken[:PREVIOUS, new] == scale * history[:PREVIOUS, old]).all()
    assert taken[SETTLING] == history[SETTLING]
    rest = taken.copy()
    rest[:PREVIOUS, new] = rest[SETTLING] = 0.0
    assert not rest.any()


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
        assert simulation.history.shape == empty_history(scene).shape
        # What carried load still does, whatever the time for which impulses are kept.
        _, same_forces = contact_forces(scene, state, simulation.history)
        assert len(same_forces) == len(forces)
        assert np.abs(same_forces - forces).max(initial=0.0) < 1e-14 * weight
        report = simulation.advance(still, still)
        # Gauss-Seidel stops at its limit of sweeps in the first steps of any run on a floor that
        # holds the robot in more ways than it needs.
        assert not report.failure and (not report.unconverged or scene.method == 'gauss_seidel')
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


BAD = {
    'a history of another scene': (
        {'history': np.zeros((7, 5, 5))},
        r'history must be an array of shape \(7, 6, 5\) of float64, got shape \(7, 5, 5\)',
    ),
    'a history of integers': (
        {'history': np.zeros((7, 6, 5), int)},
        r'history must be an array of shape \(7, 6, 5\) of float64, got shape .* of int64',
    ),
    'a state of another robot': (
        {'state': State(np.zeros((4, 7)), np.zeros((4, 6)))},
        r'state\.q must be an array of shape \(3, 7\) of float64, got shape \(4, 7\)',
    ),
    'velocities of another robot': (
        {'u': np.zeros((4, 6))},
        r'state\.u must be an array of shape \(3, 6\) of float64, got shape \(4, 6\)',
    ),
    'angles of another robot': (
        {'angle': np.zeros((2, 3, 2))},
        r'angle must be an array of shape \(\d, 2, 2\) of float64, got shape \(\d, 3, 2\)',
    ),
    'fewer rates than angles': (
        {'rate': np.zeros((1, 2, 2))},
        r'rate must be an array of shape \(2, 2, 2\) of float64, got shape \(1, 2, 2\)',
    ),
    'a list of rates': (
        {'rate': [[[0.0, 0.0]] * 2] * 2},
        r'rate must be an array of shape \(2, 2, 2\) of float64, got list',
    ),
}


@pytest.mark.parametrize('bad', BAD)
@pytest.mark.parametrize('level', ['spatial', 'planar', 'auto'])
@pytest.mark.parametrize('method', METHODS)
def test_arrays_that_do_not_fit_are_refused(method, level, bad):
    scene = scene_of('flat', method=method, level=level)
    state, still = initial_state(scene), np.zeros((2, 2, 2))
    given, sentence = BAD[bad]
    given = {
        'state': state,
        'history': empty_history(scene),
        'angle': still,
        'rate': still,
        **given,
    }
    if 'u' in given:
        given['state'] = State(state.q, given.pop('u'))
    with pytest.raises(ParameterError, match=sentence):
        make_stepper(scene).advance(**given)


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
        with pytest.raises(ParameterError, match=f'state.q must be finite, got {bad} at'):
            stepper.advance(state, history, still, still)
        history[0, 3, 0] = bad
        with pytest.raises(ParameterError, match=rf'history must be .* {bad} at \[0, 3, 0\]'):
            stepper.advance(initial_state(scene), history, still, still)


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
    with pytest.raises(ParameterError, match=r'history must be an array of shape \(7, 24, 5\)'):
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
    assert simulation.history.shape == empty_history(scene_of('both')).shape
    assert not simulation.advance(still, still).failure


if __name__ == '__main__':
    walk = closed_walk(['pegs', 'other pegs', 'ground'])
    simulation = check_walk([scene_of(name, level='spatial') for name in walk])
    # And the compiler does look: this scene has more contacts than this history.
    stepper, state = simulation.stepper, simulation.state
    still = np.zeros((1, 2, 2))
    try:
        stepper.loop(
            stepper.model, stepper.work, state.q.copy(), state.u.copy(), np.zeros((7, 2, 5)),
            still, still, np.zeros(REPORT_SIZE), np.zeros(2, np.int64),
        )  # fmt: skip
    except IndexError:
        print('all in bounds')
