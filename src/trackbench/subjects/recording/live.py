"""A run shown while it goes on: its recorded run is sent to another process, which draws it in the viewer.

Rerun's connection may wait for ever for a viewer that is gone or slow, and cannot be interrupted. So it is in another
process, to which a thread of this one writes. The run only appends to a queue of limited length, which drops the oldest
entries: the run never waits for the thread, the process or the viewer.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from trackbench.api.plan import Listener, Prepared
from trackbench.base.types import Scan, Truth
from trackbench.document.palette import tracker_colours
from trackbench.results import Result
from trackbench.runner.recorded import RecordedInstant

if TYPE_CHECKING:
    from trackbench.runner.block import OnRecordedRun

#: Instants of one run that wait to be sent at most; at a few kilobytes each, some tens of megabytes.
WAITING = 10_000
#: Pause between two deliveries, s.
PERIOD = 0.05
#: How long :meth:`Live.close` waits until everything is sent, s.
PARTING = 2.0


@dataclass(frozen=True)
class LiveRun:
    """What is known of a run before the first tracker has taken a step."""

    name: str
    colours: Mapping[str, str]
    """By tracker."""
    sensors: list[str]
    truth: Truth
    """Of the recorded run alone."""


@dataclass
class _Show:
    """One run on its way to the viewer."""

    scene: LiveRun
    begun: bool = False
    observed: deque[list[Scan] | RecordedInstant] = field(default_factory=lambda: deque(maxlen=WAITING))
    result: Result | None = None


class Live(Listener):
    """Sends the recorded run of one scenario after another; never waits and never raises."""

    def __init__(self, url: str) -> None:
        """``url``: of the viewer, ``rerun+http://HOST:PORT/proxy``."""
        self.lost = False
        """Whether the other process ended before everything was sent."""
        self._shows: deque[_Show] = deque()
        self._latest: _Show | None = None
        self._closing = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "trackbench.subjects.recording.painter", url],
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
        """A run starts; what follows belongs to it until the next one starts."""
        scenario = item.scenario.config
        colours = tracker_colours({name: item.scenario.places[name] for name in scenario.trackers})
        truth = _of_run(item.truths[scenario.recording.scene].truth, scenario.recording.run)
        self._latest = _Show(LiveRun(scenario.name, colours, list(scenario.sensors), truth))
        self._shows.append(self._latest)
        return self.observe

    def observe(self, observed: list[Scan] | RecordedInstant) -> None:
        """Take a part of the recorded run: the runner's ``on_recorded_run``."""
        if self._latest is not None:
            self._latest.observed.append(observed)

    def end(self, result: Result, folder: Path | None = None) -> None:
        """The run is complete: send its whole recording, which also has what the queue dropped."""
        if self._latest is not None:
            self._latest.result = result

    def close(self) -> None:
        """Send what is left, within a short time; the other process ends by itself when it has drawn it."""
        self._closing.set()
        self._thread.join(PARTING)
        if self._thread.is_alive():
            self.lost = True
            self._process.kill()
        # Collects the status of the process when it ends, without waiting here.
        threading.Thread(target=self._process.wait, daemon=True).start()

    def _deliver(self) -> None:
        try:
            while True:
                last = self._closing.is_set()
                batch = list(self._batch())
                if batch:
                    pickle.dump(batch, self._pipe)
                    self._pipe.flush()
                if last:
                    self._pipe.close()
                    return
                self._closing.wait(PERIOD)
        except OSError:
            self.lost = True
            with suppress(OSError):
                self._pipe.close()

    def _batch(self) -> Any:
        """Everything that waits, in order."""
        while self._shows:
            show = self._shows[0]
            if not show.begun:
                show.begun = True
                yield show.scene
            result = show.result
            while show.observed:
                yield show.observed.popleft()
            if result is None:
                return
            yield result
            self._shows.popleft()


def _of_run(truth: Truth, run: int) -> Truth:
    """The truth of one run, and no more of it."""
    motion = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate")
    whole = {name: getattr(truth, name) for name in motion}
    return replace(truth, **{name: values[..., min(run, values.shape[-1] - 1), None] for name, values in whole.items()})
