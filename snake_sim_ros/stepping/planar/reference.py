"""
The time step of the planar level in dense NumPy: what the compiled one is tested by.

It shares no algebra with `planar`: joints are constraints, W_J and P_J as in `reference`, and the
loads are the least-norm solution of equilibrium, by the pseudoinverse. In the plane a link has the
velocities (v_x, v_y, omega), out of it (v_z, omega_x, omega_y).
"""

from collections.abc import Callable
import math

import numpy as np
from scipy.linalg import null_space

from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import PD_SCHEMES
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.planar.model import PlanarMemory
from snake_sim_ros.stepping.planar.model import PlanarModel
from snake_sim_ros.stepping.planar.model import PlanarWorkspace
from snake_sim_ros.stepping.planar.model import ROLL_LIMIT
from snake_sim_ros.stepping.planar.moreau import SLIP_MEMORY
from snake_sim_ros.stepping.steps import Steps

BALANCE = 1e-9  # share of a load that rounding may leave of its balance


def centers(q: Array, half: Array) -> Array:
    """Return the link centers of planar coordinates [m], shape (n, 2)."""
    reach = half[:, None] * np.column_stack([np.cos(q[2:]), np.sin(q[2:])])
    joints = np.vstack([np.zeros(2), np.cumsum(2 * reach, axis=0)[:-1]])
    return np.asarray(q[:2] - reach[0] + joints + reach)


def directions(theta: Array, half: Array, offset: Array) -> tuple[Array, Array, Array]:
    """
    Return W_J, W_T and W_tau in the plane: ``W^T u`` are velocities of joints, sliding and yaw.

    Shapes (3n, 2(n-1)), (3n, 4n), (3n, n-1); contacts are numbered as in eq. (10).
    """
    n = len(theta)
    W_J, W_T, W_tau = (
        np.zeros((3 * n, 2 * n - 2)),
        np.zeros((3 * n, 4 * n)),
        np.zeros((3 * n, n - 1)),
    )
    for i, (c, s) in enumerate(zip(np.cos(theta), np.sin(theta), strict=True)):
        row, across = 3 * i, np.array([-s, c])
        for a, arm in ((i, offset[i]), (n + i, -offset[i])):
            W_T[row : row + 2, 2 * a], W_T[row : row + 2, 2 * a + 1] = (c, s), across
            W_T[row + 2, 2 * a + 1] = arm
        for j, sign in ((i, 1.0), (i - 1, -1.0)):  # the joint at the front, the one at the rear
            if 0 <= j < n - 1:
                W_J[row : row + 2, 2 * j : 2 * j + 2] = sign * np.eye(2)
                W_J[row + 2, 2 * j : 2 * j + 2] = half[i] * across
                W_tau[row + 2, j] = -sign
    return W_J, W_T, W_tau


def upright_directions(theta: Array, half: Array, offset: Array) -> tuple[Array, Array, Array]:
    """
    Return W_J, W_N and the pitch axes out of the plane, shapes (3n, 2(n-1)), (3n, 2n), (3n, n-1).

    A joint lets its links turn against each other about e_x of the outer one only.
    """
    n = len(theta)
    W_J, W_N, axes = (
        np.zeros((3 * n, 2 * n - 2)),
        np.zeros((3 * n, 2 * n)),
        np.zeros((3 * n, n - 1)),
    )
    heading = np.column_stack([np.cos(theta), np.sin(theta)])
    for i, (c, s) in enumerate(heading):
        row = 3 * i
        for a, arm in ((i, offset[i]), (n + i, -offset[i])):
            W_N[row : row + 3, a] = 1.0, arm * s, -arm * c
        for j, sign in ((i, 1.0), (i - 1, -1.0)):
            if 0 <= j < n - 1:
                x, y = heading[j + 1]
                W_J[row : row + 3, 2 * j] = sign, half[i] * s, -half[i] * c
                W_J[row + 1 : row + 3, 2 * j + 1] = sign * x, sign * y
                axes[row + 1 : row + 3, j] = sign * y, -sign * x
    return W_J, W_N, axes


def loads_from_friction(
    theta: Array, half: Array, offset: Array, pitch_stiffness: Array, wrench: Array
) -> tuple[Array, Array, float]:
    """
    Return the normal impulses of least norm that balance a load out of the plane (3n,).

    The pitch joints hold the one motion that neither contacts nor joint constraints resist, all
    links rolling at once, with torques in the ratios of springs of their stiffness.

    Returns
    -------
    P_N : ndarray, shape (2n,)
    torque : ndarray, shape (n-1,)
        Impulses of the pitch joints [N m s].
    roll : float
        Largest roll of a link that goes with them, with the sign of that of the middle link
        [rad s]; infinite if they do not hold the robot.

    """
    W_J, W_N, axes = upright_directions(theta, half, offset)
    rolling = null_space(np.hstack([W_J, W_N]).T, rcond=1e-9)
    held = (pitch_stiffness[:, None] * (axes.T @ rolling)).sum(axis=1, keepdims=True)
    free = null_space(np.hstack([W_J, axes @ held]).T, rcond=1e-9)
    P_N = np.linalg.pinv(free.T @ W_N, rcond=1e-9) @ (-free.T @ wrench)
    rest = -(wrench + W_N @ P_N)
    resisting = np.hstack([W_J, axes @ held])
    parts = np.linalg.lstsq(resisting, rest, rcond=None)[0]
    heading = np.column_stack([np.cos(theta), np.sin(theta)])
    roll = np.einsum('ik,ik->i', rolling.reshape(len(theta), 3)[:, 1:], heading) * parts[-1]
    balanced = np.abs(resisting @ parts - rest).max() <= BALANCE * np.abs(wrench).max()
    largest = math.copysign(np.abs(roll).max() if balanced else math.inf, roll[len(theta) // 2])
    return P_N, held[:, 0] * parts[-1], largest


def slips_too_far(model: PlanarModel, roll: float, u: Array, memory: PlanarMemory) -> bool:
    """Return whether rolling cannot be left out, as `moreau.rolls_too_far`; if not, note it."""
    left = 1.0 / (1.0 + model.dt / SLIP_MEMORY)
    way = (
        left * memory.way[0] + model.dt * np.linalg.norm(model.mass @ u[:, :2]) / model.mass.sum()
    )
    slip = left * memory.slip[0] + model.radius * abs(roll - memory.roll[0])
    if slip > model.radius * ROLL_LIMIT + model.most_slip * way:
        return True
    memory.roll[0], memory.slip[0], memory.way[0] = roll, slip, way
    return False


def make_loop(scene: Scene) -> Callable[..., None]:
    """Return what `stepper.PlanarStepper` runs."""
    n, dt, solver, friction = scene.robot.link_count, scene.dt, scene.solver, scene.friction
    scheme = PD_SCHEMES.index(scene.pd_scheme)
    pitch = scene.robot.per_joint('stiffness')[:, 1]

    def prox(P: Array, gamma: Array, P_N: Array) -> Array:
        pairs = zip(P - solver.r_sliding * gamma, np.maximum(P_N, 0.0), strict=True)
        mu = friction.longitudinal, friction.transversal
        return np.array([prox_ellipse(*x, mu[0] * load, mu[1] * load) for x, load in pairs])

    def step(
        model: PlanarModel, work: PlanarWorkspace, steps: Steps, angle: Array, rate: Array
    ) -> bool:
        q, u, history, report = steps.q, steps.u, steps.history, steps.report[0]
        impulse = history.impulse
        theta, half, offset = q[2:] + dt / 2 * u[:, 2], model.half_length, model.offset
        W_J, W_T, W_tau = directions(theta, half, offset)
        mass = np.column_stack([model.mass, model.mass, model.inertia]).ravel()
        start, turn = np.diff(q[2:]), np.diff(u[:, 2])
        law = [
            pd_law(scheme, dt, (start[j], turn[j]), (start[j] + dt / 2 * turn[j], turn[j]),
                   (angle[j, 0], rate[j, 0]), model.stiffness[j], model.damping[j])
            for j in range(n - 1)
        ]  # fmt: skip
        torque, damping = np.array(law).reshape(-1, 2).T * dt
        M_inv = np.linalg.inv(np.diag(mass) + (W_tau * damping) @ W_tau.T)
        momentum = mass * u.ravel() + W_tau @ torque
        reaction = M_inv @ W_J @ np.linalg.inv(W_J.T @ M_inv @ W_J) if n > 1 else W_J
        weight = np.tile([0.0, 0.0, 0.0], (n, 1))
        weight[:, 0] = model.mass * model.fall
        normal, tangential, iterations, change = impulse[:, 0], impulse[:, 1:3], 0, math.inf
        while not change < solver.tolerance and iterations < solver.iteration_limit:
            load = momentum + W_T @ tangential.ravel()
            u_E = M_inv @ load
            u_E = u_E - reaction @ (W_J.T @ u_E)
            c, s = np.cos(theta), np.sin(theta)
            along, across = (tangential[:n] + tangential[n:]).T
            wrench = weight.copy()
            wrench[:, 1] = model.radius * (s * along + c * across)
            wrench[:, 2] = -model.radius * (c * along - s * across)
            P_N, held, roll = loads_from_friction(theta, half, offset, pitch, wrench.ravel())
            gamma = (W_T.T @ u_E).reshape(-1, 2)
            P_T = prox(tangential, gamma, P_N)
            change = float(np.linalg.norm(P_N - normal) + np.linalg.norm(P_T - tangential))
            residual = np.linalg.norm(P_T - tangential, axis=1).max() / solver.r_sliding
            normal, tangential = P_N, P_T
            iterations += 1
        work.contacts['impulse'][:, 0] = normal
        standing = work.standing
        standing['least_load'][:], standing['roll'][:] = normal.min(), roll / dt
        standing['part'][:], standing['rolls'][:] = 1.0, 0

        if not (
            work.standing['least_load'][0] > 0.0
            and abs(work.standing['roll'][0]) <= model.most_lean
        ):
            return False
        u_E = u_E.reshape(n, 3)
        if model.held and slips_too_far(model, roll / dt, u_E, history.memory):
            standing['rolls'][:] = 1
            return False
        impulse[:, 0], impulse[:, 1:3] = normal, tangential
        held_point = model.share @ (centers(q, half) + dt / 2 * (u + u_E)[:, :2])
        q[2:] += dt / 2 * (u + u_E)[:, 2]
        q[:2] += held_point - model.share @ centers(q, half)  # section VII-C
        u[:] = u_E
        work.applied[:] = np.column_stack([torque - damping * np.diff(u[:, 2]), held])
        report['steps'] += 1
        report['iterations'] += iterations
        report['unconverged'] += change >= solver.tolerance
        report['iterations_max'] = max(report['iterations_max'], iterations)
        report['residual_max'] = report['printed_residual_max'] = max(
            report['residual_max'], residual
        )
        report['contacts'] = 2 * n
        return True

    def loop(model: PlanarModel, work: PlanarWorkspace, steps: Steps) -> None:
        for angle, rate in zip(steps.angle, steps.rate, strict=True):
            if not step(model, work, steps, angle, rate):
                steps.report['not_planar'][:] = 1
                break

    return loop
