"""``trackbench doctor``"""

from __future__ import annotations

import re
import sys
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click
import numpy as np

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.base.subjects import offered, resolve
from trackbench.cli.options import isolation_options
from trackbench.cli.terminal import progress
from trackbench.cli.tracker_name import require_tracker
from trackbench.results import EXAMINATION
from trackbench.scenario.source import parse

if TYPE_CHECKING:
    from trackbench.driving.isolation import Isolation
    from trackbench.subjects.doctor.evidence import EvidenceRun
    from trackbench.subjects.doctor.examine import Examination
    from trackbench.subjects.doctor.subject import ExaminedTracker
    from trackbench.testing.kinds import Identities

FOUND = 1
CANNOT_RUN = 3


@click.command("doctor")
@click.argument("tracker", metavar="TRACKER")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An argument of the tracker's class.")
@click.option(
    "--scenario",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Use the sensors and the observer of this scenario.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder of the files.  [default: results/doctor/TRACKER]",
)
@click.option(
    "--identities",
    type=click.Choice(["known", "hidden"]),
    help="hidden: a class that follows several objects.  [default: known]",
)
@click.option("--static-sensors", is_flag=True, help="The sensors stand still: nothing is tried with moving ones.")
@click.option("--no-misses", is_flag=True, help="Every scan has a detection: no others are given.")
@click.option(
    "--skip", multiple=True, metavar="CHECK", help="Leave a check out; `trackbench list checks` shows their names."
)
@isolation_options
@click.option("--all-checks", is_flag=True, help="Print the result of every check.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON, and nothing else.")
def doctor_command(
    tracker: str,
    options: tuple[str, ...],
    scenario: Path | None,
    out: Path | None,
    identities: Identities | None,
    static_sensors: bool,
    no_misses: bool,
    skip: tuple[str, ...],
    isolation: Isolation,
    all_checks: bool,
    as_json: bool,
) -> None:
    """Find the faults of a tracker, with evidence.

    TRACKER is SCENARIO#NAME, module:Class or a published name. It is tried on single measurements and on test
    drives, each of which shows one kind of fault, and compared with a reference.

    \b
    Examples:
      trackbench doctor highway#ekf_cv
      trackbench doctor my_tracker:Tracker --option sigma=3
      trackbench doctor my_tracker:Tracker --no-misses --skip gate
      trackbench doctor my_tracks:Tracker --identities hidden

    \b
    Exit status:
      0 healthy   1 faults found   2 bad input
      3 nothing could be asked   4 cannot write
    """
    from trackbench.driving.faults import TrackFault
    from trackbench.subjects.doctor.checks.steps import CannotRun
    from trackbench.subjects.doctor.other_kind import other_kind
    from trackbench.subjects.doctor.report.text import text
    from trackbench.subjects.doctor.subject import subject

    require_tracker(tracker)
    try:
        with _tracker_output():
            given = dict(_option(item) for item in options)
            examined = subject(tracker, given, scenario, isolation, identities)
    except TrackFault as fault:
        raise InputError(f"{tracker!r} does not start: {fault}") from fault
    stated = Stated(static_sensors, no_misses, skip)
    stated.require_fit(examined)
    folder = out or Path("results", "doctor", _file_name(examined.name))
    results.require_replaceable(folder, EXAMINATION)
    results.require_writable(folder.parent)
    for note in examined.notes:
        click.echo(f"{examined.name}: {note}", err=True)
    try:
        with _tracker_output():
            examination, evidence = _examine(examined, stated)
    except (CannotRun, TrackFault) as error:
        with _tracker_output():
            hint = "" if "#" in tracker else other_kind(tracker, given, isolation, hidden=examined.multi_object)
        if hint:
            raise InputError(hint, key="--identities") from error
        click.echo(f"{examined.name} cannot be examined: {error}", err=True)
        raise click.exceptions.Exit(CANNOT_RUN) from error
    written = _save(examination, evidence, folder)
    if as_json:
        click.echo(results.to_json(examination.json()), nl=False)
    else:
        click.echo(text(examination, every_check=all_checks))
        files = textwrap.fill(f"{folder}/: {', '.join(written)}", 80, break_long_words=False, break_on_hyphens=False)
        click.echo(f"\n{files}")
    raise click.exceptions.Exit(0 if examination.healthy else FOUND)


class Stated(NamedTuple):
    """What the user states of the tracker and its sensors."""

    static_sensors: bool
    no_misses: bool
    skip: tuple[str, ...]

    def require_fit(self, examined: ExaminedTracker) -> None:
        """Refuse what its examination does not have."""
        from trackbench.subjects.doctor.assumptions import require_known

        if not examined.multi_object:
            require_known(self.skip, examined.sensors, "--skip")
        elif self.no_misses or self.skip:
            option = "--no-misses" if self.no_misses else "--skip"
            raise InputError("only for a tracker of one object; this one follows several", key=option)


def _examine(examined: ExaminedTracker, stated: Stated) -> tuple[Examination, list[EvidenceRun]]:
    from trackbench.subjects.doctor.examine import Doctor
    from trackbench.subjects.doctor.traffic.examine import TrafficDoctor

    if examined.multi_object:
        with progress(f"examining {examined.name}", "parts") as advance:
            return TrafficDoctor(examined.sensors).examine(examined.name, examined.make, advance), []
    doctor = Doctor(examined.sensors, observer=examined.observer, **stated._asdict())
    with progress(f"examining {examined.name}", "steps") as advance:
        examination = doctor.examine(examined.name, examined.make, advance)
    with progress(f"showing what was found in {examined.name}", "steps") as advance:
        return examination, doctor.evidence(examination, examined.make, advance)


def _save(examination: Examination, evidence: Sequence[EvidenceRun], folder: Path) -> list[str]:
    from trackbench.document.html import to_html
    from trackbench.subjects.doctor.replay import examination_replay
    from trackbench.subjects.doctor.report import examination_document

    files = {
        EXAMINATION: partial(results.write_file, results.to_json(examination.json())),
        "report.html": partial(results.write_file, to_html(examination_document(examination, evidence))),
    }
    if evidence:
        replay = examination_replay(examination, evidence)
        files |= {name: partial(resolve(write), replay) for name, write in offered("replays")}
    results.save_files(files, folder, EXAMINATION)
    return list(files)


def _option(item: str) -> tuple[str, Any]:
    key, equals, value = item.partition("=")
    if not equals or not key.isidentifier():
        raise InputError(f"write KEY=VALUE, such as sigma=3, not {item!r}", key="--option")
    return key, parse(value, f"--option {item}").value


def _file_name(name: str) -> str:
    """The name without characters that a folder cannot have on some systems."""
    return re.sub(r"[^\w.-]+", "_", name).strip(".") or "tracker"


@contextmanager
def _tracker_output() -> Iterator[None]:
    """Send what the tracker prints to stderr, and drop its warnings: the checks look for the same faults."""
    with redirect_stdout(sys.stderr), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        yield
