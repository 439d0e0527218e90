"""Writing of files and folders, whole or not at all."""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import pydantic_core

from trackbench.base.errors import InputError, OutputError, TrackbenchError

#: Stand for an object's name: of a false alarm, and where there is no object.
FALSE_ALARM, NO_OBJECT = "false alarm", ""
OBSERVER = "observer"

#: Name of the summary file in the folder of a run.
SUMMARY = "result.json"
#: Name of the file in the folder of an examination by the doctor.
EXAMINATION = "examination.json"

log = logging.getLogger(__name__)

#: Suffix of the name of a file or folder that is not complete yet.
UNFINISHED = ".unfinished"


def json_text(summary: Mapping[str, Any]) -> str:
    """Return the text of a JSON file with the values of a result's summary.

    Raises:
        ValueError: the summary holds a NaN or an infinity, which a result never does.
    """
    # Ten times as fast as json.dumps with an indent, which a sweep of a thousand trackers waits for.
    text = pydantic_core.to_json(summary, indent=2).decode() + "\n"
    if any(f"{word}{end}" in text for word in ("NaN", "Infinity") for end in (",\n", "\n")):
        raise ValueError("Out of range float values are not JSON compliant")
    return text


def save_files(files: Mapping[str, Callable[[Path], object]], folder: Path, mark: str) -> None:
    """Write a folder under a temporary name beside it, and rename it when it is complete.

    Args:
        files: function that writes each file, by the file's path within the folder.
        folder: final name; an earlier folder with the file ``mark`` is replaced.
        mark: name of the file that identifies this kind of folder.

    Raises:
        OutputError: the folder cannot be written or is something else, or the disk is full; nothing is left under the
            final name.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=UNFINISHED, dir=folder.parent))
    except OSError as error:
        raise OutputError(f"cannot write to {folder.parent}: {error.strerror}") from error
    try:
        temporary.chmod(0o755)
        for name, write in files.items():
            (temporary / name).parent.mkdir(parents=True, exist_ok=True)
            write(temporary / name)
            if not (temporary / name).exists():
                raise OutputError(f"cannot write {folder}: {name} was not written")
        written = [f"{name} {(temporary / name).stat().st_size / 1000:.0f} kB" for name in sorted(files)]
        _put(temporary, folder, mark)
    except (OSError, TrackbenchError) as error:
        # The message names the final folder, not the temporary one.
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        raise OutputError(f"cannot write {folder}: {cause.strerror or cause}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    log.info("wrote %s/: %s", folder, ", ".join(written))


def require_writable(out: Path, key: str = "--out") -> None:
    """Make sure, before any work, that files can be written to a folder.

    Args:
        out: the folder.
        key: command-line option that names the folder, for the error message.

    Raises:
        InputError: files cannot be written to the folder.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"cannot write to {out}: it is a file, not a folder", key=key)
    try:
        out.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=out).close()
    except OSError as error:
        raise InputError(f"cannot write to {out}: {error.strerror or error}", key=key) from error


def require_file(path: Path, key: str) -> None:
    """Make sure, before any work, that a file can be written.

    Args:
        path: name of the file.
        key: command-line option that names the file, for the error message.

    Raises:
        InputError: the file cannot be written.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder; name a file", key=key)
    require_writable(path.parent, key)


def require_replaceable(folder: Path, mark: str = SUMMARY) -> None:
    """Make sure that a folder can be written under a name: it does not exist, is empty, or holds the file ``mark``.

    Args:
        folder: name of the folder.
        mark: name of the file that identifies this kind of folder; by default the summary of a run.

    Raises:
        InputError: a file or a folder of another kind has this name, and must not be lost.
    """
    free = not folder.exists() or (folder.is_dir() and not any(folder.iterdir()))
    if not free and not (folder / mark).is_file():
        kind = "the folder of a run" if mark == SUMMARY else f"a folder with {mark}"
        raise InputError(f"it exists and is not {kind}, so it is not replaced", file=folder)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, and the folder it is in, under a temporary name and rename it: it is whole or missing.

    A device or a pipe, such as /dev/stdout, is written directly.

    Raises:
        OutputError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}{UNFINISHED}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            path.write_bytes(content)
        else:
            temporary.write_bytes(content)
            os.replace(temporary, path)
        log.info("wrote %s", path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_file(text: str, path: Path) -> None:
    """Write a text file into a folder that has a temporary name until all its files are written."""
    path.write_text(text, encoding="utf-8")


def _put(temporary: Path, folder: Path, mark: str) -> None:
    """Rename a folder to its final name; an earlier one is moved away first, and back if the renaming fails."""
    if not folder.exists():
        os.replace(temporary, folder)
        return
    try:
        require_replaceable(folder, mark)
    except InputError as error:
        raise OutputError(f"cannot write {folder}: {error.message}") from None
    earlier = temporary.with_suffix(".replaced")
    os.replace(folder, earlier)
    try:
        os.replace(temporary, folder)
    except BaseException:
        if not folder.exists():
            os.replace(earlier, folder)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def sha256(file: Path) -> str:
    """Return the sha256 of a file's content, in hexadecimal."""
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
