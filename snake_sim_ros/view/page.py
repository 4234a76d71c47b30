# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A page in the browser that shows a robot in 3-D, with plots and controls, by viser.

The program that has a robot makes a `Page`, calls `build` with its scene, `show` with each frame,
and `plot` now and then. viser makes its callbacks in other threads; in these, a page only notes
what was chosen.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from errno import EADDRINUSE
from io import StringIO
import math
import socket
from typing import Any
import webbrowser

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.surfaces import Surface
from snake_sim_ros.view.browser_guard import BrowserMessages, own_pages_only, wake_from_any_thread
from snake_sim_ros.view.frames import at_rest, curves, floor_point, Frame, Trace, UPWARD_SCALE
from snake_sim_ros.view.stage import Stage

SHOW_PERIOD, PLOT_PERIOD = 1 / 30, 1 / 10  # s of wall time, the shortest between two updates
PANEL_WIDTH = 310  # pixels
PLOT_HEIGHT = 210  # pixels
COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#000000', '#999999')
COMMANDED_WIDTH, PALE = (
    5.0,
    '55',
)  # of lines of what is commanded; opacity as two hexadecimal digits
SECONDARY = 'gray'  # color of buttons beside the one that is pressed most
ALL_JOINTS = {'yaw of all joints': -1, 'pitch of all joints': -2}
PLOT_TITLES = {'angle': 'joint angles [deg]', 'torque': 'joint torques [N m]'}
LEGEND_LIMIT = 10  # curves
NO_PATH = np.zeros((0, 2))
SHEET = 0.4  # share of a narrow window that the controls cover
WIDE_ENOUGH = 0.85  # width over height of a window in which the first view shows the whole robot
# Columns stay where they are when texts change. Where the window is narrow, viser has one sheet at
# its bottom, which would hide the robot.
STYLE = """<style>table { table-layout: fixed; width: 100%; }
@media (max-width: 36em) {
  div[style*="max-height: 60%"] {
    max-height: 40% !important; width: 100% !important; padding-bottom: 1px;
  }
  div[style*="max-height: 60%"] div[style*="width: 20em"] { width: 100% !important; }
}</style>"""


class Page:
    """
    A page, served to any number of browsers.

    Parameters
    ----------
    title : str
    host : str
        Address of this machine to bind to.
    port : int
        0 takes any free port.

    Attributes
    ----------
    gui : viser.GuiApi
        Interface for controls; `controls` is the folder for them.
    url : str

    Raises
    ------
    ParameterError
        If the port is in use, the host is not of this machine, or viser is not installed.

    """

    def __init__(self, title: str, host: str, port: int) -> None:
        make_server = _server_class()
        check_address(host, port)
        # The caller prints the address.
        messages = BrowserMessages()
        with redirect_stdout(StringIO()), own_pages_only(host, messages.heeds):
            self._server = make_server(host=host, port=port, label=title, verbose=False)
        wake_from_any_thread(self._server)
        self.url = f'http://{host}:{self._server.get_port()}'
        self.gui = self._server.gui
        messages.controls = self.gui._gui_input_handle_from_uuid
        self.gui.configure_theme(show_logo=False, show_share_button=False)
        self.gui.main_panel.dock_right()
        self.gui.main_panel.set_width(PANEL_WIDTH)
        self.gui.add_html(STYLE)
        self.controls = self.gui.add_folder('Control')
        self._status = self.gui.add_markdown('waiting for joint_states ...')
        self._scale = self.gui.add_markdown('')
        self._add_switches()
        panel = self.gui.add_panel()
        self._plots = panel.add_tab('Joints')
        panel.dock_left()
        panel.set_width(PANEL_WIDTH)
        self._server.on_client_connect(self._fit_camera)
        self._stage: Stage | None = None
        self._joint: Any = None
        self._charts: dict[str, Any] = {}
        self._changed = self._picks = False
        self._guides = NO_PATH, NO_PATH, NO_PATH
        self._drawn: dict[str, list[str]] = {}  # plot -> names of its curves

    @property
    def watched(self) -> bool:
        """Whether a browser shows the page at present."""
        return bool(self._server.get_clients())

    def changed(self) -> bool:
        """Return whether another view was chosen since the last call."""
        changed, self._changed = self._changed, False
        return changed

    def build(self, scene: Scene, solids: Sequence[Surface] = ()) -> None:
        """Show the obstacles and the robot of a scene, and further solids."""
        with self._server.atomic():
            self._server.scene.reset()
            self._stage = Stage(self._server.scene, scene, solids)
            along = 100 * self._stage.scale
            self._scale.content = (
                f'**Orange**: forces along the floor, 1 N is {along:g} cm. '
                f'**Light blue**: upward, 1 N is {UPWARD_SCALE * along:g} cm.'
            )
            self._set_camera(scene)
            self._choose_joints(scene)
            self._stage.show(at_rest(scene.robot))
            self._stage.show_guide(*self._guides)

    def show(self, frame: Frame) -> None:
        """Show a frame."""
        stage = self._stage
        assert stage is not None, 'build comes first'
        with self._server.atomic():
            stage.follow = self._follow.value and not self._picks
            stage.show(frame)
            stage.friction.visible = self._friction.value
            stage.points.visible = self._friction.value or self._normal.value
            stage.normal.visible = self._normal.value
            stage.path.visible = self._path.value
            if stage.see_through != self._see_through.value:
                stage.see_through = self._see_through.value
                stage.set_see_through(stage.see_through)

    def tell(self, frame: Frame, status: Mapping[str, str]) -> None:
        """Write the time of a frame and a status, name -> text."""
        texts = {'time': f'{frame.time:.2f} s', **status}
        rows = [f'| {name} | **{text}** |' for name, text in texts.items()]
        self._status.content = '\n'.join(['| | |', '|:--|:--|', *rows])

    def plot(self, trace: Trace) -> None:
        """Draw the path and the curves of a trace."""
        assert self._stage is not None, 'build comes first'
        joint = self._joint_of(self._joint.value)
        with self._server.atomic():
            if len(trace.path) > 1:
                self._stage.show_path(trace.path)
            if not len(trace.time):
                return
            for what in PLOT_TITLES:
                time, values = curves(trace, what, joint)
                if list(values) != self._drawn.get(what):
                    self._drawn[what] = list(values)
                    self._replace_chart(what, time, values)
                elif values:
                    self._charts[what].data = (time, *values.values())

    def show_guide(self, guide: Array, drawn: Array, clicked: Array) -> None:
        """Draw the path to follow, one that is drawn, and clicked points, (k, 2) [m] each."""
        assert self._stage is not None, 'build comes first'
        self._guides = guide, drawn, clicked
        with self._server.atomic():
            self._stage.show_guide(*self._guides)

    def pick(self, then: Callable[[Array], None] | None) -> None:
        """
        Call a function with each point of the floor that is clicked, (2,) [m], or no more.

        Meanwhile the camera stands still.
        """
        scene, self._picks = self._server.scene, then is not None
        scene.remove_click_callback()

        def note(click: Any) -> None:
            assert self._stage is not None and then is not None
            eye = np.subtract(click.ray_origin, self._stage.root.position)
            point = floor_point(eye, click.ray_direction)
            if point is not None:
                then(point)

        if then is not None:
            scene.on_click()(note)

    def say(self, title: str, sentence: str) -> None:
        """Show a message on top of the page for some seconds."""
        for client in self._server.get_clients().values():
            client.add_notification(title, sentence, auto_close_seconds=8.0)

    def close(self) -> None:
        """End the server."""
        with redirect_stdout(StringIO()):
            self._server.stop()

    def _add_switches(self) -> None:
        with self.gui.add_folder('View'):
            self._follow = self.gui.add_checkbox('camera follows', True)
            self._friction = self.gui.add_checkbox('friction', True)
            self._normal = self.gui.add_checkbox('normal forces', False)
            self._path = self.gui.add_checkbox('trail', True)
            self._see_through = self.gui.add_checkbox('see-through', False)
        switches = self._follow, self._friction, self._normal, self._path, self._see_through
        for switch in switches:
            switch.on_update(self._note)

    def _note(self, _: object) -> None:
        self._changed = True

    def _set_camera(self, scene: Scene) -> None:
        """Look at the robot obliquely from above."""
        length = scene.robot.per_link('link_length').sum()
        camera = self._server.initial_camera
        camera.position = tuple(length * np.array([-0.45, -1.05, 0.85]))
        camera.look_at = (0.0, 0.0, 0.0)
        camera.fov = math.radians(50)

    def _fit_camera(self, client: Any) -> None:
        """Look from farther away where the window is too narrow for the robot."""
        camera, first = client.camera, self._server.initial_camera
        if camera.image_height and camera.image_width < WIDE_ENOUGH * camera.image_height:
            position = np.asarray(first.position) * WIDE_ENOUGH / camera.aspect
            with client.atomic():
                camera.position = position
                camera.look_at = lowered(position, np.asarray(first.look_at), first.fov)

    def _choose_joints(self, scene: Scene) -> None:
        for chart in self._charts.values():
            chart.remove()
        self._charts, self._drawn = {}, {}
        count = scene.robot.link_count - 1
        names = (*(f'joint {j + 1}' for j in range(count)), *ALL_JOINTS)
        if self._joint is not None:
            self._joint.remove()
        with self._plots:
            self._joint = self.gui.add_dropdown(
                'show', names, initial_value=names[count // 2] if count else names[0], order=0
            )
        self._joint.on_update(self._note)

    def _joint_of(self, name: str) -> int:
        return ALL_JOINTS[name] if name in ALL_JOINTS else int(name.split()[1]) - 1

    def _replace_chart(self, what: str, time: Array, values: dict[str, Array]) -> None:
        if what in self._charts:
            self._charts.pop(what).remove()
        if not values:
            return
        series: list[dict[str, Any]] = [{'label': 't [s]'}]
        for k, name in enumerate(values):
            color, width = COLORS[k % len(COLORS)], 1.5
            if name.endswith('commanded'):
                color, width = COLORS[k % 2] + PALE, COMMANDED_WIDTH
            line = {'stroke': color, 'width': width, 'points': {'show': False}}
            series.append({'label': name, **line})
        with self._plots:
            self._charts[what] = self.gui.add_uplot(
                (time, *values.values()),
                tuple(series),
                title=PLOT_TITLES[what],
                scales={'x': {'time': False}},
                legend={'show': len(values) <= LEGEND_LIMIT, 'live': False},
                height=PLOT_HEIGHT,
                order=1 + list(PLOT_TITLES).index(what),
            )


def lowered(position: Array, look_at: Array, fov: float) -> Array:
    """
    Return where to look so that a point is in the middle of what a sheet leaves of the window.

    The sheet covers its lower part, `SHEET` of it, where the window is narrow.

    Parameters
    ----------
    position, look_at : ndarray, shape (3,)
        The camera, and the point [m].
    fov : float
        Angle that the height of the window covers [rad].

    """
    ahead = look_at - position
    across = np.cross(ahead, (0.0, 0.0, 1.0))
    up = np.cross(across, ahead) / np.linalg.norm(across)  # as long as `ahead`
    point: Array = look_at - SHEET * math.tan(fov / 2) * up
    return point


def _server_class() -> Callable[..., Any]:
    try:
        from viser import ViserServer
    except ImportError:
        raise ParameterError(
            "the viewer needs viser, which is not installed: pip install 'snake_sim_ros[viewer]'"
        ) from None
    return ViserServer


def check_address(host: str, port: int) -> None:
    """
    Raise an error if no page can be served there; viser would silently take another port.

    Raises
    ------
    ParameterError

    """
    if not 0 <= port <= 65535:
        raise ParameterError(f'port must be 0 (any free one) to 65535, got {port}')
    try:
        family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(address)
    except PermissionError:
        raise ParameterError(f'port {port} needs root rights; choose one from 1024 on') from None
    except socket.gaierror:
        raise ParameterError(f'host must be an address of this machine, got {host!r}') from None
    except OSError as error:
        in_use = f'port {port} of {host} is in use; choose another one, or 0 for any free one'
        elsewhere = f'host must be an address of this machine, got {host!r}'
        raise ParameterError(in_use if error.errno == EADDRINUSE else elsewhere) from None


def announce(page: Page, open_browser: bool) -> None:
    """Print the address of the page, and open it in a browser if there is one."""
    print(f'the viewer is at {page.url}', flush=True)
    if open_browser and not webbrowser.open(page.url):
        print(f'there is no browser here; open {page.url} in one yourself', flush=True)
