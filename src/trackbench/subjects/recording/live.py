"""A run shown while it goes on: its recorded run is sent to another process, which draws it in the viewer.

Rerun's connection may wait for ever for a viewer that is gone or slow, and cannot be interrupted. So it is in another
process, to which a thread of this one writes. The run only appends to a queue of limited length: it never waits.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING

from trackbench.api.plan import Listener, Prepared
from trackbench.base.types import Scan, Truth
from trackbench.document.palette import tracker_colours
from trackbench.results import Result
from trackbench.runner.recorded import RecordedInstant

if TYPE_CHECKING:
    from trackbench.runner.recorded import OnRecordedRun

#: Instants that wait to be sent at most; what comes later is in the whole recording alone, which is sent at the end.
WAITING = 10_000
#: Pause between two deliveries, s.
PERIOD = 0.05
#: How long :meth:`Live.close` waits until everything is drawn, and the drawing process for the viewer, s.
PATIENCE = 20


@dataclass(frozen=True)
class LiveRun:
    """What is known of a run before the first tracker has taken a step."""

    name: str
    colours: Mapping[str, str]
    """By tracker."""
    sensors: list[str]
    truth: Truth
    """Of the recorded run alone."""


#: The start of a run, its measurements, its estimates at an instant, and at the end all of it.
Part = LiveRun | list[Scan] | RecordedInstant | Result


class Live(Listener):
    """The connection to a viewer, to which one run after another is sent.

    Attributes:
        lost: whether the drawing process ended or did not end in time.
    """

    def __init__(self, url: str) -> None:
        self.lost = False
        self._waiting: deque[Part] = deque()
        self._closing = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "trackbench.subjects.recording.live_scene", url],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        assert self._process.stdin is not None
        self._pipe: IO[bytes] = self._process.stdin
        self._thread = threading.Thread(target=self._deliver, daemon=True)
        self._thread.start()

    @property
    def observes(self) -> bool:
        """Always."""
        return True

    def begin(self, item: Prepared) -> OnRecordedRun:
        """Send what is known before a run; what follows belongs to it until the next one begins."""
        scenario = item.scenario.config
        colours = tracker_colours({name: item.scenario.places[name] for name in scenario.trackers})
        truth = truth_of_run(item.truths[scenario.recording.scene].truth, scenario.recording.run)
        self._waiting.append(LiveRun(scenario.name, colours, list(scenario.sensors), truth))
        return self.observe

    def observe(self, observed: list[Scan] | RecordedInstant) -> None:
        """Send a part of the recorded run, unless too much waits already."""
        if len(self._waiting) < WAITING:
            self._waiting.append(observed)

    def end(self, result: Result, folder: Path | None = None) -> None:
        """Send the whole recording of a run."""
        self._waiting.append(result)

    def close(self) -> None:
        """Wait until everything is drawn, or give the viewer up."""
        self._closing.set()
        self._thread.join(PATIENCE)
        try:
            self.lost |= self._process.wait(0 if self._thread.is_alive() else PATIENCE) != 0
        except subprocess.TimeoutExpired:
            self.lost = True
            self._process.kill()
            self._process.wait()

    def _deliver(self) -> None:
        try:
            is_last = False
            while not is_last:
                # Before the parts are taken, so that none that came before the end is left behind.
                is_last = self._closing.wait(PERIOD)
                if parts := [self._waiting.popleft() for _ in range(len(self._waiting))]:
                    pickle.dump(parts, self._pipe)
                    self._pipe.flush()
        except OSError:
            self.lost = True
        with suppress(OSError):
            self._pipe.close()


def truth_of_run(truth: Truth, run: int) -> Truth:
    """Return the truth with the motion of one run alone."""
    motion = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate")
    whole = {name: getattr(truth, name) for name in motion}
    return replace(truth, **{name: values[..., min(run, values.shape[-1] - 1), None] for name, values in whole.items()})
