# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The viewer's controls: they act on `sim` and `gait` through public services and parameters.

The page calls back in threads of its own. The callbacks only put into a queue what a person
pressed or moved; everything else happens in the thread of the node.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import math
from queue import SimpleQueue
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import CONFIG
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.view.page import Page, SECONDARY

FREQUENCY = 'gait.yaw.angular_frequency', 'gait.pitch.angular_frequency'


@dataclass(frozen=True)
class Knob:
    """A number on the page for a parameter of a node, in a unit that is easy to read."""

    label: str
    node: str
    parameter: str
    unit: float  # one unit of the number on the page, in the unit of the parameter
    low: float
    high: float
    step: float


DEGREE = math.pi / 180
KNOBS = (
    Knob('amplitude [deg]', 'gait', 'gait.yaw.amplitude', DEGREE, 0.0, 60.0, 0.5),
    Knob('frequency [Hz]', 'gait', FREQUENCY[0], 2 * math.pi, 0.0, 2.0, 0.01),
    Knob('steering [deg]', 'gait', 'gait.yaw.offset', DEGREE, -20.0, 20.0, 0.5),
    Knob('friction along', 'sim', 'friction.longitudinal', 1.0, 0.0, 1.5, 0.01),
    Knob('friction across', 'sim', 'friction.transversal', 1.0, 0.0, 1.5, 0.01),
    Knob('real-time factor', 'sim', 'real_time_factor', 1.0, 0.0, 4.0, 0.05),
)
SCENE = 'scene'  # the parameter of `gait` that names where the gait comes from


class RemoteParameters:
    """Parameters of another node, set by one request at a time; newer values wait meanwhile."""

    def __init__(self, node: Node, name: str, names: list[str]) -> None:
        self.name, self.names = name, names
        self.values: dict[str, Any] = {}
        self.ready = False
        self.refused: Callable[[str, str], None] = lambda name, reason: None
        self._wanted: dict[str, Any] = {}
        self._busy: Any = None
        self._get = node.create_client(GetParameters, f'{name}/get_parameters')
        self._set = node.create_client(
            SetParametersAtomically, f'{name}/set_parameters_atomically'
        )

    def want(self, **values: Any) -> None:
        """Ask for values; the node gets the newest ones."""
        self._wanted |= values

    def poll(self) -> None:
        """Check whether the node is running, and send the values that wait."""
        ready = self._get.service_is_ready() and self._set.service_is_ready()
        if ready != self.ready:
            self.ready, self._busy = ready, None
            self.values.clear()
            if ready:
                self.read()
        if not ready:
            self._wanted.clear()
        elif self._wanted and (self._busy is None or self._busy.done()):
            wanted, self._wanted = self._wanted, {}
            items = [
                Parameter(name, value=value).to_parameter_msg() for name, value in wanted.items()
            ]
            self._busy = self._set.call_async(SetParametersAtomically.Request(parameters=items))
            self._busy.add_done_callback(partial(self._on_set, ', '.join(wanted)))

    def read(self) -> None:
        """Ask for all values."""
        future = self._get.call_async(GetParameters.Request(names=self.names))
        future.add_done_callback(self._on_values)

    def heed(self, event: ParameterEvent) -> None:
        """Take the values that changed."""
        for item in (*event.new_parameters, *event.changed_parameters):
            if item.name in self.names:
                self.values[item.name] = parameter_value_to_python(item.value)

    def _on_values(self, future: Any) -> None:
        values = [parameter_value_to_python(value) for value in future.result().values]
        # A node that does not know one of the names returns no values.
        self.values |= dict(zip(self.names, values, strict=False))

    def _on_set(self, names: str, future: Any) -> None:
        result = future.result().result
        if not result.successful:
            self.refused(names, result.reason)
            self.read()


class Controls:
    """The buttons and numbers on the page, and the nodes that they act on."""

    def __init__(self, node: Node, page: Page, restart: Callable[[], None]) -> None:
        self.page, self.restart, self.paused = page, restart, False
        self.actions: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._shown: dict[str, Any] = {}  # the values of parameters that the page shows
        names = {'sim': [], 'gait': [SCENE, FREQUENCY[1]]}  # type: dict[str, list[str]]
        for knob in KNOBS:
            names[knob.node].append(knob.parameter)
        self.remotes = {name: RemoteParameters(node, name, names[name]) for name in names}
        for remote in self.remotes.values():
            remote.refused = self._on_refused
        self.services = {
            'pause': node.create_client(SetBool, 'sim/pause'),
            'step': node.create_client(Trigger, 'sim/step'),
            'reset': node.create_client(Trigger, 'sim/reset'),
            'restart': node.create_client(Trigger, 'gait/restart'),
        }
        namespace = node.get_namespace().rstrip('/')
        self._of_node = {f'{namespace}/{name}': item for name, item in self.remotes.items()}
        node.create_subscription(
            ParameterEvent, '/parameter_events', self._on_event, QoSProfile(depth=100)
        )
        self._add_controls()

    def act(self) -> None:
        """Carry out what a person did on the page, and show the values of the nodes."""
        while not self.actions.empty():
            self.actions.get()()
        for remote in self.remotes.values():
            remote.poll()
        self._show()

    @property
    def remark(self) -> str:
        """A sentence about the nodes that are not running; empty if all are."""
        away = [name for name, remote in self.remotes.items() if not remote.ready]
        verb = 'is' if len(away) == 1 else 'are'
        return f'{" and ".join(away)} {verb} not running' if away else ''

    # ---- on the page ----------------------------------------------------------------------------

    def _add_controls(self) -> None:
        gui = self.page.gui
        with self.page.controls:
            self._remark = gui.add_markdown('', visible=False)
            self.buttons = {'pause': gui.add_button('pause')}
            for name in ('step', 'reset'):
                self.buttons[name] = gui.add_button(name, color=SECONDARY)
            self.gaits = list(gaits())
            self.gait = gui.add_dropdown('gait', self.gaits)
            self.numbers = {
                knob: gui.add_slider(knob.label, knob.low, knob.high, knob.step, knob.low)
                for knob in KNOBS
            }
        for name, button in self.buttons.items():
            self.when(button.on_click, getattr(self, f'_on_{name}'))
        self.when(self.gait.on_update, self._on_gait)
        for knob, number in self.numbers.items():
            self.when(number.on_update, partial(self._on_number, knob))

    def when(self, register: Callable[[Any], Any], action: Callable[[], None]) -> None:
        """Queue an action when a person acts; the node changes numbers as well."""

        def note(event: Any) -> None:
            if event.client_id is not None:
                self.actions.put(action)

        register(note)

    def _show(self) -> None:
        gait, sim = self.remotes['gait'], self.remotes['sim']
        self._remark.visible, self._remark.content = bool(self.remark), f'*{self.remark}*'
        for button in self.buttons.values():
            button.disabled = not sim.ready
        self.buttons['step'].disabled = not (sim.ready and self.paused)
        self.buttons['pause'].label = 'resume' if self.paused else 'pause'
        self.gait.disabled = SCENE not in gait.values
        scene = gait.values.get(SCENE)
        if isinstance(scene, str) and self._news(SCENE, scene):
            if scene not in self.gaits:
                self.gaits.append(scene)
                self.gait.options = tuple(self.gaits)
            self.gait.value = scene
        for knob, number in self.numbers.items():
            value = number_in(self.remotes[knob.node].values, knob.parameter)
            number.disabled = value is None
            if value is not None and self._news(knob.label, value):
                shown = round(value / knob.unit / knob.step) * knob.step
                number.min, number.max = min(number.min, shown), max(number.max, shown)
                number.value = round(shown, 6)

    def _news(self, name: str, value: Any) -> bool:
        """Return whether a value is new; one that is not may just be changed by a person."""
        news = self._shown.get(name) != value
        self._shown[name] = value
        return news

    # ---- on the nodes ---------------------------------------------------------------------------

    def _on_pause(self) -> None:
        self._call('pause', SetBool.Request(data=not self.paused), self._set_paused)

    def _set_paused(self, message: str) -> None:
        self.paused = message == 'paused'

    def _on_step(self) -> None:
        self._call('step', Trigger.Request())

    def _on_reset(self) -> None:
        self._call('reset', Trigger.Request(), lambda _: self.restart())
        if self.services['restart'].service_is_ready():
            self._call('restart', Trigger.Request())

    def _call(
        self, name: str, request: Any, then: Callable[[str], None] = lambda message: None
    ) -> None:
        """Call a service, and show its reason if it fails."""

        def on_response(future: Any) -> None:
            response = future.result()
            if response.success:
                then(response.message)
            else:
                self.page.say(name, response.message)

        self.services[name].call_async(request).add_done_callback(on_response)

    def _on_gait(self) -> None:
        remote, wanted = self.remotes['gait'], {SCENE: self.gait.value}
        remote.values |= wanted
        remote.want(**wanted)

    def _on_number(self, knob: Knob) -> None:
        remote, value = self.remotes[knob.node], float(self.numbers[knob].value) * knob.unit
        wanted = {knob.parameter: value}
        yaw, pitch = (number_in(remote.values, name) for name in FREQUENCY)
        if knob.parameter == FREQUENCY[0] and yaw and pitch:
            wanted[FREQUENCY[1]] = value * pitch / yaw
        remote.values |= wanted
        remote.want(**wanted)

    def _on_refused(self, names: str, reason: str) -> None:
        self.page.say(names, reason)

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node in self._of_node:
            self._of_node[event.node].heed(event)


def number_in(values: dict[str, Any], name: str) -> float | None:
    """Return a parameter if it is a finite number, which another node need not have."""
    value = values.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return value if math.isfinite(value) else None


def gaits() -> dict[str, Any]:
    """Return name -> gait of the scenes without a world, each different gait once."""
    found: dict[str, Any] = {}
    for path in sorted(CONFIG.glob('*.yaml')):
        try:
            scene = load_scene(path)
        except ParameterError:  # The file describes a robot, not a scene.
            continue
        if scene.gait.yaw.amplitude and not scene.world and scene.gait not in found.values():
            found[path.stem] = scene.gait
    return found
