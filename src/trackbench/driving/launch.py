"""What the bench tells the process that starts those of trackers, and is told by it."""

from __future__ import annotations

import json
import struct
from typing import NamedTuple

#: Set in the environment of every tracker's process.
INSIDE = "TRACKBENCH_TRACKER_PROCESS"
#: What the bench is told of a process: whether it was started, or has ended; its number; its status as of
#: ``os.waitpid``.
REPORT = struct.Struct("<?ii")
#: Bytes of a launch.
LONGEST_LAUNCH = 1 << 16


class Launch(NamedTuple):
    """The process of a tracker that is to be started."""

    name: str
    """Name of the tracker in messages."""
    command: list[str] | None = None
    """A program and its arguments; None of a tracker in Python."""
    folder: str = "."
    """Where a program is started."""
    python_path: str | None = None
    """``PYTHONPATH`` as a program finds it."""

    def packed(self) -> bytes:
        """Return it as bytes, at most ``LONGEST_LAUNCH``."""
        return json.dumps(self._replace(name=self.name[:500])).encode()

    @classmethod
    def unpacked(cls, content: bytes) -> Launch:
        """Read it from bytes."""
        return cls(*json.loads(content))
