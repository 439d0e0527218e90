"""What the doctor says of faults that people made, and of the sound trackers that the faults are put into.

    python -m benchmarks.faults.rates [--workers N] [--only TEXT]

Prints a line for each program, and the shares of faults that are named and of sound trackers that are accused.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from benchmarks.faults.corpus import Program, bases, examined, faults, is_right

from trackbench.metrics.count_intervals import share_interval


class Outcome(NamedTuple):
    """What was said of a program."""

    is_right: bool
    words: str
    cpu_s: float


def examine(program: Program) -> Outcome:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    begin = time.process_time()
    with TemporaryDirectory() as folder:
        program.write(Path(folder))
        sys.path.insert(0, folder)
        try:
            examination = examined(program, import_module(program.name).Tracker)
        finally:
            sys.path.remove(folder)
    failed = [check.name for check in examination.checks if check.passed is False]
    words = "; ".join(f"{cause.fault}: {cause.evidence}" for cause in examination.causes)
    words = words or ("healthy" if examination.healthy else f"no name, and failed checks: {', '.join(failed)}")
    return Outcome(is_right(program, examination), words, time.process_time() - begin)


def share(hits: int, count: int) -> str:
    """Return a share with its Clopper-Pearson interval."""
    low, high = share_interval(hits / count, count)
    return f"{hits} of {count}, {hits / count:.0%} ({low:.0%} to {high:.0%})"


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--only", default="", help="programs whose names contain this text")
    options = arguments.parse_args()
    programs = [program for program in (*faults(), *bases()) if options.only in program.name]
    outcomes: dict[bool, list[Outcome]] = {True: [], False: []}
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        for program, outcome in zip(programs, pool.map(examine, programs), strict=True):
            outcomes[program.fault is not None].append(outcome)
            mark = "right" if outcome.is_right else "WRONG"
            print(f"{mark} {program.name} ({outcome.cpu_s:.1f} CPU s): {outcome.words}", flush=True)
    for is_faulty, of in outcomes.items():
        if of:
            hits = sum(outcome.is_right == is_faulty for outcome in of)
            words = "faults with the right name first" if is_faulty else "sound trackers accused"
            print(f"{words}: {share(hits, len(of))}")
    every = [outcome.cpu_s for of in outcomes.values() for outcome in of]
    print(f"{sum(every) / 60:.1f} CPU minutes; {np.median(every):.1f} CPU s an examination in the median")


if __name__ == "__main__":
    main()
