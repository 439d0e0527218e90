"""The report of a result: one page, whose sections follow from its identities, its truth and its metrics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.base.subjects import collected
from trackbench.document import Block, Code, Document, Figure, Item, Items, Paragraph, Row, Section, Table, TrackerStyle
from trackbench.document.palette import tracker_styles
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.verdicts import ABOVE, BELOW, LEAST_COVERAGE, SMALLEST_SHARE, TOLERANCE, WHITENESS_TOLERANCE
from trackbench.report import tables
from trackbench.report.association import comparisons
from trackbench.report.calibration import (
    BY,
    LIMITS,
    QUANTITIES,
    TITLE,
    after_jumps,
    calibration_table,
    condition_names,
    condition_nees_table,
    condition_shares,
    error_table,
    nees_parts_table,
)
from trackbench.report.figures.accuracy import cost_against_accuracy, error_over_time, errors_by_class, spread
from trackbench.report.figures.map import styles_with_map
from trackbench.report.figures.over_time import autocorrelation, modes_over_time, nees_over_time, nis_over_time
from trackbench.report.figures.tracks import existence_calibration, gospa_over_time, strip_chart
from trackbench.report.first_screen import competing, first_screen, picture
from trackbench.report.moments import events_section, moments_section, worst_moments
from trackbench.report.numbers import joined_names, margin_words, percent
from trackbench.report.pairs import Pairs, standing
from trackbench.report.scenes import (
    ONE_RUN,
    basis_of_intervals,
    scenes,
    undrawn_scenes,
    values_of_few_scenes,
    without_interval,
)
from trackbench.report.sentences import (
    FALSE_OF_REFERENCE,
    SWITCH_COSTS,
    below_the_bound,
    censored,
    drawing_random,
    facts,
    made_elsewhere,
    missing_estimates,
    other_switch_costs,
    others_ignored,
    provenance,
    reused_identities,
)
from trackbench.report.truth_and_sensors import audit_sentences, sensor_table
from trackbench.results import Result


def breakdown_section(result: Result, styles: Mapping[str, TrackerStyle]) -> Iterator[Section]:
    """The errors and the calibration of every tracker by each of them; nothing where there is none."""
    trackers = [tracker for tracker in result.scored if tracker.breakdown is not None]
    if not trackers:
        return
    # Where the first second is not scored, there is nothing to break down by age.
    ways = [by for by in BY if by != "age" or len(condition_names(trackers, by)) > 1]
    drawn = [tracker for tracker in result.drawn if tracker.breakdown is not None]
    figures = [errors_by_class(drawn, styles, by, quantity) for quantity in QUANTITIES for by in ways]
    calibration: list[Section] = []
    numbers: list[Section] = []
    for by in ways:
        explained = [Paragraph(_CALIBRATION)] if by == BY[0] else []
        row = Row(tuple(calibration_table(trackers, by, quantity) for quantity in QUANTITIES))
        calibration.append(Section(f"Calibration by {TITLE[by]}", (*explained, row), folded=by != BY[0]))
        blocks: tuple[Block, ...] = (
            Paragraph(condition_shares(trackers[0], by)),
            *(error_table(trackers, by, quantity) for quantity in QUANTITIES),
        )
        numbers.append(Section(f"Errors by {TITLE[by]} in numbers", blocks, folded=True))
    row = Row(tuple(figure for figure in figures if figure))
    yield Section("By manoeuvre and range", (Paragraph(_MANOEUVRES), row, *calibration, *numbers))


_MANOEUVRES = (
    "An object turns where its heading changes by more than 3° a second, brakes or accelerates where its speed changes "
    "by more than 1 m/s each second, both over half a second, and is in a sensor gap where no sensor of the tracker "
    "could see it for more than three periods of the slowest one; each estimate counts once, for the last of these "
    "that applies. The range is the distance from the observer. The first second begins when a sensor could first see "
    "the object."
)
_CALIBRATION = (
    "RMS error over the standard deviation that the tracker's covariance states: 1 is right, 2 means errors twice as "
    f"large as stated. Optimistic is a ratio whose whole 95 % interval is above {LIMITS[1]:.2f}, pessimistic one below "
    f"{LIMITS[0]:.2f}."
)


def result_document(result: Result) -> Document:
    """The report of a run."""
    trackers, result, summary = len(result.summary.trackers), result.listed, result.listed.summary
    styles = tracker_styles(result.places)
    shown = [styles[tracker.name] for tracker in result.drawn]
    labelled = summary.truth.known and summary.identities == "known"
    moments = worst_moments(result) if labelled else {}
    blocks = [
        Section("Verdict", tuple(first_screen(result, trackers, picture(result, shown, moments)))),
        *_sections(result, styles, shown, moments),
        *([Section("Expectations", tuple(_expectations(result)))] if summary.expectations else []),
        Section("Truth and sensors" if summary.truth.known else "Sensors", tuple(_truth_and_sensors(result))),
        Section("How to reproduce it", tuple(_reproduction(result))),
    ]
    name, description = summary.scenario.name, summary.scenario.description
    return Document("report", name, tuple(blocks), description, facts(result, trackers), tuple(shown))


def _sections(
    result: Result,
    styles: Mapping[str, TrackerStyle],
    shown: Sequence[TrackerStyle],
    moments: Mapping[str, EstimateMoment],
) -> Iterator[Section]:
    """What is between the verdict and the expectations."""
    summary, scored = result.summary, result.scored
    if not summary.truth.known:
        for title, (note, paths) in _WITHOUT_TRUTH.items():
            yield Section(title, (Paragraph(note), tables.table_without_truth(title, scored, paths)))
        missing = ", ".join(map(tables.metric_in_words, TRACK_METRICS))
        yield Section("What cannot be told", (Paragraph(f"Not without a truth: {missing}."),))
        return
    labelled = summary.identities == "known"
    others = tables.other_metrics(result)
    if scored:
        yield _ranking(result, others)
    if len(scored) > 1:
        yield _differences(result, styles)
        yield from comparisons(result)
    if summary.truth.scenes:
        yield Section("Scene by scene", tuple(scenes(result)))
    yield from collected("sections", result, shown)
    if labelled:
        yield from _accuracy(result, shown, moments)
        yield from _figures("Modes", [modes_over_time(result)])
        yield from breakdown_section(result, styles)
        yield from _consistency(result, shown)
        return
    figures = [
        gospa_over_time(result.tables.steps, shown),
        strip_chart(result.tables.objects, shown, summary.recorded_run),
        existence_calibration(result.tables.existence, shown),
    ]
    yield from _figures("What happened", figures)
    yield from events_section(result)
    notes = {"Errors of matched tracks": censored(result)}
    if reused := reused_identities(result):
        notes["Identity"] = f"{reused[0].upper()}{reused[1:]}. {_SAME_ID}"
    for title, paths in tables.TRACK_GROUPS.items() if scored else ():
        explained = (Paragraph(notes[title]),) if title in notes else ()
        yield Section(title, (tables.track_table(title, scored, paths), *explained))
    if others is not None:
        yield Section("Other metrics", (others,))


_SAME_ID = "Tracks of one identity are scored as one track: a second track of it on the same object is no switch."
#: The sections without a truth: title, what to know of it, and the metrics that are the columns of its table.
_WITHOUT_TRUTH: dict[str, tuple[str, tuple[str, ...]]] = {
    "Tracks": (
        "Trackers stand in the scenario's order. More or longer tracks are not better: they may be of nothing.",
        ("track_count", "new_tracks", "track_length", "used_share"),
    ),
    "Beside the sensor's own tracks": (
        "The sensor says of which of its own tracks each detection is, which the trackers are not told. It is one more "
        "tracker and no truth: where the two differ, either may be wrong.",
        ("track_breaks", "own_track_breaks", "track_swaps"),
    ),
    "Predictions": (
        "Before each scan a built-in tracker is asked where its tracks are. NIS is of the detections that they "
        "then used, so a tracker that takes only near ones has a small one. The score is of all detections of all "
        "scans: each tracker is asked the same. It tells how well the sensor's next scan is predicted, false alarms "
        "and all, and not how near the tracks are to vehicles; only differences of it mean something.",
        ("nis", "prediction_score"),
    ),
}


def _ranking(result: Result, others: Table | None) -> Section:
    summary, trackers, drawn = result.summary, result.scored, result.drawn
    references = any(tracker.is_reference for tracker in trackers)
    basis = f"Small print is the 95 % interval, {basis_of_intervals(result)}."
    if values_of_few_scenes(result):
        few = f"No interval and no verdict holds with fewer than {FEWEST_SCENES} scenes: see “Scene by scene”"
        basis = f"{few if summary.truth.scenes else ONE_RUN}."
    without = tuple(Item(f"{sentence[0].upper()}{sentence[1:]}.") for sentence in without_interval(result))
    folded = [Section("Metrics without an interval", (Items(without),), folded=True)] if without else []
    sentences = [drawing_random(result), *others_ignored(result), *made_elsewhere(result)]
    basis += "".join(f" {sentence}." for sentence in sentences if sentence)
    column = standing(result)
    shown = f"“{column.heading}”: {column.meaning}"
    if summary.identities == "hidden":
        metric, costs = summary.headline_name, summary.score.switch_costs_s or 0.0
        note = f"By {metric}. {shown}. {basis}" + (_ORACLES if references else "")
        headings = {path: f"{factor * costs:g} s" for path, factor in SWITCH_COSTS.items()}
        table = tables.by_switch_costs(result, headings)
        other_costs = Section(
            "At half and at twice the cost of a switch", (Paragraph(other_switch_costs(result)), table)
        )
        return Section("Ranking", (Paragraph(note), tables.ranking_table(result), *folded, other_costs))
    note = (
        f"By position RMSE. {shown}. {basis}"
        + (f" Figures show the best {len(drawn)}." if len(drawn) < len(trackers) else "")
        + (f" {_SMOOTHERS}" if references else "")
    )
    title = f"Errors along each axis, and the {summary.held_against.label}"
    sentences = missing_estimates(result) + below_the_bound(result)
    remarks = [Paragraph(". ".join(sentences) + ".")] if sentences else []
    more = Section(title, (tables.axes_and_reference(result),), folded=True)
    own = [] if others is None else [Section("Other metrics", (others,))]
    return Section("Ranking", (Paragraph(note), tables.ranking_table(result), *remarks, *folded, *own, more))


_ORACLES = f" A reference knows which detection is whose: it is no competitor; {FALSE_OF_REFERENCE}."
_SMOOTHERS = (
    "Offline: a smoother, which knows the measurements after each instant too, and shows what was to be had from the "
    "same data. It is no competitor."
)


def _differences(result: Result, styles: Mapping[str, TrackerStyle]) -> Section:
    """The differences of the metric that ranks, with the computing time."""
    summary, drawn = result.summary, result.drawn
    cost = cost_against_accuracy(drawn, styles, summary.headline)
    beside = Row((tables.key_differences(result), *([cost] if cost else [])))
    text = _DIFFERENCES.format(
        metric=summary.headline_name,
        margin=margin_words(Pairs(result).margins),
        percent=summary.score.margin.percent,
        mm=1000 * summary.score.margin.position_m,
        family=_family(result),
    )
    title = "All pairs"
    if summary.identities == "known":
        text += _NOT_BETTER if any(item.turned for item in result.differences) else ""
        undrawn = undrawn_scenes(len(summary.truth.scenes), summary.truth.few_scenes_decide)
        text += "".join(f" {sentence}." for sentence in undrawn)
        title += "" if len(drawn) == len(result.scored) else f" of the best {len(drawn)}"
    blocks: list[Block] = [Paragraph(text), beside]
    if summary.score.against is None:
        blocks.append(Section(title, (tables.all_differences(result, drawn),), folded=True))
    return Section("Differences between trackers", tuple(blocks))


_DIFFERENCES = (
    "Differences of {metric}, paired: every tracker saw the same truth and the same noise. Negative means smaller "
    "errors. Better and worse: shown to differ by more than the margin, {margin}: the larger of {percent:g} % of the "
    "better value and {mm:g} mm. {family} Equivalent: the "
    "interval lies within that margin; undecided: neither, more runs or scenes would tell. Each interval is that of "
    "its pair alone, without the correction. By other metrics no tracker is called better unless an expectation names "
    "them."
)


def _family(result: Result) -> str:
    """Over which differences the risk of a wrong word is 5 %."""
    score, expected = result.summary.score, any(item.operator == "better_than" for item in result.summary.expectations)
    beside = " and of what the expectations name" if expected else ""
    if score.best is not None:
        return (
            f"The risk is 5 % that any tracker as good as the best is called worse than {score.best}, which was chosen "
            f"from the same data: p-values are corrected for that and, after Holm, for the number of trackers{beside}."
        )
    pairs = "all pairs" if score.baseline is None else f"all trackers against {score.baseline}"
    return f"The risk that any is called so wrongly is 5 %: p-values are corrected after Holm for {pairs}{beside}."


_NOT_BETTER = (
    " Smaller and larger: shown to differ by more than the margin too, but the difference turns without what is "
    "charged for missing estimates, and neither is called better."
)


def _accuracy(
    result: Result, shown: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]
) -> Iterator[Section]:
    steps, reference = result.tables.steps, result.summary.held_against
    figures = [
        *(error_over_time(steps, shown, quantity, reference) for quantity in QUANTITIES),
        spread(steps, shown, reference.label),
    ]
    yield from _figures("Accuracy", figures)
    ringed = [style.name for style in styles_with_map(competing(result, shown))]
    yield from moments_section(result, moments, ringed)


def _consistency(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    sensors = list(enumerate(result.summary.sensors))
    figures = [
        nees_over_time(result.tables.steps, shown),
        *(nis_over_time(result.tables.nis, sensor, shown, number) for number, sensor in sensors),
        *(autocorrelation(result.tables.autocorrelation, sensor, shown, number) for number, sensor in sensors),
    ]
    numbers = (condition_nees_table(result), nees_parts_table(result), *tables.innovation_tables(result))
    yield from _figures("Consistency", figures, numbers, _VERDICTS)


_VERDICTS = (
    f"Consistent: the 95 % interval of the mean is within {percent(TOLERANCE)} of what is right; optimistic above, "
    f"pessimistic below, undecided where it is neither or under {percent(LEAST_COVERAGE)} of the estimates are given. "
    f"The NEES must be so under each condition too, from {percent(BELOW)} below to {percent(ABOVE)} above, if the "
    f"condition has {percent(SMALLEST_SHARE)} of the estimates; where the mean is undecided, one condition that is off "
    "gives the word; mixed: it is under some conditions and not under "
    "others; heavy-tailed: more of the NEES are beyond the 95 %, 99 % or 99.9 % point than a mean so far off would "
    "explain. Innovations are white where the interval of their autocorrelation is within "
    f"{WHITENESS_TOLERANCE} of zero, coloured where it is beyond."
)


def _figures(
    title: str, figures: Sequence[Figure | None], numbers: Sequence[Table | None] = (), text: str = ""
) -> Iterator[Section]:
    rows = [tuple(item for item in items if item) for items in (figures, numbers)]
    if any(rows):
        begin = [Paragraph(text)] if text else []
        yield Section(title, (*begin, *(Row(blocks) for blocks in rows if blocks)))


def _expectations(result: Result) -> Iterator[Block]:
    """What was expected, and what it is held against."""
    yield tables.expectation_table(result)
    if any(item.operator in ("below", "above") for item in result.summary.expectations):
        yield Paragraph(
            "“Below” and “above” hold the value against the limit, not its interval; “better than” is tested."
        )


def _truth_and_sensors(result: Result) -> Iterator[Block]:
    if result.summary.truth.known:
        yield from map(Paragraph, audit_sentences(result.summary.truth))
    if shares_of_jumps := after_jumps(result.scored):
        yield Paragraph(shares_of_jumps)
    yield sensor_table(result)
    for name, sensor in result.summary.sensors.items():
        if sensor.effects:
            yield Paragraph(f"Effects of {name}: {sensor.effects_with_options}.")


def _reproduction(result: Result) -> Iterator[Block]:
    summary, scenario = result.summary, result.summary.scenario
    if summary.command:
        yield Code(summary.command, "sh")
    yield Paragraph(f"{summary.made_with}.")
    engines = dict.fromkeys(tracker.engine for tracker in summary.trackers if tracker.engine is not None)
    by_engine = {name: [tracker.name for tracker in summary.trackers if tracker.engine == name] for name in engines}
    if len(by_engine) > 1:
        yield Paragraph(
            " ".join(f"Computed by {engine}: {joined_names(names)}." for engine, names in by_engine.items())
        )
    yield Paragraph(f"Fingerprint of all measurements: {summary.fingerprint}")
    if made := provenance(result):
        yield Section("Provenance", (Items(tuple(Item(text, label) for label, text in made)),))
    overrides = [Paragraph(f"Changed by the command: {', '.join(scenario.overrides)}.")] if scenario.overrides else []
    yield Section(f"Scenario {scenario.file}", (Code(scenario.text, "yaml"), *overrides), folded=True)
