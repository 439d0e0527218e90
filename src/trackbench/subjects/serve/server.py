"""The WebSocket server: it accepts programs, and ends connections."""

from __future__ import annotations

import asyncio
import itertools
import logging
import signal
from collections.abc import Callable
from contextlib import closing, suppress

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from trackbench.base.errors import InputError
from trackbench.subjects.serve.protocol import MANUAL
from trackbench.subjects.serve.session import Client, Served, TrackerError

log = logging.getLogger(__name__)

#: Longest wait for a client that opens or closes a connection, s.
PATIENCE = 2
#: Largest length of a closing frame's reason, bytes (RFC 6455, section 5.5).
REASON = 123


async def serve_udacity(served: Served, host: str, port: int, ready: Callable[[str, int], None]) -> None:
    """Serve until Ctrl-C or SIGTERM, then close each connection.

    Programs may connect. Pages in a browser, which send an origin, are refused.

    Args:
        served: tracker to serve; each client gets a fresh instance.
        host: address to listen at.
        port: port to listen at; 0 for any free port.
        ready: called with the address and the port as soon as clients can connect.

    Raises:
        InputError: the address cannot be used.
    """
    numbers = itertools.count(1)

    async def converse(connection: ServerConnection) -> None:
        name = f"client {next(numbers)}"
        log.info("%s: connected from %s", name, (connection.remote_address or ("nowhere",))[0])
        try:
            with closing(await asyncio.to_thread(Client, served, name)) as client:
                async for frame in connection:
                    # In a thread, so that a slow tracker delays no other client.
                    answer = await asyncio.to_thread(client.answer, frame)
                    if answer is not None:
                        await connection.send(answer)
        except TrackerError as failure:
            text = " ".join(f"tracker {served.name} failed {failure}".split())
            log.error("%s: %s", name, text)
            with suppress(ConnectionClosed):
                await connection.send(MANUAL)
            await connection.close(CloseCode.INTERNAL_ERROR, text.encode()[:REASON].decode(errors="ignore"))
        except ConnectionClosed as closed:
            log.warning("%s: %s", name, closed)
        log.info("%s: left", name)

    # The library would print a traceback for each client that breaks the protocol.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    try:
        server = await listen(converse, host, port, origins=[None], open_timeout=PATIENCE, close_timeout=PATIENCE)
    except OSError as error:
        raise InputError(f"cannot listen at {host}, port {port}: {error.strerror}", key="--port") from None
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.call_soon_threadsafe(stopped.set))
    async with server:
        address = server.sockets[0].getsockname()
        ready(address[0], address[1])
        await stopped.wait()
