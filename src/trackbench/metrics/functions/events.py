"""When a function is active, and which activity on tracks answers which on the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Mask

#: Shorter gaps in an activity do not end it, s; and what is so near to an event answers it.
TOLERANCE = 0.5


class Spans(NamedTuple):
    """Intervals ``(N,)`` in which a function is active, in the order of runs and time."""

    run: Indices
    start: Indices
    """The first instant."""
    stop: Indices
    """The first one after it; the number of instants where it lasts to the end."""


def spans(active: Mask, time: Array) -> Spans:
    """The intervals of activity ``(instants, runs)`` at times ``(instants,)`` s; those less than ``TOLERANCE`` apart
    are one."""
    padded = np.zeros((active.shape[1], len(active) + 2), dtype=np.int8)
    padded[:, 1:-1] = active.T
    change = np.diff(padded, axis=1)
    (run, start), (_, stop) = np.nonzero(change > 0), np.nonzero(change < 0)
    if not len(run):
        return Spans(run, start, stop)
    # The next one begins before the end where it is of the same run.
    pause = time[start[1:]] - time[np.minimum(stop[:-1], len(time) - 1)]
    apart = (run[1:] != run[:-1]) | (pause >= TOLERANCE - SAME_TIME)
    first, last = np.append(True, apart), np.append(apart, True)
    return Spans(run[first], start[first], stop[last])


class Answers(NamedTuple):
    """What became of the events ``(events,)`` of the truth and of the intervals ``(N,)`` of a tracker."""

    delay: Array
    """From the start of an event to that of the interval that answers it, s; below 0 where it is early. Of a missing
    answer the time to the end of the event."""
    missing: Mask
    false: Mask
    """``(N,)`` the intervals that answer no event."""


def answers(events: Spans, own: Spans, time: Array) -> Answers:
    """Match the intervals of a tracker with the events.

    An interval answers an event where they overlap or are up to ``TOLERANCE`` apart; of several the first counts. One
    that has gone on since the event before begins, for the next one, at that event's end.

    Args:
        events: of the truth.
        own: intervals of the tracker.
        time: ``(instants,)`` s.
    """
    reach = TOLERANCE + SAME_TIME
    ends = np.append(time, time[-1])
    # The runs follow each other, so far apart that nothing of two of them is near.
    apart = time[-1] - time[0] + 4 * reach
    begin, end = (ends[at] + events.run * apart for at in (events.start, events.stop))
    own_begin, own_end = (ends[at] + own.run * apart for at in (own.start, own.stop))
    candidate = np.searchsorted(own_end, begin - reach)
    begins = np.append(own_begin, np.inf)[candidate]
    missing = begins > end + reach
    # Of times of one run, so that rounding is no delay.
    answered = np.append(ends[own.start], 0.0)[candidate]
    going_on = np.append(False, (events.run[1:] == events.run[:-1]) & (begins[1:] < end[:-1]))
    answered = np.where(going_on, np.append(0.0, ends[events.stop[:-1]]), answered)
    delay = np.where(missing, ends[events.stop], answered) - ends[events.start]
    following = np.searchsorted(end, own_begin - reach)
    false = np.append(begin, np.inf)[following] > own_end + reach
    return Answers(delay, missing, false)
