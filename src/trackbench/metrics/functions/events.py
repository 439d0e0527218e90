"""When a function is active, and which activity on tracks answers which on the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Mask

#: Shorter gaps in an activity do not end it, s; and what is so near to an event answers it.
TOLERANCE = 0.5
#: Of a delay, s.
DECIMALS = 9


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
    """From the start of an event to that of the interval that answers it, s; below 0 where it is early, and at least
    ``-TOLERANCE``. Of a missing answer it is later than of any."""
    missing: Mask
    false: Mask
    """``(N,)`` the intervals that answer no event, or that begin too early."""


def match_events(events: Spans, own: Spans, time: Array, impact: Array) -> Answers:
    """Match the intervals of a tracker with the events.

    An interval answers an event where it is active in it, or begins up to ``TOLERANCE`` after its end; of several the
    first counts. One that has gone on since the event before begins, for the next one, at that event's end. An interval
    is false where it begins near no event, even if it goes on into one, or is over before the one that it is near.

    Args:
        events: of the truth.
        own: intervals of the tracker.
        time: ``(instants,)`` s.
        impact: ``(runs,)`` s when it ends everything; infinite where there is none. A missing answer counts as given
            then, or ``TOLERANCE`` after the end of the event.
    """
    reach = TOLERANCE + SAME_TIME
    ends = np.append(time, time[-1])
    # The runs follow each other, so far apart that nothing of two of them is near.
    apart = time[-1] - time[0] + 4 * reach
    begin, end = (ends[at] + events.run * apart for at in (events.start, events.stop))
    own_begin = ends[own.start] + own.run * apart
    # The same in instants: an interval may last to the end.
    first, own_stop = (at + each.run * len(ends) for at, each in ((events.start, events), (own.stop, own)))
    candidate = np.searchsorted(own_stop, first, side="right")
    begins = np.append(own_begin, np.inf)[candidate]
    missing = begins > end + reach
    # Of times of one run, so that rounding is no delay.
    answered = np.append(ends[own.start], 0.0)[candidate]
    going_on = np.append(False, (events.run[1:] == events.run[:-1]) & (begins[1:] < end[:-1]))
    answered = np.where(going_on, np.append(0.0, ends[events.stop[:-1]]), answered)
    latest = np.minimum(ends[events.stop] + TOLERANCE, impact[events.run])
    # Times are sums of periods: so many scans are the same delay wherever they are.
    delay = np.round(np.where(missing, latest, answered) - ends[events.start], DECIMALS)
    delay = np.maximum(delay, -TOLERANCE)
    near = np.searchsorted(end, own_begin - reach)
    early, over = np.append(begin, np.inf)[near] > own_begin + reach, np.append(first, 0)[near] >= own_stop
    return Answers(delay, missing, early | over)
