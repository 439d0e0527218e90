"""Hides from trackbench what Windows lacks, in a process that imports this before trackbench.

The standard library and other packages keep what they need of Linux: it is trackbench alone that is tried.
"""

from __future__ import annotations

import builtins
import importlib.util
import os
import platform
import signal
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

#: By module, what Windows lacks of it.
MISSING: dict[Any, tuple[str, ...]] = {
    os: ("fork", "setsid", "killpg", "fchdir", "sysconf", "getuid", "geteuid", "waitstatus_to_exitcode", "pidfd_open"),
    signal: ("SIGKILL", "SIGHUP", "SIGCHLD", "pthread_sigmask", "SIG_BLOCK", "SIG_SETMASK"),
    socket: ("send_fds", "recv_fds", "AF_UNIX", "SOCK_SEQPACKET"),
}
MODULES = ("resource", "fcntl", "pwd", "termios")
OWN = Path(__file__).parents[2] / "src" / "trackbench"


def hide() -> None:
    """From now on trackbench finds none of it."""
    # What is imported now keeps what it has.
    import asyncio  # noqa: F401
    import multiprocessing.resource_tracker  # noqa: F401
    import subprocess  # noqa: F401

    import loky  # noqa: F401

    for module, names in MISSING.items():
        module.__class__ = type(f"Other{module.__name__}", (type(module),), {"__getattribute__": _without(names)})
    platform.system = lambda: "Windows"
    plain_import, plain_spec, plain_open = builtins.__import__, importlib.util.find_spec, Path.read_text

    def without_modules(name: str, *more: Any, **options: Any) -> Any:
        if name in MODULES and _from_trackbench(sys._getframe(1)):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return plain_import(name, *more, **options)

    def find(name: str, package: str | None = None) -> Any:
        return None if name in MODULES else plain_spec(name, package)

    def read_text(self: Path, *more: Any, **options: Any) -> str:
        if self.parts[:2] == ("/", "proc"):
            raise FileNotFoundError(self)
        return plain_open(self, *more, **options)

    builtins.__import__ = without_modules  # type: ignore[assignment]
    importlib.util.find_spec = find
    Path.read_text = read_text  # type: ignore[method-assign, assignment]


def _without(names: tuple[str, ...]) -> Callable[[Any, str], Any]:
    def get(module: Any, name: str) -> Any:
        if name in names and _from_trackbench(sys._getframe(1)):
            raise AttributeError(f"module {object.__getattribute__(module, '__name__')!r} has no attribute {name!r}")
        return object.__getattribute__(module, name)

    return get


def _from_trackbench(frame: Any) -> bool:
    return Path(frame.f_code.co_filename).is_relative_to(OWN)


if __name__ == "__main__":
    hide()
    from trackbench.cli import main

    main()
