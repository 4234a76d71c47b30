# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live demonstration: `sim` and `gait` in two processes, and this one that listens."""

from pathlib import Path
import sys
from threading import Event
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
import numpy as np
import rclpy
from rclpy.node import Node
from tqdm import tqdm

from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.messages import seconds_from
from snake_sim_ros.nodes.programs import interruptible
from snake_sim_ros.nodes.tools.child_nodes import (
    Child,
    children,
    Interrupted,
    NodeDied,
    scene_to_run,
    start,
)
from snake_sim_ros.scene.checked_records import ParameterError

START_TIMEOUT = 90.0  # s, for compiling and discovery
STALL_TIMEOUT = 10.0  # s without a message
PICTURE = 0.1  # s between two pictures of the bar
LAYOUT = '{percentage:3.0f} %|{bar:10}| {desc}'
SUMMARY = (
    'method', 'real_time_factor', 'residual_max', 'iterations_per_step', 'unconverged_steps',
    'penetration_max', 'rejected_commands', 'overruns',
)  # fmt: skip


class StateListener(Node):
    """Keeps what the topics say of the robot's motion and of the simulation."""

    def __init__(self) -> None:
        super().__init__('demo')
        self.begin: float | None = None  # simulated time at which the gait began [s]
        self.times: list[float] = []
        self.positions: list[list[tuple[float, float, float]]] = []
        self.values: dict[str, str] = {}
        self.doing = ''  # what sim says of itself
        self.waited = 0.0  # wall time for which sim waited for the compiler [s]
        self.create_subscription(PoseArray, 'link_poses', self._on_link_poses, 10)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def _on_link_poses(self, message: PoseArray) -> None:
        self.times.append(seconds_from(message.header.stamp))
        self.positions.append([(p.position.x, p.position.y, p.position.z) for p in message.poses])

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'sim: physics':
                self.doing = status.message
                self.values = {item.key: item.value for item in status.values}


def demo(source: str, duration: float, out: Path) -> int:
    """
    Run a scene live and draw where the robot got to.

    Parameters
    ----------
    source : str
        The scene: a YAML file or a name.
    duration : float
        How long the gait runs [s].
    out : Path
        The file of the picture.

    Returns
    -------
    int
        0; 1 if a node died; 130 if interrupted.

    """
    scene = scene_to_run(source)
    if not duration > 0:
        raise ParameterError(f'--duration must be above 0 s, got {duration:g} s')
    if not out.absolute().parent.is_dir():
        raise ParameterError(f'--out: no folder {out.absolute().parent}')
    middle = scene.robot.middle_link
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    status, listener, begin = 0, StateListener(), time.monotonic()
    try:
        with interruptible() as stop, children() as nodes:
            _follow(listener, nodes, stop, source, duration, middle)
    except Interrupted:
        print('\ninterrupted')
        status = 130
    except NodeDied as error:
        print(f'\nsnake-sim demo: {error}', file=sys.stderr)
        status = 1
    finally:
        listener.destroy_node()
        rclpy.try_shutdown()
    _summarize(listener, middle, time.monotonic() - begin, f'{Path(source).stem}, live', out)
    return status


def _follow(
    listener: StateListener,
    nodes: list[Child],
    stop: Event,
    source: str,
    duration: float,
    middle: int,
) -> None:
    """Start the nodes and print the progress until the gait has run for the duration."""
    executor = make_executor(listener)
    print(
        f'a live run of {duration:g} s with a few s to start; the first one ever compiles before, '
        f'for up to a minute'
    )
    nodes.append(start('sim', f'scene:={source}'))
    started = heard = shown = now = time.monotonic()
    count = 0
    with tqdm(total=duration, bar_format=LAYOUT, file=sys.stdout, dynamic_ncols=True) as bar:
        while listener.begin is None or listener.times[-1] < listener.begin + duration - 1e-9:
            executor.spin_once(timeout_sec=0.1)
            if stop.is_set():
                raise Interrupted
            for node in nodes:
                node.check()
            before, now = now, time.monotonic()
            if len(listener.times) > count:
                count, heard = len(listener.times), now
            if _compiles(listener):
                started = now
                listener.waited += now - before
            if count and len(nodes) == 1:  # The gait starts once its beginning can be seen.
                nodes.append(start('gait', f'scene:={source}', 'use_sim_time:=true'))
            if said := nodes[-1].said(r'the gait begins at t = (\S+) s'):
                listener.begin = float(said[1])
            if listener.begin is None and now - started > START_TIMEOUT:
                raise NodeDied(f'the gait did not begin within {START_TIMEOUT:g} s')
            if count and now - heard > STALL_TIMEOUT:
                raise NodeDied(f'no state from sim for {STALL_TIMEOUT:g} s')
            if now - shown > PICTURE:
                shown = now
                _show(bar, listener, middle)
        _show(bar, listener, middle)


def _compiles(listener: StateListener) -> bool:
    """Return whether sim waits for the compiler."""
    return listener.doing.startswith('compiling')


def _show(bar: 'tqdm[Any]', listener: StateListener, middle: int) -> None:
    """Show how far the gait is; say what the compiler does."""
    if listener.begin is not None:
        bar.n = min(bar.total, max(0.0, listener.times[-1] - listener.begin))
    else:
        bar.n = 0.0
    if _compiles(listener):
        what = listener.doing
    else:
        what = 'starting' if listener.begin is None else _progress(listener, middle)
    bar.set_description_str(f'{what} ', refresh=False)
    bar.refresh()


def _progress(listener: StateListener, middle: int) -> str:
    x, y, _ = listener.positions[-1][middle]
    factor = listener.values.get('real_time_factor', '-')
    residual = listener.values.get('residual', '-')
    return (
        f't = {listener.times[-1] - (listener.begin or 0.0):6.2f} s   link {middle + 1} at '
        f'({x:+.3f}, {y:+.3f}) m   real-time factor {factor}   residual {residual} m/s   '
    )


def _summarize(
    listener: StateListener, middle: int, seconds: float, title: str, out: Path
) -> None:
    times, position = np.array(listener.times), np.array(listener.positions)
    if listener.begin is None or not (times >= listener.begin).any():
        print('the gait had not begun; there is nothing to show')
        return
    first = int(np.argmax(times >= listener.begin))
    times, position = times[first:], position[first:]
    start, end = position[0, middle], position[-1, middle]
    print(
        f'link {middle + 1} went from ({start[0]:.4f}, {start[1]:.4f}) to ({end[0]:.4f}, '
        f'{end[1]:.4f}) m in {times[-1] - times[0]:.2f} s: {np.linalg.norm(end - start):.3f} m'
    )
    for key in SUMMARY:
        print(f'{key.replace("_", " "):20} {listener.values.get(key, "-")}')
    print(f'{"wait for compiler":20} {listener.waited:.1f} s')
    print(f'{"wall time in all":20} {seconds:.1f} s')
    try:
        from snake_sim_ros.view.chart import path_figure
    except ImportError:
        print('no picture: matplotlib is not installed')
        return
    path_figure(out, title, times, position, middle)
    print(f'{"picture":20} {out}')
