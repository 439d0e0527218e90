"""Which pages and programs the server lets in, and what is said where the library is missing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.subjects.serve.test_serve import SECONDS, Server
from tests.support.udacity import write_scenario
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder: Path = tmp_path_factory.mktemp("origin")
    with Server(write_scenario(folder), "ekf", folder / "log") as started:
        yield started


def test_a_program_is_let_in(server: Server) -> None:
    with connect(f"ws://127.0.0.1:{server.port}/", compression=None, open_timeout=SECONDS) as client:
        client.send('42["telemetry",null]')
        assert client.recv(timeout=SECONDS) == '42["manual",{}]'


@pytest.mark.parametrize("origin", ["http://evil.example", "http://localhost:1", "null", "file://"])
def test_a_page_in_a_browser_is_refused(server: Server, origin: str) -> None:
    with pytest.raises(InvalidStatus) as caught:
        connect(f"ws://127.0.0.1:{server.port}/", origin=origin, compression=None, open_timeout=SECONDS)
    assert caught.value.response.status_code == 403


def test_without_the_library_it_says_how_to_install_it(
    cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "websockets"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "trackbench.subjects.serve.server", raising=False)
    monkeypatch.setitem(sys.modules, "websockets", None)
    done = cli("serve", "udacity", "--tracker", "scripted/figure_eight#ekf")
    message = "serving needs one more package: pip install 'trackbench[serve]'\n"
    assert (done.status, done.out, done.err) == (2, "", message)
