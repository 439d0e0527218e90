"""What a tuning amounts to, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

from trackbench.metrics.verdicts import TOLERANCE, verdict
from trackbench.tuning.held_out import MeasureComparison, direction
from trackbench.tuning.measures import NEES_DOF
from trackbench.tuning.objectives import NEES
from trackbench.tuning.parameters import shown
from trackbench.tuning.split import SAME_MOTION
from trackbench.tuning.tune import Tuning
from trackbench.words import counted

Tone = Literal["good", "warn", "bad"]

#: Each measure as a sentence names it.
WORDS = {
    "position_rmse": "position RMSE",
    "velocity_rmse": "velocity RMSE",
    "nees": "mean NEES",
    "log_likelihood": "log-likelihood of a measurement",
    "gospa": "GOSPA",
    "gospa_localisation": "GOSPA, localisation",
    "gospa_missed": "GOSPA, missed",
    "gospa_false": "GOSPA, false",
}
#: Of the logarithm of a mean NEES over its degrees of freedom, what the verdict tolerates.
OFF = math.log(1.0 + TOLERANCE)
_TONES: dict[str, Tone] = {"better": "good", "equivalent": "good", "worse": "bad"}
_VERDICTS = ("better", "worse", "equivalent", "undecided")


def headline(tuning: Tuning) -> tuple[str, Tone]:
    """The verdict on the tuned values, in a line, and how good it is."""
    compared = tuning.held_out.of(tuning.objective.measure)
    if tuning.held_out.failed:
        return tuning.held_out.failed, "bad"
    without = [one.why for one in tuning.held_out.not_compared if one.measure == tuning.objective.measure]
    if not compared and without:
        return f"not compared with the start: with the tuned values {without[0]}", "bad"
    if not compared:
        return "nothing to compare", "bad"
    if tuning.best.values == tuning.start:
        return f"{_values(compared)}: the start's values are the best that were found", "good"
    if not any(tuning.apart):
        return f"{_values(compared)} on the measurements that it was tuned on: nothing could be held out", "warn"
    same = [name for name, apart in zip(tuning.scenarios, tuning.apart, strict=True) if apart == SAME_MOTION]
    if len(tuning.scenarios) == 1:
        (one,) = compared
        return f"{_values(compared)}: {_verdict(one, same)}", _TONES.get(one.verdict, "warn")
    verdicts = [item.verdict for item in compared]
    counts = [f"{word} in {verdicts.count(word)}" for word in _VERDICTS if word in verdicts]
    if without:
        counts.append(f"not compared in {len(without)}")
    tone: Tone = "bad" if "worse" in verdicts else "warn" if without or "better" not in verdicts else "good"
    said = f"of {len(tuning.scenarios)} scenarios {', '.join(counts)}"
    if same:
        which = "" if len(same) == len(tuning.scenarios) else f" in {' and '.join(same)}"
        said += f";{which} on {SAME_MOTION}"
    return f"{_values(compared)}: {said}", tone


def _verdict(one: MeasureComparison, same: Sequence[str]) -> str:
    """The verdict on the tuned values in the only scenario."""
    where = f" on {SAME_MOTION}" if same else ""
    if one.verdict == "better":
        return f"better than the start{where}"
    if one.verdict == "worse":
        return f"worse than the start{where}: the values fit what they were tuned on, and not other measurements"
    if one.verdict == "equivalent":
        return f"no better than the start{where}: the difference is within the margin"
    none = f"no difference from the start is shown{where}"
    gain = one.difference.value * (1.0 if direction(one.measure) == "larger" else -1.0)
    return f"the gain may be noise: {none}" if gain > 0.0 else none


def _values(compared: list[MeasureComparison]) -> str:
    """Start and tuned of the main measure; over several scenarios by how much it changes in the mean."""
    start, tuned = ([getattr(one, which).value for one in compared] for which in ("start", "tuned"))
    word = WORDS[compared[0].measure]
    if compared[0].measure == "log_likelihood":
        return f"{word} {sum(tuned) / len(tuned):.4g}, start {sum(start) / len(start):.4g}"
    change = math.exp(sum(math.log(a / b) for a, b in zip(tuned, start, strict=True)) / len(compared)) - 1
    if len(compared) > 1:
        return f"{word} {_percent(change)} against the start's, the geometric mean"
    unit = f" {compared[0].unit}" if compared[0].unit else ""
    return f"{word} {tuned[0]:.4g}{unit}, start {start[0]:.4g}{unit} ({_percent(change)})"


def _percent(change: float) -> str:
    return f"{100 * change:+.1f} %".replace("-", "\N{MINUS SIGN}")


def remarks(tuning: Tuning) -> Iterator[str]:
    """What else should be known of the values."""
    for item, edge in tuning.edges:
        side = "smallest" if edge == item.low else "largest"
        yield (
            f"{item.key}: the optimum is at the edge of the range, {shown(edge)} is the {side} that was tried; "
            "widen the range"
        )
    if tuning.start is None:
        yield "The values that the tracker had are in no range, so the search did not begin with them."
    failed = [trial for trial in tuning.trials if not trial.losses]
    if failed:
        causes = dict.fromkeys(trial.failed for trial in failed)
        yield f"{counted(len(failed), 'trial')} of {len(tuning.trials)} failed: {next(iter(causes))}"
    off = [name for i, name in enumerate(tuning.scenarios) if abs(tuning.best.parts.get(f"{NEES}{i}", 0.0)) > OFF]
    if off:
        yield (
            f"No values that were tried give a consistent mean NEES in {' and '.join(off)}; these are the nearest, at "
            "the least error"
        )
    if tuning.objective.name in ("consistent_rmse", "pareto"):
        for nees in tuning.held_out.of("nees"):
            word = verdict(nees.tuned.ci95, NEES_DOF)
            yield f"{nees.scenario}: mean NEES {nees.tuned.value:.2f} where {NEES_DOF} is right, {word}"
    lacking: dict[tuple[str, str], list[str]] = {}
    for one in tuning.held_out.not_compared:
        lacking.setdefault((one.scenario, one.why), []).append(WORDS[one.measure])
    for (scenario, why), measures in lacking.items():
        yield f"{scenario}: not compared by {', '.join(measures)}: with the tuned values {why}"
    for scenario, apart in zip(tuning.scenarios, tuning.apart, strict=True):
        if not apart:
            yield (
                f"{scenario}: all of its measurements are recorded, so that start and tuned are compared on those that "
                "the values were tuned on; a second recording would tell whether they hold"
            )
