# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The time step of the planar level in dense NumPy, with which the compiled one is tested.

It shares no algebra with the compiled step: joints are constraints with W_J and P_J as in
`stepping.reference`, and the pseudoinverse gives the least-norm solution of the equilibrium.
The velocities of a link are (v_x, v_y, omega) in the plane and (v_z, omega_x, omega_y) out of it.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from oracle.contact_laws import falling, prox_half_ellipses, viscosity
from oracle.joint_laws import dense_laws, DenseLaws, solve_laws_of_axes
from oracle.pushes import generalized, step_of
from snake_sim_ros import Robot, Scene
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.scene.obstacles import floor_friction
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES
from snake_sim_ros.stepping.planar.model import PlanarMemory, PlanarModel, PlanarWorkspace
from snake_sim_ros.stepping.planar.moreau import SLIP_MEMORY
from snake_sim_ros.stepping.pushes import PushTable
from snake_sim_ros.stepping.samples import row_after
from snake_sim_ros.stepping.steps import Steps

BALANCE = 1e-9  # largest error of the balance by rounding, as a share of the load
RANK = 1e-9  # below it a singular value, or the bend of a joint for a unit of roll, is rounding


class Shape(NamedTuple):
    """Where joints and spheres are along the links, from their centers."""

    front: Array  # (n,) the next joint [m]
    rear: Array  # (n,) the joint before, behind the center [m]
    link: Array  # (m,) of each sphere
    place: Array  # (m,) the spheres [m]
    present: Array  # (n-1, 2) 1 for an axis (yaw, pitch), 0 for one that a joint lacks


def shape_of(robot: Robot) -> Shape:
    """Return the shape of a robot."""
    places, spheres = robot.chain.places, robot.chain.spheres
    along = places.distal[:, 2], -places.proximal[:, 2], spheres.link, spheres.place[:, 2]
    return Shape(*along, places.present)


def centers(q: Array, shape: Shape) -> Array:
    """Return the link centers of planar coordinates [m], shape (n, 2)."""
    heading = np.column_stack([np.cos(q[2:]), np.sin(q[2:])])
    front, rear = shape.front[:, None] * heading, shape.rear[:, None] * heading
    joints = np.vstack([-rear[0], np.cumsum(front + rear, axis=0)[:-1] - rear[0]])
    return np.asarray(q[:2] + joints + rear)


def flat_frames(theta: Array) -> Array:
    """Return the frames B in I of links with some headings, shape (n, 3, 3)."""
    c, s, zero, one = np.cos(theta), np.sin(theta), 0.0 * theta, 1.0 + 0.0 * theta
    return np.moveaxis(np.array([[-s, zero, c], [c, zero, s], [zero, one, zero]]), 2, 0)


def directions(theta: Array, shape: Shape) -> tuple[Array, Array, Array]:
    """
    Return W_J, W_T and W_tau in the plane: ``W^T u`` are velocities of joints, sliding and yaw.

    Shapes (3n, 2(n-1) + k), (3n, 2m), (3n, n-1); k yaw axes that joints lack are held.
    """
    n, m = len(theta), len(shape.link)
    W_J, W_T, W_tau = (
        np.zeros((3 * n, 2 * n - 2)),
        np.zeros((3 * n, 2 * m)),
        np.zeros((3 * n, n - 1)),
    )
    for a, (i, arm) in enumerate(zip(shape.link, shape.place, strict=True)):
        row, (c, s) = 3 * i, (math.cos(theta[i]), math.sin(theta[i]))
        W_T[row : row + 2, 2 * a], W_T[row : row + 2, 2 * a + 1] = (c, s), (-s, c)
        W_T[row + 2, 2 * a + 1] = arm
    for i, (c, s) in enumerate(zip(np.cos(theta), np.sin(theta), strict=True)):
        row, across = 3 * i, np.array([-s, c])
        for j, sign, reach in ((i, 1.0, shape.front[i]), (i - 1, -1.0, shape.rear[i])):
            if 0 <= j < n - 1:
                W_J[row : row + 2, 2 * j : 2 * j + 2] = sign * np.eye(2)
                W_J[row + 2, 2 * j : 2 * j + 2] = reach * across
                W_tau[row + 2, j] = -sign
    absent = shape.present[:, 0] == 0.0
    return np.hstack([W_J, W_tau[:, absent]]), W_T, W_tau * ~absent


def upright_directions(theta: Array, shape: Shape) -> tuple[Array, Array, Array]:
    """
    Return W_J, W_N and the pitch axes out of the plane.

    Shapes (3n, 2(n-1) + k), (3n, m), (3n, n-1). A joint lets its links turn against each other
    about e_x of the outer one only, and about nothing if it lacks that axis, as k joints do.
    """
    n, m = len(theta), len(shape.link)
    W_J, W_N, axes = (
        np.zeros((3 * n, 2 * n - 2)),
        np.zeros((3 * n, m)),
        np.zeros((3 * n, n - 1)),
    )
    heading = np.column_stack([np.cos(theta), np.sin(theta)])
    for a, (i, arm) in enumerate(zip(shape.link, shape.place, strict=True)):
        W_N[3 * i : 3 * i + 3, a] = 1.0, arm * heading[i, 1], -arm * heading[i, 0]
    for i, (c, s) in enumerate(heading):
        row = 3 * i
        for j, sign, reach in ((i, 1.0, shape.front[i]), (i - 1, -1.0, shape.rear[i])):
            if 0 <= j < n - 1:
                x, y = heading[j + 1]
                W_J[row : row + 3, 2 * j] = sign, reach * s, -reach * c
                W_J[row + 1 : row + 3, 2 * j + 1] = sign * x, sign * y
                axes[row + 1 : row + 3, j] = sign * y, -sign * x
    absent = shape.present[:, 1] == 0.0
    return np.hstack([W_J, axes[:, absent]]), W_N, axes * ~absent


Loads = tuple[Array, Array, float]


def loads_from_friction(
    theta: Array, shape: Shape, pitch_stiffness: Array
) -> Callable[[Array], Loads]:
    """
    Return a function of a wrench out of the plane (3n,): the impulses of least norm against it.

    The pitch joints hold the motions that neither contacts nor joint constraints resist: one in
    which all links roll together and, where both spheres of every link are at its center, another
    in which they pitch to and fro. Their torques are those of springs of their stiffness.

    The function returns:

    P_N : ndarray, shape (m,)
        Normal impulses [N s].
    torque : ndarray, shape (n-1,)
        Impulses of the pitch joints [N m s].
    roll : float
        Largest roll of a link under these torques, with the sign of that of the middle link
        [rad s]; infinite if they do not hold the robot.

    """
    from scipy.linalg import null_space  # 0.1 s, for which no other start should wait

    W_J, W_N, axes = upright_directions(theta, shape)
    rolling = null_space(np.hstack([W_J, W_N]).T, rcond=RANK)
    bend = axes.T @ rolling
    bend[np.abs(bend) <= RANK] = 0.0  # a straight robot rolls without bending, but for rounding
    held = pitch_stiffness[:, None] * bend
    free = null_space(np.hstack([W_J, axes @ held]).T, rcond=RANK)
    pressing = -np.linalg.pinv(free.T @ W_N, rcond=RANK) @ free.T
    resisting = np.hstack([W_J, axes @ held])
    inverse = np.linalg.pinv(resisting)
    heading = np.column_stack([np.cos(theta), np.sin(theta)])

    def loads(wrench: Array) -> Loads:
        P_N = pressing @ wrench
        rest = -(wrench + W_N @ P_N)
        parts = inverse @ rest
        turned = parts[W_J.shape[1] :]
        roll = np.einsum('ik,ik->i', (rolling @ turned).reshape(len(theta), 3)[:, 1:], heading)
        balanced = np.abs(resisting @ parts - rest).max() <= BALANCE * np.abs(wrench).max()
        most = np.abs(roll).max() if balanced else math.inf
        return P_N, held @ turned, math.copysign(most, roll[len(theta) // 2])

    return loads


def slips_too_far(model: PlanarModel, roll: float, u: Array, memory: PlanarMemory) -> bool:
    """Return whether contacts slip too far, as `moreau.slips_too_far`; if not, note how far."""
    left = 1.0 / (1.0 + model.dt / SLIP_MEMORY)
    way = (
        left * memory.way[0] + model.dt * np.linalg.norm(model.mass @ u[:, :2]) / model.mass.sum()
    )
    slip = left * memory.slip[0] + model.height * abs(roll - memory.roll[0])
    if slip > model.free_slip + model.most_slip * way:
        return True
    memory.roll[0], memory.slip[0], memory.way[0] = roll, slip, way
    return False


class Terms(NamedTuple):
    """The terms of the balance in the plane at the middle of a step."""

    theta: Array  # (n,) headings [rad]
    friction: Array  # (m, 3) coefficients forward, backward and across the link
    W_J: Array  # (3n, 2(n-1) + k)
    W_T: Array  # (3n, 2m)
    W_tau: Array  # (3n, n-1)
    M: Array  # (3n, 3n)
    momentum: Array  # (3n,) without the joint axes
    laws: DenseLaws  # of the yaw axes (n-1, 1)
    viscous: Array  # (2m,) impulse of viscous friction per velocity along and across [kg]
    M_inv: Array  # (3n, 3n) with the implicit part of the laws of the axes


class Solution(NamedTuple):
    """Result of the iteration of a step."""

    u_E: Array  # (3n,) velocities
    P_N: Array  # (m,) [N s]
    P_T: Array  # (m, 2) [N s]
    pitch_torque: Array  # (n-1,) impulses of the pitch joints [N m s]
    roll: float  # see loads_from_friction [rad s]
    iterations: int
    converged: bool
    residual: float  # [m/s]


class DenseLoop:
    """The loop of `stepper.PlanarStepper` in NumPy."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.pitch = scene.robot.per_joint('stiffness')[:, 1]
        self.shape = shape_of(scene.robot)

    def __call__(self, model: PlanarModel, work: PlanarWorkspace, steps: Steps) -> None:
        """Take the steps up to the first that is not planar."""
        record = steps.record
        for k, (angle, rate) in enumerate(zip(steps.angle, steps.rate, strict=True)):
            pushes = steps.pushes.after(k)
            terms = self.terms(model, steps.q, steps.u, angle[:, 0], rate[:, 0], pushes)
            solution, yaw_torque = self.solve(model, terms, steps)
            if not self.finish(model, work, steps, terms, solution, yaw_torque):
                steps.report['not_planar'][:] = 1
                break
            row = row_after(k, record.every, record.first, len(record.span))
            if row >= 0:
                record.q[row], record.u[row] = steps.q, steps.u
                record.torque[row] = work.applied / self.scene.dt
                record.impulse[row], record.span[row] = steps.history.impulse, self.scene.dt

    def solve(self, model: PlanarModel, terms: Terms, steps: Steps) -> tuple[Solution, Array]:
        """Return the solution of a step with the laws of its joints, and the yaw impulses."""
        impulse = steps.history.impulse

        def solve(torque: Array, damping: Array, limit: int) -> tuple[Array, Solution, int]:
            known = self.with_law(terms, torque[:, 0], damping[:, 0])
            found = self.iterate(model, known, impulse[:, 0], impulse[:, 1:3], limit)
            turn = np.diff(found.u_E.reshape(-1, 3)[:, 2])[:, None]
            return turn, found, found.iterations

        turn, inertia = np.diff(steps.u[:, 2])[:, None], model.joint_laws.inertia
        found, turn, _, iterations, settled = solve_laws_of_axes(
            terms.laws, inertia, turn, solve, model.iteration_limit
        )
        converged = found.converged and settled
        found = found._replace(iterations=iterations, converged=converged)
        return found, terms.laws.controller(turn)[:, 0]

    def terms(
        self, model: PlanarModel, q: Array, u: Array, angle: Array, rate: Array,
        pushes: PushTable,
    ) -> Terms:  # fmt: skip
        """Return the terms of the balance at the middle of a step, for yaw references (n-1,)."""
        dt, scheme = self.scene.dt, PD_SCHEMES.index(self.scene.pd_scheme)
        theta = q[2:] + dt / 2 * u[:, 2]
        shape, chain = self.shape, self.scene.robot.chain
        W_J, W_T, W_tau = directions(theta, shape)
        center = centers(np.concatenate([q[:2] + dt / 2 * u[0, :2], theta]), shape)
        heading = np.column_stack([np.cos(theta), np.sin(theta)])
        points = center[shape.link] + shape.place[:, None] * heading[shape.link]
        floor = np.array(
            [
                floor_friction(self.scene, *point, own)
                for point, own in zip(points, chain.spheres.grip, strict=True)
            ]
        )
        mass = np.column_stack([chain.mass, chain.mass, chain.inertia[:, 1, 1]]).ravel()
        start, turn = np.diff(q[2:]), np.diff(u[:, 2])
        law = [
            pd_law(scheme, dt, (start[j], turn[j]), (start[j] + dt / 2 * turn[j], turn[j]),
                   (angle[j], rate[j]), (model.stiffness[j], model.damping[j]))
            for j in range(len(start))
        ]  # fmt: skip
        torque, damping = np.array(law).reshape(-1, 2).T * dt
        angle_mid, stop = (start + dt / 2 * turn)[:, None], model.joint_laws.stop[:, :1]
        low = np.where(angle_mid <= stop[..., 0], 0.0, -np.inf)
        high = np.where(angle_mid >= stop[..., 1], 0.0, np.inf)
        laws = dense_laws(model.joint_laws, dt, torque, damping, low, high)
        force = generalized(pushes, step_of(pushes), flat_frames(theta)).reshape(-1, 6)
        M, momentum = np.diag(mass), mass * u.ravel() + dt * force[:, [0, 1, 4]].ravel()
        viscous = dt * viscosity(self.scene, np.arange(len(floor)), floor[:, 4], 0.0)
        return Terms(theta, floor[:, :3], W_J, W_T, W_tau, M, momentum, laws, viscous, M)

    def with_law(self, terms: Terms, torque: Array, damping: Array) -> Terms:
        """Return the terms with impulses (n-1,) [N m s] and dampings of the yaw axes."""
        W_tau, W_T = terms.W_tau, terms.W_T
        resisting = (W_tau * damping) @ W_tau.T + (W_T * terms.viscous) @ W_T.T
        return terms._replace(
            M_inv=np.linalg.inv(terms.M + resisting),
            momentum=terms.momentum + W_tau @ torque,
        )

    def iterate(
        self, model: PlanarModel, terms: Terms, normal: Array, tangential: Array, limit: int
    ) -> Solution:
        """Iterate loads and friction from some impulses, up to `limit` times, eqs. (84)-(93)."""
        solver, (theta, _, W_J, W_T, _, _, momentum, *_, M_inv) = self.scene.solver, terms
        n, link = len(theta), self.shape.link
        reaction = M_inv @ W_J @ np.linalg.inv(W_J.T @ M_inv @ W_J) if n > 1 else W_J
        c, s = np.cos(theta), np.sin(theta)
        loads = loads_from_friction(theta, self.shape, self.pitch)
        iterations, change = 0, math.inf
        while not change < solver.tolerance and iterations < limit:
            u_E = M_inv @ (momentum + W_T @ tangential.ravel())
            u_E = u_E - reaction @ (W_J.T @ u_E)
            total = tangential - (terms.viscous * (W_T.T @ u_E)).reshape(-1, 2)
            along, across = (np.bincount(link, part, minlength=n) for part in total.T)
            wrench = np.zeros((n, 3))
            wrench[:, 0] = model.mass * model.fall
            wrench[:, 1] = model.height * (s * along + c * across)
            wrench[:, 2] = -model.height * (c * along - s * across)
            P_N, held, roll = loads(wrench.ravel())
            gamma = np.pad((W_T.T @ u_E).reshape(-1, 2), ((0, 0), (1, 2)))
            friction = terms.friction * falling(self.scene, np.arange(len(link)), gamma)
            P_T = self.project(tangential, gamma[:, 1:3], P_N, friction)
            change = float(np.linalg.norm(P_N - normal) + np.linalg.norm(P_T - tangential))
            residual = float(np.linalg.norm(P_T - tangential, axis=1).max() / solver.r_sliding)
            normal, tangential = P_N, P_T
            iterations += 1
        converged = change < solver.tolerance
        return Solution(u_E, normal, tangential, held, roll, iterations, converged, residual)

    def project(self, P: Array, gamma: Array, P_N: Array, friction: Array) -> Array:
        """Return the friction impulses (m, 2) after one projection, for given loads (m,)."""
        radii = friction * np.maximum(P_N, 0.0)[:, None]
        pairs = zip(P - self.scene.solver.r_sliding * gamma, radii, strict=True)
        return np.array([prox_half_ellipses(*x, *radius) for x, radius in pairs])

    def finish(
        self,
        model: PlanarModel,
        work: PlanarWorkspace,
        steps: Steps,
        terms: Terms,
        found: Solution,
        yaw_torque: Array,
    ) -> bool:
        """Move to the end of the step and report it, unless it is not planar; return whether."""
        q, u, history, dt = steps.q, steps.u, steps.history, self.scene.dt
        standing, report, roll = work.standing, steps.report[0], found.roll / dt
        work.contacts['solution']['impulse'][: model.floor, 0] = found.P_N
        standing['least_load'][:], standing['roll'][:] = found.P_N.min(), roll
        standing['part'][:], standing['slips'][:] = 1.0, 0
        laws = model.joint_laws
        most = dt * (laws.torque_limit + laws.friction)[:, 1]
        standing['overloaded'][:] = (np.abs(found.pitch_torque) > most).any()
        if standing['overloaded'][0]:
            return False
        if not (found.P_N.min() > 0.0 and abs(roll) <= model.most_roll):
            return False
        u_E = found.u_E.reshape(-1, 3)
        if model.held and slips_too_far(model, roll, u_E, history.memory):
            standing['slips'][:] = 1
            return False
        history.impulse[:, 0], history.impulse[:, 1:3] = found.P_N, found.P_T
        held_point = model.share @ (centers(q, self.shape) + dt / 2 * (u + u_E)[:, :2])
        q[2:] += dt / 2 * (u + u_E)[:, 2]
        q[:2] += held_point - model.share @ centers(q, self.shape)  # section VII-C
        u[:] = u_E
        work.applied[:] = np.column_stack([yaw_torque, found.pitch_torque])
        report['steps'] += 1
        report['iterations'] += found.iterations
        report['unconverged'] += not found.converged
        report['iterations_max'] = max(report['iterations_max'], found.iterations)
        largest = max(report['residual_max'], found.residual)
        report['residual_max'] = report['printed_residual_max'] = largest
        report['contacts'] = len(found.P_N)
        return True
