# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which connections and messages of browsers the server of the page accepts, and how it wakes up.

viser takes whatever comes: it casts values, sets any field of a control, opens a tunnel to a
server outside when it is asked for a link to share, and prints a traceback for what it cannot
decode. Messages are therefore judged before viser sees them.

A browser lets any website open a websocket to a server of this machine, and a page that steers a
robot must not be steered by another one. The browser names the website in the header `Origin`, and
the name by which it found the server in `Host`. A script has no `Origin`: it is accepted, since it
could claim any. No website may show the page in a frame, where a click could be meant for another.
"""

import asyncio
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from ipaddress import ip_address
import math
import socket
import sys
import time
from typing import Any
from urllib.parse import urlsplit

from snake_sim_ros.scene.checked_records import quoted

LONGEST_MESSAGE = 4096  # bytes; those of the page have less than 1000
SAY_PERIOD = 1.0  # s, the shortest between two lines about messages that are ignored
# How many numbers the fields of a camera have; 0 is a single one.
CAMERA = {
    'wxyz': 4, 'position': 3, 'fov': 0, 'near': 0, 'far': 0, 'image_height': 0, 'image_width': 0,
    'look_at': 3, 'up_direction': 3,
}  # fmt: skip
# Fields of a click in the 3-D view.
CLICK = {'event_type', 'ray_origin', 'ray_direction', 'screen_pos', 'modifier'}


class Refused(Exception):
    """A message that is not heeded, with the reason."""


class BrowserMessages:
    """
    Judges messages, and says on stderr, once a second at most, which are ignored.

    Attributes
    ----------
    controls : mapping
        The controls of the page by their identifiers, as viser has them; a message to another one
        is passed on, since viser ignores it.

    """

    def __init__(self) -> None:
        self.controls: Mapping[str, Any] = {}
        self._said, self._ignored = -math.inf, 0

    def heeds(self, message: str | bytes) -> bool:
        """Return whether a message is one of the page; a log line says why it is not."""
        try:
            self._check(message)
        except Refused as refused:
            self._say(str(refused))
            return False
        return True

    def _check(self, message: str | bytes) -> None:
        from msgspec import DecodeError
        from msgspec.msgpack import decode

        if isinstance(message, str):
            raise Refused(f'it must be binary, got the text {quoted(message)}')
        try:
            fields = decode(message)
        except (DecodeError, RecursionError, UnicodeDecodeError):
            raise Refused(f'it must be in MessagePack, got {quoted(message)}') from None
        kind = fields.pop('type', None) if isinstance(fields, dict) else None
        if kind == 'ViewerCameraMessage':
            _check_camera(fields)
        elif kind == 'GuiUpdateMessage':
            self._check_update(fields)
        elif kind == 'ScenePointerMessage':
            _check_click(fields)
        else:
            raise Refused(
                f'its type must be that of a camera, a control or a click, got {quoted(kind)}'
            )

    def _check_update(self, fields: dict[Any, Any]) -> None:
        """Refuse what is not a value that a control can have."""
        name, updates = fields.pop('uuid', None), fields.pop('updates', None)
        if fields or not isinstance(name, str) or not isinstance(updates, dict):
            raise Refused('a control needs its identifier and its updates alone')
        if updates.keys() != {'value'}:
            raise Refused(f'only the value of a control may be set, got {quoted(list(updates))}')
        control = self.controls.get(name)
        if control is not None:  # else it is one of a robot before
            _check_value(control, updates['value'])

    def _say(self, reason: str) -> None:
        """Print a line, unless the last one is less than a second old."""
        self._ignored += 1
        now = time.monotonic()
        if now - self._said >= SAY_PERIOD:
            what = 'a message' if self._ignored == 1 else f'{self._ignored} messages'
            print(f'the page ignored {what} of a browser: {reason}', file=sys.stderr, flush=True)
            self._said, self._ignored = now, 0


def _check_value(control: Any, value: Any) -> None:
    """Refuse what is not a value of a list, of a slider, or of a button or box."""
    if options := getattr(control, 'options', None):
        if not isinstance(value, str) or value not in options:
            raise Refused(f'{control.label} must be one of its options, got {quoted(value)}')
    elif (high := getattr(control, 'max', None)) is not None:
        low, rounding = control.min, 1e-9 * (high - control.min)
        if not _is_number(value) or not low - rounding <= value <= high + rounding:
            raise Refused(f'{control.label} must be {low:g} to {high:g}, got {quoted(value)}')
    elif not isinstance(value, bool):
        raise Refused(f'{control.label} must be true or false, got {quoted(value)}')


def _check_camera(fields: dict[Any, Any]) -> None:
    """Refuse what is not a camera of finite numbers."""
    if fields.keys() != CAMERA.keys():
        raise Refused(f'a camera has the fields {", ".join(CAMERA)}; got {quoted(list(fields))}')
    for name, count in CAMERA.items():
        _check_numbers(f'{name} of a camera', fields[name], count)


def _check_click(fields: dict[Any, Any]) -> None:
    """Refuse what is not a click without a key."""
    if fields.keys() != CLICK:
        raise Refused(f'a click has other fields, got {quoted(list(fields))}')
    if fields['event_type'] != 'click' or fields['modifier'] is not None:
        raise Refused('only clicks without a key are heeded')
    for name in ('ray_origin', 'ray_direction'):
        _check_numbers(f'{name} of a click', fields[name], 3)
    places = fields['screen_pos']
    place = places[0] if isinstance(places, list) and len(places) == 1 else None
    _check_numbers('screen_pos of a click', place, 2)


def _check_numbers(what: str, value: Any, count: int) -> None:
    """Refuse what is not a list of some finite numbers, or a single one if the count is 0."""
    numbers = value if count and isinstance(value, list) else [value]
    if len(numbers) != max(count, 1) or not all(map(_is_number, numbers)):
        wanted = f'{count} finite numbers' if count else 'a finite number'
        raise Refused(f'{what} must be {wanted}, got {quoted(value)}')


def _is_number(value: Any) -> bool:
    """Return whether a value is a finite number."""
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_number and math.isfinite(value)


# ---- connections --------------------------------------------------------------------------------

HEADERS = 'Host', 'Origin'
LOOPBACK = 'localhost', '127.0.0.1', '::1'


@contextmanager
def own_pages_only(host: str, heeds: Callable[[str | bytes], bool]) -> Iterator[None]:
    """
    Have the server of viser that starts meanwhile refuse the pages of others, and some messages.

    viser passes no options to the server of websockets that it starts, so its function `serve` is
    replaced for this time.

    Parameters
    ----------
    host : str
        Address that the server binds to.
    heeds : callable
        Returns whether a message of a browser is passed on; longer ones than LONGEST_MESSAGE close
        its connection.

    Raises
    ------
    RuntimeError
        If viser starts its server in another way, and nothing would be refused.

    """
    from websockets.asyncio import server

    serve, calls = server.serve, []

    class Connection(server.ServerConnection):
        """A connection that passes on some messages only."""

        async def recv(self, decode: bool | None = None) -> Any:
            while not heeds(message := await super().recv(decode)):
                pass
            return message

    def guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        calls.append(arguments)

        def check(connection: Any, request: Any) -> Any:
            asked, pages = (', '.join(request.headers.get_all(name)) for name in HEADERS)
            reason = refusal(asked, pages, host)
            if reason:
                return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
            response = process_request(connection, request)
            if response is not None:
                response.headers['Content-Security-Policy'] = "frame-ancestors 'none'"
            return response

        options |= {'create_connection': Connection, 'max_size': LONGEST_MESSAGE}
        return serve(*arguments, process_request=check, **options)

    server.serve = guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not calls:
        raise RuntimeError('this version of viser does not serve by websockets.asyncio.server')


def refusal(host: str, origin: str, bound: str) -> str:
    """
    Return why a request is refused, '' if it is not.

    Parameters
    ----------
    host : str
        Header `Host`: where the browser found the server, as name:port.
    origin : str
        Header `Origin` of the page that asks, '' if there is none.
    bound : str
        Address that the server binds to.

    """
    try:
        own, page = _place(f'//{host}'), _place(origin)
    except ValueError:
        return f'the headers Host and Origin must be addresses, got {host!r} and {origin!r}'
    if not _is_own(own[0], bound):
        # Else a website could have its own name lead here and be of the same origin.
        return f'{host!r} is no name of this machine: open the page by its address'
    if origin and page != own:
        return f'only the page of this server may connect, not one of {origin}'
    return ''


def _place(address: str) -> tuple[str, int]:
    """Return host and port; all names of this machine for itself are the same."""
    url = urlsplit(address)
    name = url.hostname or ''
    return LOOPBACK[0] if name in LOOPBACK else name, url.port or 80


def _is_own(name: str, bound: str) -> bool:
    """Return whether a name is an address, or one of this machine."""
    machine = socket.gethostname().lower()
    if name in (LOOPBACK[0], bound.lower(), machine, f'{machine}.local'):
        return True
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


# ---- updates ------------------------------------------------------------------------------------


class WakeUp(asyncio.Event):
    """
    An event that any thread may set: the loop itself does it.

    viser sets an `asyncio.Event` from the thread that changes the page. Between the moment when
    the loop looks at it and the moment when it begins to wait, such a call wakes nobody, and no
    later one does, since the event counts as set: the page would stand still for good.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._own_loop = loop

    def set(self) -> None:
        """Have the loop set the event, unless it has ended."""
        with suppress(RuntimeError):
            self._own_loop.call_soon_threadsafe(super().set)


def wake_from_any_thread(server: Any) -> None:
    """Have a server of viser, to which no browser is connected yet, lose no update."""
    buffer = server._websock_server._broadcast_buffer
    buffer.message_event = WakeUp(buffer.event_loop)
