"""The planar level as a stepper: states of links in space from planar coordinates, and back."""

from collections.abc import Callable
import math

import numpy as np

from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.rotations import FLAT
from snake_sim_ros.scene.rotations import product
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import check_arguments
from snake_sim_ros.stepping.base import PREVIOUS
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import SETTLING
from snake_sim_ros.stepping.base import State
from snake_sim_ros.stepping.planar.model import LEAST
from snake_sim_ros.stepping.planar.model import make_planar_model
from snake_sim_ros.stepping.planar.model import make_planar_workspace
from snake_sim_ros.stepping.planar.model import ROLL
from snake_sim_ros.stepping.planar.model import ROLLS
from snake_sim_ros.stepping.planar.moreau import LAST_ROLL
from snake_sim_ros.stepping.planar.moreau import SLIP
from snake_sim_ros.stepping.planar.moreau import WAY
from snake_sim_ros.stepping.report import LEFT
from snake_sim_ros.stepping.report import report_from
from snake_sim_ros.stepping.report import REPORT_SIZE

ROUNDING = 1e-13  # Euler parameters nearer to FLAT than this are FLAT

KNOWN = -2  # in history: whether it holds planar coordinates


@compiled
def to_space(half_length, q, u, tilt, height, links, velocities):
    """
    Fill the coordinates (n, 7) and velocities (n, 6) of all links for planar ones.

    Parameters
    ----------
    half_length : ndarray, shape (n,)
    q : ndarray, shape (n+2,)
        Center of link 1 [m] and headings of all links [rad].
    u : ndarray, shape (n, 3)
        Velocities [m/s] and turning rates [rad/s] in the plane.
    tilt : ndarray, shape (n, 4)
        Euler parameters of links without their heading.
    height : ndarray, shape (n,)
        Of the link centers [m].
    links, velocities : ndarray
        As in `base.State`.

    """
    x, y, reach_x, reach_y = q[0], q[1], 0.0, 0.0
    for i in range(len(u)):
        e0, e1, e2, e3 = tilt[i, 0], tilt[i, 1], tilt[i, 2], tilt[i, 3]
        reach = 2.0 * half_length[i] * (e1 * e3 + e0 * e2)
        step_x, step_y = reach * math.cos(q[2 + i]), reach * math.sin(q[2 + i])
        if i > 0:
            x, y = x + (reach_x + step_x), y + (reach_y + step_y)
        reach_x, reach_y = step_x, step_y
        links[i, 0], links[i, 1], links[i, 2] = x, y, height[i]
        c, s = math.cos(q[2 + i] / 2), math.sin(q[2 + i] / 2)
        links[i, 3], links[i, 4] = c * e0 - s * e3, c * e1 - s * e2
        links[i, 5], links[i, 6] = c * e2 + s * e1, c * e3 + s * e0
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = u[i, 0], u[i, 1], 0.0
        velocities[i, 3] = u[i, 2] * (2.0 * (e1 * e3 - e0 * e2))
        velocities[i, 4] = u[i, 2] * (2.0 * (e2 * e3 + e0 * e1))
        velocities[i, 5] = u[i, 2] * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3)


@compiled
def recall(half_length, memory, links, velocities, q, u, tilt, made_links, made_velocities):
    """Fill q, u and tilt from memory; return whether they make these links, to the bit."""
    n = len(u)
    for i in range(n + 2):
        q[i] = memory[i]
    for i in range(n):
        for k in range(3):
            u[i, k] = memory[n + 2 + 3 * i + k]
        for k in range(4):
            tilt[i, k] = memory[4 * n + 2 + 4 * i + k]
    to_space(half_length, q, u, tilt, links[:, 2], made_links, made_velocities)
    for i in range(n):
        for k in range(7):
            if made_links[i, k] != links[i, k]:
                return False
        for k in range(6):
            if made_velocities[i, k] != velocities[i, k]:
                return False
    return True


def forget(history: Array) -> None:
    """
    Erase what the steps before kept in history, in place.

    What stays are impulses and velocities, and what is about the choice of a level.
    """
    memory, settling = history[PREVIOUS:].reshape(-1), history[SETTLING]
    slip, way = memory[SLIP], memory[WAY]
    memory[:] = 0.0
    memory[SLIP], memory[WAY], history[SETTLING] = slip, way, settling


class PlanarStepper:
    """
    A compiled contact solver in the plane; see `base.Stepper`.

    Links keep the height and the tilt that they come with, which are those of a robot that lies
    flat up to the tolerances of `levels`. Their velocity out of the plane goes into the contact
    impulses of the first step, as in any inelastic impact.

    In history, from PREVIOUS on, are the coordinates of the last step, so that the Euler
    parameters that are made of them need not be read back: steps in parts are the same to the bit.

    Parameters
    ----------
    scene : Scene
    loop : callable
        Compiled ``advance(model, work, q, u, history, angle, rate, report, cycles)``: as in
        `spatial.SpatialStepper`, for planar coordinates q (n+2,) and velocities u (n, 3). It ends
        before the first step that is not planar, and says so in the report.

    """

    level = 'planar'

    def __init__(self, scene: Scene, loop: Callable[..., None]) -> None:
        self.model = make_planar_model(scene)
        self.work = make_planar_workspace(scene)
        self.loop = loop
        n = scene.robot.link_count
        shapes = (n + 2, (n, 3), (n, 4), (n, 7), (n, 6))
        self.recalled = tuple(np.empty(shape) for shape in shapes)  # see recall
        self.cycles = np.zeros(1, np.int64)

    def advance(
        self, state: State, history: Array, angle: Array, rate: Array
    ) -> tuple[State, Array, Report]:
        """Return state, history and report after as many steps as there are references."""
        counts = len(self.model.mass), len(self.work.contact)
        check_arguments(*counts, state, history, angle, rate)
        history = history.copy()
        q, u, tilt = self.coordinates(state, history)
        numbers, self.cycles = np.zeros(REPORT_SIZE), np.zeros(len(angle) + 1, np.int64)
        angle, rate = np.ascontiguousarray(angle), np.ascontiguousarray(rate)
        self.loop(self.model, self.work, q, u, history, angle, rate, numbers, self.cycles)
        report = report_from(numbers, self.work.applied, self.model.dt)
        report.level, report.planar_steps = self.level, report.steps
        if numbers[LEFT]:
            report.left = self.reason()
        if report.steps == 0:
            return state, history, report
        end = State(np.empty_like(state.q), np.empty_like(state.u))
        to_space(self.model.half_length, q, u, tilt, state.q[:, 2], end.q, end.u)
        self.remember(history, q, u, tilt)
        return end, history, report

    def reason(self) -> str:
        """Return the sentence that says why the next step is not planar."""
        n = len(self.model.mass)
        loads = self.work.table[: 2 * n, IMPULSE]
        if (a := int(loads.argmin())) >= 0 and not loads[a] > 0.0:
            end = 'front' if a < n else 'rear'
            return f'the {end} sphere of link {a % n + 1} would lift off'
        if self.rolls:
            return (
                f'rolling would shift the robot by more than {100 * self.model.most_slip:g} % of '
                'its way'
            )
        if not self.leans:
            return 'the contacts in the plane did not converge'
        return 'the robot would roll: its pitch joints do not hold it flat'

    @property
    def rolls(self) -> bool:
        """Whether the last step was refused because of what contacts slip by rolling."""
        return bool(self.work.standing[ROLLS])

    @property
    def leans(self) -> bool:
        """Whether the last step was refused because the robot would roll or lift off."""
        least, roll = self.work.standing[[LEAST, ROLL]]
        return bool(not least > 0.0 or not abs(roll) <= self.model.most_lean)

    def coordinates(self, state: State, history: Array) -> tuple[Array, Array, Array]:
        """
        Return planar coordinates (n+2,), velocities (n, 3) and tilts (n, 4) of a state.

        The momentum that the state has out of the plane is kept for the first step.
        """
        n = len(self.model.mass)
        q, u, tilt = np.empty(n + 2), np.empty((n, 3)), np.empty((n, 4))
        self.work.impact.fill(0.0)
        if self.goes_on(state, history):
            q, u, tilt, *_ = (part.copy() for part in self.recalled)
            return q, u, tilt
        forget(history)
        R = rotation_matrices(state.q[:, 3:])
        theta = np.unwrap(np.arctan2(R[:, 1, 2], R[:, 0, 2]))  # joints bend by less than pi
        zero = np.zeros(n)
        back = np.stack([np.cos(theta / 2), zero, zero, -np.sin(theta / 2)], axis=-1)
        tilt = product(back, state.q[:, 3:])
        tilt[np.abs(tilt - FLAT).max(axis=1) < ROUNDING] = FLAT
        spin = np.einsum('ijk,ik->ij', R, state.u[:, 3:])
        u[:, :2], u[:, 2] = state.u[:, :2], spin[:, 2]
        q[:2], q[2:] = state.q[0, :2], theta
        self.take_up(state, R, spin)
        roll = np.arcsin(R[:, 2, 0])
        largest = math.copysign(np.abs(roll).max(), roll[n // 2])
        history[PREVIOUS:].reshape(-1)[LAST_ROLL] = largest
        return q, u, tilt

    def goes_on(self, state: State, history: Array) -> bool:
        """Return whether the last step was planar and led to this state."""
        memory, made = history[PREVIOUS:].reshape(-1), self.recalled
        same = recall(self.model.half_length, memory, state.q, state.u, *made)
        return bool(same and memory[KNOWN])

    def take_up(self, state: State, R: Array, spin: Array) -> None:
        """Fill work.impact with the momentum of a state out of the plane."""
        center = state.q[:, :2] - state.q[len(R) // 2, :2]
        lift = self.model.mass * state.u[:, 2]
        axial = np.einsum('ij,ij->i', R[:, :, 2], spin)[:, None] * R[:, :, 2]
        across, along = self.model.inertia, self.model.inertia_axial
        turning = across[:, None] * spin + (along - across)[:, None] * axial
        self.work.impact[:, 0] = center[:, 1] * lift + turning[:, 0]
        self.work.impact[:, 1] = -center[:, 0] * lift + turning[:, 1]
        self.work.impact[:, 2] = lift

    def remember(self, history: Array, q: Array, u: Array, tilt: Array) -> None:
        """Fill history with the coordinates."""
        memory = history[PREVIOUS:].reshape(-1)
        kept = np.concatenate([q, u.ravel(), tilt.ravel()])
        memory[: len(kept)] = kept
        memory[KNOWN] = 1.0
