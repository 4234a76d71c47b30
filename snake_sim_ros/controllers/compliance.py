# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Shape-based compliance: a wave whose bends yield to the torques of the joints.

Yaw is a serpenoid curve with an amplitude A and a shift eta of the phase in each window of the
phase phi. A window is a bend of the body, and moves along the body with the wave:

``theta_i = A(phi_i) sin(phi_i + eta(phi_i)) + psi``, ``phi_i = omega t + (i-1) delta + delta_0``,
``A(phi) = sum_k w_k(phi) A_k``, ``eta(phi) = sum_k w_k(phi) eta_k``,
``w_k(phi) = s(m (phi - k pi)) - s(m (phi - (k+1) pi))``, s the logistic function.

Each window has two admittances, which torques t_i of the joints move away from rest:

``B A_k' + K (A_k - A_0) = -sum_i w_k dtheta_i/dA t_i``,
``A_0^2 (B eta_k' + K eta_k) = -sum_i w_k dtheta_i/deta t_i``

What resists a bend flattens it, what resists its motion delays it: a bend that eta shifts is one
whose spatial frequency yields. t_i is what the torque of a joint exceeds a threshold by, up to
which the joints push. Steps are implicit in the values and in the torques of joints that are
blocked, which the stiffness of the servos gives.

Sources: Travers, Whitman, Choset, Shape-based coordination in locomotion control, IJRR 37, 2018;
Whitman, Ruscelli, Travers, Choset, Shape-based compliant control with variable coordination
centralization on a snake robot, CDC 2016. Theirs has an inertia besides, and no threshold; its
bends yield by amplitude and spatial frequency. The wave at rest is wider than that of most gaits,
so that it reaches obstacles.
"""

from dataclasses import replace
import math

import numpy as np

from snake_sim_ros.controllers.controller import check_values, Measured, Reference
from snake_sim_ros.controllers.wide_wave import AMPLITUDE, ENTRY, faded_in, PHASE_LAG, wide
from snake_sim_ros.scene import gait as waves
from snake_sim_ros.scene.gait import Wave
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import initial_angles

STEEPNESS = 8.0  # m of the windows [1/rad]
LARGEST_SHIFT = math.pi / 4  # of eta [rad]


class ShapeCompliance:
    """
    Moves the joints by a wave that obstacles bend.

    Parameters
    ----------
    amplitude, phase_lag : float, optional
        A_0 and, without its sign, delta of the wave at rest [rad].
    stiffness : float, optional
        K, with which bends return to rest [N m/rad].
    damping : float, optional
        B [N m s/rad].
    threshold : float, optional
        Torque up to which joints do not yield [N m].
    period : float, optional
        Time from one call to the next [s].

    """

    sees_poses = False

    def __init__(
        self,
        amplitude: float = AMPLITUDE,
        phase_lag: float = PHASE_LAG,
        stiffness: float = 10.0,
        damping: float = 1.0,
        threshold: float = 4.0,
        period: float = 0.05,
    ) -> None:
        positive = {
            'amplitude': amplitude, 'phase_lag': phase_lag, 'stiffness': stiffness,
            'damping': damping, 'period': period,
        }  # fmt: skip
        check_values(positive, lambda value: value > 0.0, 'above 0')
        check_values({'threshold': threshold}, lambda value: value >= 0.0, 'at least 0')
        self.amplitude, self.phase_lag, self.period = amplitude, phase_lag, period
        self.stiffness, self.damping, self.threshold = stiffness, damping, threshold

    def start(self, scene: Scene) -> None:
        """Begin anew, in the posture of a scene and with bends at rest."""
        self.robot, self.gait = scene.robot, wide(scene, self.amplitude, self.phase_lag)
        self._pitch = replace(self.gait, yaw=Wave())
        self._posture, self._fade_in = initial_angles(scene), max(ENTRY, scene.gait.soft_start)
        self._joint = np.arange(len(self._posture))
        self._servo = scene.robot.per_joint('stiffness')[:, 0]
        self._values: dict[int, Array] = {}  # (A_k, eta_k) of the windows on the body [rad]

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the wave of the next period, with bends that yield at constant rates."""
        h, rest = self.period, np.array([self.amplitude, 0.0])
        now = self._phase(np.array([time, time + h]))
        turns = now / math.pi
        windows = np.arange(math.floor(turns.min()) - 1, math.floor(turns.max()) + 2)
        begin = np.array([self._values.get(k, rest) for k in windows.tolist()])
        torque = self.robot.by_joint(measured.joint_torque, absent=0.0)[:, 0]
        excess = torque - np.clip(torque, -self.threshold, self.threshold)
        weight, _ = weights(now[0], windows)
        A, eta = begin.T @ weight
        moves = np.stack(
            [weight * np.sin(now[0] + eta), weight * A * np.cos(now[0] + eta)], axis=-1
        )  # dtheta_i/dA, dtheta_i/deta
        scale = np.array([1.0, self.amplitude**2])
        spring, damper = self.stiffness * scale, self.damping * scale
        blocked = np.einsum('i,kiv->kv', self._servo * (excess != 0.0), moves**2)
        force = -np.einsum('i,kiv->kv', excess, moves) - spring * (begin - rest)
        end = begin + h * force / (damper + h * (spring + blocked))
        end = np.clip(end, [0.0, -LARGEST_SHIFT], [self.amplitude, LARGEST_SHIFT])
        self._values = dict(zip(windows.tolist(), end, strict=True))
        slope = (end - begin) / h

        def reference(times: Array) -> tuple[Array, Array]:
            angle, rate = waves.reference(self._pitch, times, len(self._joint))
            phase, omega = self._phase(times), self.gait.yaw.angular_frequency
            weight, change = weights(phase, windows)
            value = begin[:, None] + slope[:, None] * (times - time)[:, None]
            A, eta = np.einsum('kmi,kmv->vmi', weight, value)
            A_dot, eta_dot = np.einsum('kmi,kv->vmi', weight, slope)
            A_slope, eta_slope = omega * np.einsum('kmi,kmv->vmi', change, value)
            sine, cosine = np.sin(phase + eta), np.cos(phase + eta)
            angle[..., 0] = A * sine + self.gait.yaw.offset
            rate[..., 0] = (A_dot + A_slope) * sine + A * (omega + eta_dot + eta_slope) * cosine
            return angle, rate

        return faded_in(reference, self._posture, self._fade_in)

    def _phase(self, times: Array) -> Array:
        """Return phi of all joints (m, n-1) [rad]."""
        yaw = self.gait.yaw
        return yaw.angular_frequency * times[:, None] + yaw.phase + yaw.phase_lag * self._joint


def weights(phase: Array, windows: Array) -> tuple[Array, Array]:
    """Return w_k of consecutive windows (k,) at phases, (k, ...), and derivatives [1/rad]."""
    edges = math.pi * np.append(windows, windows[-1] + 1)
    s = 0.5 + 0.5 * np.tanh(0.5 * STEEPNESS * (phase - edges.reshape(-1, *[1] * phase.ndim)))
    slope = STEEPNESS * s * (1.0 - s)
    return s[:-1] - s[1:], slope[:-1] - slope[1:]
