"""The Rerun viewer as a process of its own, and the recordings that it opens."""

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
#: Longest time for a viewer to start, to load a file, and to draw it, s.
PATIENCE = 30.0
#: Width and height of a picture, pixels.
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
    """Viewer process that listens on a port."""

    process: subprocess.Popen[bytes]
    port: int
    log: IO[bytes]

    @property
    def url(self) -> str:
        """Address at which the viewer takes data and commands."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    def wait(self) -> ViewerClient:
        """Wait until the viewer draws and takes commands, which is later than it listens on its port.

        Raises:
            InputError: the viewer ended, since there is no screen or no driver.
            TrackbenchError: the viewer does not answer.
        """
        client = self.retry(lambda: ViewerClient.connect(self.url))
        self.retry(client.get_state)
        return client

    def open(self, file: Path, at: float | None = None) -> ViewerClient:
        """Load a recording, and pause at a time (s) if one is given.

        Raises:
            InputError: the viewer ended, since there is no screen or no driver.
            TrackbenchError: the viewer does not load the file in time.
        """
        client = self.wait()
        self.retry(partial(client.open, str(file.resolve())))
        self.retry(lambda: client.get_state().loading == [] or None)
        if at is not None:
            self.retry(lambda: client.set_time(TIMELINE, duration=at, play_state="paused") or True)
        return client

    def stop(self) -> None:
        # The process is a Python program that runs the viewer; both are in one group.
        with suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(self.process.pid, signal.SIGTERM)
            else:
                self.process.terminate()
        self.process.wait()
        self.log.close()

    def retry(self, ask: Callable[[], Answer | None]) -> Answer:
        """Ask the viewer until it answers, since it answers nothing while it starts or loads."""
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
                raise end_error(self.log)
            if time.monotonic() > limit:
                self.stop()
                raise TrackbenchError(f"the viewer did not answer within {PATIENCE:g} s{cause}")
            time.sleep(0.1)


def start_viewer(*options: str) -> Viewer:
    """Start a viewer that listens on a local port; with ``--headless`` it needs no screen.

    The viewer goes on when this process ends, unless it is stopped.
    """
    with socket.create_server((LOOPBACK, 0)) as probe:
        port = int(probe.getsockname()[1])
    log = tempfile.TemporaryFile()  # noqa: SIM115 (the viewer writes to it, and may outlive this process)
    command = [
        sys.executable,
        # -P keeps modules in the working directory from replacing libraries.
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
    """Yield pictures of a recording at some times (s) as PNGs of ``size`` pixels, drawn without a screen.

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
            # Views fill up over several frames; two equal pictures show the last one.
            while png != before and time.monotonic() < limit:
                time.sleep(0.3)
                before, png = png, client.take_screenshot()
            yield bytes(png)
    except (ConnectionError, RuntimeError) as error:
        raise (end_error(viewer.log) if viewer.process.poll() is not None else TrackbenchError(str(error))) from error
    finally:
        viewer.stop()


def end_error(log: IO[bytes]) -> InputError:
    """Return the error that says why a viewer ended by itself, and what to do about it."""
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
    """Yield a recording for the viewer, and the time, s, at which it opens; a temporary recording is deleted later.

    Args:
        path: folder of a run, or its recording; only a folder has the data to centre the scene on a vehicle.
        opening: requested time, moment, vehicle and tracker.

    Raises:
        InputError: the run cannot be read, or lacks the time, moment, vehicle or tracker.
    """
    examined = path / RECORDING if path.is_dir() else path
    if examined.is_file() and (examined.parent / EXAMINATION).is_file():
        if opening != Opening(at_s=opening.at_s):
            raise InputError("an examination has no worst moments: give --at", file=path)
        yield examined, opening.at_s
        return
    run = read(path)
    focus = focus_of(run.result, opening)
    is_centred, is_alone = focus.vehicle is not None or focus.tracker is not None, not path.is_dir()
    if is_alone and is_centred and opening.worst is None:
        raise InputError("without its folder a recording cannot be centred: name the folder of the run", file=path)
    time_s = moment_of(run.result).time_s if focus == Focus() else focus.time_s
    if run.recording is not None and (is_alone or not is_centred):
        yield run.recording, time_s
        return
    with tempfile.TemporaryDirectory(prefix="trackbench-") as folder:
        file = Path(folder) / RECORDING
        write(run.result, file, focus)
        yield file, time_s
