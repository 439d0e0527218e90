"""Comparison of start and tuned values on scenes and noise that the search has not seen."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackbench.base.errors import InputError
from trackbench.metrics import Metric
from trackbench.metrics.contrasts import Contrast, paired
from trackbench.metrics.differences import UNDECIDED, contrast_verdict, holm, margin_between
from trackbench.metrics.intervals import FEWEST_SCENES, Interval
from trackbench.results.scenario_summary import MarginSummary
from trackbench.scenario import Scenario
from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.validate import same_every_run
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import Bench, Evaluator
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import Objective
from trackbench.subjects.tuning.trial_sums import GAP, LogTime
from trackbench.truth.sources import RecordingTruth

#: Default numbers of scenes of each scenario for tuning and for the test.
TRAIN_SCENES, TEST_SCENES = FEWEST_SCENES, 8
#: Largest default number of runs of each tuning scene if there are several, since new traffic tells more than noise.
TRAIN_RUNS = 25
#: First seed of the scenes for tuning, above the seeds that scenarios use.
FIRST_SEED = 1001

# Difference of the test measurements from the tuning measurements, in words.
SAME_MOTION = "other noise of the same motion"
SAME_LOG = "other stretches of the same log"
OTHER_LOGS = "other logs"
OTHER_STRETCHES = "other stretches of the same logs"


@dataclass(frozen=True)
class Split:
    """Numbers of scenes and runs for tuning and for the test; None for the default."""

    train_scenes: int | None = None
    test_scenes: int | None = None
    train_runs: int | None = None
    test_runs: int | None = None


@dataclass(frozen=True)
class Halves:
    """Scenario for tuning and scenario for the test."""

    train: Scenario
    test: Scenario
    apart: str
    """Difference between test and tuning scenario in words; empty where there is none."""


def halved(loaded: Scenario, split: Split) -> Halves:
    """Return a scenario for tuning and a scenario for the test, which differ in scenes or noise.

    With seeds the test has the scenario's own scenes: the first ``test_scenes`` of them, or all and further ones.
    Tuning has other scenes, and noise from the next seed. Of a recording that is the same in every run the test has
    every second log or stretch; a single log is not divided here.

    Raises:
        InputError: a number of scenes is given for a truth source that cannot make other scenes.
    """
    config = loaded.config
    several = "seeds" in type(config.truth).model_fields
    logs = same_every_run(config) and number_of_parts(config) > 1
    if not several and (split.train_scenes is not None or split.test_scenes is not None):
        problem = f"{config.name} has one scene; other scenes need a truth with seeds"
        if logs:
            problem = f"every second log of {config.name} is held out; their number cannot be chosen"
        raise InputError(problem, key="--train-scenes" if split.train_scenes is not None else "--test-scenes")
    test_seed = config.monte_carlo.seed
    train_seed = test_seed + 1
    if same_every_run(config):
        return _halved_logs(loaded)
    runs = config.monte_carlo.runs
    train_runs, test_runs = split.train_runs or (min(runs, TRAIN_RUNS) if several else runs), split.test_runs or runs
    if not several:
        apart = "other noise and other random motion" if config.truth.random else SAME_MOTION
        return Halves(_with_draws(loaded, train_runs, train_seed), _with_draws(loaded, test_runs, test_seed), apart)
    scene_seeds = [scene.seed for scene in config.truth.scenes()]  # type: ignore[attr-defined]
    count = split.test_scenes or (len(scene_seeds) if len(scene_seeds) > 1 else TEST_SCENES)
    further = (seed for seed in itertools.count(scene_seeds[0]) if seed not in scene_seeds)
    test_seeds = list(itertools.islice(itertools.chain(scene_seeds, further), count))
    unused = (seed for seed in itertools.count(FIRST_SEED) if seed not in test_seeds)
    train_seeds = list(itertools.islice(unused, split.train_scenes or TRAIN_SCENES))
    return Halves(
        _with_draws(loaded, train_runs, train_seed, train_seeds),
        _with_draws(loaded, test_runs, test_seed, test_seeds),
        "other scenes and other noise",
    )


def number_of_parts(config: ScenarioConfig) -> int:
    """Return the number of scenes, or of a log's stretches."""
    return len(config.truth.counted_stretches) or len(config.truth.scenes())


def _halved_logs(loaded: Scenario) -> Halves:
    """Hold out every second log or stretch; a single log stays whole, since :func:`halved_in_time` divides it."""
    truth = loaded.config.truth
    if not isinstance(truth, RecordingTruth) or number_of_parts(loaded.config) == 1:
        return Halves(loaded, loaded, "")
    train, test = (
        replace(loaded, config=loaded.config.model_copy(update={"truth": truth.every_second(first)}))
        for first in (0, 1)
    )
    return Halves(train, test, OTHER_LOGS if truth.stretches is None else OTHER_STRETCHES)


def halved_in_time(bench: Bench, objective: Objective) -> tuple[Bench, Bench, str]:
    """Return a log with its stretches for tuning, with its stretches for the test, and the difference in words.

    Nothing is held out, and the words are empty, if the log is too short or the score is no sum over time: with hidden
    identities, or for a metric with one value a run.
    """
    (loaded,), score = bench.truths, bench.scenario.config.score
    steps = np.concatenate([item.steps for item in (loaded.measurements or {}).values()])
    duration = float(np.ptp(loaded.truth.time[steps]))
    if bench.hidden or objective.metric is not None or duration < LogTime(max(score.settle_s, GAP)).shortest:
        return bench, bench, ""
    return replace(bench, held_out=False), replace(bench, held_out=True), SAME_LOG


def _with_draws(loaded: Scenario, runs: int, seed: int, scenes: list[int] | None = None) -> Scenario:
    config = loaded.config
    truth = config.truth if scenes is None else config.truth.model_copy(update={"seeds": scenes})
    monte_carlo = config.monte_carlo.model_copy(update={"runs": runs, "seed": seed})
    return replace(loaded, config=config.model_copy(update={"truth": truth, "monte_carlo": monte_carlo}))


@dataclass(frozen=True)
class MeasureComparison:
    """Comparison of start and tuned values by one measure, on the same runs."""

    scenario: str
    measure: str
    unit: str
    start: Interval
    tuned: Interval
    difference: Contrast
    """Value with the tuned options minus value with the start options, with its interval."""
    p_value: float
    """p-value of the hypothesis that the difference lies within the margin, corrected for the number of scenarios."""
    verdict: str
    """Verdict on the tuned values: better, worse, larger, smaller, equivalent or undecided."""


@dataclass(frozen=True)
class HeldOut:
    """Comparison of start and tuned values on held-out measurements."""

    comparisons: tuple[MeasureComparison, ...]
    scenes: dict[str, int]
    """Number of scenes, or of a log's stretches, by scenario; ``runs`` is the number of runs of each scene."""
    runs: dict[str, int]
    failed: str = ""
    """Reason why there is no comparison; empty where there are comparisons."""

    def of(self, measure: str) -> list[MeasureComparison]:
        return [item for item in self.comparisons if item.measure == measure]


def compare_held_out(evaluator: Evaluator, objective: Objective, tuned: Values) -> HeldOut:
    """Compare start and tuned values on the test scenes and noise.

    Args:
        evaluator: evaluator on the test benches.
        objective: objective of the tuning.
        tuned: tuned values by option.
    """
    scenes = {bench.name: number_of_parts(bench.scenario.config) for bench in evaluator.benches}
    runs = {bench.name: bench.scenario.config.monte_carlo.runs for bench in evaluator.benches}
    failed = [outcome.failed for outcome in evaluator.start if outcome.sums is None]
    if failed:
        return HeldOut((), scenes, runs, f"the start values fail: {failed[0]}")
    start = [outcome.sums for outcome in evaluator.start if outcome.sums is not None]
    outcomes = evaluator([tuned])[0]
    loss = objective(outcomes, start)
    if isinstance(loss, str):
        return HeldOut((), scenes, runs, f"the tuned values fail: {loss}")
    sides = list(zip([outcome.sums for outcome in outcomes if outcome.sums is not None], start, strict=True))
    comparisons: list[MeasureComparison] = []
    for measure, metric in start[0].measures.items():
        pairs = [
            (number, sums, start_sums)
            for number, (sums, start_sums) in enumerate(sides)
            if start_sums.has(measure) and sums.lacking(start_sums, measure) is None
        ]
        comparisons += _compare_by(measure, metric, evaluator, pairs)
    return HeldOut(tuple(comparisons), scenes, runs)


def _compare_by(
    measure: str, metric: Metric, evaluator: Evaluator, pairs: Sequence[tuple[int, Sums, Sums]]
) -> list[MeasureComparison]:
    """Compare start and tuned values by one measure in each scenario, with p-values corrected for their number."""
    better, unit = metric.better, "" if metric.unit == "1" else metric.unit
    rows = []
    for number, tuned_sums, start_sums in pairs:
        scene = evaluator.scenes(number)
        tuned, start = tuned_sums.interval(measure, scene), start_sums.interval(measure, scene)
        if tuned is None or start is None:
            continue
        config = evaluator.benches[number].scenario.config
        tuned, start = (side._replace(few_decide=config.few_scenes_decide) for side in (tuned, start))
        margin = MarginSummary(**config.score.margin.model_dump())
        # A likelihood has no margin of irrelevance: any significant difference counts.
        allowed = margin_between(tuned, start, unit, better, margin) if measure != "log_likelihood" else 0.0
        rows.append((evaluator.benches[number].name, tuned, start, paired(tuned, start, allowed)))
    corrected = holm([row[3].p_value for row in rows]) if rows else []
    return [
        MeasureComparison(
            name,
            measure,
            unit,
            start,
            tuned,
            contrast,
            p,
            contrast_verdict(contrast, p, better) if contrast.ci95 else UNDECIDED,
        )
        for (name, tuned, start, contrast), p in zip(rows, corrected, strict=True)
    ]
