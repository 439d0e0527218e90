"""The runs of a map that is not finished, so that the same command goes on where it was interrupted."""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path
from typing import Any

from trackbench.base.errors import OutputError
from trackbench.base.files import write_whole
from trackbench.subjects.envelope.axes import Point

#: Bytes of the sha256 that a file begins with.
DIGEST = 32


class Store:
    """A folder with a file for each look at each cell.

    Args:
        folder: None keeps nothing.
        signature: what determines the runs; the files of another one have other names.
    """

    def __init__(self, folder: Path | None, signature: str) -> None:
        self._folder, self._signature = folder, signature
        self.taken = 0
        """Looks that were there already."""

    def load(self, point: Point, look: int) -> Any:
        """What a look at a cell left; None where it was not made, or its file is damaged."""
        if self._folder is None:
            return None
        try:
            raw = self._file(self._folder, point, look).read_bytes()
        except OSError:
            return None
        if hashlib.sha256(raw[DIGEST:]).digest() != raw[:DIGEST]:
            return None
        try:
            content = pickle.loads(raw[DIGEST:])
        except (AttributeError, ImportError, TypeError):
            # Written by a program that had other classes.
            return None
        self.taken += 1
        return content

    def save(self, point: Point, look: int, content: Any) -> None:
        """Keep what a look at a cell left; the file is there whole, or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        if self._folder is None:
            return
        raw, file = pickle.dumps(content), self._file(self._folder, point, look)
        try:
            try:
                write_whole(file, hashlib.sha256(raw).digest() + raw)
            except FileNotFoundError:
                # Another command with the same map has ended, and removed the folder.
                write_whole(file, hashlib.sha256(raw).digest() + raw)
        except OSError as error:
            raise OutputError(f"cannot write {self._folder}: {error.strerror or error}") from error

    def _file(self, folder: Path, point: Point, look: int) -> Path:
        name = hashlib.sha256(f"{self._signature} {point!r}".encode()).hexdigest()[:24]
        return folder / f"{name}-{look}"
