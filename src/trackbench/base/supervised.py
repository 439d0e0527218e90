"""What a process in which plug-ins run leaves of them for another, which says how it ended.

That of a command tells the supervisor that waits for it (:mod:`trackbench.cli.supervisor`); a worker writes files that
the command reads. In others (``tb.run``, ``--in-process``) nothing is told.
"""

from __future__ import annotations

import faulthandler
import hashlib
import json
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from mmap import mmap
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from trackbench.base.descendants import adopt_orphans, end_descendants, end_with_parent
from trackbench.base.printed import Shown, ShownStream, say_stray_errors
from trackbench.base.process import clear_of_streams, how_it_ended

#: Functions by which Python code ends its process or replaces it, in the modules ``os`` and ``posix``.
LEAVING = ("_exit", "execv", "execve")
#: Bytes of the note of which plug-in is at work.
NOTE = 1024
#: Bytes at the start of a file that are compared with what was written.
SEALED = 2**20


class _Watch(NamedTuple):
    parent: int
    """Number of the supervisor, or of the process that started a worker."""
    own: int
    """Number of this process."""
    pipe: int
    """Takes a line for each thing that is told, and the traceback of a process that ends."""
    note: mmap
    """Shared memory with the plug-in that is at work."""
    folder: int
    """Descriptor of the working directory of the command."""
    streams: tuple[int, int]
    """Descriptors of standard output and error."""
    umask: int
    """Of the command."""


_watch: _Watch | None = None
#: The plug-ins that were loaded in this process.
_plugins: dict[str, None] = {}
#: What is shown of that which plug-ins print, by their names.
_shown: dict[str, Shown] = {}


def begin(process: int, pipe: int, note: mmap) -> None:
    """Become supervised, in a process that was just started.

    Args:
        process: number of the supervisor.
        pipe: descriptor that it reads.
        note: shared memory in which it reads which plug-in is at work.
    """
    end_with_parent(process, signal.SIGTERM)
    adopt_orphans()
    _begin_watch(process, pipe, note)


def begin_worker(notes: Path) -> None:
    """Leave in a folder what :func:`how_worker_ended` reads, in a worker that has not begun to."""
    own = os.getpid()
    if _watch is None or _watch.own != own:
        told = os.open(notes / f"{own}.told", os.O_CREAT | os.O_WRONLY | os.O_APPEND)
        with (notes / f"{own}.note").open("w+b") as file:
            file.write(bytes(NOTE))
            file.flush()
            _begin_watch(os.getppid(), clear_of_streams(told), mmap(file.fileno(), NOTE))


def how_worker_ended(notes: Path, process: int, code: int) -> str:
    """How a worker ended, and with which plug-in.

    Args:
        notes: the folder in which it has begun.
        process: its number.
        code: its exit code.
    """
    texts = []
    for kind in ("told", "note"):
        # It may have ended before it began.
        with suppress(OSError):
            texts.append((notes / f"{process}.{kind}").read_bytes())
    told, note = texts if len(texts) == 2 else (b"", b"")
    return end_in_words(how_it_ended(code), told, note, _plugins)


def end_in_words(cause: str, told: bytes, note: bytes, plugins: Iterable[str]) -> str:
    """How a process ended, where in the user's code, and which plug-in was at work.

    Args:
        cause: as of ``how_it_ended``.
        told: what it has told, with its traceback.
        note: of the plug-in that was at work.
        plugins: those that were loaded, which are named where none was at work.
    """
    # Imported here: a command that ends as it should need not wait for it.
    from trackbench.base.user_code import place_in_dump

    at_work = note.rstrip(b"\0").decode(errors="replace")
    place = place_in_dump(told.decode(errors="replace"))
    where = "" if place is None else f" ({place})"
    who = f"while {at_work} was at work" if at_work else with_plugins(plugins)
    return f"{cause}{where}, {who or 'with no plug-in; the memory may not have been enough'}"


def with_plugins(plugins: Iterable[str]) -> str:
    """ "with the plug-ins 'a:A', 'b:B'"; empty where there is none."""
    names = list(dict.fromkeys(plugins))
    return f"with the plug-in{'s' * (len(names) > 1)} {', '.join(names)}" if names else ""


def _begin_watch(parent: int, pipe: int, note: mmap) -> None:
    global _watch
    folder = -1
    with suppress(OSError):
        folder = clear_of_streams(os.open(".", os.O_RDONLY))
    os.umask(umask := os.umask(0o077))
    _watch = _Watch(parent, os.getpid(), pipe, note, folder, _copies(), umask)
    say_stray_errors(lambda: _name_at_work() or ", ".join(_plugins))
    faulthandler.enable(pipe, all_threads=False)
    for name in LEAVING:
        leaving = _dumped(getattr(os, name), pipe, os.getpid())
        for module in (os, sys.modules[os.name]):
            setattr(module, name, leaving)


def _copies() -> tuple[int, int]:
    """Copies of the descriptors of standard output and error; -1 where one is closed."""
    copies = [-1, -1]
    for place, number in enumerate((1, 2)):
        with suppress(OSError):
            copies[place] = clear_of_streams(os.dup(number))
    return copies[0], copies[1]


def _name_at_work() -> str:
    return "" if _watch is None else _watch.note[:].rstrip(b"\0").decode(errors="replace")


def end(status: int) -> NoReturn:
    """End the command with a status, which the supervisor gives to the shell whatever happens after."""
    for name, shown in _shown.items():
        if shown.unshown:
            _say(f"{name} printed {shown.unshown} lines more, which were not shown")
    _tell(f"status {status}")
    if _watch is not None and os.getppid() != _watch.parent:
        # The supervisor was killed, which would have ended them.
        end_descendants()
    raise SystemExit(status)


def is_supervised() -> bool:
    """Whether a supervisor waits for this process, or did until it was killed."""
    return _watch is not None


def loaded_plugins() -> list[str]:
    """The plug-ins that were loaded in this process."""
    return list(_plugins)


def tell_plugin(reference: str) -> None:
    """Let the supervisor know of a plug-in that was loaded."""
    _plugins[repr(reference)] = None
    _tell(f"plugin {reference!r}")


def tell_signal(number: int) -> None:
    """Let the supervisor know that this process was sent a signal to end, and which plug-in was at work."""
    if _watch is not None:
        with suppress(OSError):
            faulthandler.dump_traceback(_watch.pipe, all_threads=False)
        _tell(f"signal {number} {_name_at_work()}")


def tell_unsaid(text: str) -> None:
    """Let the supervisor say what this process cannot, whose stderr is closed."""
    _tell(f"unsaid {json.dumps(text)}")


#: What becomes of a run that is interrupted.
UNFINISHED = "the unfinished run was not kept"
_unfinished = UNFINISHED


def tell_resumable(text: str) -> None:
    """Say so of what is kept, if the command is interrupted from now on."""
    global _unfinished
    _unfinished = text
    _tell(f"resumable {json.dumps(text)}")


def if_interrupted() -> str:
    """What becomes of the work of this process if it is interrupted."""
    return _unfinished


def tell_written(place: Path, files: Mapping[str, Path]) -> None:
    """Let the supervisor look, after the end, whether files are as they were written, where plug-ins were loaded.

    Args:
        place: the file, or the folder of several; of what is told twice, the last counts.
        files: by the name that each is to have, where it is before it is renamed.
    """
    if _watch is not None:
        _tell(f"written {json.dumps([str(place), {name: seal_of(file) for name, file in files.items()}])}")


def seal_of(file: Path) -> str:
    """The size of a file and a digest of its start; empty where it is not there, or not JSON as its name says."""
    try:
        with file.open("rb") as stream:
            start = stream.read(SEALED)
            size = os.fstat(stream.fileno()).st_size
        if file.suffix == ".json" and size <= SEALED:
            json.loads(start)
    except (OSError, ValueError):
        return ""
    return f"{size} {hashlib.sha256(start).hexdigest()}"


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
    """While plug-ins are called: the supervisor can name them; afterwards the folder and the streams are as before.

    What they print goes to stderr, up to a limit. A copy of this process that one has made by ``os.fork`` ends here.

    Args:
        plugins: their names; empty where all that is called is built in.
    """
    if _watch is None or not plugins or os.getpid() != _watch.own:
        yield
        return
    note, before, streams = _watch.note, _watch.note[:], (sys.stdout, sys.stderr)
    note[:] = plugins.encode(errors="replace")[: len(note)].ljust(len(note), b"\0")
    if sys.stderr is not None:
        shown = _shown.setdefault(plugins, Shown(plugins))
        sys.stdout = sys.stderr = ShownStream(sys.stderr, shown)
    try:
        yield
    finally:
        if os.getpid() != _watch.own:
            os._exit(1)
        note[:] = before
        sys.stdout, sys.stderr = streams
        _restore_streams(plugins)
        return_to_folder()


def _restore_streams(plugins: str) -> None:
    """Let standard output and error lead where they led before, whatever plug-ins have made of their descriptors."""
    assert _watch is not None
    for number, name, copy in zip((1, 2), ("output", "error"), _watch.streams, strict=True):
        # The copy is gone where all files were closed.
        with suppress(OSError):
            before = os.fstat(copy)
            try:
                same = os.path.samestat(before, os.fstat(number))
            except OSError:
                same = False
            if not same:
                os.dup2(copy, number)
                _say(f"trackbench: {plugins} has closed standard {name}, or sent it elsewhere; it is as before again")


def _say(text: str) -> None:
    with suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)


def return_to_folder() -> None:
    """Go back to the folder in which the command was started, and its umask, whatever a plug-in has changed."""
    if _watch is not None:
        os.umask(_watch.umask)
    if _watch is not None and _watch.folder >= 0:
        with suppress(OSError):
            os.fchdir(_watch.folder)


def _tell(line: str) -> None:
    if _watch is not None and os.getpid() == _watch.own:
        with suppress(OSError):
            os.write(_watch.pipe, f"{line}\n".encode(errors="surrogateescape"))


def _dumped(call: Callable[..., Any], pipe: int, process: int) -> Callable[..., Any]:
    """A function before which the traceback goes to the supervisor."""

    def leave(*arguments: Any, **options: Any) -> Any:
        if os.getpid() == process:
            with suppress(OSError, ValueError):
                faulthandler.dump_traceback(pipe, all_threads=False)
        return call(*arguments, **options)

    return leave
