"""Files that a user names, and the user's cache folder."""

from __future__ import annotations

import json
import os
import stat
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from trackbench.base.errors import InputError


def require_regular(file: Path) -> None:
    """Make sure that a file is one that can be read to its end.

    Raises:
        FileNotFoundError: it is not there.
        InputError: it is a folder, a pipe or a device.
    """
    try:
        mode = file.stat().st_mode
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}", file=file) from None
    if stat.S_ISDIR(mode):
        raise InputError("this is a folder; name a file in it", file=file)
    if not stat.S_ISREG(mode):
        raise InputError("this is a device or a pipe; name a file", file=file)


def read_bytes(file: Path) -> bytes:
    """The content of a file.

    Raises:
        FileNotFoundError: it is not there.
        InputError: as :func:`require_regular`; it cannot be read.
    """
    require_regular(file)
    try:
        return file.read_bytes()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=file) from None


def path_from(path: str, folder: Path, elsewhere: Path) -> str:
    """A path as seen from another folder.

    Args:
        path: of a file or folder, relative to its folder or to the working directory. One that is absolute, has a
            variable or leads nowhere stays as it is.
        folder: where the path is relative to.
        elsewhere: where it will be relative to.
    """
    if "$" in path or Path(path).expanduser().is_absolute():
        return path
    file = next((place for place in (folder / path, Path(path)) if place.exists()), None)
    return path if file is None else os.path.relpath(file.resolve(), elsewhere.resolve())


def read_text(file: Path, remedy: str = "") -> str:
    """The text of a file in UTF-8; ``remedy`` ends the message about any other.

    Raises:
        FileNotFoundError: it is not there.
        InputError: as :func:`read_bytes`; it is not UTF-8.
    """
    raw = read_bytes(file)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"not UTF-8 text (byte 0x{raw[error.start]:02x}){remedy}", file=file, line=line) from None


def read_json(file: Path) -> Any:
    """The value in a JSON file.

    Raises:
        FileNotFoundError: it is not there.
        InputError: as :func:`read_bytes`.
        ValueError: it is not JSON.
        RecursionError: it is nested too deeply.
    """
    return json.loads(read_bytes(file))


@cache
def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="trackbench-"))


def cache_folder() -> Path:
    """TRACKBENCH_CACHE, else trackbench in XDG_CACHE_HOME or ~/.cache; without a home a new folder of each process."""
    own = os.environ.get("TRACKBENCH_CACHE")
    if own:
        return Path(own)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trackbench"
    except RuntimeError:
        return _temporary_folder()


def write_whole(file: Path, content: bytes) -> None:
    """Write a file, under its final name only when it is whole.

    Raises:
        OSError: the folder cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=file.parent, prefix=f".{file.stem[:8]}-")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.replace(temporary, file)
    except BaseException:
        os.unlink(temporary)
        raise
