# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium, which tests control over its own protocol (websockets come with viser)."""

import base64
from itertools import count
import json
import math
import os
from pathlib import Path
import shutil
import subprocess
import time
from typing import Any
from urllib.request import urlopen

import pytest

connect = pytest.importorskip('websockets.sync.client').connect

TIMEOUT = 120.0  # s; Chromium draws in software, beside other tests
SCALE = 0.5  # pixels that are drawn for one of the window, along each side
AGAIN = 5.0  # s after which a click that had no effect is lost
FLAGS = (
    *('--headless=new', '--no-sandbox', '--no-first-run', '--disable-background-networking'),
    *('--disable-component-update', '--disable-sync', '--disable-extensions', '--mute-audio'),
    *('--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'),
    *('--disable-dev-shm-usage', '--hide-scrollbars', '--remote-debugging-port=0'),
    '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1',  # no name leads anywhere
)
# Chromium draws in software, half a second for a scene: the page moves seven times a second, not
# sixty, and draws its scene for pictures only.
SELDOM = """
    const frame = requestAnimationFrame;
    window.requestAnimationFrame = act => setTimeout(frame, 150, act);
    window.cancelAnimationFrame = clearTimeout;
    window.draws = false;
    window.drawn = 0;
    const gl = WebGL2RenderingContext.prototype;
    for (const name of Object.keys(gl).filter(name => /^(clear$|draw[AE])/.test(name))) {
        const own = gl[name];
        gl[name] = function (...rest) {
            if (window.draws) {
                own.apply(this, rest);
                window.drawn += 1;
            }
        };
    }
"""
TEXT = 'input:not([type=hidden]):not([type=checkbox])'
NAMES = ('chromium', 'chromium-browser', 'google-chrome')


def find() -> str:
    """Return the path of Chromium; skip the test without one, unless CI is set."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        reason = f'none of {", ".join(NAMES)} is installed'
        (pytest.fail if os.environ.get('CI') else pytest.skip)(reason)
    return str(path)


class Browser:
    """One page in a Chromium of its own."""

    def __init__(self, folder: Path, size: tuple[int, int] = (1280, 720)) -> None:
        window = f'--window-size={size[0]},{size[1]}'
        command = [find(), *FLAGS, window, f'--user-data-dir={folder}', 'about:blank']
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.requests: list[str] = []  # all addresses that the page asked for
        self.errors: list[str] = []
        self._number = count(1)
        told = folder / 'DevToolsActivePort'
        self.until(lambda: told.is_file() and told.read_text().count('\n'), 'Chromium')
        port = told.read_text().split()[0]
        with urlopen(f'http://127.0.0.1:{port}/json', timeout=TIMEOUT) as answer:
            pages = [item for item in json.load(answer) if item['type'] == 'page']
        self.socket = connect(pages[0]['webSocketDebuggerUrl'], max_size=None)
        for domain in ('Page', 'Network', 'Runtime'):
            self.call(f'{domain}.enable')
        self.call('Page.addScriptToEvaluateOnNewDocument', source=SELDOM)
        self.resize(*size)

    def resize(self, width: int, height: int) -> None:
        """Give the window another size [pixels]."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=SCALE,
            mobile=False,
        )

    def call(self, method: str, **parameters: Any) -> Any:
        """Return the result of a command of the protocol; keep the events meanwhile."""
        number = next(self._number)
        self.socket.send(json.dumps({'id': number, 'method': method, 'params': parameters}))
        while True:
            message = json.loads(self.socket.recv(TIMEOUT))
            if message.get('id') == number:
                assert 'error' not in message, message
                return message['result']
            self._note(message.get('method'), message.get('params', {}))

    def _note(self, event: str | None, parameters: Any) -> None:
        if event == 'Network.requestWillBeSent':
            self.requests.append(parameters['request']['url'][:100])
        elif event == 'Network.webSocketCreated':
            self.requests.append(parameters['url'][:100])
        elif event == 'Runtime.exceptionThrown':
            self.errors.append(str(parameters['exceptionDetails']))

    def open(self, url: str) -> None:
        """Go to a page."""
        self.call('Page.navigate', url=url)

    def run(self, script: str) -> Any:
        """Return the value of an expression in the page."""
        result = self.call('Runtime.evaluate', expression=script, returnByValue=True)
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    @property
    def text(self) -> str:
        """The whole visible text of the page."""
        return str(self.run('document.body ? document.body.innerText : ""'))

    def button(self, name: str) -> str:
        """Return the expression of the button of a name."""
        return f'[...document.querySelectorAll("button")].find(b => b.innerText === "{name}")'

    def has(self, name: str) -> bool:
        """Return whether there is a button of a name."""
        return bool(self.run(f'!!({self.button(name)})'))

    def press(self, name: str) -> None:
        """Press the button of a name, once it can be pressed."""
        button = self.button(name)
        self.until(lambda: self.run(f'({button})?.disabled === false'), f'the button {name}')
        self.run(f'{button}.click()')

    def click(self, x: int, y: int) -> None:
        """Click at a place of the window [pixels]."""
        for kind in ('mousePressed', 'mouseReleased'):
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', clickCount=1)

    def press_until(self, name: str, condition: Any, what: str) -> None:
        """Press a button, again and again, until a condition; a page drawn anew loses clicks."""
        pressed = -math.inf

        def is_done() -> bool:
            nonlocal pressed
            if condition():
                return True
            if time.monotonic() - pressed > AGAIN:
                pressed = time.monotonic()
                self.run(f'{self.button(name)}?.click()')
            return False

        self.until(is_done, what)

    def field(self, label: str) -> str:
        """Return the expression of the text field of a label."""
        found = f'[...document.querySelectorAll("label")].find(l => l.innerText === "{label}")'
        return f'({found})?.parentElement.parentElement.parentElement.querySelector("{TEXT}")'

    def read(self, label: str) -> str:
        """Return the content of the field of a label."""
        return str(self.run(f'{self.field(label)}?.value'))

    def enter(self, label: str, text: str) -> None:
        """Write into the field of a label, once it is enabled, as a person does."""
        self.until(lambda: self.run(f'{self.field(label)}?.disabled === false'), label)
        for _ in range(5):  # a field that is drawn anew meanwhile loses what is written
            self.run(f'{self.field(label)}.focus(), {self.field(label)}.select()')
            self.call('Input.insertText', text=text)
            if self.read(label) == text:
                break
        self.run(f'{self.field(label)}.blur()')

    def choose(self, label: str, option: str) -> None:
        """Choose an option of the list of a label."""
        self.until(lambda: self.run(f'{self.field(label)}?.disabled === false'), label)
        self.run(f'{self.field(label)}.click()')
        items = '[...document.querySelectorAll("[role=option]")]'
        items += f'.find(o => o.innerText === "{option}")'
        self.until(lambda: self.run(f'!!({items})'), option)
        self.run(f'{items}.click()')

    def until(self, condition: Any, what: str) -> Any:
        """Wait for a condition, and return it."""
        end = time.monotonic() + TIMEOUT
        while not (value := condition()):
            assert time.monotonic() < end, f'waited {TIMEOUT} s for {what}'
            time.sleep(0.05)
        return value

    def picture(self) -> bytes:
        """Return a screenshot as PNG, with the scene as it is now."""
        before = self.run('window.draws = true, window.drawn')
        self.until(lambda: self.run('window.drawn') > before, 'the scene to be drawn')
        picture = base64.b64decode(self.call('Page.captureScreenshot')['data'])
        self.run('window.draws = false')
        return picture

    def close(self) -> None:
        """End Chromium."""
        self.socket.close()
        self.process.terminate()
        self.process.wait(TIMEOUT)
