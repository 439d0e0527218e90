"""How much does the tracker let a target's velocity change?"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import Answer, Broken, blind
from trackbench.doctor.stations import Station

#: Growth in 1 s without measurements, at 20 steps a second, of the standard deviation of a road vehicle's speed, m/s.
#: White accelerations of 0.5 and 18 m/s^2 give these: the rule of half to all of the largest acceleration (Bar-Shalom,
#: Li and Kirubarajan 2001, section 6.3.2) with 1 to 9 m/s^2 lies well within.
BAND = (0.115, 4.0)
#: The same of the reference, a white acceleration of 3 m/s^2.
REFERENCE = 3.0 * np.sqrt(0.05)
STEP = 0.05


def process_noise(bench: Bench) -> Outcome:
    """Leave the tracker without measurements for a second, and see how its uncertainty of the speed grows."""
    question = "Does it let a target's velocity change as much as a road vehicle's does?"
    grown = [
        one
        for station in bench.stations.open[:3]
        for by in bench.kinds()
        if (one := _growth(bench, station, by)) is not None
    ]
    if not grown:
        return Outcome([Check("process_noise", question, None, "there was no estimate to predict")])
    growth = float(np.median(grown))
    equal = growth / np.sqrt(STEP)
    text = (
        f"in 1 s without a measurement its standard deviation of the speed grows by {growth:.3g} m/s (root of the "
        f"difference of the squares), as from a white acceleration of {equal:.3g} m/s^2 at 20 steps a second; "
        f"{BAND[0]:g} to {BAND[1]:g} m/s fit road vehicles"
    )
    outcome = Outcome([Check("process_noise", question, BAND[0] <= growth <= BAND[1], text)])
    if not BAND[0] <= growth <= BAND[1]:
        fault = "q_too_small" if growth < BAND[0] else "q_too_large"
        edge = BAND[0] / max(growth, 1e-9) if growth < BAND[0] else growth / BAND[1]
        outcome.findings.append(
            Finding(
                fault,
                min(0.97, 0.8 + 0.1 * np.log(edge)),
                text,
                factor=(growth / REFERENCE) ** 2,
                station=bench.stations.open[0].name,
            )
        )
    return outcome


def _growth(bench: Bench, station: Station, by: tuple[str, ...]) -> float | None:
    session = bench.followed(station, by)
    if session is None:
        return None
    going = session.ahead()
    name = by[0]
    try:
        answers = [going.step(blind(station.scan(name, bench.sensors[name], STEP * k))) for k in range(21)]
    except Broken as broken:
        bench.broken.append((station.name, broken))
        return None
    first, last = answers[0], answers[-1]
    if first is None or last is None or not (first.finite and last.finite):
        return None

    def variance(answer: Answer) -> float:
        along = answer.mean[2:] / max(float(np.hypot(*answer.mean[2:])), 1e-9)
        return float(along @ answer.covariance[2:, 2:] @ along)

    return float(np.sqrt(max(0.0, variance(last) - variance(first))))
