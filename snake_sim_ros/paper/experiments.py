"""
The experiments of the paper, recorded for its figures: cases A, B and C, and variations of them.

Forces and torques are means over a sampling period of all steps in it: the force of an impact in
one step grows without bound as the step is made smaller, its mean does not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import replace
import math

import numpy as np

from snake_sim_ros.dynamics.energy import mechanical_energy
from snake_sim_ros.dynamics.energy import work_of_steps
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Friction
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.simulation import run
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.simulation import steps_in

RATE = 100.0  # Hz, samples of an experiment
PATH_RATE = 20.0  # Hz, samples of a variation of which only a path is wanted
CASES = {'A': 'lateral_undulation', 'B': 'lateral_undulation_isotropic', 'C': 'sidewinding'}
FRICTIONS = (0.1, 0.2, 0.3, 0.4, 0.5)  # isotropic; the paper's coefficient is not known


@dataclass(frozen=True)
class Experiment:
    """
    A case of the paper, with what its figures show.

    Attributes
    ----------
    scene : Scene
    time : ndarray, shape (m,)
        [s]
    position, axis : ndarray, shape (m, n, 3)
        Link centers [m] and unit vectors along the links toward link n, frame I.
    angle, reference : ndarray, shape (m, n-1, 2)
        Of the joints, (yaw, pitch) [rad].
    torque : ndarray, shape (m-1, n-1, 2)
        Means over the sampling periods, (yaw, pitch) [N m].
    normal_force : ndarray, shape (m-1, 2n)
        Means over the sampling periods, front spheres first [N].
    energy : ndarray, shape (m,)
        Mechanical energy, from zero at the start [J].
    joint_work, contact_work : ndarray, shape (m,)
        Done since the start, added up over all steps [J].
    report : Report

    """

    scene: Scene
    time: Array
    position: Array
    axis: Array
    angle: Array
    reference: Array
    torque: Array
    normal_force: Array
    energy: Array
    joint_work: Array
    contact_work: Array
    report: Report

    @property
    def path(self) -> Array:
        """Center of the middle link, shape (m, 3) [m, frame I]."""
        return np.asarray(self.position[:, self.scene.robot.middle_link])

    @property
    def periods(self) -> Array:
        """Middle of every sampling period, shape (m-1,) [s]."""
        return np.asarray(0.5 * (self.time[1:] + self.time[:-1]))

    @property
    def left_over(self) -> Array:
        """Energy that no work accounts for, shape (m,) [J]."""
        return np.asarray(self.energy - self.joint_work - self.contact_work)

    @property
    def force_along_body(self) -> Array:
        """
        Mean normal forces in the order of the spheres from link 1 to link n, shape (m-1, 2n) [N].

        The front sphere of a link is the one toward link n.
        """
        front, rear = np.split(self.normal_force, 2, axis=1)
        return np.stack([rear, front], axis=2).reshape(len(front), -1)


def case_scene(case: str, duration: float) -> Scene:
    """Return the scene of case A, B or C for a duration [s], in three dimensions throughout."""
    return replace(load_scene(CASES[case]), duration=duration, level='spatial')


def record(scene: Scene) -> Experiment:
    """
    Run a scene step by step, and return what happened.

    Raises
    ------
    ParameterError
        If dt does not divide the sampling period, or the period the duration.

    """
    steps = steps_in(1.0 / RATE, scene.dt, 'sampling period')
    samples = steps_in(scene.duration, 1.0 / RATE, 'duration')
    simulation = Simulation(scene)
    simulation.compile(scene.gait)
    q, u = [simulation.state.q], [simulation.state.u]
    force, torque, work = [], [], [(0.0, 0.0)]
    for _ in range(samples):
        qs, us, impulses, torques = _step_by_step(simulation, steps)
        contacts, joints = work_of_steps(scene, qs, us, impulses, torques)
        work.append((contacts.sum(), joints.sum()))
        force.append(impulses[..., 0].mean(axis=0) / scene.dt)
        torque.append(torques.mean(axis=0))
        q.append(qs[-1])
        u.append(us[-1])
    coordinates, time = np.array(q), np.arange(samples + 1) / RATE
    energy = mechanical_energy(scene, coordinates, np.array(u))
    contact_work, joint_work = np.cumsum(work, axis=0).T
    return Experiment(
        scene=scene,
        time=time,
        position=coordinates[..., :3],
        axis=rotation_matrices(coordinates[..., 3:])[..., 2],
        angle=joint_angles(coordinates),
        reference=gait.reference(scene.gait, time, scene.robot.link_count - 1)[0],
        torque=np.array(torque),
        normal_force=np.array(force),
        energy=energy - energy[0],
        joint_work=joint_work,
        contact_work=contact_work,
        report=simulation.report,
    )


def _step_by_step(simulation: Simulation, steps: int) -> tuple[Array, Array, Array, Array]:
    """Return coordinates and velocities before and after some steps, impulses and torques."""
    q, u, impulses, torques = [simulation.state.q], [simulation.state.u], [], []
    angle, rate = simulation.gait_reference(steps)
    for k in range(steps):
        report = simulation.advance(angle[k : k + 1], rate[k : k + 1])
        q.append(simulation.state.q)
        u.append(simulation.state.u)
        impulses.append(simulation.history.impulse[:, :3].copy())
        torques.append(report.joint_torque)
    return np.array(q), np.array(u), np.array(impulses), np.array(torques)


def path_of(scene: Scene) -> Array:
    """Return the center of the middle link at PATH_RATE, shape (m, 3) [m, frame I]."""
    return np.asarray(run(scene, rate=PATH_RATE).position[:, scene.robot.middle_link])


def isotropic_paths(duration: float) -> Mapping[float, Array]:
    """Return the path of case B at PATH_RATE for every coefficient of FRICTIONS."""
    scene = case_scene('B', duration)
    return {
        mu: path_of(replace(scene, friction=Friction(longitudinal=mu, transversal=mu)))
        for mu in FRICTIONS
    }


def mean_velocity(scene: Scene, path: Array, rate: float) -> Array:
    """
    Return the mean velocity of a path over its last whole periods of the gait, shape (2,) [m/s].

    Periods are counted back from the end, and the first one after the start is left out; what is
    shorter is taken whole.
    """
    period = 2.0 * math.pi / scene.gait.yaw.angular_frequency
    span = (len(path) - 1) / rate
    whole = period * max(math.floor(span / period) - 1, 0) or span
    # A period is not a whole number of samples.
    times = np.arange(len(path)) / rate
    begin = [float(np.interp(span - whole, times, path[:, axis])) for axis in (0, 1)]
    return np.asarray((path[-1, :2] - begin) / whole)


def mirrored(scene: Scene) -> Scene:
    """Return the scene with A_h replaced by -A_h."""
    yaw = replace(scene.gait.yaw, amplitude=-scene.gait.yaw.amplitude)
    return replace(scene, gait=replace(scene.gait, yaw=yaw))


def reversed_wave(scene: Scene) -> Scene:
    """Return the scene with delta_h replaced by -delta_h."""
    yaw = replace(scene.gait.yaw, phase_lag=-scene.gait.yaw.phase_lag)
    return replace(scene, gait=replace(scene.gait, yaw=yaw))


def other_side(scene: Scene) -> Scene:
    """Return the scene with delta_0 replaced by -delta_0."""
    pitch = replace(scene.gait.pitch, phase=-scene.gait.pitch.phase)
    return replace(scene, gait=replace(scene.gait, pitch=pitch))
