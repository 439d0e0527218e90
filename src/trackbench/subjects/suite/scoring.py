"""Scores of an entry, which are always made from the stored estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.base.execution import Executor
from trackbench.results import Result, TrackerResult
from trackbench.runner.run import run_scenario
from trackbench.subjects.suite.suite import SuiteScenario
from trackbench.truth import LoadedTruth
from trackbench.truth.config.traffic import TracksConfig, read_tracks
from trackbench.truth.tracks import TrackRows

if TYPE_CHECKING:
    import pyarrow as pa

#: Tables of a result that a comparison reads.
COMPARED_TABLES = ("runs", "truth", "stretches")
#: Fields of a tracker's result that its estimates do not determine.
RUN_FIELDS = ("describe", "offline", "random", "sensors")


def scored_estimates(
    scenario: SuiteScenario, name: str, estimates: Path, truths: Sequence[LoadedTruth], executor: Executor
) -> Result:
    """Return the result, with scores, of a tracker's estimates, which are read from a file.

    Args:
        scenario: scenario of the estimates.
        name: name of the tracker.
        estimates: file of the estimates.
        truths: truth of each scene of the scenario.
        executor: executor that scores.

    Raises:
        InputError: the estimates are not of this scenario.
    """
    trackers = {name: {"use": "tracks", "path": estimates.name}}
    loaded = scenario.loaded(trackers, estimates.parent)
    return run_scenario(loaded, truths, executor=executor, engine="numpy")


def rows_of_estimates(file: Path) -> TrackRows:
    """Read an entry's file of estimates; return its rows, each with one object and one time."""
    (rows,) = read_tracks(TracksConfig.model_validate({"use": "tracks", "path": file.name}), "estimates", file.parent)
    return rows


def add_run_fields(result: Result, fingerprints: Sequence[str], fields: Mapping[str, Any], command: str = "") -> Result:
    """Return a result of estimates with the fields that the estimates do not determine.

    Args:
        result: result of one tracker's estimates.
        fingerprints: rounded fingerprints of the measurements of each run.
        fields: values of ``RUN_FIELDS``.
        command: command that repeats the run.
    """
    (tracker,) = result.summary.trackers
    paired = TrackerResult.model_validate({**tracker.model_dump(), **fields, "paired": True})
    return result.updated(trackers=[paired], command=command, fingerprints=list(fingerprints))


def write_estimates(table: pa.Table, path: Path) -> None:
    """Write the estimates or tracks of one tracker, every number to the last bit.

    The columns of tracker and fingerprint are left out, as fingerprints differ between kinds of processors.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = table.drop_columns([name for name in ("tracker", "fingerprint") if name in table.column_names])
    # Dictionary columns are stored as plain text.
    types = [pa.string() if pa.types.is_dictionary(kind) else kind for kind in table.schema.types]
    table = table.cast(pa.schema([*zip(table.column_names, types, strict=True)]))
    numbers = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    encodings: Any = dict.fromkeys(numbers, "BYTE_STREAM_SPLIT")
    pq.write_table(table, path, compression="zstd", use_dictionary=False, column_encoding=encodings)
