"""Files that a user names, and the user's cache folder."""

from __future__ import annotations

import os
import stat
import tempfile
from functools import cache
from pathlib import Path

from trackbench.base.errors import InputError


def require_regular(file: Path) -> None:
    """Make sure that a path is a regular file.

    Raises:
        FileNotFoundError: there is no such file.
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
    """Return the content of a regular file.

    Raises:
        FileNotFoundError: there is no such file.
        InputError: it is no regular file, or cannot be read.
    """
    require_regular(file)
    try:
        return file.read_bytes()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=file) from None


def read_text(file: Path, remedy: str = "") -> str:
    """Return the text of a UTF-8 file; ``remedy`` ends the error message about a file in another encoding.

    Raises:
        InputError: there is no such file, or it is no regular file, cannot be read, or is not UTF-8.
    """
    try:
        raw = read_bytes(file)
    except FileNotFoundError:
        raise InputError("there is no such file", file=file) from None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"not UTF-8 text (byte 0x{raw[error.start]:02x}){remedy}", file=file, line=line) from None


@cache
def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="trackbench-"))


def cache_folder() -> Path:
    """Return the cache folder: TRACKBENCH_CACHE, else trackbench in XDG_CACHE_HOME, ~/.cache or a temporary folder."""
    stated = os.environ.get("TRACKBENCH_CACHE")
    if stated:
        return Path(stated)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trackbench"
    except RuntimeError:
        return _temporary_folder()


def write_whole(file: Path, content: bytes) -> None:
    """Write a file under a temporary name, and give it its final name when it is complete.

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
