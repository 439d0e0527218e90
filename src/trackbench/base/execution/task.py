"""A piece of work, the executor of this process, alone or with others beside it, and the threads of BLAS."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from threading import Lock, Timer
from typing import Any

from trackbench.base import at_hand
from trackbench.base.errors import TrackbenchError
from trackbench.base.exit_status import FAULT
from trackbench.base.plugins import one_line
from trackbench.base.user_code import place_of

#: Processes of one machine.
MOST_WORKERS = 1024
#: A worker of a cluster may have several threads; the module path and stdout belong to all of them.
_ONE_AT_A_TIME = Lock()


class Task:
    """A function whose calls share a first argument, which is pickled once for all of them.

    In another process it runs with a scenario's folder on the module path, prints to stderr, and uses one BLAS thread.

    Args:
        function: of the constant and the arguments of a call.
        constant: what all calls share.
        folder: where the modules of the constant's classes are, beside the working directory; None if nowhere else.
        long: whether its calls together take so long that other processes should start at once.
    """

    def __init__(self, function: Callable[..., Any], constant: Any, folder: Path | None, *, long: bool = False) -> None:
        self.long = long
        self._function = function
        self._constant = constant
        self._places = (*([folder] if folder else []), Path.cwd())

    def __call__(self, *args: Any) -> Any:
        return self._function(self._constant, *args)

    def __reduce__(self) -> tuple[Any, ...]:
        return _SentTask, (self._function, self._content, self._places, at_hand.pickled())

    @cached_property
    def _content(self) -> bytes:
        return at_hand.dumps(self._constant)


class Here:
    """A function that is called in this process alone: in another one, to which it is sent, it does nothing."""

    def __init__(self, call: Callable[..., None]) -> None:
        self._call = call

    def __call__(self, *args: Any) -> None:
        self._call(*args)

    def __reduce__(self) -> tuple[Any, ...]:
        return Here, (_nothing,)


def _nothing(*_: Any) -> None:
    pass


@dataclass(frozen=True)
class _SentTask:
    """A task in the process to which it was sent."""

    function: Callable[..., Any]
    content: bytes
    places: tuple[Path, ...]
    classes: dict[str, bytes]
    """Those that no process can import."""

    def __call__(self, *args: Any) -> _Result:
        at_hand.receive_classes(self.classes)
        with _ONE_AT_A_TIME, redirect_stdout(sys.stderr), one_blas_thread(), _modules_of(self.places):
            try:
                return _Result(at_hand.dumps(self.function(pickle.loads(self.content), *args)))
            except (TrackbenchError, ModuleNotFoundError):
                raise
            except BaseException as error:
                place = place_of(error, installed=False)
                if place is None and isinstance(error, Exception):
                    raise
                # Where it was raised is not sent, and a SystemExit would end whoever asks for the result.
                where = "" if place is None else f" ({place})"
                raise TrackbenchError(f"a plug-in failed: {one_line(error)}{where}") from None
            finally:
                if __name__ not in sys.modules:
                    # Without its modules it would work no more, and not end.
                    os._exit(FAULT)


@dataclass(frozen=True)
class _Result:
    """A result that was pickled while its modules were loaded; unpickled, it is the result itself."""

    content: bytes

    def __reduce__(self) -> tuple[Any, ...]:
        return pickle.loads, (self.content,)


@contextmanager
def _modules_of(places: tuple[Path, ...]) -> Iterator[None]:
    """With some folders first on the module path; a module from there is loaded anew by the next task.

    A cluster may be there for days, in which such a module changes.

    Raises:
        TrackbenchError: a folder or a module is not there.
    """
    host = socket.gethostname()
    for place in places[:-1]:
        if not place.is_dir():
            raise TrackbenchError(f"worker on {host}: there is no folder {place}, which has modules of the scenario")
    path, before = list(sys.path), set(sys.modules)
    sys.path[:0] = [str(place) for place in places]
    try:
        yield
    except ModuleNotFoundError as error:
        raise TrackbenchError(f"worker on {host}: {error}") from error
    finally:
        sys.path[:] = path
        for name in set(sys.modules) - before:
            top = name.partition(".")[0]
            own = any((place / f"{top}.py").is_file() or (place / top).is_dir() for place in places)
            if own and top != "trackbench":
                del sys.modules[name]


class InProcess(Executor):
    """Runs each call in this process, at the time at which its result is asked for."""

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future whose ``result()`` makes the call."""
        return _Later(partial(call, *args, **kwargs))

    def __str__(self) -> str:
        return "in this process"


class _Later(Future[Any]):
    def __init__(self, call: Callable[[], Any]) -> None:
        super().__init__()
        self._call = call

    def result(self, timeout: float | None = None) -> Any:
        if not self.done() and self.set_running_or_notify_cancel():
            try:
                self.set_result(self._call())
            except Exception as error:
                self.set_exception(error)
        return super().result(timeout)


#: How long this process works alone while more waits than it is at: others take a second to start, s.
ALONE = 1.0


class Shared(Executor):
    """This process and, once the work has taken a moment, others beside it: whoever is free makes the next call.

    This process makes calls while it waits for a result.

    Args:
        start: gives the others, and how many they are; called once, and not where the work has ended before.
    """

    def __init__(self, start: Callable[[], tuple[Executor, int]]) -> None:
        self._start, self._free = start, 0
        self._others: Executor | None = None
        self._waiting: deque[_Either] = deque()
        self._timer: Timer | None = None
        self._closed = False
        self._lock = Lock()

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the call, which ``result()`` makes in this process where no other one is at it."""
        outcome = _Either(partial(call, *args, **kwargs), self._taken)
        with self._lock:
            self._waiting.append(outcome)
            if self._timer is None:
                self._timer = Timer(0.0 if isinstance(call, Task) and call.long else ALONE, self._begin)
                self._timer.daemon = True
                self._timer.start()
        self._share()
        return outcome

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the other processes, whatever they do."""
        with self._lock:
            self._closed, timer = True, self._timer
            self._waiting.clear()
        if timer is not None:
            timer.cancel()
            timer.join()
        if self._others is not None:
            self._others.shutdown(wait=wait, cancel_futures=cancel_futures)

    def __str__(self) -> str:
        return "in this process"

    def _begin(self) -> None:
        with self._lock:
            if self._closed or not self._waiting:
                self._timer = None
                return
        try:
            self._others, self._free = self._start()
        except Exception as error:
            log.info("no other processes can be started: %s", one_line(error))
            return
        log.info("the work runs %s as well", self._others)
        self._share()

    def _share(self) -> None:
        """Give what waits to the others that are free."""
        while True:
            with self._lock:
                outcome = next((item for item in self._waiting if item.sendable), None) if self._free else None
                if outcome is None:
                    return
                self._waiting.remove(outcome)
                self._free -= 1
            assert self._others is not None
            try:
                future = self._others.submit(outcome.call)
            except Exception as error:
                if self._closed:
                    return
                log.info("no other processes can be started: %s", one_line(error))
                self._free = 0
                outcome.make(outcome.call)
                return
            future.add_done_callback(partial(self._ended, outcome))

    def _ended(self, outcome: _Either, future: Future[Any]) -> None:
        with self._lock:
            self._free += 1
        outcome.make(future.result)
        self._share()

    def _taken(self, wanted: _Either) -> _Either | None:
        """What this process makes next: that which it wants, or else another; None where nothing waits."""
        with self._lock:
            if wanted in self._waiting:
                self._waiting.remove(wanted)
                return wanted
            return self._waiting.popleft() if self._waiting else None


class _Either(Future[Any]):
    """A call that this process or another one makes."""

    def __init__(self, call: Callable[[], Any], taken: Callable[[_Either], _Either | None]) -> None:
        super().__init__()
        self.call, self._taken = call, taken

    @cached_property
    def sendable(self) -> bool:
        """Whether another process can be given it: what a user wrote may not."""
        try:
            pickle.dumps(self.call)
        except Exception:
            return False
        return True

    def make(self, call: Callable[[], Any]) -> None:
        """Set what the call gives or raises."""
        if self.set_running_or_notify_cancel():
            try:
                self.set_result(call())
            except Exception as error:
                self.set_exception(error)
            except BaseException as error:
                # Whoever waits for it is not to wait for ever.
                self.set_exception(error)
                raise

    def result(self, timeout: float | None = None) -> Any:
        while not self.done():
            other = self._taken(self)
            if other is None:
                break
            other.make(other.call)
        return super().result(timeout)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """With Ctrl-C held back, and for good from the processes that start meanwhile: each would print a traceback.

    So is SIGTERM; a process lets it through again by ``allow_termination``.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Where this helper of multiprocessing is not there yet, its start would undo what follows.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def allow_termination() -> None:
    """Let SIGTERM end this process, which was started uninterrupted."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


log = logging.getLogger(__name__)

_limited = ContextVar("limited", default=False)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread; also a decorator.

    The products of a filter are so small that a second thread costs more than it saves, and many times more where the
    processor is shared.
    """
    if _limited.get():
        yield
        return
    # Takes some 10 ms, which only the commands that compute shall wait for.
    from threadpoolctl import threadpool_limits

    token = _limited.set(True)
    try:
        with threadpool_limits(1, user_api="blas"):
            log.info("linear algebra (BLAS) is limited to one thread")
            yield
    finally:
        _limited.reset(token)
