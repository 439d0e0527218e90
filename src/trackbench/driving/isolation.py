"""Choice of the trackers that get a process of their own, and the limits of that process."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.foreign import Command
from trackbench.trackers.published import built_in

#: Longest time for an answer that may be set, s, and default share of the container's memory for a tracker.
LONGEST, SHARE = 86_400.0, 0.25
GIGABYTE = 10**9


def plugged_in(config: FilterConfig | PluginConfig) -> bool:
    """Return whether a tracker is not built in, but a user's or from another package."""
    return isinstance(config, PluginConfig) and not built_in(config.reference)


def is_program(config: FilterConfig | PluginConfig) -> bool:
    """Return whether a tracker is a program in another language."""
    return isinstance(config, PluginConfig) and isinstance(config.use, Command)


@dataclass(frozen=True)
class Isolation:
    """Rule for which trackers run in processes of their own, with limits of time and memory."""

    in_process: bool = False
    """Whether trackers that are not built in run in the bench's own process, for a debugger."""
    timeout: float = 300.0
    """Longest time that a tracker may take for a step, s."""
    memory: float | None = None
    """Limit on the resident memory of a tracker's process, GB; None for a quarter of the container's."""

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout <= LONGEST:
            problem = f"{self.timeout!r} is no time; give a number of seconds above 0, at most {LONGEST:g}"
            raise InputError(problem, key="tracker_timeout")
        if self.memory is not None and not 0.0 < self.memory < float("inf"):
            raise InputError(f"{self.memory!r} is no memory; give GB above 0", key="tracker_memory")

    def of(self, config: FilterConfig | PluginConfig) -> bool:
        """Return whether a tracker gets a process of its own; a program in another language always does."""
        return is_program(config) or (plugged_in(config) and not self.in_process)

    @property
    def bytes(self) -> int:
        """Limit on a tracker's memory on this machine, in bytes."""
        return int(SHARE * container_memory() if self.memory is None else self.memory * GIGABYTE)


def container_memory() -> int:
    """Return the memory limit of the container, else the memory of the machine, in bytes."""
    limits = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for file in ("memory.max", "memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):
            limits.append(int(Path("/sys/fs/cgroup", file).read_text()))
    return min(limits)


ISOLATED = Isolation()
