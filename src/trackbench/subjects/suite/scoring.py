"""The scenarios of an entry, driven and scored: a score is always made from the stored estimates."""

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


def stated_of(result: Result, fingerprints: Sequence[str], told: Mapping[str, Any], command: str = "") -> Result:
    """Return a result with what its estimates do not tell.

    Args:
        result: of estimates.
        fingerprints: rounded, of the measurements of each run.
        told: fields of the tracker.
        command: that repeats it.
    """
    (tracker,) = result.summary.trackers
    stated = TrackerResult.model_validate({**tracker.model_dump(), **told, "paired": True})
    return result.updated(trackers=[stated], command=command, fingerprints=list(fingerprints))


def write_estimates(table: pa.Table, path: Path) -> None:
    """Write the estimates or tracks of a single tracker, every number to the last bit.

    Their scene and run say of which measurements they are: fingerprints are others on another kind of processor.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    own = table.drop_columns([name for name in ("tracker", "fingerprint") if name in table.column_names])
    # Words are texts, not numbers of a dictionary.
    plain = [pa.string() if pa.types.is_dictionary(kind) else kind for kind in own.schema.types]
    own = own.cast(pa.schema([*zip(own.column_names, plain, strict=True)]))
    numbers = [field.name for field in own.schema if pa.types.is_floating(field.type)]
    encoded: Any = dict.fromkeys(numbers, "BYTE_STREAM_SPLIT")
    pq.write_table(own, path, compression="zstd", use_dictionary=False, column_encoding=encoded)
