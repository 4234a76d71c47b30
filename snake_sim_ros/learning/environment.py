# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A snake as an environment of Gymnasium."""

from typing import Any

import gymnasium

from snake_sim_ros.learning.snakes import RENDER_MODES, Snakes
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.simulation import Simulation


class SnakeEnv(gymnasium.Env[Array, Array]):
    """
    A snake with a task.

    Actions are from -1 to 1: the least and the largest value of what `action_labels` say.
    Observations are what the robot measures, in the order of `observation_labels`: angles [rad]
    and rates [rad/s] of the joint axes that act, orientation, angular velocity and specific force
    of an inertial unit in the head, forces on all links if asked for, the phase of actions that
    have one, and the command of the task. The reward is the sum of the terms of the task, see
    `tasks`, less the energy of the joints at its price; ``info['reward']`` has every term.

    An episode terminates when its task is done or the motion diverges, which ``info['failure']``
    says. Its truncation is that of Gymnasium's time limit.

    Parameters
    ----------
    task : str, optional
        ``forward``, ``sideways``, ``goal`` or ``path``.
    scene : Scene, str or Path, optional
    values : mapping, optional
        Values of the scene by dotted names.
    action : str, optional
        ``angles``, ``residual``, ``gait`` or ``torques``; see `actions`.
    axes : str, optional
        Axes that act and are measured: ``yaw``, ``all``, or ``auto``, which is all where the gait
        of the scene moves pitch joints.
    contacts : bool, optional
        Whether the forces on the links are measured.
    rate : float, optional
        Actions a second [Hz].
    method : str, optional
        ``newton``, or ``bdf2`` for steps of 1/50 s: with smooth references, such as those of
        actions of a gait, these are several times as fast.
    dt : float, optional
        Time step [s], which divides the time between actions.
    energy_price : float, optional
        Reward that a joule costs [1/J].
    randomization : Randomization or mapping, optional
    render_mode : str, optional
        ``rgb_array`` or None.

    Raises
    ------
    ParameterError
        If an argument is not usable; the message says which and why.

    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        'render_modes': [*RENDER_MODES],
        'render_fps': 25,
    }

    def __init__(self, task: str = 'forward', **settings: Any) -> None:
        self.snakes = Snakes(1, 1, task, **settings)
        self.action_space = self.snakes.action_space
        self.observation_space = self.snakes.observation_space
        self.render_mode = self.snakes.render_mode

    @property
    def action_labels(self) -> tuple[str, ...]:
        """What each number of an action is, with its unit and its least and largest value."""
        return self.snakes.action_labels

    @property
    def observation_labels(self) -> tuple[str, ...]:
        """What each number of an observation is, with its unit."""
        return self.snakes.observation_labels

    @property
    def simulation(self) -> Simulation:
        """The simulation of this episode."""
        return self.snakes.batch.simulation(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; `options` are not used."""
        super().reset(seed=seed)
        self.snakes.begin([0], [self.np_random])
        return self.snakes.seen[0].copy(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """
        Take an action of `action_space`, which is clipped to its bounds.

        Raises
        ------
        ParameterError
            If it has another shape or is not finite, or before the first reset.

        """
        snakes = self.snakes
        self._check_begun()
        count = len(snakes.action_labels)
        taken = snakes.physical(action, f'an action must be {count} finite numbers', (count,))
        terms, done = snakes.step(taken[None])
        failure = snakes.failure(0)
        reward = float(sum(terms.values())[0])  # type: ignore[index]
        info = {
            'reward': {name: term[0].item() for name, term in terms.items()},
            'unconverged': snakes.batch.unconverged[0].item(),
            'failure': failure,
        }
        return snakes.seen[0].copy(), reward, bool(done[0] or failure), False, info

    def render(self) -> Any:
        """Return a picture, (360, 640, 3) of uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        self._check_begun()
        return self.snakes.picture(0)

    def _check_begun(self) -> None:
        """Raise an error before the first episode."""
        if not self.snakes.begun[0]:
            raise ParameterError('an episode begins with reset')
