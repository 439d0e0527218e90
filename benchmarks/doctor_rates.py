"""How often the doctor names an injected fault, and how often it finds one where there is none.

    python benchmarks/doctor_rates.py [--workers N] [--objects one|several] [--only TEXT]

Writes results/doctor_rates.md and results/doctor_rates.json, unless only some of the faults are asked for; with
--objects the other half of the page stays as it is.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from doctor.faults import CORRECT, MUTANTS, ONE_SENSOR
from doctor.traffic import rates as traffic
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.subject import SENSORS

PAGE = Path(__file__).parents[1] / "results" / "doctor_rates.md"
DATA = PAGE.with_suffix(".json")
#: Number of seeds of the noise and the probes.
SEEDS = 5
#: Examinations of correct trackers, at least.
HEALTHY = 300
#: Examinations of each fault, at least: where fewer trackers have it, with several seeds.
EACH = 10
#: What a drive's check says of the NEES.
NEES = re.compile(r"NEES of position ([\d.e+-]+) and of velocity ([\d.e+-]+)")
#: The factor of a wrong noise is right within this.
FACTOR = 2.0


class Task(NamedTuple):
    """One examination: of a mutant by its number, or of a correct tracker by its name."""

    seed: int
    what: int | str


class Seen(NamedTuple):
    """The outcome of a task."""

    task: Task
    found: tuple[str, ...]
    """Names of the faults, the first one first."""
    right: bool
    seconds: float
    words: str
    nees: tuple[float, ...]
    """Of the position and of the velocity in each drive that was judged."""


@lru_cache(maxsize=3 * SEEDS)
def doctor(seed: int, sensors: tuple[str, ...]) -> Doctor:
    return Doctor({name: SENSORS[name] for name in sensors}, seed)


def examine(task: Task) -> Seen:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    known = {**CORRECT, **{name: make for name, (_, make) in ONE_SENSOR.items()}}
    make = known[task.what] if isinstance(task.what, str) else MUTANTS[task.what].make
    sensors = (ONE_SENSOR[task.what][0],) if task.what in ONE_SENSOR else tuple(SENSORS)
    ready = doctor(task.seed, sensors)
    begin = time.perf_counter()
    found = ready.examine(str(task.what), make)
    seconds = time.perf_counter() - begin
    names = tuple(finding.fault for finding in found.findings)
    right = found.healthy if isinstance(task.what, str) else _right(task.what, found)
    failed = [f"{check.name}: {check.result}" for check in found.checks if check.passed is False]
    words = "; ".join([*(f"{one.fault}: {one.evidence}" for one in found.findings), *failed])
    said = (NEES.search(check.result) for check in found.checks)
    nees = tuple(float(number) for match in said if match is not None for number in match.groups())
    return Seen(task, names, right, seconds, words, nees)


def _right(number: int, found: Examination) -> bool:
    mutant = MUTANTS[number]
    if not found.findings and any(one.fault == mutant.fault for one in found.fragile):
        return True
    if not found.findings or found.findings[0].fault != mutant.fault:
        return False
    first = found.findings[0]
    if mutant.factor is None:
        return True
    # A fault of all sensors may be found in any of them first.
    named = mutant.sensor is None or first.sensor == mutant.sensor
    return named and first.factor is not None and 1 / FACTOR <= first.factor / mutant.factor <= FACTOR


#: Right names and all, by fault and by the trackers that it is injected into.
Named = dict[str, dict[str, tuple[int, int]]]


def named_faults(seen: Sequence[Seen]) -> Named:
    """Return how often each fault is named first, with the sums under "all"."""
    subjects = list(dict.fromkeys(mutant.subject for mutant in MUTANTS))
    counts: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for one in seen:
        if isinstance(one.task.what, int):
            mutant = MUTANTS[one.task.what]
            for key in ((mutant.fault, mutant.subject), (mutant.fault, "all"), ("all", mutant.subject), ("all", "all")):
                counts[key].append(one.right)
    return {
        fault: {
            subject: (sum(counts[fault, subject]), len(counts[fault, subject]))
            for subject in [*subjects, "all"]
            if counts[fault, subject]
        }
        for fault in [*sorted({mutant.fault for mutant in MUTANTS}), "all"]
    }


def table(named: Named) -> list[str]:
    """Return the rows of the faults that are not always named, and of all together."""
    lines = ["| injected fault | named first |", "| --- | ---: |"]
    for fault, cells in named.items():
        right, number = cells["all"]
        if right < number:
            lines.append(f"| {f'`{fault}`' if fault != 'all' else 'all'} | {right}/{number} |")
    return lines


def page(seen: Sequence[Seen]) -> str:
    injected = [one for one in seen if isinstance(one.task.what, int)]
    correct = [one for one in seen if isinstance(one.task.what, str)]
    hits, silent = sum(one.right for one in injected), sum(one.right for one in correct)
    lines = [
        "# How often the doctor is right",
        "",
        "<!-- Made by `make doctor-rates`. Change benchmarks/doctor_rates.py, not this page. -->",
        "",
        f"{hits} of {len(injected)} injected faults ({hits / len(injected):.1%}) have the right name first "
        f"({SEEDS} seeds of noise and probes).",
        "",
        f"{silent} of {len(correct)} examinations of {len({one.task.what for one in correct})} correct trackers found "
        "nothing: all built-in filters with every motion model, calm to lively tunings, several starts, one sensor or "
        "two, and the trackers of the table without their faults.",
        "",
        "Every fault is injected into correct trackers: plain NumPy ones, ones made with FilterPy, and "
        "built-in ones. It counts where its name is the first finding; of a wrong measurement noise also the sensor "
        "and the factor, within a factor of two. A row for each fault that is not always named; "
        "`results/doctor_rates.json` has all of them.",
        "",
        *table(named_faults(injected)),
    ]
    return "\n".join(lines)


def quiet_trackers(seen: Sequence[Seen]) -> dict[str, tuple[int, int, float, float]]:
    """Return of each correct tracker the examinations without a finding, all, and the least and largest mean NEES."""
    by_name: dict[str, list[Seen]] = defaultdict(list)
    for one in seen:
        by_name[str(one.task.what)].append(one)
    quiet = {}
    for name, found in by_name.items():
        nees = [number for one in found for number in one.nees] or [np.nan]
        quiet[name] = sum(one.right for one in found), len(found), min(nees), max(nees)
    return quiet


def write_data(seen: Sequence[Seen]) -> None:
    """Write how often each fault is named, and what each correct tracker gives."""
    injected = [one for one in seen if isinstance(one.task.what, int)]
    correct = [one for one in seen if isinstance(one.task.what, str)]
    rates = {"faults": named_faults(injected), "correct": quiet_trackers(correct)}
    DATA.write_text(json.dumps(rates, indent=1) + "\n", encoding="utf-8")


def single_objects(pool: ProcessPoolExecutor, only: str, sample: int) -> list[Seen]:
    chosen = [number for number, mutant in enumerate(MUTANTS) if only in mutant.name]
    names = [] if only else [*CORRECT, *ONE_SENSOR]
    times = -(-HEALTHY // len(names)) if names else 0
    count = Counter(MUTANTS[number].fault for number in chosen)
    tasks = [
        Task((number + turn) % SEEDS, number)
        for number in chosen
        for turn in range(1 if only else min(SEEDS, -(-EACH // count[MUTANTS[number].fault])))
    ]
    tasks += [Task((number + turn) % SEEDS, name) for turn in range(times) for number, name in enumerate(names)]
    if sample:
        tasks = random.Random(sample).sample(tasks, min(sample, len(tasks)))
    seen = []
    for one in pool.map(examine, tasks, chunksize=1 if sample else 8):
        seen.append(one)
        if not one.right:
            name = one.task.what if isinstance(one.task.what, str) else MUTANTS[one.task.what].name
            print(f"{name} (seed {one.task.seed}): {one.words or 'nothing'}", flush=True)
    return seen


def several_objects(pool: ProcessPoolExecutor, only: str) -> list[traffic.TrafficSeen]:
    chosen = [number for number, subject in enumerate(traffic.SUBJECTS) if only in subject.name]
    seen = []
    for one in pool.map(traffic.examine, chosen):
        seen.append(one)
        if not one.right:
            print(f"{one.subject.name}: {', '.join(one.found)}: {one.words or 'nothing'}", flush=True)
    return seen


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--objects", choices=("one", "several"), help="only trackers of one object, or of several")
    arguments.add_argument("--sample", type=int, default=0, help="so many of the trackers of one object, drawn")
    arguments.add_argument("--only", default="", help="faults, trackers or variants whose names contain this")
    given = arguments.parse_args()
    one, mark, several = PAGE.read_text(encoding="utf-8").partition(traffic.TITLE)
    halves = [one.rstrip("\n"), (mark + several).rstrip("\n")]
    outcomes: list[Seen | traffic.TrafficSeen] = []
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        if given.objects != "several":
            of_one = single_objects(pool, given.only, given.sample)
            outcomes += of_one
            if not given.only and not given.sample:
                halves[0] = page(of_one)
                write_data(of_one)
        if given.objects != "one" and not given.sample:
            of_several = several_objects(pool, given.only)
            outcomes += of_several
            halves[1] = halves[1] if given.only else "\n".join(traffic.section(of_several))
    if given.only or given.sample:
        print(f"{sum(one.right for one in outcomes)} of {len(outcomes)}")
    else:
        PAGE.write_text("\n\n".join(halves) + "\n", encoding="utf-8")
        print(PAGE.read_text(encoding="utf-8"))
    print(f"{np.median([one.seconds for one in outcomes]):.1f} s an examination in the median")


if __name__ == "__main__":
    main()
