"""Start against tuned values on scenes and noise that the search has not seen."""

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

#: Scenes of each scenario that are tuned on, and those that are tried on, unless stated.
TRAIN_SCENES, TEST_SCENES = FEWEST_SCENES, 8
#: Most runs of each scene that is tuned on, where there are several: other traffic tells more than other noise.
TRAIN_RUNS = 25
#: The seeds of traffic for tuning begin here: above those that scenarios use.
FIRST_SEED = 1001

#: What tells what is tried on from what is tuned on: noise where every run has the same truth; the time of a log; logs.
SAME_MOTION = "other noise of the same motion"
SAME_LOG = "other stretches of the same log"
OTHER_LOGS = "other logs"
OTHER_STRETCHES = "other stretches of the same logs"


@dataclass(frozen=True)
class Split:
    """Sizes of what is tuned on and tried on; None as usual."""

    train_scenes: int | None = None
    test_scenes: int | None = None
    train_runs: int | None = None
    test_runs: int | None = None


@dataclass(frozen=True)
class Halves:
    """A scenario for tuning and one for trying."""

    train: Scenario
    test: Scenario
    apart: str
    """Difference of the two in words; empty where there is none."""


def halved(loaded: Scenario, split: Split) -> Halves:
    """Return the scenario with some scenes and noise, and with others.

    The scenes tried on are the scenario's own, and those after them. The noise tried on is the scenario's, and that
    tuned on is drawn by the next seed.

    Raises:
        InputError: scenes are asked for of a source that has no others.
    """
    config = loaded.config
    several = "seeds" in type(config.truth).model_fields
    logs = same_every_run(config) and number_of_parts(config) > 1
    if not several and (split.train_scenes is not None or split.test_scenes is not None):
        problem = f"{config.name} has one scene; tuning on others is for truths with seeds"
        if logs:
            problem = f"every second log of {config.name} is held out; their number is no choice"
        raise InputError(problem, key="--train-scenes" if split.train_scenes is not None else "--test-scenes")
    test_seed = config.monte_carlo.seed
    train_seed = test_seed + 1
    if same_every_run(config):
        return _halved_logs(loaded)
    runs = config.monte_carlo.runs
    train_runs, test_runs = split.train_runs or (min(runs, TRAIN_RUNS) if several else runs), split.test_runs or runs
    if not several:
        apart = "other noise and other random motion" if config.truth.random else SAME_MOTION
        return Halves(_drawn(loaded, train_runs, train_seed), _drawn(loaded, test_runs, test_seed), apart)
    own = [scene.seed for scene in config.truth.scenes()]  # type: ignore[attr-defined]
    wanted = split.test_scenes or (len(own) if len(own) > 1 else TEST_SCENES)
    own = own[:wanted] if wanted <= len(own) else [own[0] + number for number in range(wanted)]
    free = (seed for seed in itertools.count(FIRST_SEED) if seed not in own)
    others = list(itertools.islice(free, split.train_scenes or TRAIN_SCENES))
    return Halves(
        _drawn(loaded, train_runs, train_seed, others),
        _drawn(loaded, test_runs, test_seed, own),
        "other scenes and other noise",
    )


def number_of_parts(config: ScenarioConfig) -> int:
    """Return the number of scenes, or of stretches of logs."""
    return len(config.truth.counted_stretches) or len(config.truth.scenes())


def _halved_logs(loaded: Scenario) -> Halves:
    """Hold out every second log or stretch; one log is divided by :func:`halved_in_time`."""
    truth = loaded.config.truth
    if not isinstance(truth, RecordingTruth) or number_of_parts(loaded.config) == 1:
        return Halves(loaded, loaded, "")
    train, test = (
        replace(loaded, config=loaded.config.model_copy(update={"truth": truth.every_second(first)}))
        for first in (0, 1)
    )
    return Halves(train, test, OTHER_LOGS if truth.stretches is None else OTHER_STRETCHES)


def halved_in_time(bench: Bench, objective: Objective) -> tuple[Bench, Bench, str]:
    """Return a log with stretches of time to tune on, with others to try on, and the difference in words.

    Nothing is held out, and nothing tells them apart, where the log is too short, or where the score is not a sum over
    time: with hidden identities, and of a metric that has one value in a run.
    """
    (loaded,), score = bench.truths, bench.scenario.config.score
    steps = np.concatenate([item.steps for item in (loaded.measurements or {}).values()])
    duration = float(np.ptp(loaded.truth.time[steps]))
    if bench.hidden or objective.metric is not None or duration < LogTime(max(score.settle_s, GAP)).shortest:
        return bench, bench, ""
    return replace(bench, held_out=False), replace(bench, held_out=True), SAME_LOG


def _drawn(loaded: Scenario, runs: int, seed: int, scenes: list[int] | None = None) -> Scenario:
    """Return the scenario with other runs, noise and scenes."""
    config = loaded.config
    truth = config.truth if scenes is None else config.truth.model_copy(update={"seeds": scenes})
    monte_carlo = config.monte_carlo.model_copy(update={"runs": runs, "seed": seed})
    return replace(loaded, config=config.model_copy(update={"truth": truth, "monte_carlo": monte_carlo}))


@dataclass(frozen=True)
class MeasureComparison:
    """A measure of the start and of the tuned values, and their difference on the same runs."""

    scenario: str
    measure: str
    unit: str
    start: Interval
    tuned: Interval
    difference: Contrast
    """Tuned minus start."""
    p_value: float
    """Of the hypothesis that the difference is within the margin, corrected for the number of scenarios."""
    verdict: str
    """Verdict on the tuned values: better, worse, larger, smaller, equivalent or undecided."""


@dataclass(frozen=True)
class HeldOut:
    """Comparison of start and tuned values where the search has not looked."""

    comparisons: tuple[MeasureComparison, ...]
    scenes: dict[str, int]
    """Number of scenes by scenario."""
    runs: dict[str, int]
    failed: str = ""
    """Reason why there is no comparison."""

    def of(self, measure: str) -> list[MeasureComparison]:
        """Return the comparisons by one measure."""
        return [item for item in self.comparisons if item.measure == measure]


def compare_held_out(evaluator: Evaluator, objective: Objective, tuned: Values) -> HeldOut:
    """Try the start's and the tuned values on other scenes and noise.

    Args:
        evaluator: on these.
        objective: what the values were tuned for.
        tuned: the values that were found.
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
            (number, own, other)
            for number, (own, other) in enumerate(sides)
            if other.has(measure) and own.lacking(other, measure) is None
        ]
        comparisons += _by(measure, metric, evaluator, pairs)
    return HeldOut(tuple(comparisons), scenes, runs)


def _by(
    measure: str, metric: Metric, evaluator: Evaluator, pairs: Sequence[tuple[int, Sums, Sums]]
) -> list[MeasureComparison]:
    """Compare by one measure, with p-values corrected for the number of scenarios."""
    better, unit = metric.better, "" if metric.unit == "1" else metric.unit
    rows = []
    for number, own_sums, other_sums in pairs:
        scene = evaluator.scenes(number)
        own, other = own_sums.interval(measure, scene), other_sums.interval(measure, scene)
        if own is None or other is None:
            continue
        config = evaluator.benches[number].scenario.config
        own, other = (side._replace(few_decide=config.few_scenes_decide) for side in (own, other))
        margin = MarginSummary(**config.score.margin.model_dump())
        # A likelihood has no margin that means nothing: any difference that is shown is one.
        allowed = margin_between(own, other, unit, better, margin) if measure != "log_likelihood" else 0.0
        rows.append((evaluator.benches[number].name, own, other, paired(own, other, allowed)))
    corrected = holm([row[3].p_value for row in rows]) if rows else []
    return [
        MeasureComparison(
            name,
            measure,
            unit,
            other,
            own,
            contrast,
            p,
            contrast_verdict(contrast, p, better) if contrast.ci95 else UNDECIDED,
        )
        for (name, own, other, contrast), p in zip(rows, corrected, strict=True)
    ]
