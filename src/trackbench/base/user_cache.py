"""The user's folder for what takes long to compute again."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def cache_folder() -> Path:
    """TRACKBENCH_CACHE, else trackbench in XDG_CACHE_HOME, else ~/.cache/trackbench."""
    own = os.environ.get("TRACKBENCH_CACHE")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trackbench"


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
