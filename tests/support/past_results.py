"""Results of one small scene whose errors are drawn, in no time: the nights that a comparison looks at."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from functools import cache

import numpy as np
from tests.support.results import with_tables

import trackbench as tb
from trackbench.metrics import ratio, root
from trackbench.results import Result
from trackbench.results.summary import Provenance

SCENE = """\
name: scene
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  observer: {x: 0, y: 0, yaw_deg: 0}
  objects: {car: {start: {x: 20, y: -3, speed_mps: 8, course_deg: 10}, pieces: [{for_s: 2}]}}
sensors: {lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}}
trackers:
  raw: {use: raw}
  kf: {filter: kf, motion: cv, acceleration_sigma_mps2: 1}
score: {settle_s: 0}
monte_carlo: {runs: 20, seed: 7}
"""
BEGIN = datetime(2026, 1, 1, tzinfo=UTC)


@cache
def scene() -> Result:
    """What every result of the past is made from."""
    return tb.run(SCENE)


def past(
    number: int,
    errors: Mapping[str, float],
    seed: int | None = None,
    *,
    spread: float = 0.2,
    code: Mapping[str, str | None] | None = None,
    version: str = "0.8.0",
    commit: str = "a" * 40,
) -> Result:
    """A result of the day ``number`` with drawn position errors.

    Args:
        number: of the day.
        errors: by tracker, the root mean square that is expected.
        seed: of the measurements; the same noise acts on all trackers and all results of one seed. A seed of each day
            unless given.
        spread: of the squared error from run to run, relative.
        code: of own trackers.
        version: of trackbench.
        commit: of the scenario.
    """
    base = scene()
    seed = number if seed is None else seed
    runs = base.summary.runs
    drawn = np.random.default_rng(seed).gamma(1 / spread**2, spread**2, runs)
    table = base.tables["runs"]
    names = table["tracker"].to_pylist()
    squares = {name: errors[name] ** 2 * drawn for name in base}
    values = [float(np.sqrt(squares[name][names[: i + 1].count(name) - 1])) for i, name in enumerate(names)]
    place = table.column_names.index("position_rmse_m")
    table = table.set_column(place, "position_rmse_m", [np.array(values)])
    trackers = []
    for tracker in base.summary.trackers:
        count = np.full(runs, 1.0)
        interval = root(ratio(squares[tracker.name], count, at_least=0.0))
        metrics = dict(tracker.metrics) | {"position_rmse": interval.as_value("m")}
        trackers.append(tracker.model_copy(update={"metrics": type(tracker.metrics)(metrics)}))
    made = (BEGIN + timedelta(days=number)).isoformat()
    return with_tables(base, runs=table).updated(
        trackers=trackers,
        ranking=sorted(base, key=errors.__getitem__),
        seed=seed,
        fingerprints=[f"{seed} {run}" for run in range(runs)],
        versions={**base.summary.versions, "trackbench": version},
        provenance=Provenance(made_at=made, commit=commit, changed=False, code=dict(code or {})),
    )
