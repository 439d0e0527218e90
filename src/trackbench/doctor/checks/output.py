"""Is the estimate given as px, py, vx, vy of the target?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import blind
from trackbench.types import Array

#: Largest error after a target was followed without noise, m and m/s.
NEAR = 1.0


class Mapping(NamedTuple):
    """What may have become of px, py, vx, vy."""

    fault: str
    words: str
    matrix: Array
    """``(4, 4)`` from the truth to what is given."""


def _signed(order: str, signs: tuple[int, ...] = (1, 1, 1, 1)) -> Array:
    names = ("px", "py", "vx", "vy")
    return np.array(
        [[sign * (name == item) for name in names] for sign, item in zip(signs, order.split(), strict=True)]
    )


MAPPINGS = (
    Mapping("axis_swapped", "it gives px, vx, py, vy", _signed("px vx py vy")),
    Mapping("axis_swapped", "it gives py, px, vy, vx", _signed("py px vy vx")),
    Mapping("axis_swapped", "it gives px, py, vy, vx", _signed("px py vy vx")),
    Mapping("axis_swapped", "it gives py, px, vx, vy", _signed("py px vx vy")),
    Mapping("axis_swapped", "it gives the velocity before the position", _signed("vx vy px py")),
    Mapping("axis_mirrored", "y has the other sign in it", _signed("px py vx vy", (1, -1, 1, -1))),
    Mapping("axis_mirrored", "x has the other sign in it", _signed("px py vx vy", (-1, 1, -1, 1))),
)


def output(bench: Bench) -> Outcome:
    """Follow targets without noise, and see how what is given lies to what is true."""
    question = "Is the estimate given as px, py, vx, vy in the fixed frame?"
    pairs = []
    for station in bench.stations.open:
        session = bench.followed(station, bench.kinds()[-1])
        name = bench.kinds()[-1][0]
        answer = None if session is None else session.peek(blind(station.scan(name, bench.sensors[name], 0.0)))
        if answer is not None and answer.finite:
            pairs.append((answer.mean, station.truth(0.0)))
    if not pairs:
        return Outcome([Check("output", question, None, "there was no estimate")])

    def worst(matrix: Array) -> float:
        return max(float(np.abs(mean - matrix @ truth).max()) for mean, truth in pairs)

    error = worst(np.eye(4))
    found = None if error < NEAR else next((one for one in MAPPINGS if worst(one.matrix) < NEAR), None)
    text = f"after {len(pairs)} targets followed without noise the largest error is {error:.3g} m or m/s"
    outcome = Outcome([Check("output", question, found is None, text)])
    if found is not None:
        mean, truth = pairs[0]
        said = f"{found.words}: of a target at {_shown(truth)} it says {_shown(mean)}, at all of {len(pairs)} stations"
        outcome.findings.append(Finding(found.fault, 0.98, said, station=bench.stations.open[0].name))
    return outcome


def _shown(state: Array) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in state) + ")"
