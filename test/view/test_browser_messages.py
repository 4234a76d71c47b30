# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of a browser to the page, on a real server: what it heeds, and what it says."""

import asyncio
from collections import deque
import re
from threading import Thread
import time
from urllib.request import urlopen

from hypothesis import given, settings, strategies as st
import pytest

pytest.importorskip('viser')  # the server of the page, which brings websockets and msgspec

from msgspec import msgpack
import numpy as np
import viser
from websockets.sync.client import connect

from snake_sim_ros import Scene
from snake_sim_ros.view.browser_guard import (
    BrowserMessages,
    CAMERA,
    CLICK,
    LONGEST_MESSAGE,
    WakeUp,
)
from snake_sim_ros.view.page import Page
from snake_sim_ros.view.playback import Player

GOOD_CAMERA = {'type': 'ViewerCameraMessage'} | {
    name: [1.0] * count if count else 1 for name, count in CAMERA.items()
}
GOOD_CLICK = {
    'type': 'ScenePointerMessage', 'event_type': 'click', 'ray_origin': [0.5, 0.0, 2.0],
    'ray_direction': [0.0, 1.0, -1.0], 'screen_pos': [[0.5, 0.5]], 'modifier': None,
}  # fmt: skip


@pytest.fixture
def page():
    page = Page('test', '127.0.0.1', 0)
    yield page
    page.close()


@pytest.fixture
def player(page):
    return Player(page, np.arange(11) / 10)


@pytest.fixture
def browser(page):
    address = page.url.replace('http', 'ws')
    with connect(address, subprotocols=[f'viser-v{viser.__version__}']) as connection:
        yield connection


def update(control, value, **more):
    fields = {'uuid': control._impl.uuid, 'updates': {'value': value}, **more}
    return {'type': 'GuiUpdateMessage', **fields}


def heeded(browser, player, *messages):
    """Send messages, then a value of a box; return whether that came within a second."""
    for message in messages:
        browser.send(message if isinstance(message, (str, bytes)) else msgpack.encode(message))
    wanted = not player.loop.value
    browser.send(msgpack.encode(update(player.loop, wanted)))
    end = time.monotonic() + 1.0
    while player.loop.value != wanted and time.monotonic() < end:
        time.sleep(0.01)
    return player.loop.value == wanted


def test_values_that_controls_can_have_are_taken(page, player, browser):
    values = update(player.speed, '2'), update(player.slider, 0.25), update(player.button, True)
    assert heeded(browser, player, GOOD_CAMERA, *values)
    assert (player.speed.value, player.slider.value) == ('2', 0.25)
    assert page.watched
    assert player.advance(0.0) == 2  # the slider was heard


@pytest.mark.parametrize(
    ('control', 'value', 'said'),
    [
        ('speed', 'x', "speed must be one of its options, got 'x'"),
        ('speed', ['1'], 'one of its options'),
        ('slider', float('nan'), r'time \[s\] must be 0 to 1, got nan'),
        ('slider', 1.5, 'must be 0 to 1, got 1.5'),
        ('slider', 10**18, 'must be 0 to 1'),
        ('slider', '0.5', 'must be 0 to 1'),
        ('slider', None, 'must be 0 to 1'),
        ('loop', 0, 'must be true or false, got 0'),
    ],
)
def test_other_values_are_ignored_with_a_reason(control, value, said, player, browser, capfd):
    handle = getattr(player, control)
    before = handle.value
    assert heeded(browser, player, update(handle, value))
    assert control == 'loop' or handle.value == before
    player.advance(0.1)  # and the playback goes on
    said_lines = capfd.readouterr().err.splitlines()
    assert len(said_lines) == 1 and re.search(said, said_lines[0])


def test_no_other_field_of_a_control_is_set(player, browser):
    other = {'type': 'GuiUpdateMessage', 'uuid': player.speed._impl.uuid}
    for updates in ({'removed': True}, {'value': '2', 'update_cb': 1}, {}, []):
        assert heeded(browser, player, other | {'updates': updates})
    assert player.speed.value == '1'
    assert heeded(browser, player, update(player.speed, '2'))
    assert player.speed.value == '2'


def test_clicks_on_the_floor_are_points_while_they_are_asked_for(page, player, browser):
    points = []
    page.build(Scene())
    page._stage.root.position = (-1.0, 0.0, 0.0)  # the camera follows a robot at x = 1 m
    assert heeded(browser, player, GOOD_CAMERA, GOOD_CLICK)
    page.pick(points.append)
    away = GOOD_CLICK | {'ray_direction': [0.0, 1.0, 1.0]}
    assert heeded(browser, player, away, GOOD_CLICK)
    end = time.monotonic() + 1.0
    while not points and time.monotonic() < end:
        time.sleep(0.01)
    page.pick(None)
    assert heeded(browser, player, GOOD_CLICK)
    time.sleep(0.1)
    np.testing.assert_array_equal(points, [[1.5, 2.0]])


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'ray_origin': [0.0, 0.0]}, 'ray_origin of a click must be 3 finite numbers'),
        ({'ray_direction': [0.0, float('inf'), 1.0]}, 'ray_direction of a click must be 3 finite'),
        ({'ray_origin': None}, 'ray_origin of a click must be 3 finite numbers, got None'),
        ({'screen_pos': [0.5, 0.5]}, 'screen_pos of a click must be 2 finite numbers'),
        ({'event_type': 'rect-select'}, 'only clicks without a key'),
        ({'modifier': 'shift'}, 'only clicks without a key'),
        ({'more': 1}, 'a click has other fields'),
    ],
)
def test_other_clicks_are_ignored_with_a_reason(changes, said, page, player, browser, capfd):
    points = []
    page.build(Scene())
    page.pick(points.append)
    assert heeded(browser, player, GOOD_CLICK | changes)
    (line,) = capfd.readouterr().err.splitlines()
    assert said in line and not points


@pytest.mark.parametrize('kind', ['ShareUrlRequest', 'ShareUrlDisconnect'])
def test_no_tunnel_is_opened(kind, page, player, browser, monkeypatch):
    asked = []
    monkeypatch.setattr(page._server, 'request_share_url', lambda: asked.append('on'))
    monkeypatch.setattr(page._server, 'disconnect_share_url', lambda: asked.append('off'))
    assert heeded(browser, player, {'type': kind})
    time.sleep(0.2)  # viser would ask in a thread of its own
    assert not asked


def test_malformed_frames_are_a_line_a_second(player, browser, capfd):
    begin = time.monotonic()
    frames = ['text', b'', b'\xc1', b'\x81\xa1a', msgpack.encode([1]), msgpack.encode({'type': 1})]
    assert heeded(browser, player, *frames * 50)
    lines = capfd.readouterr().err.splitlines()
    assert 1 <= len(lines) <= 1 + (time.monotonic() - begin)
    assert all(line.startswith('the page ignored ') for line in lines), lines


def test_a_long_message_ends_its_connection_alone(player, browser, page):
    address = page.url.replace('http', 'ws')
    with connect(address, subprotocols=[f'viser-v{viser.__version__}']) as other:
        other.send(bytes(LONGEST_MESSAGE + 1))
        with pytest.raises(Exception, match='1009'):
            while True:
                other.recv(2.0)
    assert heeded(browser, player)


@pytest.mark.parametrize('path', ['/', '/missing'])
def test_no_other_page_may_show_it_in_a_frame(path, page):
    try:
        headers = urlopen(page.url + path).headers
    except OSError as error:
        headers = error.headers
    assert headers['Content-Security-Policy'] == "frame-ancestors 'none'"


FIELDS = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-(2**63), 2**64 - 1) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.integers(0, 9), inner),
    max_leaves=10,
)
KEYS = st.sampled_from(['type', 'uuid', 'updates', *CAMERA, *sorted(CLICK)])
KINDS = st.sampled_from(['ViewerCameraMessage', 'GuiUpdateMessage', 'ScenePointerMessage'])


@settings(max_examples=200, deadline=None)
@given(
    st.binary()
    | st.text()
    | st.builds(msgpack.encode, FIELDS)
    | st.builds(
        lambda fields, kind: msgpack.encode(fields | {'type': kind}),
        st.dictionaries(KEYS, FIELDS), KINDS,
    )
)  # fmt: skip
def test_no_message_is_an_error(message):
    assert BrowserMessages().heeds(message) in (True, False)


def test_update_between_look_and_wait_of_the_server_wakes_it():
    """A thread sets the event after the loop found it unset, just before the loop waits for it."""

    class Waiters(deque):
        def append(self, waiter):
            thread = Thread(target=event.set)
            thread.start()
            thread.join()
            super().append(waiter)

    async def wait():
        nonlocal event
        event = WakeUp(asyncio.get_running_loop())
        event._waiters = Waiters()
        await asyncio.wait_for(event.wait(), 10)

    event = None
    asyncio.run(wait())


def test_page_wakes_up_from_any_thread(page):
    assert isinstance(page._server._websock_server._broadcast_buffer.message_event, WakeUp)
