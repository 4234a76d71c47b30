# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A partitioned gait over a large step: undulation below and above it, a cantilever between.

Along the body, s in links from the head, each link has a heading theta and an elevation epsilon
against the direction in which the robot travels. The foot of the step is at s = f in the body, the
edge at e < f. Links turn up about f and down about e, over b links each, S a smooth step from 0
to 1 between -1/2 and 1/2:

``epsilon(s) = pi/2 (S((f-s)/b) - S((e-s)/b))``
``theta(s) = -w(s) A/(2 sin(delta/2)) cos(omega t + delta (s - 1/2) + delta_0)``

Joint angles are those between neighbors. With a window w = 1 they are the wave of the gait, eq.
(70), whose amplitude is A; the window is 1 below and above, and 0 where links turn up or down, so
that the cantilever is in a vertical plane. Below, it is 0 for one link more: a cardan joint yaws
before it pitches, and has no angles for the opposite. The rise of the cantilever, ``integral L sin
epsilon ds``, is the height of the step.

The foot travels down the body as fast as the robot advances, which is seen: f is where the body is
at a clearance from the face of the step, measured from the next link on the floor, or the last one
on the step when few are left below.

Sources: Gart, Mitchel, Li, Snakes partition their body to traverse large steps stably, J. Exp.
Biol. 222, 2019; Fu, Li, Robotic modelling of snake traversing large, smooth obstacles reveals
stability benefits of body compliance, R. Soc. Open Sci. 7, 2020. They describe the three sections;
the functions above are ours.
"""

import math

import numpy as np

from snake_sim_ros.controllers.controller import check_values, Measured, Reference
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import soft_start, Wave
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import FLAT, rotation_matrices

FADE = 2.0  # links over which the wave fades before and after the cantilever
FEW = 3.0  # links on the floor with which f is still measured there
LAG = 0.3  # with which f follows what is measured [s]
FASTEST = 8.0  # of f [links/s]
INSTANT = 1e-4  # of central differences, which are good to 1e-8 of a rate [s]


class PartitionedGait:
    """
    Takes the lateral undulation of a scene over one step that is straight ahead.

    Parameters
    ----------
    height : float
        Height of the step [m].
    face : float
        Distance of its face from the origin, in the direction in which it leads up [m].
    direction : float, optional
        That direction, from the x axis [rad]. Default: toward -x, as robots start.
    clearance : float, optional
        Distance of the cantilever from the face [m].
    bend : float, optional
        Links b over which the body turns up, and down.
    period : float, optional
        Time from one call to the next [s].

    Attributes
    ----------
    foot : float
        Where the foot of the step is in the body at the last call, f [links from the head].

    """

    sees_poses = True

    def __init__(
        self,
        height: float,
        face: float,
        direction: float = math.pi,
        clearance: float = 0.12,
        bend: float = 3.0,
        period: float = 0.05,
    ) -> None:
        given = {'height': height, 'clearance': clearance, 'bend': bend, 'period': period}
        check_values(given, lambda value: value > 0.0, 'above 0')
        for name, value in (('face', face), ('direction', direction)):
            if not math.isfinite(value):
                raise ParameterError(f'{name} must be finite, got {value}')
        self.height, self.face, self.clearance = height, face, clearance
        self.bend, self.period = bend, period
        self.ahead = np.array([math.cos(direction), math.sin(direction)])

    def start(self, scene: Scene) -> None:
        """
        Begin anew, before the step.

        Raises
        ------
        ParameterError
            If the gait is no lateral undulation, or the step is lower than both turns are.

        """
        robot, gait, self.wave = scene.robot, scene.gait, scene.gait.yaw
        self.links, self.length = robot.link_count, float(robot.per_link('link_length').mean())
        is_a_wave = self.wave.amplitude != 0.0 and self.wave.phase_lag != 0.0
        has_more = self.wave.offset or self.wave.gradient or gait.pitch != Wave() or gait.table
        if has_more or not is_a_wave:
            raise ParameterError(
                'a partitioned gait needs a wave of the yaw joints without offset and gradient, '
                'and nothing else'
            )
        self.limit = robot.joint_limit
        self.fade_in = gait.soft_start
        self.heading = self.wave.amplitude / (2.0 * math.sin(self.wave.phase_lag / 2.0))
        x = (np.arange(1000) + 0.5) / 1000
        turn = 2.0 * self.bend * float(np.sin(math.pi / 2 * step(x, 1.0)).mean())
        self.rise = self.bend + self.height / self.length - turn  # f - e [links]
        if self.rise < self.bend:
            least = turn * self.length
            raise ParameterError(f'height must be at least {least:.3g} m, got {self.height:g} m')
        self.foot = -math.inf

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the joint angles of the next period, in which the foot moves on steadily."""
        assert measured.position is not None  # it sees poses
        found = self._measured_foot(self.face - measured.position[:, :2] @ self.ahead)
        begin = found if math.isinf(self.foot) else self.foot
        speed = min(max((found - begin) / LAG, 0.0), FASTEST)
        self.foot = begin + speed * self.period

        def angles(times: Array) -> Array:
            return self.joint_angles(begin + speed * (times - time), times)

        def reference(times: Array) -> tuple[Array, Array]:
            change = angles(times + INSTANT) - angles(times - INSTANT)
            return angles(times), change / (2.0 * INSTANT)

        return reference

    def joint_angles(self, foot: Array, time: Array) -> Array:
        """
        Return the joint angles of a partition, within the limit of the joints.

        Parameters
        ----------
        foot : ndarray, shape (m,)
            Where the foot of the step is in the body, f [links from the head].
        time : ndarray, shape (m,)
            [s]

        Returns
        -------
        ndarray, shape (m, n-1, 2)
            (yaw, pitch) of every joint [rad].

        """
        s, f = np.arange(self.links), foot[:, None]
        e, b = f - self.rise, self.bend
        up = step(f - s + b / 2, b) - step(e - s + b / 2, b)
        window = step(s - 1 - f - b / 2, FADE) + step(e - b / 2 - s, FADE)
        window *= step(time[:, None], self.fade_in)
        phase = self.wave.angular_frequency * time[:, None] + self.wave.phase_lag * (s - 0.5)
        theta = -self.heading * window * np.cos(phase + self.wave.phase)
        R = turned(theta, math.pi / 2 * up) @ rotation_matrices(FLAT)
        between = np.swapaxes(R[:, :-1], -1, -2) @ R[:, 1:]  # R_y(yaw) R_x(pitch)
        yaw = np.arctan2(-between[..., 2, 0], between[..., 0, 0])
        pitch = np.arctan2(-between[..., 1, 2], between[..., 1, 1])
        angles = np.stack([yaw, pitch], axis=-1)
        return np.asarray(np.clip(angles, -self.limit, self.limit))

    def _measured_foot(self, distance: Array) -> float:
        """Return f from the distances of all links from the face, negative beyond it [m]."""
        last, turn, foot = self.links - 1, (self.bend + FADE) / 2.0, max(self.foot, -1.0)
        below = min(max(math.ceil(foot + turn), 0), last)
        above = min(math.floor(foot - self.rise - turn), last)
        if below <= last - FEW or above < 0:
            return float(below - (distance[below] - self.clearance) / self.length)
        return float(above - (distance[above] - self.clearance) / self.length) + self.rise


def step(x: Array, width: float) -> Array:
    """Return a smooth step that is 0 up to x = 0, and 1 from x = width on."""
    return soft_start(x, width)[0]


def turned(heading: Array, elevation: Array) -> Array:
    """
    Return ``R_z(heading) R_y(elevation)``, shape (..., 3, 3).

    A link along x, its head at the smaller x, has its head up by the elevation [rad].
    """
    ct, st, ce, se = np.cos(heading), np.sin(heading), np.cos(elevation), np.sin(elevation)
    zero = np.zeros(ct.shape)
    rows = [[ct * ce, -st, ct * se], [st * ce, ct, st * se], [-se, zero, ce]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
