# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The live view of `snake-sim view`: the node `viewer`, and for a scene also `sim` and `gait`.

Where the gait can be steered, the node `follow` waits for a path that is drawn on the page.
"""

import sys
from threading import Event

from snake_sim_ros.controllers.following import speed_along
from snake_sim_ros.gaits.steering import Stride
from snake_sim_ros.nodes.programs import interruptible
from snake_sim_ros.nodes.tools.child_nodes import Child, children, NodeDied, scene_to_run, start
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.view.page import check_address

LOOK_PERIOD = 0.2  # s between two looks at the nodes


def view_live(source: str | None, host: str, port: int, open_browser: bool) -> int:
    """
    Show the robot on the topics, or run a scene and show it, until SIGINT or SIGTERM.

    Parameters
    ----------
    source : str, optional
        A scene to run: a YAML file or a name.
    host : str
    port : int
        Address of the page.
    open_browser : bool

    Returns
    -------
    int
        0; 1 if a node died.

    Raises
    ------
    ParameterError
        If there is no such scene, or the page cannot be served there.

    """
    check_address(host, port)
    browser = f'open_browser:={str(open_browser).lower()}'
    page = [f'host:={host}', f'port:={port}', browser]
    scene = scene_to_run(source) if source else None
    if scene:
        page.append(f'scene:={source}')
    with interruptible() as stop, children() as nodes:
        try:
            if scene:
                nodes.append(start('sim', f'scene:={source}'))
                nodes.append(start('gait', f'scene:={source}', 'use_sim_time:=true'))
            if scene and (scene.follow or can_be_steered(scene)):
                nodes.append(start('follow', f'scene:={source}', 'use_sim_time:=true'))
            nodes.append(start('viewer', *page, echo=True))
            _watch(nodes, stop)
        except NodeDied as error:
            print(f'snake-sim view: {error}', file=sys.stderr)
            return 1
    return 0


def can_be_steered(scene: Scene) -> bool:
    """Return whether a path can be followed with the gait of a scene."""
    try:
        speed_along(scene.follow, scene.gait, Stride.of(scene.gait, scene.friction))
    except ParameterError:
        return False
    return True


def _watch(nodes: list[Child], stop: Event) -> None:
    """Wait for the event; raise if a node ends before."""
    while not stop.wait(LOOK_PERIOD):
        for node in nodes:
            node.check()
