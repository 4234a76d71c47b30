# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The experiments of the paper, recorded for its figures: cases A, B and C, and variations of them.

Forces and torques are means over all steps of a sampling period. The force of an impact in a
single step grows without bound as the step gets smaller, but its mean over a period does not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math

import numpy as np

from snake_sim_benchmarks.energy import mechanical_energy, work_of_steps
from snake_sim_ros import Friction, Scene, Simulation, Wave
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, load_scene, steps_in
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.stepping.sampling import Keep
from snake_sim_ros.stepping.simulation import sample, simulate
from snake_sim_ros.stepping.trajectory import Trajectory

RATE = 100.0  # Hz, samples of an experiment
PATH_RATE = 20.0  # Hz, samples of a variation of which only the path is used
CASES = {'A': 'lateral_undulation', 'B': 'lateral_undulation_isotropic', 'C': 'sidewinding'}
FRICTIONS = (0.1, 0.2, 0.3, 0.4, 0.5)  # isotropic; the paper's coefficient is not known


@dataclass(frozen=True)
class Experiment:
    """
    A case of the paper: samples of a run, with means and sums of all steps between them.

    Attributes
    ----------
    trajectory : Trajectory
        m samples.
    torque : ndarray, shape (m-1, n-1, 2)
        Means over the sampling periods, (yaw, pitch) [N m].
    normal_force : ndarray, shape (m-1, 2n)
        Means over the sampling periods, front spheres first [N].
    joint_work, contact_work : ndarray, shape (m,)
        Work since the start, the sum over all steps [J].

    """

    trajectory: Trajectory
    torque: Array
    normal_force: Array
    joint_work: Array
    contact_work: Array

    @property
    def scene(self) -> Scene:
        """The scene of the run."""
        return self.trajectory.scene

    @property
    def tracking_error(self) -> Array:
        """Reference less angle of the joints, shape (m, n-1, 2) as (yaw, pitch) [rad]."""
        joints = self.scene.robot.link_count - 1
        reference, _ = gait.reference(self.scene.gait, self.trajectory.time, joints)
        return reference - joint_angles(self.trajectory.coordinates)

    @property
    def energy(self) -> Array:
        """Mechanical energy, from zero at the start, shape (m,) [J]."""
        q, u = self.trajectory.coordinates, self.trajectory.velocity
        energy = mechanical_energy(self.scene, q, u)
        return np.asarray(energy - energy[0])

    @property
    def periods(self) -> Array:
        """Middle of every sampling period, shape (m-1,) [s]."""
        time = self.trajectory.time
        return np.asarray(0.5 * (time[1:] + time[:-1]))

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
    Run a scene and return its experiment.

    Raises
    ------
    ParameterError
        If dt does not divide the sampling period, or the period the duration.

    """
    steps = steps_in(1.0 / RATE, scene.dt, 'sampling period')
    samples = steps_in(scene.duration, 1.0 / RATE, 'duration')
    simulation = Simulation(scene)
    simulation.compile(scene.gait)
    return experiment(sample(simulation, 1, samples * steps, keep=Keep(impulses=True)), steps)


def experiment(trajectory: Trajectory, steps: int) -> Experiment:
    """
    Return the experiment of a run that was sampled at every step, with its impulses.

    Parameters
    ----------
    trajectory : Trajectory
    steps : int
        Number of steps in a sampling period of the experiment.

    """
    q, u, dt = trajectory.coordinates, trajectory.velocity, trajectory.scene.dt
    torque, force, work = [], [], [(0.0, 0.0)]
    for begin in range(0, len(trajectory.time) - 1, steps):
        states, ends = slice(begin, begin + steps + 1), slice(begin + 1, begin + steps + 1)
        impulses = trajectory.impulse[ends, :, :3]
        torques = trajectory.scene.robot.by_joint(trajectory.joint_torque[ends])
        contacts, joints = work_of_steps(trajectory.scene, q[states], u[states], impulses, torques)
        work.append((contacts.sum(), joints.sum()))
        torque.append(torques.mean(axis=0))
        force.append(impulses[..., 0].mean(axis=0) / dt)
    contact_work, joint_work = np.cumsum(work, axis=0).T
    return Experiment(
        trajectory=replace(trajectory, impulse=np.zeros(0)).every(steps),
        torque=np.array(torque),
        normal_force=np.array(force),
        joint_work=joint_work,
        contact_work=contact_work,
    )


def path_of(scene: Scene) -> Array:
    """Return the center of the middle link at PATH_RATE, shape (m, 3) [m, frame I]."""
    return simulate(scene, rate=PATH_RATE).path


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

    Periods are counted back from the end, and the first one after the start is left out. If that
    leaves no period, the mean is that of the whole path.
    """
    period = 2.0 * math.pi / scene.gait.yaw.angular_frequency
    span = (len(path) - 1) / rate
    whole = period * max(math.floor(span / period) - 1, 0) or span
    # A period need not be a whole number of samples.
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


# ---- what the paper does not state, in words for the figures ------------------------------------


SOLVER_WORDS = (
    'of several possible normal forces those of least norm; '
    'contacts solved to 1e-9 m/s, not to the unknown tolerance of (93)'
)


def degrees(value: float) -> str:
    """Return an angle in words."""
    return f'{np.degrees(value):.3g} deg'


def wave_words(wave: Wave) -> str:
    """Return the parameters of a wave that are not zero, in words."""
    return (
        f'A = {degrees(wave.amplitude)}, omega = {degrees(wave.angular_frequency)}/s, '
        f'delta = {degrees(wave.phase_lag)}'
        + f', delta_0 = {degrees(wave.phase)}'
        * bool(wave.phase)
    )


def assumed_in_a(scene: Scene) -> str:
    """Return the assumptions of case A."""
    return f'assumed: rolling friction {scene.friction.rolling:g}; {SOLVER_WORDS}'


def assumed_in_b() -> str:
    """Return the assumptions of case B."""
    return (
        'assumed: the coefficient, isotropic (0.2 stands for it elsewhere); gait, curved start '
        f'and 15 s as in case A;\nrolling friction 0; {SOLVER_WORDS}'
    )


def assumed_in_c(scene: Scene) -> str:
    """Return the assumptions of case C."""
    yaw, pitch = scene.gait.yaw, scene.gait.pitch
    return (
        f'assumed: isotropic friction {scene.friction.longitudinal:g}; yaw wave '
        f'{wave_words(yaw)}; pitch wave {wave_words(pitch)};\nsoft start '
        f's = 3x² - 2x³, x = t/{scene.gait.soft_start:g} s; rolling friction '
        f'{scene.friction.rolling:g}; {SOLVER_WORDS}'
    )


def assumed_in_both(sidewinding: Scene) -> str:
    """Return the assumptions of a figure with case A and case C."""
    in_c = assumed_in_c(sidewinding).removeprefix('assumed: ')
    return f'A assumed: rolling friction 0; normal forces and tolerance as in C\nC assumed: {in_c}'
