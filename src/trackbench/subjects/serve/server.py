"""The WebSocket server: who may connect, and how a connection ends."""

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
from trackbench.subjects.serve.session import Client, Served, TrackerFailed

log = logging.getLogger(__name__)

#: For how long the server waits for a client that opens or closes, s.
PATIENCE = 2
#: Bytes of the longest reason that a closing frame carries (RFC 6455, section 5.5).
REASON = 123


async def serve_udacity(served: Served, host: str, port: int, ready: Callable[[str, int], None]) -> None:
    """Serve until Ctrl-C or SIGTERM; every client is told goodbye.

    Programs may connect. Pages in a browser, which say their origin, are refused.

    Args:
        served: the tracker, of which every client gets its own.
        host: the address to listen at.
        port: 0 for any that is free.
        ready: called with the address and the port when clients can connect.

    Raises:
        InputError: the address cannot be listened at.
    """
    numbers = itertools.count(1)

    async def converse(connection: ServerConnection) -> None:
        name = f"client {next(numbers)}"
        log.info("%s: connected from %s", name, (connection.remote_address or ("nowhere",))[0])
        try:
            with closing(await asyncio.to_thread(Client, served, name)) as client:
                async for frame in connection:
                    # A slow tracker keeps no other client waiting.
                    answer = await asyncio.to_thread(client.answer, frame)
                    if answer is not None:
                        await connection.send(answer)
        except TrackerFailed as failure:
            text = " ".join(f"tracker {served.name} failed {failure}".split())
            log.error("%s: %s", name, text)
            with suppress(ConnectionClosed):
                await connection.send(MANUAL)
            await connection.close(CloseCode.INTERNAL_ERROR, text.encode()[:REASON].decode(errors="ignore"))
        except ConnectionClosed as closed:
            log.warning("%s: %s", name, closed)
        log.info("%s: left", name)

    # The library would trace each client that says nothing sensible.
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
