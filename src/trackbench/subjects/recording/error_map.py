"""Where the errors are: the true paths of the recorded run in the colour of the position error of each contender."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from trackbench.base.types import Array, Indices
from trackbench.document.palette import ERROR_COLOURS, error_labels, error_limits
from trackbench.document.replay import NamedColour
from trackbench.results import Tables
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.scene import ROADS
from trackbench.subjects.recording.stream import Stream, path, pixels, rgba
from trackbench.subjects.recording.views import MARGIN, from_above

ERRORS, FRAME = "errors", "errors_frame"
#: A map this many times as wide as high has the whole width.
ELONGATED = 4.0


class ErrorMap:
    """A map for each contender.

    Args:
        tables: of the recorded run, whose identities are known.
        trackers: the contenders.
        hold: pieces of a path end this far apart at most, s.
    """

    def __init__(self, tables: Tables, trackers: list[str], hold: float) -> None:
        truth = {name: rows for (name,), rows in split(tables.truth, "object").items()}
        self._pieces: dict[str, list[tuple[Array, Array]]] = {}
        for (tracker, name), rows in split(tables.if_there("estimates"), "tracker", "object").items():
            if tracker in trackers:
                self._pieces.setdefault(tracker, []).append(_pieces(truth[name], rows, hold))

    @cached_property
    def limits(self) -> Array:
        """Between the colours, m."""
        return error_limits([error for pieces in self._pieces.values() for _, error in pieces])

    @property
    def legend(self) -> list[NamedColour]:
        """What the colours stand for."""
        labels = (label.replace("under", "error <") for label in error_labels(self.limits))
        return [NamedColour(label, colour) for label, colour in zip(labels, ERROR_COLOURS, strict=False)]

    def send(self, stream: Stream) -> None:
        """The pieces of all paths, the largest errors on top."""
        stream.static(FRAME, rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])))
        palette = np.array([rgba(colour) for colour in ERROR_COLOURS], dtype=np.uint32)
        for tracker, pieces in self._pieces.items():
            strips, error = (np.concatenate(part) for part in zip(*pieces, strict=True))
            level: Indices = np.digitize(error, self.limits)
            order = np.argsort(level, kind="stable")
            lines = rr.LineStrips2D(strips[order], colors=palette[level[order]], radii=pixels(1.5), draw_order=2.0)
            stream.static(path(ERRORS, tracker), lines)

    def view(self) -> rrb.Container:
        """The maps, each in a view."""
        at = np.concatenate([strips.reshape(-1, 2) for pieces in self._pieces.values() for strips, _ in pieces])
        (left, low), (right, high) = at.min(axis=0) - MARGIN, at.max(axis=0) + MARGIN
        views = (
            from_above(
                FRAME,
                f"Position error of {tracker}",
                [f"+ {path(*ROADS)}", f"+ {path(ERRORS, tracker)}"],
                ((left, right), (-high, -low)),
                {},
            )
            for tracker in self._pieces
        )
        columns = 1 if right - left > ELONGATED * (high - low) else min(3, len(self._pieces))
        return rrb.Grid(*views, grid_columns=columns, name="Map of errors")

    def __bool__(self) -> bool:
        return bool(len(self.limits))


def _pieces(truth: Columns, rows: Mapping[str, Array], hold: float) -> tuple[Array, Array]:
    """``(pieces, 2, 2)`` m from each estimate to the next, and the larger error at their ends, m."""
    time, error = rows["time_s"], rows["position_error_m"]
    step = np.searchsorted(truth["time_s"], time - 1e-9)
    at = np.stack([truth["px_m"][step], truth["py_m"][step]], axis=1)
    joined = np.isfinite(error[1:] + error[:-1]) & (np.diff(time) <= hold + 1e-9)
    return np.stack([at[:-1], at[1:]], axis=1)[joined], np.maximum(error[1:], error[:-1])[joined]
