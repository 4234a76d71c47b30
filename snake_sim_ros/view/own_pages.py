# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which requests the server of the page answers: those of its own page, of no other website.

A browser lets any website open a websocket to a server of this machine, and a page that steers a
robot must not be steered by another one. The browser tells the website in the header `Origin`, and
the name by which it found the server in `Host`. A script has no `Origin`: it is accepted, since it
could claim any. No website may show the page in a frame, where a click could be meant for another.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from ipaddress import ip_address
import socket
from typing import Any
from urllib.parse import urlsplit

from snake_sim_ros.view.browser_messages import LONGEST_MESSAGE

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
