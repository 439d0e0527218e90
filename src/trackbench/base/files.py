"""Files that a user names, and the user's cache folder."""

from __future__ import annotations

import json
import os
import re
import stat
import tempfile
from pathlib import Path
from typing import Any

from trackbench.base.errors import InputError

#: Bytes of a scenario.
SCENARIO = 4 * 2**20
#: Of a result.
JSON = 64 * 2**20
#: Of a log as text.
LARGE = 2**30
_SURROGATE = re.compile("[\ud800-\udfff]")


def is_utf8(name: str) -> bool:
    """Whether a name of the file system is text; Python has a surrogate for each byte that is not."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def require_regular(file: Path) -> None:
    """Make sure that a file is one that can be read to its end.

    Raises:
        FileNotFoundError: it is not there.
        InputError: it is a folder, a pipe or a device, or its name is not UTF-8.
    """
    if not is_utf8(str(file)):
        raise InputError(f"{str(file)!a}: its name is not UTF-8; rename it")
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


def read_bytes(file: Path, most: int = LARGE) -> bytes:
    """The content of a file.

    Args:
        file: its name.
        most: bytes.

    Raises:
        FileNotFoundError: it is not there.
        InputError: as :func:`require_regular`; it is larger than ``most`` or cannot be read.
    """
    require_regular(file)
    try:
        if file.stat().st_size > most:
            raise InputError(f"larger than {most / 2**20:g} MiB, which none is", file=file)
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


def read_text(file: Path, most: int = LARGE, remedy: str = "") -> str:
    """The text of a file in UTF-8; ``remedy`` ends the message about any other.

    Raises:
        FileNotFoundError: it is not there.
        InputError: as :func:`read_bytes`; it is not UTF-8.
    """
    raw = read_bytes(file, most)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"not UTF-8 text (byte 0x{raw[error.start]:02x}){remedy}", file=file, line=line) from None


def read_json(file: Path) -> Any:
    """The value in a JSON file.

    Raises:
        FileNotFoundError: it is not there.
        InputError: as :func:`read_bytes`; it is larger than ``JSON``.
        ValueError: it is not JSON, or has half a character, which no file can hold.
        RecursionError: it is nested too deeply.
    """
    raw = read_bytes(file, JSON)
    value = json.loads(raw)
    if b"\\u" in raw and (half := _SURROGATE.search(json.dumps(value, ensure_ascii=False))):
        raise ValueError(f"half a character: \\u{ord(half[0]):x} alone")
    return value


def cache_folder() -> Path:
    """TRACKBENCH_CACHE, else trackbench in XDG_CACHE_HOME or ~/.cache; of a user without a home in /tmp."""
    own = os.environ.get("TRACKBENCH_CACHE")
    if own:
        return Path(own)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trackbench"
    except RuntimeError:
        return Path(tempfile.gettempdir()) / f"trackbench-{os.getuid()}"


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
