# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Expressions of metrics: arithmetic that is looked up, never run, and what must hold of it."""

import math
import warnings

import pytest

from snake_sim_ros import ParameterError
from snake_sim_ros.studies.expressions import constraint_of, expression_of

pytestmark = pytest.mark.fast

NUMBERS = {'speed': 0.5, 'cost': 2.0, 'gait.yaw.phase': -3.0, 'void': math.nan}


def value(text):
    return expression_of(text, NUMBERS, 'maximize').value(NUMBERS)


def excess(text):
    return constraint_of(text, NUMBERS, 'constraints').value(NUMBERS)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('speed', 0.5),
        ('-cost', -2.0),
        (' speed - 0.1 * abs(gait.yaw.phase) ', 0.5 - 0.1 * 3.0),
        ('min(speed, cost, 0.25) + max(-cost, 1)', 0.25 + 1),
        ('(speed + 1) / cost ** 3 - +1e-3', 1.5 / 8 - 1e-3),
    ],
)
def test_an_expression_has_the_value_that_python_gives(text, expected):
    assert value(text) == expected


@pytest.mark.parametrize(
    'text',
    ['speed / (cost - 2)', '(-speed) ** 0.5', 'cost ** 9999', 'cost ** cost ** 99 ** 9', 'void',
     'min(1, void)', 'max(void, speed)', '(speed - 0.5) ** -1', 'speed * 1e308 * 1e308'],
)  # fmt: skip
def test_what_is_no_finite_number_is_nan(text):
    assert math.isnan(value(text))


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('speed <= 0.5', 0.0),
        ('cost <= 1', 1.0),
        ('cost <= 1.6', 0.25),
        ('cost >= 4', 0.5),
        ('4 <= cost', 0.5),
        ('-1 < gait.yaw.phase < 1', 2.0),
        ('0.1 < speed < cost', 0.0),
        ('cost <= 0', 2.0),  # a bound of 0 has no shares
        ('void <= 1', math.inf),
        ('1 / (cost - 2) <= 1', math.inf),
    ],
)
def test_a_constraint_tells_by_what_share_of_its_bound_it_does_not_hold(text, expected):
    assert excess(text) == pytest.approx(expected, rel=1e-15)


def test_a_strict_comparison_of_equal_numbers_does_not_hold():
    assert 0.0 < excess('speed < 0.5') < 1e-9


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('spead', "unknown name 'spead'; did you mean 'speed'?"),
        ('speed.real', "unknown name 'speed.real'"),
        ('__import__("os").system("true")', 'unknown function'),
        ('abz(speed)', "unknown function 'abz'; did you mean 'abs'?"),
        ('open', "unknown name 'open'"),
        ('[speed]', 'is not possible'),
        ('speed if cost else 1', 'is not possible'),
        ('lambda: speed', 'is not possible'),
        ('(x := speed)', 'is not possible'),
        ('"speed"', 'is not possible'),
        ('True', 'is not possible'),
        ('speed // 2', 'is not possible'),
        ('f"{speed}"', 'is not possible'),
        ('abs(speed, cost)', 'abs takes one number'),
        ('max(speed)', 'max takes two numbers or more'),
        ('max(*speed)', 'is not possible'),
        ('max(speed, cost, key=abs)', 'max takes two numbers or more'),
        ('speed <= 1', 'got the comparison'),
        ('3', 'must depend on something'),
        ('speed * 1e999', 'numbers must be finite'),
        ('speed +', 'is not readable'),
        ('speed; cost', 'is not readable'),
        ('(' * 300, 'is not readable'),
        ('-' * 399 + 'x', 'unknown name'),
        ('speed ' * 100, 'at most 400 characters'),
        ('', 'must be an expression'),
        (3.0, 'must be an expression'),
    ],
)
def test_anything_else_gets_one_sentence(text, message):
    with pytest.raises(ParameterError) as caught:
        value(text)
    assert message in str(caught.value)
    assert str(caught.value).startswith('maximize') and '\n' not in str(caught.value)


@pytest.mark.parametrize('text', ['1if speed else 2', '0x1for x', "speed + '\\d'", 'speed is 1'])
def test_python_says_nothing_of_it(text):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        with pytest.raises(ParameterError):
            value(text)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('speed', 'must be a comparison such as'),
        ('speed == 1', r'compare by <=, <, >= or >'),
        ('speed != 1', r'compare by <=, <, >= or >'),
        ('speed <= 1 and cost <= 1', 'must be a comparison'),
        ('speed in cost', r'compare by <=, <, >= or >'),
        ('1 <= 2', 'must depend on something'),
        ('sped <= 1', "did you mean 'speed'"),
    ],
)
def test_what_is_no_constraint_is_refused(text, message):
    with pytest.raises(ParameterError, match=message):
        excess(text)
