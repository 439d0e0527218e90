"""What one client is answered."""

from __future__ import annotations

import logging

from trackbench.base.errors import InputError
from trackbench.subjects.serve import protocol
from trackbench.subjects.serve.protocol import Control, NoData, Ping, Telemetry
from trackbench.subjects.serve.session import Served, Session

log = logging.getLogger(__name__)

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
            said = protocol.parse(frame)
        except InputError as error:
            log.warning("%s: bad frame, %s: %s", self._name, error, _shown(frame))
            return protocol.MANUAL
        match said:
            case Ping(answer):
                return answer
            case Control():
                log.debug("%s: no event: %s", self._name, _shown(frame))
                return None
            case NoData():
                return protocol.MANUAL
            case Telemetry():
                return self._measured(said)

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
