"""How often the doctor is right about faults as people make them, and silent about sound trackers.

    python benchmarks/real_faults.py SET [--workers N] [--out FILE] [--log FILE]

Writes a table and what was said of each miss, as Markdown. With --log, what was found of a program is kept there, and a
program that has not changed since is not examined again.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

import numpy as np

from doctor.traffic.subject import looped
from doctor_rates import doctor
from faults.corpus import KINDS, Fault, Program, bases, faults, sound
from markdown import table
from trackbench.metrics.count_intervals import share_interval
from trackbench.subjects.doctor.certainty import Word
from trackbench.subjects.doctor.report import examination_verdict
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor

LONGEST = 150.0  # CPU s, of an examination
OUTCOMES = RIGHT, WRONG, UNNAMED, HEALTHY = "right", "wrong name", "failed checks, no name", "said healthy"


@dataclass
class Seen:
    """What was said of a program."""

    module: str
    text: str  # its mark
    kind: str
    outcome: str
    word: str | None  # how certain the first finding is said to be
    examination_verdict: str
    said: list[str]
    seconds: float


def mark(program: Program) -> str:
    """Of the text of a program with its parts, and of what is accepted."""
    return sha256(f"{program.accept}{program.whole}".encode()).hexdigest()[:16]


def _too_long(*_: object) -> None:
    raise TimeoutError(f"it takes over {LONGEST:g} CPU s")


def examine(program: Program) -> Seen:
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, LONGEST, 5.0)  # again and again: a check takes an error of the tracker
    np.seterr(all="ignore")
    begin = time.process_time()
    with TemporaryDirectory() as folder:
        program.write(Path(folder))
        sys.path.insert(0, folder)
        try:
            tracker = import_module(program.module).Tracker
            if program.identities == "hidden":
                found = TrafficDoctor(SENSORS).examine(program.module, looped(tracker))
            else:
                found = doctor(0, tuple(SENSORS)).examine(program.module, tracker)
        except Exception as error:
            return Seen(program.module, mark(program), program.kind, UNNAMED, None, f"not examined: {error}", [], 0.0)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            sys.path.remove(folder)
    said = [f"{one.fault} ({found.certainty(one).word}): {one.evidence}" for one in found.causes]
    said += [f"{check.name}: {check.result}" for check in found.checks if check.passed is False]
    first = found.findings[0] if found.findings else None
    if first is None:
        outcome = HEALTHY if found.healthy else UNNAMED
    else:
        lines = map(int, re.findall(rf"{program.module}\.py:(\d+)", first.evidence))
        outcome = RIGHT if first.fault in program.accept or not program.lines.isdisjoint(lines) else WRONG
    word, seconds = None if first is None else found.certainty(first).word, time.process_time() - begin
    return Seen(program.module, mark(program), program.kind, outcome, word, examination_verdict(found), said, seconds)


def shared(hits: int, count: int) -> str:
    """A share and its exact 95 % interval; empty of none."""
    if not count:
        return ""
    low, high = share_interval(hits / count, count)
    return f"{hits / count:.0%} ({low:.0%} to {high:.0%})"


def _right(outcomes: list[str]) -> list[str]:
    """How many, how many of these right, and their share; of a sound tracker none is."""
    right = outcomes.count(RIGHT)
    return [str(len(outcomes)), str(right), shared(right, len(outcomes))]


def page(name: str, programs: Sequence[Program], seen: dict[str, Seen]) -> str:
    found = [seen[program.module] for program in programs]
    faulty = [one for one in found if one.kind != "sound"]
    rows = []
    for kind in (*KINDS, "all"):
        outcomes = [one.outcome for one in faulty if kind in (one.kind, "all")]
        counts = [str(outcomes.count(outcome)) for outcome in OUTCOMES]
        rows.append([kind, str(len(outcomes)), *counts, shared(outcomes.count(RIGHT), len(outcomes))])
    silent = [one for one in found if one.kind == "sound"]
    blamed = [one for one in silent if one.outcome != HEALTHY]
    lines = [f"# The set `{name}`: what the doctor says", ""]
    lines += table(["kind", "faults", *OUTCOMES, "share right"], rows)
    words = [word for word in get_args(Word) if any(one.word == word for one in found)]
    rows = [[f"`{word}`", *_right([one.outcome for one in found if one.word == word])] for word in words]
    lines += ["", *table(["first finding", "findings", "right", "share right"], rows)]
    lines += [f"Sound ones and bases faulted: {len(blamed)} of {len(silent)}, {shared(len(blamed), len(silent))}.", ""]
    harm = {program.module: program.entry.harm for program in programs if isinstance(program.entry, Fault)}
    hidden = [one.module for one in faulty if one.outcome == HEALTHY and (harm[one.module] or [np.inf])[0] >= 2]
    lines += [f"With at least twice the error, and said healthy: {', '.join(hidden) or 'none'}.", ""]
    lines += [f"Median of {np.median([one.seconds for one in found]):.1f} CPU s an examination.", "", "## Misses", ""]
    for program, one in zip(programs, found, strict=True):
        if one.outcome != (HEALTHY if one.kind == "sound" else RIGHT):
            lines += [f"### {one.module} ({one.kind}): {one.outcome}", "", one.verdict, ""]
            if one.module in harm:
                accepted = ", ".join(program.accept)
                lines += [f"{program.entry.said} Accepted: {accepted}. Harm: {harm[one.module]}.", ""]
            lines += [f"- {words}" for words in one.said] + [""] * bool(one.said)
    return "\n".join(lines)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("set")
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--out", type=Path, help="default: the terminal")
    arguments.add_argument("--log", type=Path, help="a line of JSON for each program")
    given = arguments.parse_args()
    programs = [*faults(given.set), *sound(given.set), *bases(given.set)]
    kept = given.log.read_text(encoding="utf-8").splitlines() if given.log and given.log.exists() else []
    seen = {one.module: one for one in (Seen(**json.loads(line)) for line in kept)}
    todo = [program for program in programs if program.module not in seen or seen[program.module].text != mark(program)]
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        for one in pool.map(examine, todo):
            print(f"{one.module}: {one.outcome}: {one.said[:1]}", flush=True)
            seen[one.module] = one
            if given.log:
                with given.log.open("a", encoding="utf-8") as log:
                    log.write(json.dumps(asdict(one)) + "\n")
    text = page(given.set, programs, seen)
    print(text) if given.out is None else given.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
