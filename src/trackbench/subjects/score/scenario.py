"""The scenario that scores files of tracks against a file of boxes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydantic_core import PydanticCustomError

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.subjects.score.sequences import pair_sequences
from trackbench.truth.config.traffic import AUTO, format_of
from trackbench.truth.formats.tables import QUANTITIES, column_layout
from trackbench.truth.recorded.cycles import SHORTEST, stretch_of
from trackbench.truth.recorded.table_files import read_header
from trackbench.truth.tracks import TRAFFIC_FORMATS, read_rows

#: Largest number of stretches of time into which a sequence is divided, for intervals.
MOST_STRETCHES = 10
#: Formats whose files have named columns.
TABLES = ("csv", "parquet")


class FileOptions(NamedTuple):
    """Options for reading the files of tracks and boxes, such as columns and formats, common to all files."""

    columns: Sequence[tuple[str, str]]
    """Pairs of a key and a column of the files. A unit may end the column's name: ``timestamp:ns``. A key comes again
    where its column differs between the files."""
    format: str | None = None
    """Format of the files; None or auto for a format by each file's ending."""
    rate_hz: float | None = None
    truth_format: str | None = None
    """Format of the files with the true boxes; None for the format of the tracks."""


def scoring_scenario(
    tracks: Sequence[Path],
    truth: Sequence[Path],
    options: FileOptions,
    folder: Path,
    *,
    time_offset_s: float = 0.0,
    overrides: Sequence[str] = (),
) -> Scenario:
    """Return the scenario that scores tracks against boxes, in one sequence or in several.

    Args:
        tracks: files or folders, see :func:`pair_sequences`.
        truth: files of boxes, or folders of them.
        options: options of all files.
        folder: folder of the scenario's file, from which its paths start.
        time_offset_s: time that is added to the time stamps of all tracks, s.
        overrides: changes of the scenario, as ``key.path=value``.

    Raises:
        InputError: a file cannot be read or has no partner, or its columns are unknown.
    """
    truth_options = options._replace(format=options.truth_format or options.format)
    sequences = pair_sequences(tracks, truth, options.format, truth_options.format)
    number = len(sequences.truth)
    forms = [(file, _format(file, options)) for file in chain(*sequences.tracks)]
    _require_known([*forms, *((file, _format(file, truth_options)) for file in sequences.truth)], options.columns)
    boxes = _entry_of_sequences(sequences.truth, truth_options, folder)
    form = TRAFFIC_FORMATS[boxes["format"]]
    options_of_form = form.model_validate({k: v for k, v in boxes.items() if k in form.model_fields})
    tables_of_boxes = [read_rows(options_of_form, file) for file in sequences.truth]
    name = re.sub("[^a-z0-9_-]+", "_", sequences.name.lower())[:64].strip("_") or "boxes"
    stretches = _stretches([rows.time for rows in tables_of_boxes])
    cut = {"stretches": stretches} if stretches else {}
    offset = {"time_offset_s": time_offset_s} if time_offset_s else {}
    against = sequences.truth[0].name if number == 1 else f"{number} sequences of {sequences.name}"
    content = {
        "name": name,
        "description": f"Tracks made elsewhere against {against}.",
        "truth": {
            "source": "recorded-boxes",
            **boxes,
            **cut,
        },
        "sensing": {"identities": "hidden"},
        "trackers": {
            tracker: {"use": "tracks", **_entry_of_sequences(files, options, folder), **offset}
            for tracker, files in zip(tracker_names(sequences.trackers), sequences.tracks, strict=True)
        },
        "monte_carlo": {"runs": 1},
    }
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)
    return scenario_of(text, folder / f"{name}.yaml", overrides)


def _stretches(times: Sequence[Array]) -> int:
    """Return the number of stretches into which each sequence is divided for intervals; 0 to leave sequences whole."""
    shortest = min(float(np.ptp(time)) for time in times)
    count = min(MOST_STRETCHES, int(shortest / SHORTEST))
    if len(times) >= FEWEST_SCENES or count < 2 or count * len(times) < FEWEST_SCENES:
        return 0
    return count if all(len(np.unique(stretch_of(time, count))) == count for time in times) else 0


def tracker_names(paths: Iterable[Path]) -> list[str]:
    """Return a tracker name for each file or folder; equal names get the parent folder's name or a number."""
    names: list[str] = []
    for file in paths:
        stem = file.name if file.is_dir() else file.stem
        name = _as_name(stem)
        if name in names:
            name = _as_name(f"{file.absolute().parent.name}_{stem}")
        number, begin = 2, name
        while name in names:
            name, number = f"{begin}_{number}", number + 1
        names.append(name)
    return names


def _as_name(text: str) -> str:
    word = re.sub("[^A-Za-z0-9_-]+", "_", text)[:56]
    return word if word[:1].isalpha() else f"t{word}"


def _format(file: Path, options: FileOptions) -> str:
    if options.format in (None, AUTO):
        try:
            return format_of(file.name)
        except PydanticCustomError as error:
            raise InputError(error.message().replace("name it in format", "give --format"), file=file) from None
    if options.format not in TRAFFIC_FORMATS.names():
        message = f"no format {options.format!r}; {nearest_choices(options.format, TRAFFIC_FORMATS.names())}"
        raise InputError(message, key="--truth-format" if options.format == options.truth_format else "--format")
    return options.format


def _entry_of_sequences(files: Sequence[Path], options: FileOptions, folder: Path) -> dict[str, Any]:
    """Return the scenario's entry for the files of several sequences, which must have the same options."""
    first, *others = (_entry(file, options, folder) for file in files)
    for file, entry in zip(files[1:], others, strict=True):
        if {**entry, "path": ""} != {**first, "path": ""}:
            raise InputError(f"its format or its columns are not those of {files[0]}: make them alike", file=file)
    return first if not others else {**first, "path": [entry["path"] for entry in (first, *others)]}


def _entry(file: Path, options: FileOptions, folder: Path) -> dict[str, Any]:
    """Return the scenario's values for a file of tracks or boxes: path, format and options."""
    form = _format(file, options)
    entry = {"path": os.path.relpath(file.absolute(), folder.absolute()), "format": form}
    if form not in TABLES:
        rate = TRAFFIC_FORMATS[form].model_fields.get("rate_hz")
        if rate is not None and rate.is_required() and options.rate_hz is None:
            raise InputError(f"{form} counts frames: give their number per second, --rate", file=file)
        return {**entry, **({"rate_hz": options.rate_hz} if rate and options.rate_hz else {})}
    names = read_header(file, form)
    stated: dict[str, str] = {}
    for key, text in options.columns:
        if _column_name(text, names) in names and stated.setdefault(key, text) != text:
            raise InputError(
                f"{key} is mapped to {stated[key]!r} and {text!r}, and this file has both", file=file, key="--map"
            )
    try:
        known = column_layout(names, stated)
    except InputError as error:
        raise InputError(f"{error.message} (--map KEY=COLUMN)", file=file) from None
    columns = {key: f"{item.name}:{item.unit}" if item.factor != 1.0 else item.name for key, item in known.items()}
    return {**entry, "columns": columns}


def _column_name(text: str, names: Sequence[str]) -> str:
    return text if text in names else text.rpartition(":")[0] or text


def _require_known(forms: Iterable[tuple[Path, str]], columns: Iterable[tuple[str, str]]) -> None:
    """Refuse a named column that no file has; ``forms`` are the files with their formats."""
    tables = [(file, form) for file, form in forms if form in TABLES]
    names = list(dict.fromkeys(name for file, form in tables for name in read_header(file, form)))
    for key, text in columns:
        if key not in QUANTITIES:
            raise InputError(f"no column is called {key!r}; {nearest_choices(key, QUANTITIES)}", key="--map")
        if _column_name(text, names) not in names:
            raise InputError(f"no file has a column {text!r}; {nearest_choices(text, names)}", key="--map")
