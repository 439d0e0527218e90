"""The runs of a map that is not finished, so that the same command goes on where it was interrupted."""

from __future__ import annotations

import hashlib
import logging
import pickle
import shutil
from pathlib import Path
from typing import Any

from trackbench.base.files import write_whole
from trackbench.subjects.envelope.axes import Point

log = logging.getLogger(__name__)

#: Of what the files of another program, scenario or design do not have.
SIGNATURE = "signature"


class Store:
    """A folder with a file for each look at each cell.

    Args:
        folder: None keeps nothing.
        signature: what determines the runs; the files of another one are removed.
    """

    def __init__(self, folder: Path | None, signature: str) -> None:
        self._folder = folder
        self.taken = 0
        """Looks that were there already."""
        if folder is None:
            return
        mark = folder / SIGNATURE
        if mark.is_file() and mark.read_text() != signature:
            log.info("%s is of another scenario or version, and is begun anew", folder)
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        mark.write_text(signature)

    def load(self, point: Point, look: int) -> Any:
        """What a look at a cell left; None where it was not made, or its file is damaged."""
        if self._folder is None:
            return None
        try:
            content = pickle.loads(self._file(point, look).read_bytes())
        except (OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError):
            return None
        self.taken += 1
        return content

    def save(self, point: Point, look: int, content: Any) -> None:
        """Keep what a look at a cell left; the file is there whole, or not at all."""
        if self._folder is not None:
            write_whole(self._file(point, look), pickle.dumps(content))

    def _file(self, point: Point, look: int) -> Path:
        assert self._folder is not None
        return self._folder / f"{hashlib.sha256(repr(point).encode()).hexdigest()[:24]}-{look}"
