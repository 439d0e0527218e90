"""What a scenario's trackers are held against, and what they get: the truth and the scans."""

from __future__ import annotations

from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import InputError
from trackbench.base.types import Scan, Truth, scan_of_run
from trackbench.runner.work import work_of
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truth_of
from trackbench.sensing import scans
from trackbench.sensing.detections import sense_hidden


def truth(scenario: Scenario | Named) -> Truth:
    """The motion of every target and of the observer, simulated unless it is in the cache.

    Args:
        scenario: what :func:`load` gave or takes.

    Raises:
        InputError: something is wrong in the scenario, or a recording cannot be read.
    """
    return truth_of(loaded_scenario(scenario)).truth


def sense(scenario: Scenario | Named, runs: range = range(1)) -> list[Scan]:
    """The scans of some runs, in the order of their times: what each tracker gets, bit for bit.

    Args:
        scenario: what :func:`load` gave or takes.
        runs: their numbers, from 0.

    Returns:
        Scans of which ``measurement`` is ``(m, objects, runs)`` and ``valid`` is ``(objects, runs)``; the objects are
        those of the truth's ``ids``. Where the scenario hides the identities: ``(m, D)`` and ``(D,)``, of one run.

    Raises:
        InputError: something is wrong in the scenario, it has no such run, or identities are hidden in several runs.
    """
    loaded = loaded_scenario(scenario)
    if not isinstance(runs, range) or not runs:
        raise InputError(f"{runs!r} is no range of runs; write range(3) for the first three", key="runs")
    there = loaded.config.monte_carlo.runs
    for run in runs:
        if run not in range(there):
            raise InputError(f"there is no run {run}; choose from 0 to {there - 1}", key="runs", file=loaded.path)
    hidden = loaded.config.sensing.identities == "hidden"
    if hidden and len(runs) != 1:
        message = "with hidden identities each run has its own number of detections; ask for one run at a time"
        raise InputError(message, key="runs", file=loaded.path)
    found = truth_of(loaded)
    work = work_of(loaded, [found])
    sensors = work.scenes[0].sensors
    if hidden:
        return [scan_of_run(scan, 0) for scan in sense_hidden(sensors, work.seed, work.scenario, runs).scans]
    seen = scans.sense(sensors, work.seed, work.scenario, runs).scans
    shape = (len(found.truth.ids), len(runs))
    return [
        scan._replace(measurement=scan.measurement.reshape(-1, *shape), valid=scan.valid.reshape(shape))
        for scan in seen
    ]
