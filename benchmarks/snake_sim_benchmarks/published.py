# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Published results on controllers and gaits, measured again: a line for each, pass or fail.

[L] Liljeback, Pettersen, Stavdahl, Gravdahl, Snake Robots, Springer 2013, and Experimental
investigation of fundamental properties of snake robot locomotion, ICARCV 2010: with viscous
friction the speed of lateral undulation is proportional to ``alpha^2 omega k_delta`` for small
amplitudes. [G] Gong, Hatton, Choset, Conical sidewinding, ICRA 2012: a robot whose amplitude grows
linearly along its body turns as a cone rolls, about the point where the amplitude would be 0. [K]
Kelasidi, Liljeback, Pettersen, Gravdahl, Integral line-of-sight guidance for path following
control of underwater snake robots, T-RO 2017: cross-track error e and heading chi converge as the
cascade ``e' = sin chi``, ``chi' = -k (chi + arctan(e/Delta))``, by distance, with our proportional
heading controller in place of theirs. [F] Fu, Li, Robotic modelling of snake traversing large,
smooth obstacles reveals stability benefits of body compliance, R. Soc. Open Sci. 7, 2020: a
robot with a partitioned gait stably traverses steps of a third of its length; on higher ones it
is more likely to fail, and fails by turning over. Robot and gait are those of `large_step`.

A tolerance is what the publication leaves open: small amplitudes, equal loads, an ideal heading
controller, a probability that is high. None was chosen after the measurement to make a line pass.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from snake_sim_benchmarks.large_steps import trials
from snake_sim_ros import Following, Run, run

ANGULAR_FREQUENCY = 1.4  # rad/s
Array = NDArray[Any]


class Line(NamedTuple):
    """A published result and what was measured."""

    what: str
    published: float
    measured: float
    tolerance: float  # relative

    @property
    def passed(self) -> bool:
        """Whether both agree within the tolerance."""
        return abs(self.measured - self.published) <= self.tolerance * abs(self.published)

    def __str__(self) -> str:
        """Return the line as text."""
        share = 100 * (self.measured / self.published - 1.0)
        return (
            f'{"pass" if self.passed else "FAIL"}  {self.what}: published {self.published:.4g}, '
            f'measured {self.measured:.4g} ({share:+.1f} %, {100 * self.tolerance:.0f} % allowed)'
        )


def _run(scene: str, duration: float, **values: Any) -> Run:
    """Return a run with steps whose error is far below what is compared."""
    return run(scene, values, duration=duration, dt=1e-3, method='bdf2')


def lines() -> Iterator[Line]:
    """Yield all results."""
    yield from undulation()
    yield from cones()
    yield from guidance()
    yield from large_steps()


# ---- lateral undulation [L] ---------------------------------------------------------------------


def k_delta(phase_lag: Array, links: int) -> Array:
    """Return k_delta of phase lags [rad], shape (m,): sum over i, j of a_ij sin((j - i) delta)."""
    add = np.eye(links - 1, links) + np.eye(links - 1, links, 1)
    subtract = np.eye(links - 1, links) - np.eye(links - 1, links, 1)
    a = add @ np.linalg.pinv(subtract)
    joint = np.arange(links - 1)
    angle = (joint - joint[:, None]) * phase_lag[:, None, None]
    return (a * np.sin(angle)).sum(axis=(1, 2))


def _speed(amplitude_deg: float, angular_frequency: float, phase_lag: float) -> float:
    """Return the mean speed of three cycles of lateral undulation with viscous friction [m/s]."""
    cycle = 2 * math.pi / angular_frequency
    wave = {'amplitude_deg': amplitude_deg, 'angular_frequency': angular_frequency}
    friction = {'longitudinal': 0.0, 'transversal': 0.0}
    friction |= {'viscous_longitudinal': 0.5, 'viscous_transversal': 1.5}  # N s/m
    # Speed is lost with the time constant m/c, of 2 s.
    duration = round(20.0 + 3 * cycle, 2)
    gait = {'yaw': wave | {'phase_lag': -phase_lag}}
    moved = _run('lateral_undulation', duration, gait=gait, friction=friction)
    center, last = moved.position[:, :, :2].mean(axis=1), moved.time[-1]
    before = int(np.searchsorted(moved.time, last - 3 * cycle))
    return float(np.hypot(*(center[-1] - center[before])) / (last - moved.time[before]))


def undulation() -> Iterator[Line]:
    """Yield the speed over amplitude, frequency and phase lag, and the best phase lag."""
    lag, w = math.radians(30), ANGULAR_FREQUENCY
    with ThreadPoolExecutor() as pool:
        small, twice, faster = pool.map(_speed, (5, 10, 5), (w, w, 2 * w), (lag,) * 3)
        yield Line('speed with twice the amplitude, 5 and 10 degrees', 4.0, twice / small, 0.1)
        yield Line('speed with twice the frequency', 2.0, faster / small, 0.02)
        lags = np.radians(np.arange(14.0, 34.0, 2.0))
        speeds = np.array(list(pool.map(_speed, (5,) * len(lags), (w,) * len(lags), lags)))
    fine = np.linspace(lags[0], lags[-1], 2001)
    wanted = fine[k_delta(fine, 11).argmax()]
    found = np.poly1d(np.polyfit(lags, speeds, 4))(fine)
    best = math.degrees(fine[found.argmax()])
    yield Line(
        'phase lag of the largest speed, 11 links [degrees]', math.degrees(wanted), best, 0.1
    )
    of_formula = k_delta(lags, 11)
    share = (speeds / speeds.max()) / (of_formula / of_formula.max())
    worst = float(share[np.abs(share - 1.0).argmax()])
    yield Line('shape of the speed over phase lags of 14 to 32 degrees, where it is worst', 1.0,
               worst, 0.1)  # fmt: skip


# ---- conical sidewinding [G] --------------------------------------------------------------------


def _curvature(gradient: float) -> tuple[float, float]:
    """Return the curvature of the path of a gradient, and that of the cone, to the left [1/m]."""
    shape = {'gradient': gradient}
    moved = _run('sidewinding', 40.5, gait={'yaw': shape, 'pitch': shape})
    cycle = 4.5  # s
    late = int(np.searchsorted(moved.time, 2 * cycle))
    every = round(cycle / float(moved.time[1] - moved.time[0]))
    x, y = moved.position[late:, :, 0], moved.position[late:, :, 1]
    heading = np.unwrap(np.arctan2(y[:, 0] - y[:, -1], x[:, 0] - x[:, -1]))
    way = np.hypot(np.diff(x.mean(axis=1)[::every]), np.diff(y.mean(axis=1)[::every])).sum()
    # The amplitude is that of joints: the first and the last one are half a link inside.
    joints = moved.scene.robot.link_count - 1
    half = np.hypot(x[:, 0] - x[:, -1], y[:, 0] - y[:, -1]).mean() / 2 * (joints - 1) / joints
    return float((heading[-1] - heading[0]) / way), -gradient / half


def cones() -> Iterator[Line]:
    """
    Yield the turning radius over the gradient.

    The gait turns by itself, by an amount that depends on friction; the difference of the
    curvatures of opposite gradients is free of that.
    """
    gradients = (0.1, 0.2, 0.3)
    with ThreadPoolExecutor() as pool:
        found = list(pool.map(_curvature, (*gradients, *(-each for each in gradients))))
    for k, gradient in enumerate(gradients):
        (one, cone), (other, _) = found[k], found[k + len(gradients)]
        yield Line(
            f'turning radius of sidewinding with a gradient of {gradient:g} [m]',
            1.0 / abs(cone), 2.0 / abs(one - other), 0.2,
        )  # fmt: skip


# ---- line of sight [K] --------------------------------------------------------------------------


def _distance(x: Array, error: Array) -> float:
    """Return the distance over which an error falls from 70 to 10 % of 0.5 m [m]."""
    shares = np.abs(error / 0.5)
    begin, end = int((shares < 0.7).argmax()), int((shares < 0.1).argmax())
    return float(abs(x[end] - x[begin]))


def _cascade(gain: float, lookahead: float) -> float:
    """Return that distance of guidance and heading control without slip [m]."""

    def slopes(x: float, state: Array) -> tuple[float, float]:
        error, heading = state
        return math.sin(heading), -gain * (heading + math.atan(error / lookahead))

    x = np.linspace(0.0, 20.0, 20001)
    return _distance(x, solve_ivp(slopes, (0.0, 20.0), (0.5, 0.0), t_eval=x, rtol=1e-8).y[0])


def guidance() -> Iterator[Line]:
    """Yield the distance of convergence for some lookahead distances."""
    for lookahead in (0.5, 1.0, 1.5):
        path = Following(points=((0.0, 0.5), (-30.0, 0.5)), lookahead=lookahead, integral_gain=0.0)
        moved = _run('lateral_undulation', 60.0, follow=path)
        every = round(4.5 / float(moved.time[1] - moved.time[0]))  # a cycle of the gait
        x, y = (
            np.convolve(moved.position[:, :, axis].mean(axis=1), np.ones(every) / every, 'valid')
            for axis in (0, 1)
        )
        yield Line(
            f'distance in which the cross-track error falls from 70 to 10 %, lookahead of '
            f'{lookahead:g} m [m]',
            _cascade(path.heading_gain, lookahead), _distance(x, y - 0.5), 0.2,
        )  # fmt: skip


# ---- a partitioned gait [F] ---------------------------------------------------------------------


def large_steps() -> Iterator[Line]:
    """Yield how many of ten trials go over a third of the length, and how those higher up fail."""
    third, higher = (trials(share, 10)[0] for share in (0.33, 0.43))
    yield Line(
        'share of trials that traverse a step of 33 % of the length', 1.0,
        third['traversed'] / third.total(), 0.1,
    )  # fmt: skip
    failures = higher['turned over'] + higher['stuck']
    yield Line(
        'share of those that fail at 43 % by turning over', 1.0,
        higher['turned over'] / max(1, failures), 0.1,
    )  # fmt: skip
