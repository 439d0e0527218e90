"""The process between a run and the viewer, which ``live`` starts and feeds."""

from __future__ import annotations

import pickle
import signal
import sys
import threading
import time
from queue import Queue
from typing import Any
from urllib.parse import urlsplit

from trackbench.subjects.recording.painter import Painter
from trackbench.subjects.recording.viewer import PATIENCE, listens

#: A viewer that accepts no data for this long is given up, s.
STALLED = 20
#: Deliveries that are kept while the viewer accepts none; then no more are read, and the queue of the run fills.
KEPT = 500


def main(url: str) -> None:
    """Pass on what comes at standard input until it ends."""
    # Ctrl-C is for the run, whose end ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    batches: Queue[list[Any] | None] = Queue(KEPT)
    threading.Thread(target=_read, args=(batches,), daemon=True).start()
    address = urlsplit(url)
    limit = time.monotonic() + PATIENCE
    while not listens(address.hostname or "", address.port or 0):
        if time.monotonic() > limit:
            return
        time.sleep(0.1)
    painter = Painter(url)
    while (batch := batches.get()) is not None:
        with _Limit():
            painter.take(batch)
    with _Limit():
        painter.finish()


class _Limit:
    """The system ends this process if what is within takes too long: Rerun's calls cannot be interrupted otherwise."""

    def __enter__(self) -> None:
        signal.alarm(STALLED)

    def __exit__(self, *_: object) -> None:
        signal.alarm(0)


def _read(batches: Queue[list[Any] | None]) -> None:
    try:
        while True:
            batches.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):
        batches.put(None)


if __name__ == "__main__":
    main(sys.argv[1])
