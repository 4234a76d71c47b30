# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The terms of the balance (75) of the links: inertia, momentum and joint torques, about O.

O is the center of the middle link; twists, wrenches and inertias are in axes of I.
"""

from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_control import ControlMemory, held_torque, pd_law
from snake_sim_ros.dynamics.kinematics import JointFrames
from snake_sim_ros.dynamics.mechanism import Mechanism
from snake_sim_ros.scene.chain import JointPlaces
from snake_sim_ros.scene.parameters import Array


@inlined
def control_impulses(
    robot: Mechanism,
    dt: float,
    control: ControlMemory,
    coordinate: Array,
    reference: tuple[Array, Array],
    loads: tuple[Array, Array],
) -> None:
    """
    Fill the impulses and the implicit damping of the controller on every joint axis.

    Parameters
    ----------
    robot : Mechanism
        Gains, PD scheme and control loop.
    dt : float
        Time step [s].
    control : ControlMemory
        That of the control loop, after its sample.
    coordinate : ndarray, shape (2, n-1, 2, 2)
        At start and middle of the step: (yaw, pitch) x (angle [rad], rate [rad/s]).
    reference : tuple of ndarray, shape (n-1, 2)
        Angles and rates (yaw, pitch) at the middle of the step [rad], [rad/s].
    loads : tuple of ndarray, shape (n-1, 2)
        Filled with impulses without their implicit part [N m s], and with the impulse per rate at
        the end of the step [N m s^2].

    """
    start, mid, (angle, rate), (torques, dampings) = coordinate[0], coordinate[1], reference, loads
    for j in range(len(torques)):
        for k in range(2):
            held, stiffness, known_rate = 0.0, robot.stiffness[j, k], rate[j, k]
            if robot.control.present:
                held, stiffness, known_rate = held_torque(
                    robot.control, control, j, k, stiffness, known_rate
                )
            torque, damping = pd_law(
                robot.pd_scheme,
                dt,
                (start[j, k, 0], start[j, k, 1]),
                (mid[j, k, 0], mid[j, k, 1]),
                (angle[j, k], known_rate),
                (stiffness, robot.damping[j, k]),
            )
            torques[j, k] = (held + torque) * dt
            dampings[j, k] = damping * dt


@inlined
def axis_loads(torque: Array, damping: Array, chain: Chain) -> None:
    """
    Fill the torques and damping of the controller in terms of the rates of the joint axes.

    The axes a, b of a joint are at right angles only up to the drift of a step, c = a . b. A
    relative angular velocity s_1 a + s_2 b has the joint rates J s with J = [[1, c], [c, 1]]. A
    torque T on the joint angles is therefore J T on the axes, and a damping K is J K J.

    Parameters
    ----------
    torque, damping : ndarray, shape (n-1, 2)
        Impulse [N m s] and impulse per rate [N m s^2] of yaw and pitch.
    chain : Chain
        The twists of its joint axes are read. Its torque is filled with J T, its damping with the
        entries 11, 12, 22 of J K J.

    """
    axis, axis_torque, axis_damping = chain.axis, chain.torque, chain.damping
    for j in range(len(axis)):
        c = 0.0
        for k in range(3):
            c += axis[j, 0, k] * axis[j, 1, k]
        axis_torque[j, 0] = torque[j, 0] + c * torque[j, 1]
        axis_torque[j, 1] = torque[j, 1] + c * torque[j, 0]
        axis_damping[j, 0] = damping[j, 0] + c * c * damping[j, 1]
        axis_damping[j, 1] = c * (damping[j, 0] + damping[j, 1])
        axis_damping[j, 2] = damping[j, 1] + c * c * damping[j, 0]
    hold_absent_axes(chain)


@inlined
def hold_absent_axes(chain: Chain) -> None:
    """
    Fill the loads of axes that a joint does not have.

    Their twists are 0. With a damping of 1 N m s^2 and no torque, their rates are 0 and they add
    nothing to what other axes and links feel.
    """
    places = chain.places
    if places.complete:
        return
    for j in range(len(chain.torque)):
        for k in range(2):
            if places.present[j, k] == 0.0:
                chain.torque[j, k], chain.damping[j, 2 * k] = 0.0, 1.0


@inlined
def axis_rates(chain: Chain, rate: Array) -> None:
    """Fill what `joint_rates` does from the rates of the joint axes; see `axis_loads`."""
    axis, places = chain.axis, chain.places
    for j in range(len(axis)):
        c = 0.0
        for k in range(3):
            c += axis[j, 0, k] * axis[j, 1, k]
        rate[j, 0] = places.present[j, 0] * (chain.rate[j, 0] + c * chain.rate[j, 1])
        rate[j, 1] = places.present[j, 1] * (chain.rate[j, 1] + c * chain.rate[j, 0])


@inlined
def rates_of_twists(chain: Chain, rate: Array) -> None:
    """Fill what `joint_rates` does from the twists of the links and of the joint axes."""
    axis, twist, places = chain.axis, chain.twist, chain.places
    for j in range(len(axis)):
        outer, parent = (j, j + 1) if j < len(twist) // 2 else (j + 1, j)
        for k in range(2):
            rate[j, k] = 0.0
            for i in range(3):
                rate[j, k] += axis[j, k, i] * (twist[outer, i] - twist[parent, i])
            rate[j, k] *= places.present[j, k]


@inlined
def joint_rates(places: JointPlaces, frames: JointFrames, twist: Array, rate: Array) -> None:
    """
    Fill the rates of all joints, 0 for axes that a joint does not have.

    Parameters
    ----------
    places : JointPlaces
    frames : JointFrames
    twist : ndarray, shape (n, 6)
        Twists of the links.
    rate : ndarray, shape (n-1, 2)
        Filled [rad/s].

    """
    for j in range(len(rate)):
        yaw_rate = pitch_rate = 0.0
        for k in range(3):
            relative = twist[j + 1, k] - twist[j, k]
            yaw_rate += frames.inner[j, k, 1] * relative
            pitch_rate += frames.outer[j, k, 0] * relative
        rate[j, 0] = places.present[j, 0] * yaw_rate
        rate[j, 1] = places.present[j, 1] * pitch_rate


@inlined
def link_inertia(robot: Mechanism, R: Array, center: Array, inertia: Array) -> None:
    """
    Fill the inertia of every link about O, eqs. (47), (48).

    Parameters
    ----------
    robot : Mechanism
        Masses and moments of inertia.
    R : ndarray, shape (n, 3, 3)
        Link frames in I.
    center : ndarray, shape (n, 3)
        Link centers from O [m].
    inertia : ndarray, shape (n, 6, 6)
        Filled [kg m^2], [kg m], [kg].

    """
    for i in range(len(R)):
        m, transversal = robot.mass[i], robot.inertia_transversal[i]
        slender = robot.inertia_axial[i] - transversal
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        square = x * x + y * y + z * z
        A = inertia[i]
        for k in range(3):
            for j in range(3):
                A[k, j] = slender * R[i, k, 2] * R[i, j, 2] - m * center[i, k] * center[i, j]
                A[k + 3, j + 3] = 0.0
            A[k, k] += transversal + m * square
            A[k + 3, k + 3] = m
            A[k, k + 3] = A[k + 3, k] = 0.0
        A[0, 4] = A[4, 0] = -m * z
        A[0, 5] = A[5, 0] = m * y
        A[1, 3] = A[3, 1] = m * z
        A[1, 5] = A[5, 1] = -m * x
        A[2, 3] = A[3, 2] = -m * y
        A[2, 4] = A[4, 2] = m * x
    if not robot.slender:
        for i in range(len(R)):
            add_uneven_inertia(R[i], robot.uneven[i], inertia[i])


@inlined
def add_uneven_inertia(R: Array, uneven: Array, A: Array) -> None:
    """Add ``R T R^T`` to an inertia A about O, with what the inertia of a link has besides."""
    for k in range(3):
        a0 = R[k, 0] * uneven[0, 0] + R[k, 1] * uneven[1, 0] + R[k, 2] * uneven[2, 0]
        a1 = R[k, 0] * uneven[0, 1] + R[k, 1] * uneven[1, 1] + R[k, 2] * uneven[2, 1]
        a2 = R[k, 0] * uneven[0, 2] + R[k, 1] * uneven[1, 2] + R[k, 2] * uneven[2, 2]
        for j in range(3):
            A[k, j] += a0 * R[j, 0] + a1 * R[j, 1] + a2 * R[j, 2]


@inlined
def smooth_momentum(
    robot: Mechanism,
    dt: float,
    velocities: tuple[Array, Array],
    R: Array,
    center: Array,
    momentum: Array,
) -> None:
    """
    Fill the momentum ``M u + h(u_h) dt`` of every link as a wrench about O, eq. (75).

    Parameters
    ----------
    robot : Mechanism
        Masses, moments of inertia and gravity.
    dt : float
        Time over which gravity and gyroscopic torques act [s].
    velocities : tuple of ndarray, shape (n, 6)
        u and u_h: velocities [m/s, frame I] and angular velocities [rad/s, frame B], of the
        momentum and of the gyroscopic torques.
    R : ndarray, shape (n, 3, 3)
        Link frames in I.
    center : ndarray, shape (n, 3)
        Link centers from O [m].
    momentum : ndarray, shape (n, 6)
        Filled: moment about O [N m s] and impulse [N s], in axes of I.

    """
    u, u_h = velocities
    for i in range(len(u)):
        slender = (robot.inertia_axial[i] - robot.inertia_transversal[i]) * dt
        wx, wy, wz = u_h[i, 3], u_h[i, 4], u_h[i, 5]
        lx = robot.inertia_transversal[i] * u[i, 3] - slender * wy * wz
        ly = robot.inertia_transversal[i] * u[i, 4] + slender * wz * wx
        lz = robot.inertia_axial[i] * u[i, 5]
        px = robot.mass[i] * (u[i, 0] + dt * robot.gravity[0])
        py = robot.mass[i] * (u[i, 1] + dt * robot.gravity[1])
        pz = robot.mass[i] * (u[i, 2] + dt * robot.gravity[2])
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        momentum[i, 0] = R[i, 0, 0] * lx + R[i, 0, 1] * ly + R[i, 0, 2] * lz + y * pz - z * py
        momentum[i, 1] = R[i, 1, 0] * lx + R[i, 1, 1] * ly + R[i, 1, 2] * lz + z * px - x * pz
        momentum[i, 2] = R[i, 2, 0] * lx + R[i, 2, 1] * ly + R[i, 2, 2] * lz + x * py - y * px
        momentum[i, 3], momentum[i, 4], momentum[i, 5] = px, py, pz
    if not robot.slender:
        for i in range(len(u)):
            add_uneven_momentum(dt, robot.uneven[i], u[i], u_h[i], R[i], momentum[i])


@inlined
def add_uneven_momentum(
    dt: float, T: Array, u: Array, u_h: Array, R: Array, momentum: Array
) -> None:
    """
    Add to the momentum of a link what the inertia T that it has besides contributes.

    Other arguments are those of `smooth_momentum`, of one link.
    """
    wx, wy, wz = u_h[3], u_h[4], u_h[5]
    hx = T[0, 0] * wx + T[0, 1] * wy + T[0, 2] * wz
    hy = T[1, 0] * wx + T[1, 1] * wy + T[1, 2] * wz
    hz = T[2, 0] * wx + T[2, 1] * wy + T[2, 2] * wz
    lx = T[0, 0] * u[3] + T[0, 1] * u[4] + T[0, 2] * u[5] - dt * (wy * hz - wz * hy)
    ly = T[1, 0] * u[3] + T[1, 1] * u[4] + T[1, 2] * u[5] - dt * (wz * hx - wx * hz)
    lz = T[2, 0] * u[3] + T[2, 1] * u[4] + T[2, 2] * u[5] - dt * (wx * hy - wy * hx)
    for k in range(3):
        momentum[k] += R[k, 0] * lx + R[k, 1] * ly + R[k, 2] * lz
