"""Which pages and programs the server lets in."""

from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.subjects.serve.test_serve import SECONDS, Server
from tests.support.udacity import write_scenario
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from trackbench.base.errors import InputError
from trackbench.subjects.serve.server import request_refusal, require_origin

LOOPBACK = ["127.0.0.1:4567", "localhost:4567", "LOCALHOST", "[::1]:4567", "127.0.0.2"]
#: Of a page elsewhere, of a sandboxed frame, and what is no origin.
FOREIGN = [
    "http://evil.example",
    "https://localhost.evil.example:4567",
    "null",
    "",
    "http://10.0.0.7",
    "http://[",
    "file://",
]


@pytest.mark.parametrize("host", LOOPBACK)
def test_programs_of_this_machine(host: str) -> None:
    assert request_refusal([], [host], "127.0.0.1", ()) is None
    assert request_refusal([f"http://{host}"], [host], "127.0.0.1", ()) is None


@pytest.mark.parametrize("origin", FOREIGN)
def test_pages_from_elsewhere(origin: str) -> None:
    cause = request_refusal([origin], ["localhost:4567"], "127.0.0.1", ())
    assert cause is not None
    assert "--allow-origin" in cause
    assert request_refusal(["http://localhost", origin], ["localhost:4567"], "127.0.0.1", ()) is not None


def test_a_page_that_is_named() -> None:
    allowed = [require_origin("http://Viewer.example:8000")]
    assert request_refusal(["http://viewer.example:8000"], ["localhost"], "127.0.0.1", allowed) is None
    for other in ("https://viewer.example:8000", "http://viewer.example", "http://viewer.example:80000"):
        assert request_refusal([other], ["localhost"], "127.0.0.1", allowed) is not None


@pytest.mark.parametrize("origin", ["viewer.example", "http://viewer.example/", "http://", "*", "http://a b/c"])
def test_what_is_no_origin(origin: str) -> None:
    with pytest.raises(InputError, match="write SCHEME://HOST"):
        require_origin(origin)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:4567", "192.0.2.7:4567", "127.0.0.1.evil.example", ""])
def test_names_that_were_made_to_point_here(host: str) -> None:
    cause = request_refusal([], [host], "127.0.0.1", ())
    assert cause is not None
    assert "--host" in cause


def test_a_server_that_is_open_to_others() -> None:
    for bound in ("0.0.0.0", "::"):
        for host in ("192.0.2.7:4567", "[2001:db8::7]:4567", socket.gethostname()):
            assert request_refusal([], [host], bound, ()) is None
        assert request_refusal([], ["evil.example"], bound, ()) is not None
    assert request_refusal([], ["bench.example:4567"], "bench.example", ()) is None


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder: Path = tmp_path_factory.mktemp("origin")
    with Server(write_scenario(folder), "ekf", folder / "log", "--allow-origin", "http://viewer.example") as started:
        yield started


@pytest.mark.parametrize(
    ("origin", "status"),
    [(None, 101), ("http://localhost:1", 101), ("http://viewer.example", 101), ("http://x.y", 403)],
)
def test_the_handshake(server: Server, origin: str | None, status: int) -> None:
    address = f"ws://127.0.0.1:{server.port}/socket.io/"
    if status == 101:
        with connect(address, origin=origin, compression=None, open_timeout=SECONDS) as client:
            client.send("2")
            assert client.recv(timeout=SECONDS) == "3"
        return
    with pytest.raises(InvalidStatus) as caught:
        connect(address, origin=origin, compression=None, open_timeout=SECONDS)
    assert caught.value.response.status_code == status
    assert "refused 127.0.0.1: a page of 'http://x.y' is not let in" in server.log()


def test_a_request_by_another_name(server: Server) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=SECONDS)
    connection.request("GET", "/", headers={"Host": "evil.example"})
    assert connection.getresponse().status == 403
    connection.close()
