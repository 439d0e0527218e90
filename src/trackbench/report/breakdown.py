"""Errors by manoeuvre, range and age."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.document import Block, Paragraph, Row, Section, TrackerStyle
from trackbench.report.calibration import BY, LIMITS, QUANTITIES, TITLE, calibrations, classes, errors, shares
from trackbench.report.figures.accuracy import errors_by_class
from trackbench.results import Result


def breakdown_section(result: Result, styles: Mapping[str, TrackerStyle]) -> Iterator[Section]:
    """The errors and the calibration of every tracker by each of them; nothing where there is none."""
    trackers = [tracker for tracker in result.scored if tracker.breakdown is not None]
    if not trackers:
        return
    # Where the first second is not scored, there is nothing to break down by age.
    ways = [by for by in BY if by != "age" or len(classes(trackers, by)) > 1]
    drawn = [tracker for tracker in result.drawn if tracker.breakdown is not None]
    figures = [errors_by_class(drawn, styles, by, quantity) for quantity in QUANTITIES for by in ways]
    calibration: list[Section] = []
    numbers: list[Section] = []
    for by in ways:
        explained = [Paragraph(_CALIBRATION)] if by == BY[0] else []
        row = Row(tuple(calibrations(trackers, by, quantity) for quantity in QUANTITIES))
        calibration.append(Section(f"Calibration by {TITLE[by]}", (*explained, row), folded=by != BY[0]))
        blocks: tuple[Block, ...] = (
            Paragraph(shares(trackers[0], by)),
            *(errors(trackers, by, quantity) for quantity in QUANTITIES),
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
