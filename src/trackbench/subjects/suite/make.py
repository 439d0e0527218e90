"""``trackbench suite run``: runs of a tracker in scenarios of a suite, and the folder of its entry."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import tempfile
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench import results
from trackbench.api.plan import Listener
from trackbench.api.provenance import provenance_of
from trackbench.api.save import with_artifacts
from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.execution import Executor
from trackbench.driving.isolation import Isolation
from trackbench.results import Result, Tables
from trackbench.results.summary import Provenance
from trackbench.runner.assemble import versions
from trackbench.runner.rounded_scans import rounded_fingerprints
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.truth import truths_of
from trackbench.subjects.suite.entry import (
    ENTRY,
    ESTIMATES,
    EnteredScenario,
    Entry,
    Machine,
    SuiteIdentity,
    TrackerIdentity,
    digests_in,
    entry_digest,
)
from trackbench.subjects.suite.scoring import (
    COMPARED_TABLES,
    RUN_FIELDS,
    add_run_fields,
    rows_of_estimates,
    scored_estimates,
    write_estimates,
)
from trackbench.subjects.suite.suite import Suite, SuiteScenario
from trackbench.subjects.suite.tracker import EnteringTracker
from trackbench.truth import LoadedTruth

if TYPE_CHECKING:
    import pyarrow as pa

Files = dict[str, Callable[[Path], object]]


class TrackerFailedError(TrackbenchError):
    """Failure of a tracker, which leaves no entry."""


@dataclass
class EntryMaker:
    """Work that runs one tracker in a suite and writes its entry: a folder of estimates and scores.

    Args:
        suite: suite that the tracker enters.
        tracker: tracker that enters.
        executor: executor of the runs and of the scoring.
        isolation: isolation of the tracker's process.
        listener: listener for the progress.
        left_out: names of artifacts that are not written.
    """

    suite: Suite
    tracker: EnteringTracker
    executor: Executor
    isolation: Isolation
    listener: Listener
    left_out: Collection[str] = ()
    results: dict[str, Result] = field(default_factory=dict)
    """Result of each finished scenario, by id."""
    _entered: list[EnteredScenario] = field(default_factory=list)
    _run_fields: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Values of the result's fields ``RUN_FIELDS``, by kind of scenario: single or traffic."""
    _origins: dict[str, Provenance] = field(default_factory=dict)
    """Provenance of the tracker's code, by kind of scenario: single or traffic."""

    def command(self, *only: str) -> str:
        """Return the command that runs the scenarios ``only`` again, or all."""
        words = ["trackbench", "suite", "run", self.suite.argument, self.tracker.argument]
        return shlex.join([*words, *(["--only", ",".join(only)] if only else [])])

    def check(self, chosen: list[SuiteScenario]) -> list[SuiteScenario]:
        """Start the tracker once for each kind of scenario (single, traffic), and return the scenarios that it enters.

        Raises:
            InputError: the tracker can enter none, does not fit them, or cannot be started.
        """
        entering = self.tracker.scenarios(chosen)
        by_kind = {item.kind: item for item in reversed(entering)}
        for kind, item in by_kind.items() if self.tracker.stated.tracks is None else ():
            loaded = self._loaded(item, started=True)
            self._origins[kind] = provenance_of(loaded)
        return entering

    def make(self, scenarios: list[SuiteScenario], folder: Path) -> None:
        """Run the scenarios, and write the folder of the entry whole or not at all.

        Raises:
            InputError: the truth or the scans are not the suite's, or the tracks were made from other scans.
            TrackerFailedError: the tracker failed.
            OutputError: the folder cannot be written.
        """
        with tempfile.TemporaryDirectory(prefix="trackbench-suite-") as temporary:
            files: Files = {}
            for item in scenarios:
                place = Path(temporary) / item.id
                place.mkdir()
                files |= {f"{item.id}/{name}": write for name, write in self._files(item, place).items()}
            results.save_files({**files, ENTRY: partial(self._write_entry, scenarios)}, folder, ENTRY)

    def _files(self, item: SuiteScenario, place: Path) -> Files:
        """Run one scenario, and return the files of its folder, each with a function that writes it."""
        with self.listener.progress(f"truth of {item.id}", "steps") as advance:
            truths = truths_of(item.plain, advance, self.executor)
        _require(item, item.why_other_truth(truths))
        fingerprints = rounded_fingerprints(item.plain, truths)
        _require(item, item.why_other_scans(fingerprints))
        estimates, tracks = place / ESTIMATES, self.tracker.tracks_of(item)
        table = self._run(item, truths) if tracks is None else self._read_tracks(item, tracks, truths)
        write_estimates(table, estimates)
        result = scored_estimates(item, self.tracker.name, estimates, truths, self.executor)
        (scored,) = result.summary.trackers
        if scored.failed is not None:
            raise TrackerFailedError(f"the estimates of {scored.name} in {item.id} cannot be scored: {scored.failed}")
        result = add_run_fields(result, fingerprints, self._run_fields.get(item.kind, {}), self.command(item.id))
        self.results[item.id] = result
        self._entered.append(EnteredScenario(id=item.id, command=self.command(item.id)))
        shown, artifacts = with_artifacts(result, self.left_out)
        tables = Tables({name: result.tables[name] for name in COMPARED_TABLES if name in result.tables})
        return {ESTIMATES: partial(shutil.copyfile, estimates), **artifacts, **replace(shown, tables=tables).files()}

    def _run(self, item: SuiteScenario, truths: Sequence[LoadedTruth]) -> pa.Table:
        """Run the tracker, and return its estimates in every run."""
        loaded = self._loaded(item)
        with self.listener.progress(item.id, "runs") as advance:
            options: Any = {"isolation": self.isolation, "keeps_answers": True, "progress": advance}
            driven = run_scenario(loaded, truths, executor=self.executor, **options)
        (tracker,) = driven.summary.trackers
        if tracker.failed is not None:
            raise TrackerFailedError(f"{tracker.name} could not go on in {item.id}: {tracker.failed}")
        self._run_fields[item.kind] = {key: getattr(tracker, key) for key in RUN_FIELDS}
        return driven.tables["answers"]

    def _read_tracks(self, item: SuiteScenario, tracks: Path, truths: Sequence[LoadedTruth]) -> pa.Table:
        """Return the tracks of a file, after a check that they are of the suite's scans."""
        from pyarrow import csv, parquet

        rows = rows_of_estimates(tracks)
        if rows.fingerprint is None or rows.run is None:
            raise InputError("the columns run and fingerprint are missing; copy them from the scans", file=tracks)
        scored_estimates(item, self.tracker.name, tracks, truths, self.executor)
        return parquet.read_table(tracks) if tracks.suffix == ".parquet" else csv.read_csv(tracks)

    def _write_entry(self, scenarios: list[SuiteScenario], path: Path) -> None:
        kinds = list(dict.fromkeys(item.kind for item in scenarios))
        stated, origins = self.tracker.stated, [*self._origins.values()]
        all_of_its_kind = self.tracker.scenarios([*self.suite.scenarios.values()])
        tracker = TrackerIdentity(
            **stated.model_dump(include={"name", "version", "licence", "source"}),
            made="run here" if stated.tracks is None else "tracks",
            options={kind: self.tracker.entry(kind) or {} for kind in kinds},
            sensors={kind: self._run_fields.get(kind, {}).get("sensors") for kind in kinds},
            code={kind: code for kind in kinds if kind in self._origins for code in self._origins[kind].code.values()},
            random=any(fields["random"] for fields in self._run_fields.values()),
        )
        entry = Entry(
            suite=SuiteIdentity.model_validate(self.suite.identity),
            tracker=tracker,
            scenarios=self._entered,
            machine=Machine(system=platform.platform(), cores=os.cpu_count() or 1, versions=versions()),
            made_at=origins[0].made_at if origins else provenance_of(scenarios[0].plain).made_at,
            commit=origins[0].commit if origins else None,
            command=self.command(*([] if scenarios == all_of_its_kind else [item.id for item in scenarios])),
            files=digests_in(path.parent),
            sha256="",
        )
        values = entry.model_dump(mode="json")
        results.write_file(results.json_text({**values, "sha256": entry_digest(values)}), path)

    def _loaded(self, item: SuiteScenario, started: bool = False) -> Scenario:
        """Return a scenario with the tracker, after starting it if ``started``; an error names the tracker's file."""
        try:
            loaded = item.loaded({self.tracker.name: self.tracker.entry(item.kind)}, self.tracker.folder)
            if started:
                check_plugins(loaded, self.isolation)
        except InputError as error:
            raise self.tracker.located(error, item.kind) from None
        return loaded


def _require(scenario: SuiteScenario, problem: str | None) -> None:
    if problem is not None:
        raise InputError(f"{scenario.id} {problem}", file=scenario.suite.path)
