"""The WebSocket server."""

from __future__ import annotations

import asyncio
import errno
import itertools
import logging
import signal
import socket
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from types import FrameType

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from trackbench.base.errors import InputError
from trackbench.subjects.serve.client import Client
from trackbench.subjects.serve.origin import refusal
from trackbench.subjects.serve.protocol import MANUAL
from trackbench.subjects.serve.session import Served, TrackerFailed

log = logging.getLogger(__name__)

#: A larger message ends its connection before it fills the memory, bytes; a smaller one is answered.
LARGEST = 16 * 2**20
#: Messages of one client that wait for their turn.
WAITING = 4
#: For how long the server waits for a client that opens, and for one that closes, s.
OPENING = 5
CLOSING = 2
#: Bytes of the longest reason that a closing frame carries (RFC 6455, section 5.5).
REASON = 123


async def serve(
    served: Served, host: str, port: int, ready: Callable[[str, int], None], origins: Collection[str] = ()
) -> signal.Signals:
    """Serve until a signal ends it; every client is told goodbye. A second signal interrupts at once.

    Args:
        served: the tracker, of which every client gets its own.
        host: the address to listen at.
        port: 0 for any that is free.
        ready: called with the address and the port when clients can connect.
        origins: of pages of other machines that may connect, as ``origin.require_origin`` gives them.

    Returns:
        The signal.

    Raises:
        InputError: the address cannot be listened at.
    """
    numbers = itertools.count(1)

    async def converse(connection: ServerConnection) -> None:
        await _converse(connection, served, f"client {next(numbers)}")

    def admit(connection: ServerConnection, request: Request) -> Response | None:
        cause = refusal(request.headers.get_all("Origin"), request.headers.get_all("Host"), host, origins)
        if cause is None:
            return None
        log.warning("refused %s: %s", (connection.remote_address or ("nowhere",))[0], cause)
        return connection.respond(HTTPStatus.FORBIDDEN, f"{cause}\n")

    stopped: asyncio.Future[signal.Signals] = asyncio.get_running_loop().create_future()
    with _signals(stopped):
        try:
            server = await listen(
                converse,
                host,
                port,
                process_request=admit,
                compression=None,
                max_size=LARGEST,
                max_queue=WAITING,
                open_timeout=OPENING,
                close_timeout=CLOSING,
                logger=logging.getLogger(f"{__name__}.websockets"),
            )
        except OSError as error:
            raise _refused(error, host, port) from None
        async with server:
            address = server.sockets[0].getsockname()
            ready(address[0], address[1])
            number = await stopped
            log.info("%s: the server ends", number.name)
    return number


async def _converse(connection: ServerConnection, served: Served, name: str) -> None:
    log.info("%s: connected from %s", name, (connection.remote_address or ("nowhere",))[0])
    try:
        await _answer(connection, await asyncio.to_thread(Client, served, name))
    except TrackerFailed as failure:
        text = f"tracker {served.name} failed {failure}"
        log.error("%s: %s", name, text)
        with suppress(ConnectionClosed):
            await connection.send(MANUAL)
        await connection.close(CloseCode.INTERNAL_ERROR, text.encode()[:REASON].decode(errors="ignore"))
    except ConnectionClosed as closed:
        log.warning("%s: %s", name, closed)
    log.info("%s: left", name)


async def _answer(connection: ServerConnection, client: Client) -> None:
    """Answer a client until it leaves."""
    try:
        async for frame in connection:
            # A slow tracker keeps no other client waiting.
            answer = await asyncio.to_thread(client.answer, frame)
            if answer is not None:
                await connection.send(answer)
    finally:
        client.close()


@contextmanager
def _signals(stopped: asyncio.Future[signal.Signals]) -> Iterator[None]:
    """With the first SIGINT or SIGTERM told to ``stopped``, and the next one interrupting."""
    loop = asyncio.get_running_loop()

    def tell(number: int, _: FrameType | None) -> None:
        for name in before:
            signal.signal(name, signal.default_int_handler)
        loop.call_soon_threadsafe(stopped.set_result, signal.Signals(number))

    before = {name: signal.getsignal(name) for name in (signal.SIGINT, signal.SIGTERM)}
    for name in before:
        signal.signal(name, tell)
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


def _refused(error: OSError, host: str, port: int) -> InputError:
    if isinstance(error, socket.gaierror):
        return InputError(f"there is no host {host!r}", key="--host")
    if error.errno == errno.EADDRINUSE:
        return InputError(f"port {port} of {host} is in use; name another one, or 0 for any that is free", key="--port")
    # From Python 3.13 on asyncio sums up that no address of the host was available without giving a number.
    if error.errno in (errno.EADDRNOTAVAIL, None):
        return InputError(f"{host} is not an address of this machine", key="--host")
    return InputError(f"cannot listen at port {port} of {host}: {error.strerror}", key="--port")
