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

from rerun.experimental import ViewerClient

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.results import EXAMINATION
from trackbench.subjects.recording.data import RECORDING, read
from trackbench.subjects.recording.focus import Focus, Opening, focus_of, moment_of
from trackbench.subjects.recording.stream import TIMELINE
from trackbench.subjects.recording.writer import write

LOOPBACK = "127.0.0.1"
#: For how long a viewer may take to start, to load a file and to draw it, s.
PATIENCE = 30.0
#: Pixels of a picture.
SIZE = (1600, 1000)
NO_SCREEN = (
    "there is no screen here for the viewer; report.html has a map, `trackbench inspect RUN --worst 3` lists the worst"
    " moments, `trackbench snapshot` takes a picture, `rerun --serve-web RECORDING.rrd` shows a recording in a browser"
)
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
    port: int
    log: IO[bytes]

    @property
    def url(self) -> str:
        """Where it takes data and commands."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    def wait(self) -> ViewerClient:
        """Wait until it draws and takes commands; to listen at its port is not enough.

        Raises:
            InputError: it ended, for want of a screen or of a driver.
            TrackbenchError: it does not answer.
        """
        client = self.patiently(lambda: ViewerClient.connect(self.url))
        self.patiently(client.get_state)
        return client

    def open(self, file: Path, at: float | None = None) -> ViewerClient:
        """Load a recording, and pause at a time (s) if one is given.

        Raises:
            InputError: it ended, for want of a screen or of a driver.
            TrackbenchError: it does not load them in time.
        """
        client = self.wait()
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

    def patiently(self, ask: Callable[[], Answer | None]) -> Answer:
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
                raise TrackbenchError(f"the viewer did not answer within {PATIENCE:g} s{cause}")
            time.sleep(0.1)


def start_viewer(*options: str) -> Viewer:
    """Start a viewer that listens on a port of this machine alone; with ``--headless`` it needs no screen.

    It goes on when this process ends, unless it is stopped.
    """
    with socket.create_server((LOOPBACK, 0)) as probe:
        port = int(probe.getsockname()[1])
    log = tempfile.TemporaryFile()  # noqa: SIM115 (the viewer writes to it, and may outlive this process)
    command = [
        sys.executable,
        # Without -P a module in the working directory comes before the library.
        "-P",
        "-m",
        "rerun_cli",
        "--bind",
        LOOPBACK,
        "--port",
        str(port),
        "--hide-welcome-screen",
        *options,
    ]
    process = subprocess.Popen(
        command,
        env={"XDG_RUNTIME_DIR": tempfile.gettempdir(), **os.environ},
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, start_new_session=True,
    )  # fmt: skip
    return Viewer(process, port, log)


def pictures(file: Path, times: Sequence[float], size: tuple[int, int] = SIZE) -> Iterator[bytes]:
    """Yield what the viewer shows of a recording at some times (s), as PNGs, drawn without a screen.

    Args:
        file: the recording.
        times: s.
        size: pixels.

    Raises:
        InputError: there is no Vulkan driver.
        TrackbenchError: the viewer does not draw.
    """
    viewer = start_viewer("--headless", "--window-size", f"{size[0]}x{size[1]}")
    try:
        client = viewer.open(file)
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
    """Return why a viewer ended by itself, and what to do about it."""
    with log:
        log.seek(0)
        text = log.read().decode(errors="replace")
    if "WAYLAND_DISPLAY" in text or "DISPLAY is set" in text:
        return InputError(NO_SCREEN)
    if "render context" in text or "graphics adapter" in text:
        return InputError(NO_DRIVER)
    causes = [line for line in text.splitlines() if line.startswith(("Error", "thread"))]
    return InputError(f"the viewer ended: {causes[0] if causes else 'it gave no reason'}")


@contextmanager
def playable(path: Path, opening: Opening) -> Iterator[tuple[Path, float | None]]:
    """Yield a file for the viewer, which is deleted at the end if it had to be written, and where it stops, s.

    Args:
        path: the folder of a run, or a recording, which opens as it is: only a folder has all that is needed to centre
            the scene on a vehicle or a tracker.
        opening: what the viewer opens with.

    Raises:
        InputError: the run cannot be read or lacks what the viewer should open with.
    """
    examined = path / RECORDING if path.is_dir() else path
    if examined.is_file() and (examined.parent / EXAMINATION).is_file():
        if opening != Opening(at_s=opening.at_s):
            raise InputError("an examination has one target and is not scored by moments: give --at", file=path)
        yield examined, opening.at_s
        return
    run = read(path)
    focus = focus_of(run.result, opening)
    is_centred, is_alone = focus.vehicle is not None or focus.tracker is not None, not path.is_dir()
    if is_alone and is_centred and opening.worst is None:
        raise InputError("a recording without its folder is shown as it is: name the folder of the run", file=path)
    time_s = moment_of(run.result).time_s if focus == Focus() else focus.time_s
    if run.recording is not None and (is_alone or not is_centred):
        yield run.recording, time_s
        return
    with tempfile.TemporaryDirectory(prefix="trackbench-") as folder:
        file = Path(folder) / RECORDING
        write(run.result, file, focus)
        yield file, time_s
