"""Where a run of any method led, what it took, and how far two runs are apart."""

from dataclasses import dataclass
import math

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report

SAMPLE = 0.1  # s between two samples of a course


@dataclass(frozen=True)
class Course:
    """
    A sampled run, of whatever method.

    Attributes
    ----------
    position : ndarray, shape (m, n, 3)
        Link centers every SAMPLE seconds, from the start on [m, frame I].
    axis : ndarray, shape (m, n, 3)
        Unit vectors e_z^B along the links, toward link n [frame I].
    joint_angle : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad].
    seconds : float
        Wall time of all steps, without compiling [s].
    median, p99 : float
        Wall time of single steps [us]; their mean where single steps cannot be timed.
    compile_seconds : float
        Wall time of compiling, of loading what was compiled, or of building a model [s].
    report : Report
        Its `failure` says why a run ended early.
    energy_error : float
        See `energy.balance_error`; nan if it was not asked for.
    late : bool
        Whether the run was stopped because it took too long.

    """

    position: Array
    axis: Array
    joint_angle: Array
    seconds: float
    median: float
    p99: float
    compile_seconds: float
    report: Report
    energy_error: float = math.nan
    late: bool = False

    @property
    def simulated(self) -> float:
        """Simulated time [s]."""
        return SAMPLE * (len(self.position) - 1)

    @property
    def path(self) -> Array:
        """Center of the middle link, shape (m, 3) [m]."""
        return np.asarray(self.position[:, self.position.shape[1] // 2])

    @property
    def heading(self) -> Array:
        """Direction in the plane of the mean link axis, without jumps, shape (m,) [rad]."""
        x, y, _ = self.axis.sum(axis=1).T
        return np.unwrap(np.arctan2(y, x))

    @property
    def status(self) -> str:
        """How it went: a value of `base.Status`, or too_slow."""
        return 'too_slow' if self.late else self.report.status.value


def extrapolated(coarse: Course, fine: Course) -> Course:
    """
    Return the course without time step, of two runs of first order with steps 2 to 1.

    All times and counts are those of the finer run.
    """
    return Course(
        position=2 * fine.position - coarse.position,
        axis=2 * fine.axis - coarse.axis,
        joint_angle=2 * fine.joint_angle - coarse.joint_angle,
        seconds=fine.seconds,
        median=fine.median,
        p99=fine.p99,
        compile_seconds=fine.compile_seconds,
        report=fine.report,
    )


def path_error(path: Array, expected: Array) -> float:
    """
    Return the largest distance of two paths at any time, over the length of the way gone.

    The way is the distance from the first point of the expected path to its last. Paths of
    different lengths, one of them a run that ended early, are infinitely far apart.
    """
    if path.shape != expected.shape:
        return math.inf
    way = np.linalg.norm(expected[-1] - expected[0])
    return float(np.linalg.norm(path - expected, axis=-1).max() / way)


def largest_difference(values: Array, expected: Array) -> float:
    """Return the largest absolute difference; infinity for runs of different lengths."""
    if values.shape != expected.shape:
        return math.inf
    return float(np.abs(values - expected).max(initial=0.0))
