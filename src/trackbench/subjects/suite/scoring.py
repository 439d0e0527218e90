"""The scenarios of an entry, driven and scored: a score is always made from the stored estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.results import Result, Tables, TrackerResult
from trackbench.runner.run import run_scenario
from trackbench.subjects.suite.suite import SuiteScenario
from trackbench.truth import LoadedTruth
from trackbench.truth.config.traffic import TracksConfig, read_tracks
from trackbench.truth.tracks import TrackRows

if TYPE_CHECKING:
    import pyarrow as pa

#: Tables of a result that a comparison reads.
KEPT = ("runs", "truth", "stretches")
#: Fields of a tracker that its estimates do not tell.
TOLD = ("describe", "offline", "random", "sensors")


def scored_estimates(
    scenario: SuiteScenario, name: str, estimates: Path, truths: Sequence[LoadedTruth], executor: Executor
) -> Result:
    """Return the result of estimates in a file.

    Args:
        scenario: of the suite.
        name: of the tracker.
        estimates: the file.
        truths: those of the scenario.
        executor: what scores.

    Raises:
        InputError: they are not of this scenario.
    """
    trackers = {name: {"use": "tracks", "path": estimates.name}}
    loaded = scenario.loaded(trackers, estimates.parent)
    return run_scenario(loaded, truths, executor=executor, engine="numpy")


def rows_of_estimates(file: Path) -> TrackRows:
    """Return the rows of estimates, as they are scored."""
    (rows,) = read_tracks(TracksConfig.model_validate({"use": "tracks", "path": file.name}), "estimates", file.parent)
    return rows


def stated_of(result: Result, told: Mapping[str, Any], command: str) -> Result:
    """Return a result with what its estimates do not tell of the tracker, and the command that repeats it."""
    (tracker,) = result.summary.trackers
    stated = TrackerResult.model_validate({**tracker.model_dump(), **told})
    return result.updated(trackers=[stated], command=command)


def compared_tables(result: Result) -> Result:
    """Return a result with the tables alone that a comparison reads."""
    return replace(result, tables=Tables({name: result.tables[name] for name in KEPT if name in result.tables}))


def write_estimates(table: pa.Table, path: Path) -> None:
    """Write the table ``answers`` of a single tracker, every number to the last bit."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    own = table.drop_columns(["tracker"])
    numbers = [field.name for field in own.schema if pa.types.is_floating(field.type)]
    options = {"use_dictionary": False, "column_encoding": dict.fromkeys(numbers, "BYTE_STREAM_SPLIT")}
    pq.write_table(_plain(own), path, compression="zstd", **options)


def _plain(table: pa.Table) -> pa.Table:
    """Return a table whose words are texts, not numbers of a dictionary."""
    import pyarrow as pa

    fields = [
        pa.field(field.name, pa.string()) if pa.types.is_dictionary(field.type) else field for field in table.schema
    ]
    return table.cast(pa.schema(fields))


def failure_of(result: Result) -> str | None:
    """Return why the tracker of a result could not go on; None where it could."""
    failed = result.summary.trackers[0].failed
    return None if failed is None else str(failed)


def require_entered(scenario: SuiteScenario, problem: str | None) -> None:
    """Refuse to go on with a truth or scans that are not those of the suite.

    Raises:
        InputError: there is a problem.
    """
    if problem is not None:
        raise InputError(f"{scenario.id} {problem}", file=scenario.suite.path)
