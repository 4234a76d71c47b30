# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What must hold in a run, whatever the scene; every check yields a sentence for what does not.

`of_step` judges one step of the paper in dense matrices, which share no code with the compiled
solvers. With the impulses P of its contacts and the torques of its controllers:

- Balance (75): the momentum that these do not account for is that of the joints.
- Energy: contacts, joint friction and stops only take it. Joints are closed by a projection in the
  metric of the kinetic energy, and P . gamma <= 0 with the velocities gamma after the step. So the
  kinetic energy is at most that of the same step without contacts.
- Signorini: P_N >= 0, only where the gap is closed; closed contacts do not approach each other.
- Coulomb: friction is within its half ellipses, and takes energy.

Numbers of a computer make each an inequality with a tolerance: `ROUNDING` of the largest velocity,
and what the selection rule and the residual of the step leave.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from snake_sim_benchmarks.coordinates import (
    end_coordinates,
    middle_coordinates,
    with_unit_parameters,
)
from snake_sim_benchmarks.energy import mechanical_energy
from snake_sim_ros import Report, Scene, State
from snake_sim_ros.contact.closing import closed_gap
from snake_sim_ros.contact.detection import reach_of_step
from snake_sim_ros.contact.placing import world_geometry
from snake_sim_ros.contact.surroundings import ORDER
from snake_sim_ros.dynamics.force_directions import (
    joint_directions,
    joint_gaps,
    mass_matrix,
    mean_delassus,
    scene_contacts,
    smooth_forces,
    torque_directions,
)
from snake_sim_ros.dynamics.joint_laws import make_joint_laws
from snake_sim_ros.scene.obstacles import contact_friction, contact_geometry, OF_CAPSULE, OF_SPHERE
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import center_of_mass, joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.samples import Samples

ROUNDING = 1e-7  # of the largest velocity that a step deals with
FASTEST = 500.0  # steps of an explicit controller that explodes are not judged [m/s], [rad/s]
ALIKE = 1e-6  # difference of normals, in the direction that orders them
SIDEWAYS = 10.0  # way that closes gaps in a world, over the gaps
UNKNOWN = 1e-5  # gap in a world that the checks do not find [m]
CLOSED = 1e-9  # joint gaps after the drift correction, over the length of the robot


def of_run(
    scene: Scene, start: State, samples: Samples, report: Report, depth: float
) -> Iterator[str]:
    """
    Check what holds for every method.

    Parameters
    ----------
    scene : Scene
    start : State
    samples : Samples
        Of all steps that were done, in the same order.
    report : Report
    depth : float
        Penetration at the start [m].

    """
    q, u = samples.q, samples.u
    if not all(np.isfinite(array).all() for array in samples[2:]):
        yield 'finite: a sample is not finite'
        return
    length = np.linalg.norm(q[..., 3:], axis=-1)
    if np.abs(length - 1.0).max(initial=0.0) > 1e-9:
        yield f'unit: Euler parameters have the length {length.max():.12g}'
    robot = scene.robot
    size = float(robot.per_link('link_length').sum())
    if len(q) and scene.drift_correction != 'none':
        gap = float(np.abs(joint_gaps(robot, q[-1])).max(initial=0.0))
        if gap > CLOSED * (1.0 + size + np.abs(q[-1, :, :3]).max()):
            yield f'joints: they are open by {gap:.3g}'
    reach = float((robot.per_link('contact_offset') + robot.per_link('contact_radius')).max())
    moved = np.concatenate([start.u[None], u])
    speed = np.linalg.norm(moved[..., :3], axis=-1) + reach * np.linalg.norm(
        moved[..., 3:], axis=-1
    )
    way = scene.dt * float(speed.max())
    # What a step that does not converge lets in, later ones do not undo.
    deepest = depth + 1.5 * way * (1 + report.unconverged) + 1e-5 + 1e-6 * len(q)
    # A sphere that moves further than its radius in a step may step over the edge of a cell or
    # through a wall.
    has_walls = scene.ground.heights or scene.world
    steps_over = has_walls and way > 0.2 * robot.per_link('contact_radius').min()
    if report.penetration_max > deepest and not steps_over:
        yield f'penetration: {report.penetration_max:.3g} m, at most {deepest:.3g} m expected'
    laws = make_joint_laws(robot)
    if laws.has_stops and len(q):
        angle, first = joint_angles(q, robot), joint_angles(start.q, robot)
        low, high = np.minimum(first, laws.stop[..., 0]), np.maximum(first, laws.stop[..., 1])
        beyond = float(np.maximum(angle - high, low - angle).max(initial=0.0))
        turn = 4.0 * scene.dt * float(np.linalg.norm(moved[..., 3:], axis=-1).max())
        if beyond > turn + 1e-9:
            yield f'stop: a joint is {beyond:.4g} rad beyond its stop'


class Terms(NamedTuple):
    """The terms of the balance (75) of a step, in dense matrices."""

    q_M: Array  # (n, 7) coordinates in its middle
    mass: Array  # (6n,) diagonal of M
    W_J: Array  # (6n, 4(n-1)) directions of the joints
    W_tau: Array  # (6n, 2(n-1)) of the axes
    gap: Array  # (contacts,) [m]
    W: Array  # (6n, contacts, 5) directions of the contacts
    force: Array  # (6n,) impulses of gravity, gyroscopic torques and controllers
    grip: Array  # (contacts,) factor of the friction of what is touched
    numbered: bool  # whether contacts with a world have the numbers of the step for certain


def dense_terms(scene: Scene, before: State, torque: Array) -> Terms:
    """Return the terms of a step; parameters are those of `of_step`."""
    q_M = with_unit_parameters(middle_coordinates(before, scene.dt))
    R, mass = rotation_matrices(q_M[:, 3:]), np.diag(mass_matrix(scene.robot))
    W_tau, (geometry, grip) = torque_directions(scene.robot, R), _with_world(scene, q_M)
    numbered = not scene.world or _is_numbered(scene, geometry[0], geometry[2])
    gap, *directions = scene_contacts(scene, q_M, geometry)
    parts = [part.reshape(len(mass), len(gap), -1) for part in directions]
    h = smooth_forces(scene.robot, np.array(scene.gravity), before.u)
    force = scene.dt * (h + W_tau @ torque.ravel())
    W = np.concatenate(parts, axis=2)
    return Terms(q_M, mass, joint_directions(scene.robot, R), W_tau, gap, W, force, grip, numbered)


def _with_world(scene: Scene, q: Array) -> tuple[tuple[Array, Array, Array], Array]:
    """Return the geometry of all contacts, those with a world too, and the grip of its solids."""
    geometry = contact_geometry(scene, q)
    if not scene.world:
        return geometry, np.ones(len(geometry[0]))
    *of_world, grip = world_geometry(scene, q)
    is_near = np.isfinite(of_world[0])
    for array, own in zip(geometry, of_world, strict=True):
        array[is_near] = own[is_near]
    return geometry, grip


def _is_numbered(scene: Scene, gap: Array, frame: Array) -> bool:
    """Return whether the normals of no shape are so similar that rounding decides their order."""
    chain = scene.robot.chain
    spheres, capsules = np.arange(len(chain.spheres.link)), np.arange(len(chain.capsules.link))
    of_sphere, of_capsule = np.repeat(spheres, OF_SPHERE), np.repeat(capsules, OF_CAPSULE)
    shape = np.concatenate([spheres, len(spheres) + of_sphere, 2 * len(spheres) + of_capsule])
    near = np.flatnonzero(np.isfinite(gap[: len(shape)]))
    key = frame[near, 0] @ ORDER
    order = np.lexsort([key, shape[near]])
    same = np.diff(shape[near][order]) == 0
    return bool((np.diff(key[order])[same] > ALIKE).all())


def of_step(
    scene: Scene, before: State, after: State, torque: Array, impulse: Array, *, converged: bool
) -> Iterator[str]:
    """
    Check one step of the paper at the spatial level.

    Parameters
    ----------
    scene : Scene
    before, after : State
    torque : ndarray, shape (n-1, 2)
        Torques of the controllers [N m].
    impulse : ndarray, shape (contacts, 5)
        [N s]
    converged : bool
        Whether contacts must obey their laws; else only the energy is judged.

    """
    robot = scene.robot
    terms = dense_terms(scene, before, torque)
    mass, W_J, gap, W, force = terms.mass, terms.W_J, terms.gap, terms.W, terms.force
    closed = np.flatnonzero(impulse.any(axis=1))
    if scene.world:  # where rounding decides whether a place is one, others have its number
        reach = reach_of_step(_tolerance(scene), scene.dt / 2)
        converged &= terms.numbered and not (gap[closed] > reach + 1e-9).any()
    u_A, u_E = before.u.ravel(), after.u.ravel()
    contacts = np.einsum('rkj,kj->rk', W[:, closed], impulse[closed])
    sums = np.abs(contacts / mass[:, None]).sum(axis=1)
    scale = max(1e-3, *(float(np.abs(part).max()) for part in (u_A, u_E, force / mass, sums)))
    if scale > FASTEST:
        return
    # Laws of the joints have impulses of their own on the axes: then these are not judged.
    held = np.hstack([W_J, terms.W_tau]) if make_joint_laws(robot).present else W_J
    left = u_E - u_A - (force + contacts.sum(axis=1)) / mass
    off = float(np.abs(projected(mass, held, left)).max())
    viscous = scene.friction.viscous_longitudinal or scene.friction.viscous_transversal
    if converged and not viscous and off > ROUNDING * scale:
        yield f'balance: velocities are off by {off:.3g}, of {scale:.3g}'
    open_rate = float(np.abs(W_J.T @ u_E).max(initial=0.0))
    if open_rate > ROUNDING * scale:
        yield f'joints: they open at {open_rate:.3g}, of {scale:.3g}'
    P = impulse[closed]
    if converged:
        yield from _of_contacts(scene, terms, u_E, impulse, scale)
        yield from _of_cone(scene, terms, closed, P, scale)
    free = projected(mass, W_J, u_A + force / mass)
    energy, most = (0.5 * float(mass @ u**2) for u in (u_E, free))
    slack = _press(scene, impulse) + 10 * scene.solver.residual_tolerance
    most += np.abs(P).sum() * slack + ROUNDING * float(mass.sum()) * scale**2
    if energy > most:
        yield f'energy: {energy:.6g} J after a step, at most {most:.6g} J without contacts'
    if scene.drift_correction != 'paper':
        tolerance = _tolerance(scene)
        lands = bool((gap[impulse[:, 0] > 0.0] > tolerance).any())
        yield from _of_center(scene, before, after, scale, np.abs(P).sum() if lands else 0.0)


def _of_center(
    scene: Scene, before: State, after: State, scale: float, landing: float
) -> Iterator[str]:
    """
    Check that the center of mass moved by its mean velocity.

    After a landing, with impulses of the size `landing` [N s], other velocities moved it for half
    a step: those with which contacts close their gaps.
    """
    m = scene.robot.per_link('link_mass')
    q_M = middle_coordinates(before, scene.dt)
    free = end_coordinates(q_M, after.u, scene.dt)
    gaps = np.array([_with_world(scene, q)[0][0] for q in (free, after.q)])
    known, left = np.isfinite(gaps).all(axis=0), np.isfinite(gaps[0])
    # Gaps are closed by a move that no velocity has; the center moves by no more than contacts do.
    closed = float(np.abs(np.diff(gaps[:, known], axis=0)).max(initial=0.0))
    if scene.world:  # contacts that have another number after the move
        closed = max(closed, float(-gaps[0, left & np.logical_not(known)].min(initial=0.0)))
    moved = center_of_mass(scene.robot, after.q) - center_of_mass(scene.robot, before.q)
    mean = 0.5 * scene.dt * (before.u[:, :3] + after.u[:, :3])
    error = float(np.abs(moved - m @ mean / m.sum()).max())
    closed += 0.5 * scene.dt * landing / float(m.sum())
    if scene.world:  # where contacts have other numbers then, and normals are nearly parallel
        closed = SIDEWAYS * closed + UNKNOWN
    if error > closed + 1e-12 * (1.0 + np.abs(after.q[:, :3]).max() + scene.dt * scale):
        yield f'center of mass: it moved {error:.3g} m more than its velocity'


def projected(mass: Array, held: Array, u: Array) -> Array:
    """Return the velocities next to u, in the metric of the masses, without those of `held`."""
    if not held.shape[1]:
        return u
    root = np.sqrt(mass)
    columns = held / root[:, None]
    size = np.linalg.norm(columns, axis=0)
    basis, _ = np.linalg.qr(columns / np.where(size > 0.0, size, 1.0))
    scaled = root * u
    return np.asarray((scaled - basis @ (basis.T @ scaled)) / root)


def _tolerance(scene: Scene) -> float:
    """Return the gap up to which a contact counts as closed [m]."""
    return closed_gap(scene.solver.activation_tolerance, scene.dt)


def _press(scene: Scene, impulse: Array) -> float:
    """Return the velocity at which the selection rule may press contacts in [m/s]."""
    largest = float(impulse[:, 0].max(initial=0.0))
    return 2e-6 + scene.solver.normal_compliance * mean_delassus(scene.robot) * largest


def _of_contacts(
    scene: Scene, terms: Terms, u: Array, impulse: Array, scale: float
) -> Iterator[str]:
    """Check Signorini's law and the sense of friction, after a step that converged."""
    slack = _press(scene, impulse) + 10 * scene.solver.residual_tolerance + ROUNDING * scale
    tolerance = _tolerance(scene)
    gap, loaded = terms.gap, impulse[:, 0] > 0.0
    if (gap[loaded] > reach_of_step(tolerance, scene.dt / 2) + 1e-9).any():
        yield f'complementarity: a force at a gap of {gap[loaded].max():.3g} m'
    gamma = np.einsum('rkj,r->kj', terms.W, u)
    touching = gap <= tolerance - 1e-9
    if scene.world:  # a solid may hide the floor
        touching[: len(scene.robot.chain.spheres.link)] = False
    if (gamma[touching, 0] < -slack).any():
        yield f'penetration: a closed contact approaches at {-gamma[touching, 0].min():.3g} m/s'
    if (gamma[loaded, 0] > slack).any():
        yield f'complementarity: a force where {gamma[loaded, 0].max():.3g} m/s open the contact'
    for part, name in ((slice(1, 3), 'sliding'), (slice(3, 5), 'rolling')):
        power = (impulse[:, part] * gamma[:, part]).sum(axis=1)
        size = np.linalg.norm(impulse[:, part], axis=1)
        excess = power - size * slack
        if (excess > 0.0).any():
            yield f'friction: {name} makes {excess.max():.3g} J'


def _of_cone(scene: Scene, terms: Terms, closed: Array, P: Array, scale: float) -> Iterator[str]:
    """Check that impulses are within their sets."""
    if not len(closed):
        return
    if (P[:, 0] < 0.0).any():
        yield f'cone: a normal impulse of {P[:, 0].min():.3g} N s'
    friction = contact_friction(scene, closed, terms.q_M) * terms.grip[closed, None]
    # Friction along e_x acts against sliding: it is negative while sliding forward.
    along = np.where(P[:, 1] <= 0.0, friction[:, 0], friction[:, 1])
    # The residual of a step moves impulses by as much as stops the robot at this velocity.
    error = 10 * scene.solver.residual_tolerance + 1e-3 * ROUNDING * scale
    tiny = error * float(scene.robot.per_link('link_mass').sum())
    for name, x, y, mu_x, mu_y in (
        ('sliding', P[:, 1], P[:, 2], along, friction[:, 2]),
        ('rolling', P[:, 3], P[:, 4], friction[:, 3], friction[:, 3]),
    ):
        # What is left of a force of size `tiny` in the ellipse, whose half axes may be 0.
        x, y = (np.sign(part) * np.maximum(np.abs(part) - tiny, 0.0) for part in (x, y))
        inside = (x * mu_y) ** 2 + (y * mu_x) ** 2 <= (mu_x * mu_y * (P[:, 0] + tiny)) ** 2
        inside &= (mu_x > 0.0) | (x == 0.0)
        inside &= (mu_y > 0.0) | (y == 0.0)
        if not inside.all():
            k = int(inside.argmin())
            yield (
                f'cone: {name} friction ({x[k]:.3g}, {y[k]:.3g}) N s with coefficients '
                f'{mu_x[k]:.3g}, {mu_y[k]:.3g} under a load of {P[k, 0]:.3g} N s'
            )


def passive_energy(scene: Scene, state: State, angle: Array, depth: float) -> float:
    """
    Return the energy of a robot and of the springs of its controllers [J].

    It is 0 in the lowest configuration: at rest, with all contacts at a depth [m] in the floor.
    The spheres of a link are on both sides of its center, so that none is lower.
    """
    robot = scene.robot
    spring = 0.5 * robot.per_joint('stiffness') * (joint_angles(state.q) - angle) ** 2
    height = robot.per_link('contact_radius') - depth
    lowest = -scene.gravity[2] * float(robot.per_link('link_mass') @ height)
    return float(mechanical_energy(scene, state.q, state.u) + spring.sum()) - lowest
