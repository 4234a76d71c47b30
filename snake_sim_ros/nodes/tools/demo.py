"""The live demonstration: `sim` and `gait` as two processes, watched over ROS 2 by a third."""

from pathlib import Path
import sys
from threading import Event
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
import numpy as np
import rclpy
from rclpy.node import Node

from snake_sim_ros.nodes.messages import seconds_from
from snake_sim_ros.nodes.running import make_executor
from snake_sim_ros.nodes.tools.processes import Child
from snake_sim_ros.nodes.tools.processes import children
from snake_sim_ros.nodes.tools.processes import Interrupted
from snake_sim_ros.nodes.tools.processes import interruptible
from snake_sim_ros.nodes.tools.processes import NodeDied
from snake_sim_ros.nodes.tools.processes import start
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.quantities import ParameterError

START_TIMEOUT = 90.0  # s, for compiling and discovery
STALL_TIMEOUT = 10.0  # s without a message
SUMMARY = (
    'method', 'real_time_factor', 'residual_max', 'iterations_per_step', 'unconverged_steps',
    'penetration_max', 'rejected_commands', 'overruns',
)  # fmt: skip


class Watch(Node):
    """What the robot does, from its topics."""

    def __init__(self) -> None:
        super().__init__('demo')
        self.begin: float | None = None  # simulated time at which the gait began [s]
        self.times: list[float] = []
        self.positions: list[list[tuple[float, float, float]]] = []
        self.values: dict[str, str] = {}
        self.create_subscription(PoseArray, 'link_poses', self._on_link_poses, 10)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def _on_link_poses(self, message: PoseArray) -> None:
        self.times.append(seconds_from(message.header.stamp))
        self.positions.append([(p.position.x, p.position.y, p.position.z) for p in message.poses])

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'sim: physics':
                self.values = {item.key: item.value for item in status.values}


def demo(source: str, duration: float, out: Path) -> int:
    """
    Run a scene live and draw where the robot got to.

    Parameters
    ----------
    source : str
        Scene, a YAML file or a name.
    duration : float
        Time of the gait [s].
    out : Path
        Picture.

    Returns
    -------
    int
        0; 1 if a node died; 130 if interrupted.

    """
    scene = load_scene(source)
    if not duration > 0:
        raise ParameterError(f'--duration must be above 0 s, got {duration:g} s')
    if not out.absolute().parent.is_dir():
        raise ParameterError(f'--out: no folder {out.absolute().parent}')
    middle = scene.robot.middle_link
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    status, watch, begin = 0, Watch(), time.monotonic()
    try:
        with interruptible() as stop, children() as nodes:
            _follow(watch, nodes, stop, source, duration, middle)
    except Interrupted:
        print('\ninterrupted')
        status = 130
    except NodeDied as error:
        print(f'\nsnake-sim demo: {error}', file=sys.stderr)
        status = 1
    finally:
        watch.destroy_node()
        rclpy.try_shutdown()
    _summarize(watch, middle, time.monotonic() - begin, f'{Path(source).stem}, live', out)
    return status


def _follow(
    watch: Watch, nodes: list[Child], stop: Event, source: str, duration: float, middle: int
) -> None:
    """Start the nodes and show how the robot does until the gait has run for the duration."""
    executor = make_executor(watch)
    nodes.append(start('sim', f'scene:={source}'))
    print('compiling the physics (half a minute at the first start ever) ...')
    started = heard = shown = time.monotonic()
    count = 0
    while watch.begin is None or watch.times[-1] < watch.begin + duration - 1e-9:
        executor.spin_once(timeout_sec=0.1)
        if stop.is_set():
            raise Interrupted
        for node in nodes:
            node.check()
        now = time.monotonic()
        if len(watch.times) > count:
            count, heard = len(watch.times), now
        if count and len(nodes) == 1:  # the gait comes when its beginning will be seen
            nodes.append(start('gait', f'scene:={source}', 'use_sim_time:=true'))
        if said := nodes[-1].said(r'the gait begins at t = (\S+) s'):
            watch.begin = float(said[1])
        if watch.begin is None and now - started > START_TIMEOUT:
            raise NodeDied(f'the gait did not begin within {START_TIMEOUT:g} s')
        if count and now - heard > STALL_TIMEOUT:
            raise NodeDied(f'no state from sim for {STALL_TIMEOUT:g} s')
        if watch.begin is not None and now - shown > 0.1:
            shown = now
            print('\r' + _progress(watch, middle), end='', flush=True)
    print('\r' + _progress(watch, middle))


def _progress(watch: Watch, middle: int) -> str:
    x, y, _ = watch.positions[-1][middle]
    factor = watch.values.get('real_time_factor', '-')
    residual = watch.values.get('residual', '-')
    return (
        f't = {watch.times[-1] - (watch.begin or 0.0):6.2f} s   link {middle + 1} at '
        f'({x:+.3f}, {y:+.3f}) m   real-time factor {factor}   residual {residual} m/s   '
    )


def _summarize(watch: Watch, middle: int, seconds: float, title: str, out: Path) -> None:
    times, position = np.array(watch.times), np.array(watch.positions)
    if watch.begin is None or not (times >= watch.begin).any():
        print('the gait had not begun; there is nothing to show')
        return
    first = int(np.argmax(times >= watch.begin))
    times, position = times[first:], position[first:]
    start, end = position[0, middle], position[-1, middle]
    print(
        f'link {middle + 1} went from ({start[0]:.4f}, {start[1]:.4f}) to ({end[0]:.4f}, '
        f'{end[1]:.4f}) m in {times[-1] - times[0]:.2f} s: {np.linalg.norm(end - start):.3f} m'
    )
    for key in SUMMARY:
        print(f'{key.replace("_", " "):20} {watch.values.get(key, "-")}')
    print(f'{"wall time in all":20} {seconds:.1f} s')
    try:
        from snake_sim_ros.comparison.charts import path_figure
    except ImportError:
        print('no picture: matplotlib is not installed')
        return
    path_figure(out, title, times, position, middle)
    print(f'{"picture":20} {out}')
