"""
Runs of MuJoCo in one call of `mujoco.rollout`, on the calling thread.

MuJoCo is an optional dependency and is imported only when a function needs it.
"""

import math

import numpy as np

from snake_sim_ros.comparison.courses import Course
from snake_sim_ros.comparison.courses import least_seconds
from snake_sim_ros.comparison.courses import portions
from snake_sim_ros.comparison.courses import Start
from snake_sim_ros.comparison.courses import step_count
from snake_sim_ros.comparison.mujoco_model import import_mujoco
from snake_sim_ros.comparison.mujoco_model import MujocoSettings
from snake_sim_ros.comparison.mujoco_runs import collected_warnings
from snake_sim_ros.comparison.mujoco_runs import MujocoRobot
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene

PLACE = slice(1, 4)  # of the middle link, the root of the tree, in a state of MuJoCo


def rolled_course(scene: Scene, start: Start | None = None, *, settings: MujocoSettings) -> Course:
    """
    Return the course of a scene by MuJoCo, see `courses.Course`.

    The call writes the state after every step, which takes little of its time. A warning of MuJoCo
    counts as a failure, since MuJoCo resets the robot to its start then.

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run the scene, see `mujoco_model.mjcf`, or if the
        drive is `torque`, which needs the caller before every step.

    """
    if settings.drive == 'torque':
        raise ParameterError('drive must be spring or position for a run in one call, got torque')
    import_mujoco()
    from mujoco.rollout import Rollout

    state, begin = start or (None, 0.0)
    robot = MujocoRobot(scene, settings, state)
    angle, rate = (
        values[:, robot.axes] for values in robot.reference(0, step_count(scene), begin)
    )
    K_p, K_d = robot.gains()
    control = np.ascontiguousarray(K_p * angle + K_d * rate)[None]
    physics = robot.mujoco.mjtState.mjSTATE_FULLPHYSICS
    first = np.empty(robot.mujoco.mj_stateSize(robot.model, physics))
    robot.mujoco.mj_getState(robot.model, robot.data, first, physics)
    states = np.empty((1, control.shape[1], len(first)))
    sensors = np.empty((1, control.shape[1], 0))

    def call() -> None:
        rollout.rollout(robot.model, robot.data, first[None], control, nstep=control.shape[1],
                        state=states, sensordata=sensors)  # fmt: skip

    with collected_warnings() as warnings, Rollout(nthread=0) as rollout:
        seconds = least_seconds(call)
    return _course_of(scene, first, states[0], seconds, warnings)


def _course_of(
    scene: Scene, first: Array, states: Array, seconds: float, warnings: list[str]
) -> Course:
    """Return the course in a table of states, whose columns are time, place of the root, ..."""
    last = [last for _, last in portions(scene)]
    path = np.concatenate([first[None, PLACE], states[np.array(last) - 1, PLACE]])
    failure = f'MuJoCo: {warnings[0].partition(".")[0]}' if warnings else ''
    time = scene.dt * np.array([0, *last])
    return Course(time, path, math.nan if failure else seconds, 0, failure)
