# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Playback of a recorded run on a page in the browser, with a time slider."""

import math
import signal
from threading import Event
import time

import numpy as np

from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.trajectory import Trajectory
from snake_sim_ros.view.frames import Frame, PATH_LENGTH, PLOTTED_TIME, Trace
from snake_sim_ros.view.page import announce, Page, PLOT_PERIOD, SHOW_PERIOD

SIGNALS = (signal.SIGINT, signal.SIGTERM)
SPEEDS = {'1/10': 0.1, '1/4': 0.25, '1/2': 0.5, '1': 1.0, '2': 2.0, '4': 4.0}


class Recording:
    """A trajectory as frames and traces."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.run, self.middle = trajectory, trajectory.scene.robot.middle_link
        by_joint = trajectory.scene.robot.by_joint
        self.angle = by_joint(trajectory.joint_angle)
        self.torque = by_joint(trajectory.joint_torque)
        waves, commanded = trajectory.scene.gait, np.full_like(self.angle, math.nan)
        if waves.yaw.amplitude or waves.pitch.amplitude:
            commanded = gait.reference(waves, trajectory.time, commanded.shape[1])[0]
        self.reference: Array = commanded

    def frame(self, k: int) -> Frame:
        """Return the robot at sample k."""
        run = self.run
        return Frame(
            float(run.time[k]),
            run.position[k],
            run.orientation[k],
            self.angle[k],
            self.torque[k],
            self.reference[k],
            *run.contacts(k),
        )

    def status(self, k: int) -> dict[str, str]:
        """Return the texts that the page shows at sample k."""
        run = self.run
        path = run.position[k, self.middle] - run.position[0, self.middle]
        return {'distance': f'{np.linalg.norm(path):.3f} m', 'level': str(run.level[k])}

    def trace(self, k: int) -> Trace:
        """Return the trace of the robot up to sample k."""
        run = self.run
        first = int(np.searchsorted(run.time, run.time[k] - PLOTTED_TIME))
        part = slice(first, k + 1, 1 + (k - first) // 400)
        path = run.position[: k + 1 : 1 + k // PATH_LENGTH, self.middle]
        joints = self.angle[part], self.reference[part], self.torque[part]
        return Trace(run.time[part], *joints, path)


class Player:
    """The current time of the playback, and its controls."""

    def __init__(self, page: Page, times: Array) -> None:
        self.times, self.now = times, float(times[0])
        step = float(np.diff(times).min())
        gui = page.gui
        with page.controls:
            self.slider = gui.add_slider(
                'time [s]', float(times[0]), float(times[-1]), step, self.now
            )
            self.button = gui.add_button('pause')
            self.speed = gui.add_dropdown('speed', tuple(SPEEDS), initial_value='1')
            self.loop = gui.add_checkbox('repeat', True)
        self.playing, self._wanted = True, math.nan
        self._marked, self._label = self.now, 'pause'  # what the controls say
        self.button.on_click(lambda _: self._toggle())
        self.slider.on_update(self._on_slider)

    def advance(self, seconds: float) -> int:
        """Advance by some wall time, or to the time of the slider; return the sample."""
        if not math.isnan(self._wanted):
            self.now, self._wanted = self._wanted, math.nan
        elif self.playing:
            self.now += SPEEDS[self.speed.value] * seconds
            if self.now > self.times[-1]:
                self.now = float(self.times[0] if self.loop.value else self.times[-1])
                self.playing = self.loop.value
        return max(int(np.searchsorted(self.times, self.now, 'right')) - 1, 0)

    def mark(self) -> None:
        """Update the controls, where they change: what a person does meanwhile stays."""
        time, label = round(self.now, 2), 'pause' if self.playing else 'play'
        if math.isnan(self._wanted) and time != self._marked:
            self._marked = self.slider.value = time
        if label != self._label:
            self._label = self.button.label = label

    def _toggle(self) -> None:
        self.playing = not self.playing
        if self.playing and self.now >= self.times[-1]:
            self._wanted = float(self.times[0])

    def _on_slider(self, event: object) -> None:
        if getattr(event, 'client_id', None) is not None:  # a person moved it
            self.playing, self._wanted = False, self.slider.value


def play(trajectory: Trajectory, title: str, host: str, port: int, open_browser: bool) -> int:
    """
    Serve the page of a recorded run until it is interrupted.

    Parameters
    ----------
    trajectory : Trajectory
    title : str
    host : str
    port : int
        0 takes any free port.
    open_browser : bool

    Returns
    -------
    int
        Exit status, 0.

    Raises
    ------
    ParameterError
        If there are less than two samples, or if no page can be served there.

    """
    if len(trajectory.time) < 2:
        raise ParameterError(
            f'a run to be played must have at least 2 samples, got {len(trajectory.time)}'
        )
    page = Page(title, host, port)
    stop, recording = Event(), Recording(trajectory)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in SIGNALS}
    try:
        page.build(trajectory.scene)
        player = Player(page, trajectory.time)
        announce(page, open_browser)
        _serve(page, player, recording, stop)
    finally:
        page.close()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0


def _serve(page: Page, player: Player, recording: Recording, stop: Event) -> None:
    """Show the current sample of the player until the page is to be closed; play while watched."""
    last, plotted, shown, written = time.monotonic(), -math.inf, -1, -1
    while not stop.is_set():
        now = time.monotonic()
        k = player.advance(now - last if page.watched else 0.0)
        last, changed = now, page.changed()
        if k != shown or changed:
            page.show(recording.frame(k))
            shown = k
        if (k != written or changed) and now - plotted >= PLOT_PERIOD:
            plotted, written = now, k
            player.mark()
            page.tell(recording.frame(k), recording.status(k))
            page.plot(recording.trace(k))
        stop.wait(max(SHOW_PERIOD - (time.monotonic() - now), 0.0))
