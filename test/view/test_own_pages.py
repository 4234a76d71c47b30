# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which requests the page of the viewer answers, on a real server."""

import socket

import pytest

pytest.importorskip('viser')  # the server of the page, which brings websockets

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from snake_sim_ros.view.browser_guard import own_pages_only, refusal
from snake_sim_ros.view.page import Page

BOUND = '127.0.0.1'


@pytest.fixture(scope='module')
def port():
    page = Page('test', BOUND, 0)
    yield page.url.rpartition(':')[2]
    page.close()


@pytest.mark.parametrize(
    'origin', ['http://127.0.0.1:{}', 'http://localhost:{}', 'http://[::1]:{}', None]
)
def test_own_pages_and_scripts_connect(port, origin):
    with connect(f'ws://127.0.0.1:{port}', origin=origin and origin.format(port)) as connection:
        assert connection.response.status_code == 101


@pytest.mark.parametrize(
    'origin',
    [
        *('http://evil.example', 'https://evil.example:{}', 'http://127.0.0.1.evil.example:{}'),
        *('http://localhost:1', 'http://localhost', 'null', 'file://', 'http://[', 'x:y:z'),
        'http://127.0.0.1:{}, http://evil.example',
    ],
)
def test_other_pages_are_refused(port, origin):
    with pytest.raises(InvalidStatus) as refused:
        connect(f'ws://127.0.0.1:{port}', origin=origin.format(port))
    assert refused.value.response.status_code == 403
    assert b'\n' in refused.value.response.body


@pytest.mark.parametrize(
    ('host', 'name'),
    [
        *((BOUND, f'192.168.0.7:{8080}'), ('0.0.0.0', '[fe80::1]:8080'), (BOUND, 'LOCALHOST:1')),
        *(('robot.lab', 'robot.lab:8080'), ('0.0.0.0', socket.gethostname())),
    ],
)
def test_names_of_this_machine(host, name):
    assert not refusal(name, f'http://{name}', host)
    assert 'only the page' in refusal(name, 'http://evil.example', host)


@pytest.mark.parametrize('name', ['evil.example:8080', '', 'localhost.evil.example'])
def test_a_website_whose_name_leads_here_is_refused(name):
    assert 'no name of this machine' in refusal(name, f'http://{name}', BOUND)
    assert 'no name of this machine' in refusal(name, '', BOUND)


def test_a_server_that_would_refuse_nothing_does_not_start():
    with pytest.raises(RuntimeError, match='does not serve by'), own_pages_only(BOUND, bool):
        pass
