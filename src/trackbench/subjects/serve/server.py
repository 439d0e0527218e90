"""The WebSocket server: who may connect, and what one client is answered."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import itertools
import logging
import signal
import socket
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, contextmanager, suppress
from http import HTTPStatus
from types import FrameType
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from trackbench.base.errors import InputError
from trackbench.subjects.serve import protocol
from trackbench.subjects.serve.protocol import MANUAL, Control, NoData, Ping, Telemetry
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


async def serve_udacity(
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
            text = f"tracker {served.name} failed {failure}"
            log.error("%s: %s", name, text)
            with suppress(ConnectionClosed):
                await connection.send(MANUAL)
            await connection.close(CloseCode.INTERNAL_ERROR, text.encode()[:REASON].decode(errors="ignore"))
        except ConnectionClosed as closed:
            log.warning("%s: %s", name, closed)
        log.info("%s: left", name)

    def admit(connection: ServerConnection, request: Request) -> Response | None:
        cause = request_refusal(request.headers.get_all("Origin"), request.headers.get_all("Host"), host, origins)
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


@contextmanager
def _signals(stopped: asyncio.Future[signal.Signals]) -> Iterator[None]:
    """Let the first SIGINT or SIGTERM set ``stopped``, and the next one interrupt."""
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


#: Characters of a frame that a log line shows.
SHOWN = 60


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
        self._last_answer = protocol.MANUAL

    def answer(self, frame: str | bytes) -> str | None:
        """The frame to send back, or None where none is due. A bad frame is logged, and answered with ``manual``.

        Raises:
            TrackerFailed: the session is over.
        """
        try:
            message = protocol.parse(frame)
        except InputError as error:
            log.warning("%s: bad frame, %s: %s", self._name, error, _shown(frame))
            return protocol.MANUAL
        match message:
            case Ping(answer):
                return answer
            case Control():
                log.debug("%s: no event: %s", self._name, _shown(frame))
                return None
            case NoData():
                return protocol.MANUAL
            case Telemetry():
                return self._measured(message)

    def close(self) -> None:
        """End the session, and log what it came to."""
        session = self._session
        session.close()
        if session.measurements:
            px, py, vx, vy = session.rmse
            text = "%s: %d measurements, %d estimates, RMSE %.4f %.4f m, %.4f %.4f m/s"
            log.info(text, self._name, session.measurements, session.estimates, px, py, vx, vy)

    def _measured(self, telemetry: Telemetry) -> str:
        measurement, last = telemetry.measurement, self._last
        if measurement.kind not in self._served.sensors:
            log.debug("%s: the scenario has no %s", self._name, measurement.kind)
            return protocol.MANUAL
        if telemetry == last:
            # The simulator's clock does not wait for answers, nor run while it pauses: it may send a line twice.
            return self._last_answer
        if last is not None and measurement.stamp < last.measurement.stamp:
            self.close()
            log.info("%s: time goes backwards: starts afresh", self._name)
            self._session = Session(self._served)
        self._last = telemetry
        marker = self._session.take(measurement)
        self._last_answer = protocol.MANUAL if marker is None else protocol.estimate_marker(marker)
        return self._last_answer


def _shown(frame: str | bytes) -> str:
    text = repr(frame[:SHOWN])
    return text if len(frame) <= SHOWN else text + "..."


EVERYWHERE = ("0.0.0.0", "::")


def require_origin(origin: str) -> str:
    """An origin as browsers write it.

    Raises:
        InputError: it is none.
    """
    parts = urlsplit(origin)
    if not parts.scheme or not parts.netloc or origin != f"{parts.scheme}://{parts.netloc}":
        raise InputError(f"write SCHEME://HOST[:PORT], such as http://localhost:8000, not {origin!r}")
    return origin.lower()


def request_refusal(origins: list[str], hosts: list[str], bound: str, allowed: Collection[str]) -> str | None:
    """Why a request is refused; None if it is not.

    Args:
        origins: its Origin headers; programs that are no browsers send none.
        hosts: its Host headers.
        bound: the address at which the server listens, as the user named it.
        allowed: origins of other machines.
    """
    for origin in origins:
        if origin.lower() not in allowed and not _loopback(_name(origin.partition("://")[2])):
            return f"a page of {origin!r} is not let in; --allow-origin lets it"
    for host in hosts:
        if not _own(_name(host), bound):
            return f"{host!r} is no name of this server; --host names it"
    return None


def _own(name: str, bound: str) -> bool:
    if _loopback(name) or name == bound.lower():
        return True
    # A name that was made to point here is never an address.
    return bound in EVERYWHERE and (name == socket.gethostname().lower() or _address(name) is not None)


def _name(netloc: str) -> str:
    """The host without its port."""
    try:
        return urlsplit(f"//{netloc}").hostname or ""
    except ValueError:
        return ""


def _loopback(name: str) -> bool:
    address = _address(name)
    return name == "localhost" or (address is not None and address.is_loopback)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
