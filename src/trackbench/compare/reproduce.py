"""The commands that make a comparison again: its runs, and then the comparison."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from trackbench.compare.entries import ResultSet
from trackbench.compare.limits import OPTION, Limit


def commands(
    sets: Sequence[ResultSet], metrics: Sequence[str], trackers: Sequence[str] | None, limits: Sequence[Limit]
) -> list[str]:
    """One for each run, and one for the comparison; none where a result does not say how it was made."""
    if not all(entry.result.summary.command for item in sets for entry in item.entries):
        return []
    places = [_places(item) for item in sets]
    runs = [
        f"{entry.result.summary.command} {shlex.join(['--out', str(out)])}"
        for item, (out, _) in zip(sets, places, strict=True)
        for entry in item.entries
    ]
    options = [word for metric in metrics for word in ("--metric", metric)]
    options += [] if trackers is None else ["--trackers", ",".join(trackers)]
    options += [word for limit in limits for word in (OPTION, f"{limit.metric}:{limit.percent:g}")]
    compared = shlex.join(["trackbench", "compare", *(str(path) for _, path in places), *options])
    return [*dict.fromkeys(runs), compared]


def _places(item: ResultSet) -> tuple[Path, Path]:
    """The folder into which the runs of a set are written, and what a comparison names then."""
    path = Path(item.label)
    path = path.parent if path.suffix == ".json" else path
    if len(item.entries) > 1 or item.entries[0].label != item.label:
        return path, path
    name = item.entries[0].result.name
    return (path.parent, path) if path.name == name else (path, path / name)
