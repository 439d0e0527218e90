"""``trackbench suite verify``: checks of an entry, with the place of each fault, and what is taken on trust."""

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
from trackbench.subjects.suite.scoring import COMPARED_TABLES, add_run_fields, rows_of_estimates, scored_estimates
from trackbench.subjects.suite.suite import SuiteScenario
from trackbench.truth import LoadedTruth
from trackbench.truth.tracks import TrackRows

#: One scene in this many is run again.
SCENES_PER_RERUN = 10
#: Tolerance of estimates from a second run on another kind of processor, m and m/s.
RERUN_TOLERANCE = 1e-6
#: Fields of a tracker's result that its estimates determine.
SCORED_FIELDS = {"name", "metrics", "conditions", "health", "time_offset", "failed", "paired"}
#: Keys of a result that the estimates determine, and keys that the suite's scenario determines.
SCORE_KEYS, SCENARIO_KEYS = ("seed", "runs", "ranking", "fingerprints"), ("truth", "sensors", "score", "identities")
#: Number of problems of one kind that are printed.
PRINTED = 5


class Check(NamedTuple):
    """Outcome of a check of an entry, or something taken on trust."""

    outcome: Literal["checked", "failed", "on trust"]
    what: str
    text: str
    """Finding, with the place where the check failed."""


@dataclass
class Verifier:
    """Checks of an entry: its files, its suite, its scores, and a second run of its tracker.

    Args:
        stored: entry to be checked.
        executor: executor of second runs and of the scoring.
        isolation: isolation of the tracker's process.
        listener: listener for the progress.
    """

    stored: StoredEntry
    executor: Executor
    isolation: Isolation
    listener: Listener
    _truths: dict[str, list[LoadedTruth]] = field(default_factory=dict)

    def checks(self) -> Iterator[Check]:
        """Yield every check; scores and second runs are checked only if files and suite are right."""
        first = [*self._check_files(), *self._check_suite()]
        yield from first
        if all(check.outcome != "failed" for check in first):
            yield from self._check_scores()
            yield from self._check_rerun()
        yield from self._on_trust()

    def _check_files(self) -> Iterator[Check]:
        files = counted(len(self.stored.entry.files), "file")
        yield from _outcome("files", self.stored.file_problems(), f"{files} and {ENTRY}, by sha256")

    def _check_suite(self) -> Iterator[Check]:
        try:
            suite = self.stored.suite
        except InputError as error:
            yield Check("failed", "suite", f"{ENTRY}: suite.id: {error.message}")
            return
        differences = differing(self.stored.entry.suite.model_dump(), suite.identity)
        problems = [f"{ENTRY}: suite.{key}: {ours} in the entry, {theirs} here" for key, ours, theirs in differences]
        unknown = [item.id for item in self.stored.entry.scenarios if item.id not in suite.scenarios]
        problems += [f"{ENTRY}: scenarios: {suite.stated.id} has no {name}" for name in unknown]
        files = [f"{item.id}/{ESTIMATES}" for item in self.stored.entry.scenarios]
        problems += [f"{ENTRY}: files: {name} is missing" for name in files if name not in self.stored.entry.files]
        number = f"{len(self.stored.entry.scenarios)} of {counted(len(suite.scenarios), 'scenario')}"
        yield from _outcome("suite", problems, f"{suite.stated.id}, version {suite.stated.version}: {number}")

    @cached_property
    def _pairs(self) -> list[tuple[SuiteScenario, EnteredScenario]]:
        """Entered scenarios, each from the suite and from the entry."""
        scenarios = self.stored.suite.scenarios
        return [(scenarios[item.id], item) for item in self.stored.entry.scenarios]

    def _check_scores(self) -> Iterator[Check]:
        """Compare truth, scans and scores with those made on this machine."""
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
                scored = scored_estimates(scenario, self.stored.entry.tracker.name, file, truths, self.executor)
            except InputError as error:
                problems["scores"].append(str(error))
                continue
            scored = add_run_fields(scored, fingerprints, {})
            problems["scores"] += [f"{item.id}/{text}" for text in _score_problems(stated, scored)]
            if scored.summary.trackers[0].beats_bound(scored.summary.reference):
                ratio = scored.summary.trackers[0].metrics["position_over_reference"]
                problems["bound"].append(f"{item.id}: its position RMSE {BEATS_BOUND} ({ratio} of the bound)")
            problems["noise"] += [f"{item.id}/{ESTIMATES}: {text}" for text in _equal_runs(rows_of_estimates(file))]
        number = counted(len(self._pairs), "scenario")
        yield from _outcome("truth", problems["truth"], f"the motion of {number} is the suite's")
        yield from _outcome("scans", problems["scans"], f"the measurements of {number} are the suite's")
        yield from _outcome("scores", problems["scores"], f"all scores of {number} come again from the estimates")
        yield from _outcome("bound", problems["bound"], "no score is below the Cramér-Rao bound, where one holds")
        yield from _outcome("noise", problems["noise"], "no two runs have the same estimates, for their noise differs")

    def _check_rerun(self) -> Iterator[Check]:
        """Compare the tracker's code, and the estimates of a second run of some scenes, if the tracker is available."""
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
            ours, stated = code.get(tracker.name), tracker.code.get(scenario.kind)
            if tracker.name in code and ours is None:
                missing.add(str(tracker.options[scenario.kind].get("use")))
            elif ours != stated:
                changed.append(f"{ENTRY}: tracker.code.{scenario.kind}: {stated} in the entry, {ours} here")
        if missing:
            yield Check("on trust", "rerun", f"{' and '.join(sorted(missing))} is not here: no run was made again")
            return
        yield from _outcome("code", list(dict.fromkeys(changed)), "the tracker's code is that of the entry")
        if not changed:
            yield from self._rerun(loaded)

    def _rerun(self, loaded: dict[str, Scenario]) -> Iterator[Check]:
        places = [(item.id, scene) for _, item in self._pairs for scene in range(len(self._truths.get(item.id, ())))]
        random = np.random.default_rng(int(self.stored.entry.sha256, 16))
        drawn = sorted(random.choice(len(places), ceil(len(places) / SCENES_PER_RERUN), replace=False).tolist())
        chosen: dict[str, list[int]] = {}
        for place in drawn:
            chosen.setdefault(places[place][0], []).append(places[place][1])
        problems = []
        with self.listener.progress("runs made again", "scenarios") as advance:
            for number, (name, scenes) in enumerate(chosen.items()):
                advance(number, len(chosen))
                problems += self._rerun_problems(name, loaded[name], scenes)
        rerun = f"{len(drawn)} of {counted(len(places), 'scene')}, drawn by the entry's hash"
        yield from _outcome("rerun", problems, f"{rerun}, give the same estimates again")

    def _rerun_problems(self, name: str, loaded: Scenario, scenes: list[int]) -> list[str]:
        import pyarrow.parquet as pq

        place = f"{name}/{ESTIMATES}: scene {', '.join(map(str, scenes))}"
        answers = answers_of_scenes(loaded, self._truths[name], scenes, self.executor, self.isolation)
        if isinstance(answers, Failure):
            return [f"{place}: the tracker could not go on: {answers}"]
        table = pq.read_table(self.stored.folder / name / ESTIMATES)
        stated = table.filter(np.isin(table["scene"].to_numpy(), scenes))
        problem = table_difference(stated, answers.drop_columns(["tracker", "fingerprint"]), RERUN_TOLERANCE)
        return [] if problem is None else [f"{place}: {problem}"]

    def _on_trust(self) -> Iterator[Check]:
        tracker = self.stored.entry.tracker
        stated = [f"licence {tracker.licence or 'not stated'}", f"source {tracker.source or 'not stated'}"]
        yield Check("on trust", "identity", f"version {tracker.version or 'not stated'}, {', '.join(stated)}")
        yield Check("on trust", "machine", f"what {ENTRY} says of the machine and of the time")
        yield Check("on trust", "pages", "what reports and recordings show: their sha256 alone was checked")


def _outcome(what: str, problems: list[str], right: str) -> Iterator[Check]:
    """Yield a passed check, or failed checks: the first ``PRINTED`` problems, and one that counts further problems."""
    if not problems:
        yield Check("checked", what, right)
    for problem in problems[:PRINTED]:
        yield Check("failed", what, problem)
    if len(problems) > PRINTED:
        yield Check("failed", what, f"and {len(problems) - PRINTED} more")


def _score_problems(stated: Result, scored: Result) -> Iterator[str]:
    """Yield the values of the stated result that differ from the result of its estimates."""
    include: Any = {"trackers": {"__all__": SCORED_FIELDS}, **dict.fromkeys((*SCENARIO_KEYS, *SCORE_KEYS), True)}
    values, scores = (result.summary.model_dump(mode="json", include=include) for result in (stated, scored))
    for key, value, score in differing(values, scores, ROUNDING):
        # Another version may describe the same truth and sensors, or why a value is missing, in other words.
        is_text = isinstance(value, str) and isinstance(score, str)
        is_wording = (is_text and key.startswith(SCENARIO_KEYS)) or key.endswith((".reason", ".words"))
        if not is_wording and key != "truth.cached":
            yield f"result.json: {key}: the file has {value}, and the estimates give {score}"
    for name in COMPARED_TABLES:
        if (problem := table_difference(stated.tables.if_there(name), scored.tables.if_there(name))) is not None:
            yield f"{name}.parquet: {problem}"


def _equal_runs(rows: TrackRows) -> Iterator[str]:
    """Yield a message for each two runs of a scene with equal positions at all times."""
    content: dict[tuple[str, bytes], str] = {}
    scenes = np.asarray([""] * len(rows) if rows.scene is None else rows.scene)
    runs = np.asarray([""] * len(rows) if rows.run is None else rows.run)
    values = np.stack([rows.time, rows.px, rows.py])
    for scene, run in np.unique([scenes, runs], axis=1).T.tolist():
        estimates = values[:, (scenes == scene) & (runs == run)]
        key = scene, estimates[:, np.lexsort(estimates)].tobytes()
        if key in content:
            yield f"scene {scene}, runs {content[key]} and {run}: the same estimates, though their noise differs"
        content[key] = run
