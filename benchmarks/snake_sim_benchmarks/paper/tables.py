# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the paper's figures as tables, and the effects of its printed errors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import math
from pathlib import Path

import numpy as np

from snake_sim_benchmarks.coordinates import (
    end_coordinates,
    middle_coordinates,
    with_unit_parameters,
)
from snake_sim_benchmarks.paper.experiments import (
    Experiment,
    mean_velocity,
    mirrored,
    other_side,
    path_of,
    PATH_RATE,
    RATE,
    reversed_wave,
)
from snake_sim_ros import Robot, Scene, Solver, State
from snake_sim_ros.dynamics.force_directions import (
    joint_directions,
    mass_matrix,
    smooth_forces,
    torque_directions,
)
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES
from snake_sim_ros.scene.posture import center_of_mass, joint_angles, joint_rates
from snake_sim_ros.scene.rotations import product, rotation_matrices
from snake_sim_ros.stepping.state import initial_state

# ---- printed errors: inertia from half the radius, sign in eq. (84) -----------------------------


def consistent(scene: Scene) -> Scene:
    """Return the scene with moments of inertia from the radius as the paper states it."""
    return replace(scene, robot=replace(scene.robot, inertia='consistent'))


def controller_torques(scene: Scene, state: State, q_M: Array, angle: Array, rate: Array) -> Array:
    """Return the torques (2(n-1),) of the joint controllers, all explicit terms [N m]."""
    robot, scheme = scene.robot, PD_SCHEMES.index(scene.pd_scheme)
    starts = np.stack([joint_angles(state.q), joint_rates(state.q, state.u)], -1)
    mids = np.stack([joint_angles(q_M), joint_rates(q_M, state.u)], -1)
    references = np.stack([angle, rate], -1)
    gains = np.stack([robot.per_joint('stiffness'), robot.per_joint('damping')], -1)
    torque = np.zeros(angle.shape)
    for axis in np.ndindex(angle.shape):
        rows = (each[axis].tolist() for each in (starts, mids, references, gains))
        start, mid, reference, gain = ((first, second) for first, second in rows)
        torque[axis], _ = pd_law(scheme, scene.dt, start, mid, reference, gain)
    return torque.ravel()


def with_closed_joints(robot: Robot, q: Array, rule: str) -> Array:
    """Return the coordinates without the drift of joints, section VII-C; see `joint_drift`."""
    q = with_unit_parameters(q)
    if rule == 'none':
        return q
    center, half = center_of_mass(robot, q), robot.per_link('link_length') / 2
    for i in range(robot.link_count - 1):
        inner, outer = rotation_matrices(q[i : i + 2, 3:])
        normal, sine = np.cross(inner[:, 1], outer[:, 0]), inner[:, 1] @ outer[:, 0]
        turn = np.arctan2(sine, np.linalg.norm(normal))
        axis = np.sin(turn / 2) / np.linalg.norm(normal) * normal
        q[i + 1, 3:] = product(np.array([np.cos(turn / 2), *axis]), q[i + 1, 3:])
        outer = rotation_matrices(q[i + 1 : i + 2, 3:])[0]
        q[i + 1, :3] = q[i, :3] + half[i] * inner[:, 2] + half[i + 1] * outer[:, 2]
    if rule == 'center_of_mass':
        q[:, :3] += center - center_of_mass(robot, q)
    return q


def step_in_the_air(
    scene: Scene, state: State, angle: Array, rate: Array, sign: float
) -> tuple[State, float, float]:
    """
    Take a step without contacts, with a sign for the first term of eq. (84).

    The step is ``P_J = -G_J^-1 (sign W_J^T u_A + W_J^T M^-1 (h + tau_C) dt)`` with
    ``G_J = W_J^T M^-1 W_J``, so that ``W_J^T u_E = (1 - sign) W_J^T u_A``.

    Parameters
    ----------
    scene : Scene
        With a joint controller of the start or the middle of the step.
    state : State
    angle, rate : ndarray, shape (n-1, 2)
        Joint references [rad], [rad/s].
    sign : float
        1 as derived, -1 as printed.

    Returns
    -------
    state : State
    before, after : float
        Largest rate of a joint gap of u_A and of u_E, in the directions of the step [m/s].

    """
    robot, dt, u_A = scene.robot, scene.dt, state.u.ravel()
    q_M = middle_coordinates(state, dt)
    unit_q_M = with_unit_parameters(q_M)
    R = rotation_matrices(unit_q_M[:, 3:])
    W_J, M_inv = joint_directions(robot, R), 1.0 / np.diag(mass_matrix(robot))
    torque = controller_torques(scene, state, unit_q_M, angle, rate)
    h = smooth_forces(robot, np.array(scene.gravity), state.u)
    gained = M_inv * (h + torque_directions(robot, R) @ torque) * dt
    G_J = W_J.T @ (M_inv[:, None] * W_J)
    P_J = -np.linalg.solve(G_J, sign * W_J.T @ u_A + W_J.T @ gained)
    u_E = u_A + gained + M_inv * (W_J @ P_J)
    u = u_E.reshape(state.u.shape)
    q = end_coordinates(q_M, u, dt)
    rates = [float(np.abs(W_J.T @ v).reshape(-1, 4)[:, :3].max()) for v in (u_A, u_E)]
    q = with_closed_joints(robot, q, scene.drift_correction)
    return State(q, u), rates[0], rates[1]


# ---- tables -------------------------------------------------------------------------------------


SHOWN_STEPS = (1, 2, 3, 5, 10, 20, 30, 40)  # steps in the table of the sign in eq. (84)

Change = tuple[str, Callable[[Scene], Scene]]
PRINTED = Solver(normal_compliance=0.0, activation_tolerance=0.0)
CHOICES: list[Change] = [
    ('half the time step', lambda scene: replace(scene, dt=scene.dt / 2)),
    ('joint torques of the middle of a step', lambda scene: replace(scene, pd_scheme='midpoint')),
    ('normal forces as the solver finds them', lambda scene: replace(scene, solver=PRINTED)),
]


def write_tables(
    folder: Path,
    undulation: Experiment,
    isotropic: Mapping[float, Array],
    sidewinding: Experiment,
) -> list[Path]:
    """Write the tables of cases A, B, C and of the printed errors, and return their files."""
    tables = {
        'paths': path_table(undulation, isotropic, sidewinding),
        'checks': check_table(undulation, sidewinding),
        'choices': choices_table(undulation, sidewinding),
        'inertia': inertia_table(undulation, sidewinding),
        'sign': sign_table(undulation.scene),
    }
    files = [folder / f'{name}.md' for name in tables]
    for file, text in zip(files, tables.values(), strict=True):
        write_whole(file, text)
    return files


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ['---'] * len(head), *rows]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def weight(scene: Scene) -> float:
    """Return the weight of the robot [N]."""
    return float(scene.robot.per_link('link_mass').sum() * math.hypot(*scene.gravity))


def millimeters(values: Array) -> list[str]:
    """Return numbers in m or m/s as texts in mm or mm/s; a rounded zero has no sign."""
    return [f'{1e3 * value:.1f}'.replace('-0.0', '0.0') for value in values]


def path_row(name: str, scene: Scene, path: Array, rate: float) -> list[str]:
    """Return the row of a path: its end point and its mean velocity."""
    velocity = mean_velocity(scene, path, rate)
    return [name, *millimeters((path[-1] - path[0])[:2]), *millimeters(velocity)]


def path_table(
    undulation: Experiment, isotropic: Mapping[float, Array], sidewinding: Experiment
) -> str:
    """Return where link 6 got in every case and in variations that must reverse it."""
    A, C = undulation.scene, sidewinding.scene
    rows = [path_row('A', A, undulation.trajectory.path, RATE)]
    for name, scene in (('A, -A_h', mirrored(A)), ('A, -delta_h', reversed_wave(A))):
        rows.append(path_row(name, scene, path_of(scene), PATH_RATE))
    for mu, path in isotropic.items():
        rows.append(path_row(f'B, friction {mu:g}', A, path, PATH_RATE))
    rows.append(path_row('C', C, sidewinding.trajectory.path, RATE))
    scene = other_side(C)
    rows.append(path_row('C, -delta_0', scene, path_of(scene), PATH_RATE))
    return table(['case', 'x [mm]', 'y [mm]', 'v_x [mm/s]', 'v_y [mm/s]'], rows)


def check_table(undulation: Experiment, sidewinding: Experiment) -> str:
    """Return the table of checks, for case A and case C."""
    columns = [checks(case) for case in (undulation, sidewinding)]
    rows = [[name, *(column[name] for column in columns)] for name in columns[0]]
    return table(['', 'A', 'C'], rows)


def checks(case: Experiment) -> dict[str, str]:
    """Return the numbers of a case other than those of its path."""
    total = case.normal_force.sum(axis=1)
    later = case.normal_force[case.periods > case.scene.gait.soft_start]
    loaded = (later > 0.0).sum(axis=1) if len(later) else np.zeros(1)
    error = np.degrees(np.abs(case.tracking_error)).max(axis=(0, 1))
    torque = np.abs(case.torque).max(axis=(0, 1))
    report = case.trajectory.report
    return {
        'sum of the normal forces, mean': f'{total.mean():.3f} N',
        'sum of the normal forces, least to largest': f'{total.min():.2f} to {total.max():.2f} N',
        'largest normal force of a sphere': f'{case.normal_force.max():.1f} N',
        'loaded spheres after the soft start, mean': f'{loaded.mean():.1f}',
        'loaded spheres after the soft start, range': f'{loaded.min():.0f} to {loaded.max():.0f}',
        'largest yaw torque': f'{torque[0]:.2f} N m',
        'largest pitch torque': f'{torque[1]:.2f} N m',
        'largest yaw error': f'{error[0]:.2f} deg',
        'largest pitch error': f'{error[1]:.3f} deg',
        'work of the joints': f'{case.joint_work[-1]:.2f} J',
        'work of the contacts': f'{case.contact_work[-1]:.2f} J',
        'mechanical energy gained': f'{case.energy[-1]:.2f} J',
        'energy left over, largest': f'{1e3 * np.abs(case.left_over).max():.2f} mJ',
        'deepest penetration': f'{1e6 * report.penetration_max:.0f} um',
        'unconverged steps': f'{report.unconverged} of {report.steps}',
    }


def inertia_table(*cases: Experiment) -> str:
    """Return the changes of the path of link 6 with consistent moments of inertia."""
    return comparison([('inertia from the stated radius', consistent)], cases)


def choices_table(*cases: Experiment) -> str:
    """Return the changes of the path of link 6 with other choices than ours."""
    return comparison(CHOICES, cases)


def comparison(changes: Sequence[Change], cases: Sequence[Experiment]) -> str:
    """Return the largest distances of paths of link 6 in A and C with and without changes."""
    rows = []
    for name, case in zip('AC', cases, strict=True):
        path = case.trajectory.path[:: round(RATE / PATH_RATE), :2]
        for words, change in changes:
            changed = path_of(change(case.scene))[:, :2]
            apart = np.linalg.norm(changed - path, axis=1).max()
            share = 100 * apart / np.linalg.norm(path[-1] - path[0])
            ends = [', '.join(millimeters(each[-1] - each[0])) for each in (path, changed)]
            rows.append([name, words, *ends, f'{1e3 * apart:.2f}', f'{share:.2g} %'])
    head = ['case', 'change', 'x, y before [mm]', 'x, y after [mm]', 'apart at most [mm]']
    return table([*head, 'of the distance'], rows)


def sign_table(scene: Scene) -> str:
    """Return the rates of the joint gaps after steps of case A with both signs in (84)."""
    rates = {sign: joint_gap_rates(scene, sign, SHOWN_STEPS[-1]) for sign in (1.0, -1.0)}
    rows = [[f'{k}', *(f'{rates[sign][k - 1]:.1e}' for sign in rates)] for k in SHOWN_STEPS]
    return table(['step', 'as derived [m/s]', 'as scanned [m/s]'], rows)


def joint_gap_rates(scene: Scene, sign: float, steps: int) -> list[float]:
    """
    Return the largest rate of a joint gap at the end of each step from the start [m/s].

    Parameters
    ----------
    scene : Scene
    sign : float
        See `printed_errors.step_in_the_air`.
    steps : int

    """
    scene = replace(scene, pd_scheme='midpoint')
    state, rates = initial_state(scene), []
    for k in range(steps):
        wanted = gait.reference(scene.gait, (k + 0.5) * scene.dt, scene.robot.link_count - 1)
        state, _, after = step_in_the_air(scene, state, *wanted, sign)
        rates.append(after)
    return rates
