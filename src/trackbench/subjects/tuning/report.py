"""The report of a tuning: its verdict, tables and figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Literal

from trackbench.base.errors import counted
from trackbench.document import Block, Code, Document, Item, Items, Paragraph, Row, Section, Status
from trackbench.report.numbers import joined_names, rounded
from trackbench.report.pairs import difference_word
from trackbench.subjects.tuning import tables
from trackbench.subjects.tuning.figures import trials_figure
from trackbench.subjects.tuning.held_out import MeasureComparison
from trackbench.subjects.tuning.measures import WORDS
from trackbench.subjects.tuning.parameters import option_text
from trackbench.subjects.tuning.tune import Tuning

Tone = Literal["good", "warn", "bad"]

#: Sentence and tone of each verdict on the tuned values.
_VERDICTS: dict[str, tuple[str, Tone]] = {
    "better": ("better than the start", "good"),
    "worse": ("worse than the start", "bad"),
    "equivalent": ("the same as the start, within the margin", "good"),
    "undecided": ("not shown to be better or worse than the start: a gain may be noise", "warn"),
}


def tuning_headline(tuning: Tuning) -> tuple[str, Tone]:
    """Return the verdict on the tuned values in one line, and its tone."""
    compared = tuning.held_out.of(tuning.objective.measure)
    if not compared:
        return tuning.held_out.failed or "nothing to compare", "bad"
    values, verdicts = _main_values(compared), [item.verdict for item in compared]
    errors = tuning.held_out.of("position_rmse")
    if errors and tuning.objective.measure == "log_likelihood":
        values = f"{_main_values(errors)}; {values}"
    if tuning.best.values == tuning.start:
        return f"{values}: the start's values are the best of all that were tried", "good"
    if not any(tuning.apart):
        why = "nothing could be held out; a second log in truth.path would tell whether the values hold"
        return f"{values} on the measurements that it was tuned on: {why}", "warn"
    if len(verdicts) == 1:
        text, tone = _VERDICTS[verdicts[0]]
        return f"{values}: {text}", tone
    counts = ", ".join(f"{difference_word(word)} in {verdicts.count(word)}" for word in _VERDICTS if word in verdicts)
    tone = "bad" if "worse" in verdicts else "good" if "better" in verdicts else "warn"
    return f"{values}: of {len(verdicts)} scenarios {counts}", tone


def _main_values(compared: list[MeasureComparison]) -> str:
    """Return start and tuned value of a measure as text; its mean change over several scenarios."""
    start, tuned = ([getattr(item, which).value for item in compared] for which in ("start", "tuned"))
    word = WORDS[compared[0].measure]
    if compared[0].measure == "log_likelihood":
        return f"{word} {_pair(sum(tuned) / len(tuned), sum(start) / len(start))}"
    change = math.exp(sum(math.log(a / b) for a, b in zip(tuned, start, strict=True)) / len(compared)) - 1
    if len(compared) > 1:
        return f"{word} {_percent(change)} against the start's, the geometric mean"
    unit = f" {compared[0].unit}" if compared[0].unit else ""
    return f"{word} {_pair(tuned[0], start[0], unit)} ({_percent(change)})"


def _pair(tuned: float, start: float, unit: str = "") -> str:
    """Return "start -> tuned", both with the decimals, at most four, that show four digits of the smaller value."""
    least = min((abs(value) for value in (tuned, start) if value), default=1.0)
    places = min(4, max(0, 3 - math.floor(math.log10(least))))
    return f"{rounded(start, places)} -> {rounded(tuned, places)}{unit}"


def _percent(change: float) -> str:
    return f"{100 * change:+.1f} %".replace("-", "\N{MINUS SIGN}")


def remarks(tuning: Tuning) -> Iterator[str]:
    """Yield sentences on values at the edge of their range, and on failed trials."""
    for parameter, edge in tuning.edges:
        side = "smallest" if edge == parameter.low else "largest"
        yield (
            f"{parameter.key}: the optimum is at the edge of the range, {option_text(edge)} is the {side} that was "
            "tried; widen the range"
        )
    failed = [trial for trial in tuning.trials if trial.failed]
    if failed:
        causes = dict.fromkeys(trial.failed for trial in failed)
        yield f"{counted(len(failed), 'trial')} of {len(tuning.trials)} failed: {next(iter(causes))}"


_METHOD = (
    "All trials took the same measurements. The search begins with evenly spread values and goes on where good ones "
    "are frequent (the tree-structured Parzen estimator of Optuna). Start and tuned values are then compared on other "
    "scenes or noise, run by run."
)


def tuning_document(tunings: Sequence[Tuning], command: str) -> Document:
    """Return the report of the tunings, one for each tracker; ``command`` repeats them."""
    method = Section("How it was done", (Paragraph(_METHOD), _split(tunings[0]), Code(command, "sh")))
    return _document(tunings, [*_answer(tunings, _page), method])


def tuning_summary(tunings: Sequence[Tuning]) -> Document:
    """Return the summary for the terminal: the values, and whether they are better."""
    return _document(tunings, _answer(tunings, _tables))


def _answer(tunings: Sequence[Tuning], page: Callable[[Tuning, str], Iterator[Block]]) -> list[Block]:
    """Return the verdict on each tracker, followed by the page of each."""
    heads = [tuning_headline(item) for item in tunings]
    if len(tunings) == 1:
        return [Status(*heads[0]), *page(tunings[0], "")]
    answers = [Item(text, item.tracker, tone=tone) for item, (text, tone) in zip(tunings, heads, strict=True)]
    return [Items(tuple(answers)), *(Section(item.tracker, tuple(page(item, f"{item.tracker}-"))) for item in tunings)]


def _document(tunings: Sequence[Tuning], blocks: Sequence[Block]) -> Document:
    objective = tunings[0].objective
    return Document(
        "tuning",
        f"Tuning of {joined_names([item.tracker for item in tunings])}",
        tuple(blocks),
        f"For the {objective.meaning}, in {joined_names(tunings[0].scenarios)}.",
        (counted(sum(len(item.trials) for item in tunings), "trial"), f"objective {objective.name}"),
    )


def _tables(item: Tuning, name: str) -> Iterator[Block]:
    yield tables.values_table(item, name)
    yield tables.held_out_table(item, name)
    if items := tuple(Item(text) for text in remarks(item)):
        yield Items(items)


def _page(item: Tuning, name: str) -> Iterator[Block]:
    yield from _tables(item, name)
    figures = tuple(trials_figure(item, parameter, name) for parameter in item.parameters if parameter.is_number)
    if figures:
        yield Section("Trials", (Row(figures),))


def _split(item: Tuning) -> Block:
    """Return a list of the scenes and runs for tuning and for the test, by scenario."""
    rows = []
    for number, scenario in enumerate(item.scenarios):
        trained = f"{counted(item.train_scenes[number], 'scene')} of {counted(item.train_runs[number], 'run')}"
        tried = f"{counted(item.held_out.scenes[scenario], 'scene')} of {counted(item.held_out.runs[scenario], 'run')}"
        apart = item.apart[number]
        text = f"tuned on {trained}, tried on {tried}: {apart}" if apart else f"tuned and tried on {trained}"
        rows.append(Item(text, scenario))
    return Items(tuple(rows))
