# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hostile messages of browsers at the page of `snake-sim view`, which plays a short run.

A second of a flood, then a look at what must hold, and so on: the page is served, its controls are
heeded, and little is printed.
"""

from collections.abc import Iterator
from pathlib import Path
import random
import tempfile
import time
from typing import Any
from urllib.request import urlopen

from snake_sim_benchmarks.reliability.attacked_node import AttackedNode
from snake_sim_benchmarks.reliability.trials import Trial
from snake_sim_ros.recording.recorded_runs import write_npz
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.view.browser_guard import CAMERA

URL = r'http://\S+'
START = 60.0  # s for the page to be served
ANSWER = 5.0  # s for the page, and for a control to be heeded
FLOOD = 1.0  # s between two looks
PAUSE = 1e-3  # s between two messages of a flood
PRINTED = 2_000  # bytes that may be printed in a second of a flood
BOX = 'again and again'  # the label of a box on the page
HEAD = 8  # bytes of each of the two sizes at the start of what the server sends
KINDS = (
    *('GuiUpdateMessage', 'ViewerCameraMessage', 'ShareUrlRequest', 'ShareUrlDisconnect'),
    *('GuiButtonHoldMessage', 'FileTransferStartUpload', 'FileTransferPart', 'Message', '', None),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2**63, 0.5, 1e308, float('nan'), float('inf'), '', 'x', '1'),
    *('\0', 'x' * 1000, [], [1], [[1]] * 3, {}, {'value': 1}, b'', b'\xff' * 100),
)
FIELDS = ('value', 'removed', 'update_cb', 'uuid', 'min', 'options', '__class__', '')


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Flood the page that plays a run."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'run.npz'
        write_npz(
            simulate(with_settings(load_scene('lateral_undulation'), {'duration': 1.0})), path
        )
        command = [
            '-m',
            'snake_sim_ros.commands',
            'view',
            str(path),
            '--port',
            '0',
            '--no-browser',
        ]
        attacked = AttackedNode(command)
        try:
            if attacked.wait_until_said(URL, START):
                yield _flooded(attacked, attacked.found(URL), seconds, seed)
            else:
                first = f'view did not start: {" / ".join(list(attacked.lines)[-3:])}'
                yield Trial('pages', 'view', 'messages', 0, 1, START, first=first)
        finally:
            attacked.end()


def _flooded(attacked: AttackedNode, url: str, seconds: float, seed: int) -> Trial:
    """Flood a page repeatedly, and return the trial."""
    from websockets.exceptions import WebSocketException

    rng, sent, violations, most, longest, first = random.Random(seed), 0, 0, 0, 0.0, ''
    begin, floods = time.monotonic(), 0
    while floods == 0 or (attacked.is_alive and time.monotonic() - begin < seconds):
        floods += 1
        problems, printed = [], attacked.printed
        try:
            sent += _flood(url, rng)
            longest = max(longest, _answer(url))
        except (OSError, EOFError, WebSocketException) as error:
            problems.append(f'the page does not answer: {error!r}')
        most = max(most, attacked.printed - printed)
        if not attacked.is_alive or attacked.said('Traceback'):
            problems.append(f'view failed: {" / ".join(list(attacked.lines)[-3:])}')
        if most > PRINTED:
            problems.append(f'view printed {most} bytes in a second')
        violations += len(problems)
        if problems and not first:
            first = f'seed {seed}, second {floods}: {problems[0]}'
    return Trial(
        'pages', 'view', 'messages', sent, violations, time.monotonic() - begin, longest,
        figures=f'{floods} floods, {most} bytes printed in a second at most', first=first,
    )  # fmt: skip


class _Browser:
    """
    A connection as that of a browser.

    Attributes
    ----------
    controls : dict
        Label -> identifier of the controls of the page.

    """

    def __init__(self, url: str) -> None:
        from viser import __version__
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        protocols = [Subprotocol(f'viser-v{__version__}')]
        self._connection = connect(url.replace('http', 'ws'), subprotocols=protocols)
        self.controls: dict[str, str] = {}
        while BOX not in self.controls:
            for message in self.received():
                if 'uuid' in message and 'label' in message.get('props', ()):
                    self.controls[message['props']['label']] = message['uuid']

    def received(self) -> list[dict[str, Any]]:
        """Return the messages of the next frame of the server."""
        from msgspec import msgpack
        from zstandard import decompress

        frame = self._connection.recv(ANSWER, decode=False)
        size = int.from_bytes(frame[HEAD : 2 * HEAD], 'little')
        content = msgpack.decode(decompress(frame[2 * HEAD :][:size]))
        return list(content['messages'])

    def send(self, message: Any) -> None:
        """Send bytes or a text as they are, and all else in MessagePack."""
        from msgspec import msgpack

        is_raw = isinstance(message, (bytes, str))
        self._connection.send(message if is_raw else msgpack.encode(message))

    def __enter__(self) -> '_Browser':
        """Return the browser itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the connection."""
        self._connection.close()


def _flood(url: str, rng: random.Random) -> int:
    """Send random messages for a while; return how many."""
    sent, end = 0, time.monotonic() + FLOOD
    with _Browser(url) as browser:
        names = list(browser.controls.values())
        while time.monotonic() < end:
            browser.send(_hostile(rng, names))
            sent += 1
            time.sleep(PAUSE)
    return sent


def _hostile(rng: random.Random, names: list[str]) -> Any:
    """Return a message of which something is wrong, as a rule."""
    way = rng.random()
    if way < 0.1:
        return rng.randbytes(rng.randrange(60))
    if way < 0.2:
        return rng.choice(VALUES)
    fields: dict[Any, Any] = {'type': rng.choice(KINDS[:2] if way < 0.8 else KINDS)}
    if fields['type'] == 'ViewerCameraMessage':
        fields |= {name: [1.0] * count if count else 1 for name, count in CAMERA.items()}
        fields[rng.choice([*CAMERA, ''])] = rng.choice(VALUES)
    else:
        updates = {rng.choice(FIELDS): rng.choice(VALUES) for _ in range(rng.randrange(1, 3))}
        fields |= {'uuid': rng.choice([*names, *VALUES]), 'updates': updates}
    return fields


def _answer(url: str) -> float:
    """Return how long it takes until one browser hears what another one did [s]."""
    begin = time.monotonic()
    with urlopen(url, timeout=ANSWER) as page:
        page.read()
    with _Browser(url) as hand, _Browser(url) as eye:
        box = hand.controls[BOX]
        for value in (True, False):  # one of them is new
            hand.send({'type': 'GuiUpdateMessage', 'uuid': box, 'updates': {'value': value}})
        while not any(
            message['type'] == 'GuiUpdateMessage' and message['uuid'] == box
            for message in eye.received()
        ):
            if time.monotonic() - begin > ANSWER:
                raise EOFError(f'{BOX!r} was not heeded within {ANSWER:g} s')
    return time.monotonic() - begin
