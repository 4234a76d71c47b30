# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How held radii follow loads that are a linear map of them."""

import numpy as np
import pytest

from snake_sim_ros.contact.contacts import make_contacts, MIXED
from snake_sim_ros.contact.radii import begin_to_follow, follow_loads, SMALL, TURN
from snake_sim_ros.dynamics.compilation import compiled

COUNT = 6
assert COUNT < MIXED
AGREE = 1e-10  # N s: a ten millionth of what is wrong at first, far above rounding


@compiled
def follow(contacts, closed, A, b, first, most):
    """Do rounds from number `first` on until radii and loads agree; return how many."""
    following = begin_to_follow()
    newton = contacts.newton
    rounds = 0
    while rounds < most:
        wrong = 0.0
        for a in closed:
            load = b[a]
            for c in closed:
                load += A[a, c] * newton.held_radius[c]
            newton.anchor[a, 0] = load
            wrong = max(wrong, abs(load - newton.held_radius[a]))
        if wrong <= AGREE:
            break
        following = follow_loads(first + rounds, following, closed, contacts, None)
        rounds += 1
    return rounds


def followed(slopes, first, most):
    """Return the rounds, and what radii are wrong by, for a map with some eigenvalues."""
    random = np.random.default_rng(1)
    turn = np.linalg.qr(random.normal(size=(COUNT, COUNT)))[0]
    A, end = turn @ np.diag(slopes) @ turn.T, random.uniform(1.0, 2.0, COUNT)
    contacts = make_contacts(np.array([[k, -1] for k in range(COUNT)]))
    contacts['newton']['held_radius'] = end + 1e-3 * random.normal(size=COUNT)
    rounds = follow(contacts, np.arange(COUNT), A, end - A @ end, first, most)
    return rounds, np.abs(contacts['newton']['held_radius'] - end).max()


@pytest.mark.parametrize('steepest', [0.7, 1.5, 3.0])
def test_mixing_ends_after_as_many_moves_as_there_are_radii(steepest):
    # Loads that grow by more than the radii drive these away without it. The first round knows no
    # move, each of the next ones adds one, and one more may correct the rounding of these.
    slopes = np.array([steepest, 0.9, 0.5, 0.2, -0.5, -2.0])
    rounds, wrong = followed(slopes, TURN, TURN)
    assert rounds <= COUNT + 2
    assert wrong <= COUNT * AGREE / np.abs(1.0 - slopes).min()


def test_small_shares_end_what_turns_back():
    # Each round leaves 1 + SMALL (slope - 1) of what is wrong.
    slopes = np.array([0.0, -1.0, -2.0, -3.0, -4.0, -5.0])
    _, wrong = followed(slopes, 2 * TURN, TURN)
    assert wrong <= 1e-2 * (1.0 - SMALL) ** TURN
