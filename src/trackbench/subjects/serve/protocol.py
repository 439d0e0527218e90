"""Frames (messages) that the Udacity term-2 simulator and its server exchange: Socket.IO 2 over a WebSocket.

An event is ``42`` and a JSON array of its name and its data. The simulator sends ``telemetry`` and waits for an
answer before it goes on, so that every event needs one. The answer is ``estimate_marker``, or ``manual`` without an
estimate.
"""

from __future__ import annotations

import json

from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.truth.recorded.udacity import Measurement, parse_line

EVENT = "42"
MANUAL = EVENT + '["manual",{}]'
#: Fields that the simulator draws: the estimate, and the RMSE of all estimates so far, in SI units.
MARKER = ("estimate_x", "estimate_y", "rmse_x", "rmse_y", "rmse_vx", "rmse_vy")


def parse(frame: str | bytes) -> Measurement | str | None:
    """Return the measurement in a frame (message), the answer to an event without measurement, or None without event.

    Raises:
        InputError: the event is none of the simulator's.
    """
    if not isinstance(frame, str) or not frame.startswith(EVENT):
        # Pings and other frames of the transport need no answer.
        return None
    try:
        _, *data = json.loads(frame[len(EVENT) :])
        if not data or not data[0]:
            # The simulator has stopped.
            return MANUAL
        return parse_line(data[0]["sensor_measurement"])
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise InputError(f'an event is {EVENT}["telemetry",{{"sensor_measurement":"L\\t..."}}]') from None


def estimate_marker(mean: Array, rmse: Array) -> str:
    """Return the frame (message) that carries the mean ``(4,)`` of an estimate and the RMSE ``(4,)``.

    Raises:
        ValueError: a number is not finite.
    """
    marker = dict(zip(MARKER, [*mean[:2].tolist(), *rmse.tolist()], strict=True))
    return EVENT + json.dumps(["estimate_marker", marker], separators=(",", ":"), allow_nan=False)
