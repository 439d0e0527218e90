"""The Rerun viewer as a process of its own, and the recordings made ready for it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, TypeVar
from urllib.parse import quote

from rerun.experimental import ViewerClient

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.results import EXAMINATION
from trackbench.subjects.recording.contents import labels, laid_over, same_traffic
from trackbench.subjects.recording.data import RECORDING, Recorded, read
from trackbench.subjects.recording.focus import Focus, Opening, focus_of, moment_of
from trackbench.subjects.recording.stream import TIMELINE
from trackbench.subjects.recording.writer import reopened, write, write_overlay

LOOPBACK = "127.0.0.1"
EVERYWHERE = ("0.0.0.0", "::")
#: For how long a viewer may take to start, to load a file and to draw it, s.
PATIENCE = 30.0
#: Pixels of a picture.
SIZE = (1600, 1000)
NO_SCREEN = (
    "there is no screen here for the viewer; report.html has a map, `trackbench inspect RUN --worst 3` lists the worst"
    " moments, `trackbench run --serve` shows a run in a browser"
)
SNAPSHOT = ", and `trackbench snapshot` takes a picture"
NO_DRIVER = (
    "the viewer found no Vulkan driver to draw with; install one that needs no graphics card (Debian and Ubuntu:"
    " apt-get install mesa-vulkan-drivers libvulkan1; Fedora: dnf install mesa-vulkan-drivers vulkan-loader);"
    " without one, report.html has a map and `trackbench inspect RUN --worst 3` lists the worst moments"
)


Answer = TypeVar("Answer")


@dataclass
class Viewer:
    """A viewer that was started here and listens on a port."""

    process: subprocess.Popen[bytes]
    host: str
    port: int
    log: IO[bytes]

    @property
    def url(self) -> str:
        """Where it takes data and commands."""
        return grpc_url(LOOPBACK if self.host in EVERYWHERE else self.host, self.port)

    def wait(self) -> ViewerClient:
        """Wait until it draws and takes commands; to listen at its port is not enough.

        Raises:
            InputError: it ended, for want of a screen or of a driver.
            TrackbenchError: it does not answer.
        """
        client = self.patiently(lambda: ViewerClient.connect(self.url))
        self.patiently(client.get_state)
        return client

    def open(self, files: Sequence[Path], at: float | None = None) -> ViewerClient:
        """Load recordings, show the first one, and pause at a time (s) if one is given.

        Raises:
            InputError: it ended, for want of a screen or of a driver.
            TrackbenchError: it does not load them in time.
        """
        client = self.wait()
        for file in reversed(files):
            self.patiently(partial(client.open, str(file.resolve())))
        self.patiently(lambda: client.get_state().loading == [] or None)
        if at is not None:
            self.patiently(lambda: client.set_time(TIMELINE, duration=at, play_state="paused") or True)
        return client

    def stop(self) -> None:
        """End the viewer."""
        # What was started is a Python program that runs the viewer: both are of one group.
        with suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(self.process.pid, signal.SIGTERM)
            else:
                self.process.terminate()
        self.process.wait()
        self.log.close()

    def patiently(self, ask: Callable[[], Answer | None], verb: str = "answer") -> Answer:
        """Ask until there is an answer: a viewer that starts or loads does not answer at once."""
        limit = time.monotonic() + PATIENCE
        while True:
            cause = ""
            try:
                answer = ask()
                if answer is not None:
                    return answer
            except (ConnectionError, RuntimeError) as error:
                cause = f": {error}"
            if self.process.poll() is not None:
                raise ended(self.log)
            if time.monotonic() > limit:
                self.stop()
                raise TrackbenchError(f"the viewer did not {verb} within {PATIENCE:g} s{cause}")
            time.sleep(0.1)


def start_viewer(*options: str, host: str = LOOPBACK, port: int | None = None) -> Viewer:
    """Start a viewer that listens on a port of ``host``; with ``--headless`` it needs no screen.

    It goes on when this process ends, unless it is stopped.

    Raises:
        InputError: it cannot start here.
    """
    port = port or free_port(host)
    log = tempfile.TemporaryFile()  # noqa: SIM115 (the viewer writes to it, and may outlive this process)
    command = [sys.executable, "-m", "rerun", "--bind", host, "--port", str(port), "--hide-welcome-screen", *options]
    process = subprocess.Popen(
        command,
        env={"XDG_RUNTIME_DIR": tempfile.gettempdir(), **os.environ},
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, start_new_session=True,
    )  # fmt: skip
    viewer = Viewer(process, host, port, log)
    viewer.patiently(lambda: listens(LOOPBACK if host in EVERYWHERE else host, port) or None, "start")
    return viewer


def serve_viewer(host: str) -> tuple[Viewer, str]:
    """A viewer for browsers that listens at an address of this machine (0.0.0.0: at all), and that of its page.

    Raises:
        InputError: ``host`` is not an address of this machine.
    """
    port, page = free_port(host), free_port(host)
    options = ["--serve-web", "--web-viewer-port", str(page)]
    name = host
    if host != LOOPBACK:
        name = socket.gethostname() if host in EVERYWHERE else host
        # Rerun lets pages of this machine alone read its data.
        options += ["--cors-allow-origin", f"http://*:{page}"]
    viewer = start_viewer(*options, host=host, port=port)
    return viewer, f"http://{name}:{page}/?url={quote(grpc_url(name, port), safe='')}"


def pictures(
    files: Sequence[Path], times: Sequence[float], size: tuple[int, int] = SIZE, zoom: int = 0
) -> Iterator[bytes]:
    """What the viewer shows of recordings at some times (s), as PNGs, drawn without a screen.

    Args:
        files: the recordings.
        times: s.
        size: pixels.
        zoom: by how many tenths everything is larger.

    Raises:
        InputError: there is no Vulkan driver.
        TrackbenchError: the viewer does not draw.
    """
    viewer = start_viewer("--headless", "--window-size", f"{size[0]}x{size[1]}")
    try:
        client = viewer.open(files)
        for _ in range(zoom):
            client.run_command("ui.zoom_in_ui")
        for at in times:
            client.set_time(TIMELINE, duration=at, play_state="paused")
            limit = time.monotonic() + PATIENCE
            before, png = b"", client.take_screenshot()
            # Views fill up over several frames; two pictures that are the same are of the last one.
            while png != before and time.monotonic() < limit:
                time.sleep(0.3)
                before, png = png, client.take_screenshot()
            yield bytes(png)
    except (ConnectionError, RuntimeError) as error:
        raise (ended(viewer.log) if viewer.process.poll() is not None else TrackbenchError(str(error))) from error
    finally:
        viewer.stop()


def ended(log: IO[bytes]) -> InputError:
    """Why a viewer ended by itself, and what to do about it."""
    with log:
        log.seek(0)
        text = log.read().decode(errors="replace")
    if "WAYLAND_DISPLAY" in text or "DISPLAY is set" in text:
        return InputError(NO_SCREEN + (SNAPSHOT if draws() else ""))
    if "render context" in text or "graphics adapter" in text:
        return InputError(NO_DRIVER)
    causes = [line for line in text.splitlines() if line.startswith(("Error", "thread"))]
    return InputError(f"the viewer ended: {causes[0] if causes else 'it gave no reason'}")


def draws() -> bool:
    """Whether there is a driver for a viewer without a screen, which starts without one too."""
    viewer = start_viewer("--headless")
    try:
        return bool(viewer.wait().take_screenshot())
    except (InputError, ConnectionError, RuntimeError):
        return False
    finally:
        viewer.stop()


def grpc_url(host: str, port: int) -> str:
    """The address under which Rerun's programs talk to each other."""
    shown = f"[{host}]" if ":" in host else host
    return f"rerun+http://{shown}:{port}/proxy"


def listens(host: str, port: int) -> bool:
    """Whether anything takes connections there."""
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True


def free_port(host: str = LOOPBACK) -> int:
    """A port that nothing uses.

    Raises:
        InputError: ``host`` is not an address of this machine.
    """
    try:
        with socket.create_server((host, 0)) as probe:
            return int(probe.getsockname()[1])
    except OSError as error:
        raise InputError(f"{host} is not an address of this machine", key="--host") from error


@dataclass(frozen=True)
class Playable:
    """Files that the viewer opens."""

    files: list[Path]
    notes: list[str]
    """What its user should know of how they came about."""
    time_s: float | None = None
    """Where it stops; None if it plays."""


@contextmanager
def playable(paths: Sequence[Path], opening: Opening) -> Iterator[Playable]:
    """Files for the viewer; those that had to be written are deleted at the end.

    Several runs of the same traffic become one file; those of different traffic stay apart.

    Raises:
        InputError: one of the recordings or folders cannot be read or lacks what the viewer should open with.
    """
    examined = paths[0] / RECORDING if paths[0].is_dir() else paths[0]
    if len(paths) == 1 and examined.is_file() and (examined.parent / EXAMINATION).is_file():
        if opening != Opening(at_s=opening.at_s):
            raise InputError("an examination has one target and is not scored by moments: give --at", file=paths[0])
        yield Playable([examined], [], opening.at_s)
        return
    runs = [read(path) for path in paths]
    notes = [f"{run.note}: shown from its tables" for run in runs if run.note]
    results = [run.result for run in runs]
    same = len(runs) == 1 or same_traffic(results)
    if not same and opening != Opening(at_s=opening.at_s):
        raise InputError("these runs do not show the same traffic: give --at alone, or one run", file=paths[1])
    labelled = all(result.summary.identities == "known" for result in results)
    focus = focus_of(results, opening)
    with tempfile.TemporaryDirectory(prefix="trackbench-") as folder:
        names = labels(paths)
        if len(runs) > 1 and same and labelled:
            file = Path(folder) / f"{' over '.join(names)}.rrd"
            write_overlay(laid_over(dict(zip(names, results, strict=True))), file, focus)
            files = [file]
        else:
            files = [_file(run, Path(folder) / f"{number}.rrd", opening) for number, run in enumerate(runs)]
        if not same:
            notes.append("they do not show the same traffic: the viewer has them one beside the other, not laid over")
        elif len(runs) > 1 and not labelled:
            notes.append("their identities are hidden: the viewer has them one beside the other, not laid over")
        yield Playable(files, notes, moment_of(results[0]).time_s if same and focus == Focus() else focus.time_s)


def _file(run: Recorded, made: Path, opening: Opening) -> Path:
    """The run's own file if it opens where it should, or else one that is made."""
    focus = focus_of([run.result], opening)
    if run.rerun is None:
        write(run.result, made, focus=focus)
    elif focus.vehicle is not None or focus.tracker is not None:
        reopened(run.file, run.result, made, focus)
    else:
        return run.file
    return made
