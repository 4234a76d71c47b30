# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A budget of iterations that the steps of a publish period share."""

import numpy as np
import pytest
from rclpy.parameter import Parameter
from scenes import kinetic_energy

from snake_sim_ros import ParameterError, Report, Scene, Simulation
from snake_sim_ros.nodes.sim_parameters import changed, Settings
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.bdf2.formula import LEAST_ITERATIONS, TICKS
from snake_sim_ros.stepping.simulation import FLOOR, IterationBudget, TOGETHER

STEPS, MOST = 20, 5000
ANGLE = np.zeros((STEPS, 10, 2))


class Counter:
    """A stepper whose steps need a number of iterations each; its state is the steps so far."""

    level = 'spatial'

    def __init__(self, needs):
        self.needs, self.limit, self.spent = needs, MOST, 0
        self.limits = {}  # number of a step -> its last limit

    def limit_iterations(self, limit):
        self.limit = limit

    def advance(self, state, history, angle, rate, samples=None, pushes=None):
        report = Report()
        for k in range(state, state + len(angle)):
            spent = min(self.needs[k], self.limit)
            report += Report(1, spent, spent, int(self.needs[k] > self.limit))
            self.limits[k] = self.limit
        self.spent += report.iterations
        self.cycles = 10 * np.arange(len(angle) + 1)
        return state + len(angle), history, report


def counted(needs, budget):
    """Return the stepper, the budget and the report after a period of steps with these needs."""
    stepper, shared = Counter(needs), IterationBudget()
    shared.share = budget / STEPS
    end, _, report = shared.spend(stepper, MOST, 0, None, (ANGLE, ANGLE))
    assert (end, report.steps, stepper.limit) == (STEPS, STEPS, MOST)
    assert shared.cycles.tolist() == [10 * k for k in range(STEPS + 1)]
    return stepper, shared, report


def test_one_hard_step_takes_what_the_others_leave():
    stepper, shared, report = counted([2] * 7 + [600] + [2] * 12, 900)
    assert (shared.cut, report.unconverged, report.iterations_max) == (0, 0, 600)
    assert stepper.spent <= 900


def test_steps_after_the_budget_have_a_floor_and_are_counted():
    needs = [3, 700, 30, 700, *[30] * 16]
    stepper, shared, report = counted(needs, 500)
    assert (shared.cut, report.unconverged) == (2, 2)  # steps that need less than the floor go on
    assert stepper.limits[1] > 200 and stepper.limits[3] == FLOOR
    assert stepper.spent <= 500 + 2 * FLOOR * STEPS


def test_the_worst_period_is_bounded():
    for budget in (1, 200, 1000):
        stepper, shared, _ = counted([MOST + 1] * STEPS, budget)
        assert shared.cut == STEPS
        assert stepper.spent <= budget + FLOOR * (2 * STEPS)


def test_a_budget_that_is_large_enough_for_all_cuts_nothing():
    stepper, shared, report = counted([MOST + 1] * STEPS, 10**12)
    assert (shared.cut, report.unconverged) == (0, STEPS)
    assert stepper.spent == MOST * STEPS  # nothing is taken twice


def test_steps_within_the_budget_keep_their_bits():
    scene = with_settings(load_scene('lateral_undulation'), {'level': 'spatial'})
    free, bound = Simulation(scene), Simulation(scene)
    bound.budget.share = 40.0
    for count in (STEPS, 1, 1, 1, TOGETHER + 1, STEPS):
        for each in (free, bound):
            each.advance(*each.gait_reference(count))
        assert len(bound.budget.cycles) == count + 1
    assert np.array_equal(bound.state.q, free.state.q)
    assert np.array_equal(bound.state.u, free.state.u)
    assert bound.report.iterations == free.report.iterations > 0
    assert (bound.budget.cut, bound.report.unconverged) == (0, 0)
    assert bound.stepper.model.iteration_limit == scene.iteration_limit


def test_newton_has_another_usual_limit_than_sweeps():
    scene = Scene()
    assert [
        with_settings(scene, {'method': name}).iteration_limit
        for name in ('newton', 'bdf2', 'auto', 'paper')
    ] == [1000, 1000, 1000, 5000]
    assert with_settings(scene, {'solver.iteration_limit': 7}).iteration_limit == 7


def test_a_budget_may_change_while_a_node_runs():
    scene, wanted = load_scene('lateral_undulation'), Parameter('iteration_budget', value=300)
    settings, _ = changed(Settings(), scene, [wanted])
    assert settings.iteration_budget == 300
    with pytest.raises(ParameterError, match='iteration_budget'):
        changed(settings, scene, [Parameter('iteration_budget', value=-1)])


@pytest.mark.parametrize('limit', [5000, 300])
def test_the_limit_bounds_all_parts_and_landings_of_a_step(limit):
    # A long robot that slides down a steep slope lands all the time, at large steps.
    settings = {
        'robot.link_count': 30,
        'friction.longitudinal': 1.5,
        'friction.transversal': 1.5,
        'gait.yaw.amplitude': 0.3,
        'gait.yaw.angular_frequency': 2.0,
        'gait.yaw.phase_lag': -0.5,
        'gait.soft_start': 0.5,
        'gravity': [0.0, 8.496, -4.905],
        'level': 'spatial',
        'method': 'bdf2',
        'dt': 1 / 50,
        'solver.iteration_limit': limit,
    }
    simulation = Simulation(with_settings(Scene(), settings))
    reached = 0
    for _ in range(27):
        report = simulation.advance(*simulation.gait_reference(1))
        # Solutions after the limit: two in each of the parts, which double in length.
        assert report.iterations <= limit + 2 * LEAST_ITERATIONS * (1 + TICKS.bit_length())
        assert report.unconverged or report.iterations <= limit
        reached += report.iterations > limit / 2
    assert reached > 0


@pytest.mark.parametrize('seed', range(6))
def test_steps_that_give_up_do_not_drive_a_robot(seed):
    # It slides down a steep slope on all of its links, and most steps reach a limit this small.
    rng = np.random.default_rng([7, seed])
    heading, slope = rng.uniform(0.0, 2 * np.pi), np.radians(rng.uniform(60.0, 75.0))
    along = np.sin(slope) * np.array([np.cos(heading), np.sin(heading)])
    settings = {
        'robot.link_count': 20,
        'friction.longitudinal': rng.uniform(0.8, 1.5),
        'friction.transversal': rng.uniform(0.8, 1.5),
        'gait.yaw.amplitude': 0.3,
        'gait.yaw.angular_frequency': 2.0,
        'gait.yaw.phase_lag': -0.5,
        'gait.soft_start': 0.5,
        'gravity': [*(9.81 * along), -9.81 * np.cos(slope)],
        'level': 'spatial',
        'method': 'bdf2',
        'dt': 1 / 50,
        'solver.iteration_limit': 100,
    }
    simulation = Simulation(with_settings(Scene(), settings))
    mass, start = simulation.scene.robot.per_link('link_mass'), simulation.state.q
    report = simulation.advance(*simulation.gait_reference(15))
    assert not report.failure
    moved = simulation.state.q[:, :3] - start[:, :3]
    work = mass @ moved @ np.array(simulation.scene.gravity)
    assert kinetic_energy(simulation.scene.robot, simulation.state.u) < 1.1 * work
