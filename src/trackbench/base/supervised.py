"""What the process of a command tells the supervisor that waits for it (:mod:`trackbench.cli.supervisor`).

Without a supervisor (``tb.run``, ``--in-process``, a worker) nothing is told.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from mmap import mmap
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from trackbench.base.descendants import end_with_parent
from trackbench.base.process import clear_of_streams

#: Functions by which Python code ends its process or replaces it, in the modules ``os`` and ``posix``.
LEAVING = ("_exit", "execv", "execve")


class _Supervisor(NamedTuple):
    process: int
    """Its number."""
    own: int
    """Number of the supervised process."""
    pipe: int
    """Takes a line for each thing that is told, and the traceback of a process that ends."""
    note: mmap
    """Shared memory with the plug-in that is at work."""
    folder: int
    """Descriptor of the working directory of the command."""


_supervisor: _Supervisor | None = None


def begin(process: int, pipe: int, note: mmap) -> None:
    """Become supervised, in a process that was just started.

    Args:
        process: number of the supervisor.
        pipe: descriptor that it reads.
        note: shared memory in which it reads which plug-in is at work.
    """
    global _supervisor
    end_with_parent(process, signal.SIGTERM)
    folder = -1
    with suppress(OSError):
        folder = clear_of_streams(os.open(".", os.O_RDONLY))
    _supervisor = _Supervisor(process, os.getpid(), pipe, note, folder)
    faulthandler.enable(pipe, all_threads=False)
    for name in LEAVING:
        leaving = _dumped(getattr(os, name), pipe, os.getpid())
        for module in (os, sys.modules["posix"]):
            setattr(module, name, leaving)


def end(status: int) -> NoReturn:
    """End the command with a status, which the supervisor gives to the shell whatever happens after."""
    _tell(f"status {status}")
    raise SystemExit(status)


def alone() -> bool:
    """Whether there was a supervisor, and it was killed."""
    return _supervisor is not None and os.getppid() != _supervisor.process


def tell_plugin(reference: str) -> None:
    """Let the supervisor know of a plug-in that was loaded."""
    _tell(f"plugin {reference!r}")


def tell_scratch(folder: Path) -> None:
    """Let the supervisor remove a temporary folder, if this process is killed before it does."""
    _tell(f"scratch {folder.absolute()}")


def tell_kept(process: int) -> None:
    """Let the supervisor leave a child running when the command ends."""
    _tell(f"kept {process}")


def plugins_among(*things: Any) -> str:
    """Those of some objects whose class is not built in, as scenarios name them; empty where all are."""
    kinds = dict.fromkeys(type(thing) for thing in things)
    own = [kind for kind in kinds if not kind.__module__.startswith("trackbench.")]
    return ", ".join(repr(f"{kind.__module__}:{kind.__qualname__}") for kind in own)


@contextmanager
def at_work(plugins: str) -> Iterator[None]:
    """While plug-ins are called: the supervisor can name them, and afterwards this process is where it was before.

    A copy of this process that a plug-in has made by ``os.fork`` ends here.

    Args:
        plugins: their names; empty where all that is called is built in.
    """
    if _supervisor is None or not plugins or os.getpid() != _supervisor.own:
        yield
        return
    note, before = _supervisor.note, _supervisor.note[:]
    note[:] = plugins.encode(errors="replace")[: len(note)].ljust(len(note), b"\0")
    try:
        yield
    finally:
        if os.getpid() != _supervisor.own:
            os._exit(1)
        note[:] = before
        return_to_folder()


def return_to_folder() -> None:
    """Go back to the folder in which the command was started, wherever a plug-in has gone."""
    if _supervisor is not None and _supervisor.folder >= 0:
        with suppress(OSError):
            os.fchdir(_supervisor.folder)


def _tell(line: str) -> None:
    if _supervisor is not None and os.getpid() == _supervisor.own:
        with suppress(OSError):
            os.write(_supervisor.pipe, f"{line}\n".encode(errors="surrogateescape"))


def _dumped(call: Callable[..., Any], pipe: int, process: int) -> Callable[..., Any]:
    """A function before which the traceback goes to the supervisor."""

    def leave(*arguments: Any, **options: Any) -> Any:
        if os.getpid() == process:
            with suppress(OSError, ValueError):
                faulthandler.dump_traceback(pipe, all_threads=False)
        return call(*arguments, **options)

    return leave
