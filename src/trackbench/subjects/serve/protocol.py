"""The frames that the Udacity term-2 simulator and its server exchange: Socket.IO 2 over a WebSocket.

An event is ``42`` and a JSON array of its name and its data. The simulator sends ``telemetry`` and waits for the
answer before it sends the next, so that every event needs one. It takes two: ``estimate_marker``, and ``manual``,
which only asks it to go on.
"""

from __future__ import annotations

import json
import re
from typing import NamedTuple

from trackbench.base.errors import InputError
from trackbench.truth.recorded.udacity import Measurement, parse_line

EVENT = "42"
MANUAL = EVENT + '["manual",{}]'
#: Engine.IO's ping, and the one that probes a connection before it is upgraded.
_PING = re.compile(r"2(probe)?")
#: What Engine.IO and Socket.IO exchange beside events: open, close, pong, upgrade, no operation; connect, disconnect,
#: acknowledgement, error.
_CONTROL = re.compile(r"(0\{.*|1|3(probe)?|5|6|4[0134]([/{\[0-9\"].*)?)", re.DOTALL)


class Telemetry(NamedTuple):
    """A measurement."""

    measurement: Measurement
    line: str
    """As it was sent."""


class Marker(NamedTuple):
    """What the simulator draws and shows: the estimate, and the RMSE of all estimates so far. SI units."""

    estimate_x: float
    estimate_y: float
    rmse_x: float
    rmse_y: float
    rmse_vx: float
    rmse_vy: float


def parse(frame: str | bytes) -> Telemetry | str | None:
    """Return the measurement of a frame, or the answer to a frame without one; None where no answer is due.

    Raises:
        InputError: it says nothing that a simulator would say.
    """
    if isinstance(frame, bytes):
        raise InputError("it is binary, where text is spoken")
    if frame.startswith(EVENT):
        return _event(frame[len(EVENT) :])
    if _PING.fullmatch(frame):
        return "3" + frame[1:]
    if _CONTROL.fullmatch(frame):
        return None
    raise InputError(f'it is no event, which begins with {EVENT}["telemetry",')


def estimate_marker(marker: Marker) -> str:
    """Return the frame that carries an estimate; its numbers are finite."""
    return EVENT + json.dumps(["estimate_marker", marker._asdict()], separators=(",", ":"), allow_nan=False)


def _event(text: str) -> Telemetry | str:
    try:
        event = json.loads(text)
    except RecursionError:
        raise InputError("its JSON is nested too deeply") from None
    except ValueError as error:
        raise InputError(f"it is not JSON after {EVENT}: {error}") from None
    if not isinstance(event, list) or not event or not isinstance(event[0], str):
        raise InputError('an event is an array that begins with its name: ["telemetry",{...}]')
    name, data = event[0], event[1] if len(event) > 1 else None
    if data is None or data == {}:
        # The simulator is not running.
        return MANUAL
    if name != "telemetry":
        raise InputError(f"the event {name[:40]!r} is not known, only telemetry is")
    line = data.get("sensor_measurement") if isinstance(data, dict) else None
    if not isinstance(line, str):
        raise InputError('telemetry is {"sensor_measurement":"L\\t..."}')
    return Telemetry(parse_line(line), line)
