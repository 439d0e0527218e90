"""The WebSocket server: who may connect, and what one client is answered."""

from __future__ import annotations

import asyncio
import errno
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
from trackbench.subjects.serve import protocol
from trackbench.subjects.serve.protocol import MANUAL, Telemetry
from trackbench.subjects.serve.session import Served, Session, TrackerFailed

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
#: Characters of a frame that a log line shows.
SHOWN = 60


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

    try:
        server = await listen(
            converse,
            host,
            port,
            origins=[None],
            compression=None,
            max_size=LARGEST,
            max_queue=WAITING,
            open_timeout=OPENING,
            close_timeout=CLOSING,
            logger=_quiet(),
        )
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            problem = f"port {port} of {host} is in use; name another one, or 0 for any that is free"
            raise InputError(problem, key="--port") from None
        problem = f"cannot listen at {host}: {error.strerror or 'it is no address of this machine'}"
        raise InputError(problem, key="--host") from None
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.call_soon_threadsafe(stopped.set))
    async with server:
        address = server.sockets[0].getsockname()
        ready(address[0], address[1])
        await stopped.wait()


def _quiet() -> logging.Logger:
    """Return a logger for the library, which would tell every step and trace each client that says nothing sensible."""
    logger = logging.getLogger(f"{__name__}.websockets")
    logger.setLevel(logging.CRITICAL)
    return logger


class Client:
    """One connection: a data set, and another when the simulator is restarted. Knows nothing of the network."""

    def __init__(self, served: Served, name: str) -> None:
        """Start a session.

        Raises:
            TrackerFailed: there is no fresh tracker.
        """
        self._served = served
        self._name = name
        self._session = Session(served)
        self._last: Telemetry | None = None
        self._last_answer = MANUAL

    def answer(self, frame: str | bytes) -> str | None:
        """Return the frame to send back, or None where none is due; a bad frame is logged and answered ``manual``.

        Raises:
            TrackerFailed: the session is over.
        """
        try:
            message = protocol.parse(frame)
        except InputError as error:
            log.warning("%s: bad frame, %s: %r", self._name, error, frame[:SHOWN])
            return MANUAL
        if not isinstance(message, Telemetry):
            return message
        measurement, last = message.measurement, self._last
        if measurement.kind not in self._served.sensors:
            return MANUAL
        if message == last:
            # The simulator's clock does not wait for answers, nor run while it pauses: it may send a line twice.
            return self._last_answer
        if last is not None and measurement.stamp < last.measurement.stamp:
            self.close()
            log.info("%s: time goes backwards: starts afresh", self._name)
            self._session = Session(self._served)
        self._last = message
        marker = self._session.take(measurement)
        self._last_answer = MANUAL if marker is None else protocol.estimate_marker(marker)
        return self._last_answer

    def close(self) -> None:
        """End the session, and log what it came to."""
        session = self._session
        session.close()
        if session.measurements:
            px, py, vx, vy = session.rmse
            text = "%s: %d measurements, %d estimates, RMSE %.4f %.4f m, %.4f %.4f m/s"
            log.info(text, self._name, session.measurements, session.estimates, px, py, vx, vy)
