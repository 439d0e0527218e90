"""A run shown while it goes on: what is observed goes to a process of its own, which talks to the viewer.

Rerun's connection may wait for ever for a viewer that is gone or slow, and cannot be interrupted. So it lives in
another process, to which a thread of this one writes. The run only puts references into a queue that forgets the
oldest: whatever becomes of the thread, the process or the viewer, the run does not wait for it.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import IO, Any

from trackbench.results import Result
from trackbench.runner.block import Observation
from trackbench.scenario import LoadedScenario
from trackbench.types import Scan, Truth

#: What waits of one run to be sent at most; at a few hundred bytes each, some megabytes.
WAITING = 20_000
#: Pause between two deliveries, s.
PERIOD = 0.05
#: For how long the end of all runs may wait until everything is handed over, s.
PARTING = 2.0


@dataclass(frozen=True)
class Scene:
    """What is known of a run before the first tracker has taken a step."""

    name: str
    trackers: list[str]
    sensors: list[str]
    hold: float
    """For how long an estimate is shown when none follows, s."""
    truth: Truth
    """Of the recorded run alone."""


@dataclass
class _Show:
    """One run on its way to the viewer."""

    scene: Scene
    begun: bool = False
    observed: deque[list[Scan] | Observation] = field(default_factory=lambda: deque(maxlen=WAITING))
    result: Result | None = None


class Live:
    """Takes what is observed of one run after another; never waits and never raises."""

    def __init__(self, url: str) -> None:
        """``url``: of the viewer, ``rerun+http://HOST:PORT/proxy``."""
        self.lost = False
        """Whether the way to the viewer ended before everything was handed over."""
        self._shows: deque[_Show] = deque()
        self._latest: _Show | None = None
        self._closing = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "trackbench.recording.forward", url],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        assert self._process.stdin is not None
        self._pipe: IO[bytes] = self._process.stdin
        self._thread = threading.Thread(target=self._deliver, daemon=True)
        self._thread.start()

    def begin(self, loaded: LoadedScenario, truth: Truth) -> None:
        """A run starts; until the next one does, what is observed is of this one."""
        scenario = loaded.config
        self._latest = _Show(
            Scene(
                name=scenario.name,
                trackers=list(scenario.trackers),
                sensors=list(scenario.sensors),
                hold=max(1.0 / sensor.rate_hz for sensor in scenario.sensors.values()),
                truth=_of_run(truth, scenario.recording.run),
            )
        )
        self._shows.append(self._latest)

    def observe(self, observed: list[Scan] | Observation) -> None:
        """Something is found of the recorded run: the ``observer`` of the runner."""
        if self._latest is not None:
            self._latest.observed.append(observed)

    def end(self, result: Result) -> None:
        """The run is complete: its whole recording follows, and fills what was forgotten."""
        if self._latest is not None:
            self._latest.result = result

    def close(self) -> None:
        """Hand over what waits, within a short time; the other process goes on alone to pass it on."""
        self._closing.set()
        self._thread.join(PARTING)
        if self._thread.is_alive():
            self.lost = True
            self._process.kill()
        # Nobody waits for it, but its end is taken note of.
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
