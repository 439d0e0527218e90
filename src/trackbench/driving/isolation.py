"""Which trackers get a process of their own."""

from __future__ import annotations

import os
import platform
import signal
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.foreign import Command
from trackbench.trackers.published import built_in

#: A day, s.
LONGEST = 86_400.0
#: Of the memory of the container, unless another number of bytes is stated.
SHARE = 0.25
GIGABYTE = 10**9


def plugged_in(config: FilterConfig | PluginConfig) -> bool:
    """Whether a tracker is not built in."""
    return isinstance(config, PluginConfig) and not built_in(config.reference)


def is_program(config: FilterConfig | PluginConfig) -> bool:
    """Whether a tracker is a program in another language."""
    return isinstance(config, PluginConfig) and isinstance(config.use, Command)


@dataclass(frozen=True)
class Isolation:
    """How trackers that are not built in are kept apart from the bench."""

    in_process: bool = False
    """Whether they are not: for a debugger."""
    timeout: float = 300.0
    """The longest that one may take for a step, s."""
    memory: float | None = None
    """The most that one may take, GB, resident and with all that it starts; a quarter of the container's unless set."""

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout <= LONGEST:
            problem = f"{self.timeout!r} is no time; give a number of seconds above 0, at most {LONGEST:g}"
            raise InputError(problem, key="tracker_timeout")
        if self.memory is not None and not 0.0 < self.memory < float("inf"):
            raise InputError(f"{self.memory!r} is no memory; give GB above 0", key="tracker_memory")

    def of(self, config: FilterConfig | PluginConfig) -> bool:
        """Whether a tracker gets a process of its own: a program has one in any case."""
        return is_program(config) or (plugged_in(config) and not self.in_process and not lacking())

    def missing(self, name: str, config: FilterConfig | PluginConfig) -> str:
        """A line where this system cannot give a tracker the process of its own that it should have; else empty."""
        if self.in_process or not plugged_in(config) or is_program(config) or not lacking():
            return ""
        return (
            f"{name}: {platform.system()} has no {lacking()}, so that this tracker runs in the process of the bench, "
            "without limits of time and memory, and may end it"
        )

    @property
    def bytes(self) -> int:
        """The most memory that one may take on this machine."""
        return int(SHARE * container_memory() if self.memory is None else self.memory * GIGABYTE)


def lacking() -> str:
    """What this system lacks for processes of trackers, such as "os.fork"; empty where it has all, as Linux has."""
    needed = [(os, "fork"), (os, "setsid"), (signal, "SIGKILL"), (signal, "pthread_sigmask"), (socket, "send_fds")]
    names = [f"{module.__name__}.{name}" for module, name in needed if not hasattr(module, name)]
    return " or ".join([*names[:1], *(["resource"] if not names and find_spec("resource") is None else [])])


def container_memory() -> int:
    """Memory of the container, or of the machine where none is limited, bytes."""
    return min([os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), *_group_limits()])


def _group_limits() -> Iterator[int]:
    """The limits of the control groups in which this process is, of either version, bytes."""
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, controllers, group = line.split(":", 2)
            if controllers not in ("", "memory"):
                continue
            mounted = Path("/sys/fs/cgroup", controllers)
            place = mounted / group.lstrip("/")
            # In a container the path may be that of the host, which is not seen here.
            for folder in [place, *(parent for parent in place.parents if parent.is_relative_to(mounted))]:
                with suppress(OSError, ValueError):
                    yield int((folder / ("memory.limit_in_bytes" if controllers else "memory.max")).read_text())


ISOLATED = Isolation()
