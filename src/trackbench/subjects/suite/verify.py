"""``trackbench suite verify``: what of an entry was checked, what is wrong and where, and what is taken on trust."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.api.plan import Listener
from trackbench.api.provenance import code_of_trackers
from trackbench.base.errors import InputError, counted
from trackbench.base.execution import Executor
from trackbench.driving.isolation import Isolation
from trackbench.results import Failure, Result
from trackbench.results.checks import ROUNDING, differing, table_difference
from trackbench.results.tracker_result import BEATS_BOUND
from trackbench.runner.rounded_scans import rounded_fingerprints
from trackbench.runner.run import answers_of_scenes
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.suite.entry import ENTRY, ESTIMATES, EnteredScenario, StoredEntry
from trackbench.subjects.suite.scoring import KEPT, rows_of_estimates, scored_estimates, stated_of
from trackbench.subjects.suite.suite import SuiteScenario
from trackbench.truth import LoadedTruth
from trackbench.truth.tracks import TrackRows

#: One of so many scenes is run again.
ONE_OF = 10
#: Estimates that are made again differ by less, in m and m/s, on another kind of processor.
AGAIN = 1e-6
#: Fields of a tracker that its estimates tell.
SCORED = {"name", "metrics", "conditions", "health", "time_offset", "failed", "paired"}
#: Values of a result that the estimates determine, and those that the suite's scenario determines.
SCORES, SCENARIO = ("seed", "runs", "ranking", "fingerprints"), ("truth", "sensors", "score", "identities")
#: Number of problems of one kind that are printed.
SHOWN = 5


class Check(NamedTuple):
    """Something of an entry that was checked, or is taken on trust."""

    outcome: Literal["checked", "failed", "on trust"]
    what: str
    text: str
    """Finding, with the place where the check failed."""


@dataclass
class Verifier:
    """Checks an entry.

    Args:
        stored: the entry.
        executor: what scores and runs again.
        isolation: how the tracker is kept apart.
        listener: is told of the work.
    """

    stored: StoredEntry
    executor: Executor
    isolation: Isolation
    listener: Listener
    _truths: dict[str, list[LoadedTruth]] = field(default_factory=dict)

    def checks(self) -> Iterator[Check]:
        """Yield every check; those on scores and reruns come only where files and suite are right."""
        early = [*self._files(), *self._suite()]
        yield from early
        if all(check.outcome != "failed" for check in early):
            yield from self._scores()
            yield from self._again()
        yield from self._on_trust()

    def _files(self) -> Iterator[Check]:
        """Hold each file against its digest."""
        many = counted(len(self.stored.entry.files), "file")
        yield from _outcome("files", self.stored.file_problems(), f"{many} and {ENTRY}, by sha256")

    def _suite(self) -> Iterator[Check]:
        """Hold the suite of the entry against the one here."""
        try:
            suite = self.stored.suite
        except InputError as error:
            yield Check("failed", "suite", f"{ENTRY}: suite.id: {error.message}")
            return
        others = differing(self.stored.entry.suite.model_dump(), suite.identity)
        problems = [f"{ENTRY}: suite.{key}: {ours} in the entry, {theirs} here" for key, ours, theirs in others]
        unknown = [item.id for item in self.stored.entry.scenarios if item.id not in suite.scenarios]
        problems += [f"{ENTRY}: scenarios: {suite.stated.id} has no {name}" for name in unknown]
        files = [f"{item.id}/{ESTIMATES}" for item in self.stored.entry.scenarios]
        problems += [f"{ENTRY}: files: {name} is missing" for name in files if name not in self.stored.entry.files]
        many = f"{len(self.stored.entry.scenarios)} of {counted(len(suite.scenarios), 'scenario')}"
        yield from _outcome("suite", problems, f"{suite.stated.id}, version {suite.stated.version}: {many}")

    @cached_property
    def _pairs(self) -> list[tuple[SuiteScenario, EnteredScenario]]:
        """Each scenario of the suite that is entered, with what the entry has of it."""
        scenarios = self.stored.suite.scenarios
        return [(scenarios[item.id], item) for item in self.stored.entry.scenarios]

    def _scores(self) -> Iterator[Check]:
        """Make truth, scans and scores again."""
        problems: dict[str, list[str]] = {"truth": [], "scans": [], "scores": [], "bound": [], "noise": []}
        for scenario, item in self._pairs:
            with self.listener.progress(f"truth of {item.id}", "steps") as advance:
                truths = self._truths[item.id] = truths_of(scenario.plain, advance, self.executor)
            if (why := scenario.why_other_truth(truths)) is not None:
                problems["truth"].append(f"{item.id}: {why}")
                continue
            fingerprints = rounded_fingerprints(scenario.plain, truths)
            if (why := scenario.why_other_scans(fingerprints)) is not None:
                problems["scans"].append(f"{item.id}: {why}")
                continue
            file = self.stored.folder / item.id / ESTIMATES
            try:
                stated = Result.load(self.stored.folder / item.id)
                found = scored_estimates(scenario, self.stored.entry.tracker.name, file, truths, self.executor)
            except InputError as error:
                problems["scores"].append(str(error))
                continue
            found = stated_of(found, fingerprints, {})
            problems["scores"] += [f"{item.id}/{text}" for text in _score_problems(stated, found)]
            if found.summary.trackers[0].beats_bound(found.summary.reference):
                ratio = found.summary.trackers[0].metrics["position_over_reference"]
                problems["bound"].append(f"{item.id}: its position RMSE {BEATS_BOUND} ({ratio} of the bound)")
            problems["noise"] += [f"{item.id}/{ESTIMATES}: {text}" for text in _unmoved(rows_of_estimates(file))]
        many = counted(len(self._pairs), "scenario")
        yield from _outcome("truth", problems["truth"], f"the motion of {many} is the suite's")
        yield from _outcome("scans", problems["scans"], f"the measurements of {many} are the suite's")
        yield from _outcome("scores", problems["scores"], f"all scores of {many} come again from the estimates")
        yield from _outcome("bound", problems["bound"], "no score is below the Cramér-Rao bound, where one holds")
        yield from _outcome("noise", problems["noise"], "no two runs have the same estimates, for their noise differs")

    def _again(self) -> Iterator[Check]:
        """Run a tenth of the scenes again, drawn by the entry's own hash."""
        tracker = self.stored.entry.tracker
        if tracker.made == "tracks":
            yield Check("on trust", "rerun", "the tracks were made by a program that is not here")
            return
        if tracker.random:
            yield Check("on trust", "rerun", "the tracker says that it draws random numbers, so no run can be repeated")
            return
        loaded = {
            item.id: scenario.loaded({tracker.name: tracker.options[scenario.kind]}, self.stored.folder)
            for scenario, item in self._pairs
        }
        missing, changed = set[str](), list[str]()
        for scenario, item in self._pairs:
            code = code_of_trackers(loaded[item.id])
            here, there = code.get(tracker.name), tracker.code.get(scenario.kind)
            if tracker.name in code and here is None:
                missing.add(str(tracker.options[scenario.kind].get("use")))
            elif here != there:
                changed.append(f"{ENTRY}: tracker.code.{scenario.kind}: {there} in the entry, {here} here")
        if missing:
            yield Check("on trust", "rerun", f"{' and '.join(sorted(missing))} is not here: no run was made again")
            return
        yield from _outcome("code", list(dict.fromkeys(changed)), "the tracker's code is that of the entry")
        if not changed:
            yield from self._rerun(loaded)

    def _rerun(self, loaded: dict[str, Scenario]) -> Iterator[Check]:
        places = [(item.id, scene) for _, item in self._pairs for scene in range(len(self._truths.get(item.id, ())))]
        random = np.random.default_rng(int(self.stored.entry.sha256, 16))
        drawn = sorted(random.choice(len(places), ceil(len(places) / ONE_OF), replace=False).tolist())
        chosen: dict[str, list[int]] = {}
        for place in drawn:
            chosen.setdefault(places[place][0], []).append(places[place][1])
        problems = []
        with self.listener.progress("runs made again", "scenarios") as advance:
            for number, (name, scenes) in enumerate(chosen.items()):
                advance(number, len(chosen))
                problems += self._problems_again(name, loaded[name], scenes)
        many = f"{len(drawn)} of {counted(len(places), 'scene')}, drawn by the entry's hash"
        yield from _outcome("rerun", problems, f"{many}, give the same estimates again")

    def _problems_again(self, name: str, loaded: Scenario, scenes: list[int]) -> list[str]:
        import pyarrow.parquet as pq

        place = f"{name}/{ESTIMATES}: scene {', '.join(map(str, scenes))}"
        found = answers_of_scenes(loaded, self._truths[name], scenes, self.executor, self.isolation)
        if isinstance(found, Failure):
            return [f"{place}: the tracker could not go on: {found}"]
        table = pq.read_table(self.stored.folder / name / ESTIMATES)
        stated = table.filter(np.isin(table["scene"].to_numpy(), scenes))
        problem = table_difference(stated, found.drop_columns(["tracker", "fingerprint"]), AGAIN)
        return [] if problem is None else [f"{place}: {problem}"]

    def _on_trust(self) -> Iterator[Check]:
        tracker = self.stored.entry.tracker
        stated = [f"licence {tracker.licence or 'not stated'}", f"source {tracker.source or 'not stated'}"]
        yield Check("on trust", "identity", f"version {tracker.version or 'not stated'}, {', '.join(stated)}")
        yield Check("on trust", "machine", f"what {ENTRY} says of the machine and of the time")
        yield Check("on trust", "pages", "what reports and recordings show: their sha256 alone was checked")


def _outcome(what: str, problems: list[str], right: str) -> Iterator[Check]:
    """Yield that something is right, or each problem."""
    if not problems:
        yield Check("checked", what, right)
    for problem in problems[:SHOWN]:
        yield Check("failed", what, problem)
    if len(problems) > SHOWN:
        yield Check("failed", what, f"and {len(problems) - SHOWN} more")


def _score_problems(stated: Result, found: Result) -> Iterator[str]:
    """Yield where a result states other values than its estimates give."""
    include: Any = {"trackers": {"__all__": SCORED}, **dict.fromkeys((*SCENARIO, *SCORES), True)}
    ours, theirs = (result.summary.model_dump(mode="json", include=include) for result in (stated, found))
    for key, value, again in differing(ours, theirs, ROUNDING):
        # Another version may describe the same truth and sensors, or why a value is missing, in other words.
        is_text = isinstance(value, str) and isinstance(again, str)
        is_wording = is_text and (key.startswith(SCENARIO) or key.endswith(".reason"))
        if not is_wording and key != "truth.cached":
            yield f"result.json: {key}: the file has {value}, and the estimates give {again}"
    for name in KEPT:
        ours, theirs = (result.tables.if_there(name) for result in (stated, found))
        if (problem := table_difference(ours, theirs)) is not None:
            yield f"{name}.parquet: {problem}"


def _unmoved(rows: TrackRows) -> Iterator[str]:
    """Yield the scenes of which two runs have the same positions at all times."""
    content: dict[tuple[str, bytes], str] = {}
    scenes = np.asarray([""] * len(rows) if rows.scene is None else rows.scene)
    runs = np.asarray([""] * len(rows) if rows.run is None else rows.run)
    values = np.stack([rows.time, rows.px, rows.py])
    for scene, run in np.unique([scenes, runs], axis=1).T.tolist():
        own = values[:, (scenes == scene) & (runs == run)]
        key = scene, own[:, np.lexsort(own)].tobytes()
        if key in content:
            yield f"scene {scene}, runs {content[key]} and {run}: the same estimates, though their noise differs"
        content[key] = run
