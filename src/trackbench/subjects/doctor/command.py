"""The command ``trackbench doctor``."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import click

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.base.files import read_bytes
from trackbench.cli.answer import print_answer
from trackbench.cli.options import isolation_options, out_option
from trackbench.cli.terminal import progress
from trackbench.results import EXAMINATION
from trackbench.scenario.source import parse_yaml

if TYPE_CHECKING:
    from trackbench.driving.isolation import Isolation
    from trackbench.testing.rules import Identities

FOUND = 1
CANNOT_RUN = 3
#: Number of letters that are shown of the first line that a tracker prints.
FIRST = 200


@click.command("doctor")
@click.argument("tracker", metavar="TRACKER")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An argument of the tracker's class.")
@click.option(
    "--scenario",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Use the sensors and the observer of this scenario.",
)
@out_option("Folder for the files.  [default: results/doctor/TRACKER]")
@click.option(
    "--identities",
    type=click.Choice(["known", "hidden"]),
    help="hidden: a class that follows several objects.  [default: known]",
)
@click.option("--static-sensors", is_flag=True, help="The sensors stand still: no moving sensors are tried.")
@click.option("--no-misses", is_flag=True, help="Every scan has a detection: no scans without one are given.")
@click.option(
    "--skip", multiple=True, metavar="CHECK", help="Leave a check out; `trackbench list checks` shows their names."
)
@isolation_options
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
    as_json: bool,
) -> None:
    """Find the faults of a tracker, with evidence.

    TRACKER is SCENARIO#NAME, module:Class, a published name, or a program by its path. It is
    tried on single measurements and on test drives, each for one kind of fault, and compared with a
    reference.

    \b
    Examples:
      trackbench doctor highway#ekf_cv
      trackbench doctor my_tracker:Tracker --option sigma=3
      trackbench doctor my_tracker:Tracker --no-misses --skip process_noise
      trackbench doctor my_tracks:Tracker --identities hidden
      trackbench doctor "./my_tracker --q 2"

    \b
    Exit status:
      0 healthy   1 faults found   2 bad input
      3 nothing could be asked   4 cannot write
    """
    from trackbench.driving.faults import TrackFault
    from trackbench.subjects.doctor.api import doctor
    from trackbench.subjects.doctor.checks.steps import CannotRun
    from trackbench.subjects.doctor.report import examination_text

    require_tracker(tracker)
    name = tracker.rpartition("#")[2]
    # Some systems do not allow the other characters in the name of a folder.
    folder = out or Path("results", "doctor", re.sub(r"[^\w.-]+", "_", name).strip(".") or "tracker")
    results.require_replaceable(folder, EXAMINATION)
    results.require_writable(folder.parent)
    try:
        with fold_prints(), progress(f"examining {name}", "steps") as advance:
            examination = doctor(
                tracker,
                options=dict(_option(item) for item in options),
                scenario=scenario,
                identities=identities,
                static_sensors=static_sensors,
                no_misses=no_misses,
                skip=skip,
                in_process=isolation.in_process,
                tracker_timeout=isolation.timeout,
                tracker_memory=isolation.memory,
                progress=advance,
            )
    except InputError as error:
        if error.key in ("identities", "no_misses", "skip"):
            error.key = f"--{error.key.replace('_', '-')}"
        raise
    except (CannotRun, TrackFault) as error:
        click.echo(f"{name} cannot be examined: {error}", err=True)
        raise click.exceptions.Exit(CANNOT_RUN) from error
    for note in examination.notes:
        click.echo(f"{name}: {note}", err=True)
    written = examination.save(folder)
    if as_json:
        print_answer(results.json_text(examination.json()), nl=False)
    else:
        print_answer(examination_text(examination))
        files = textwrap.fill(f"{folder}/: {', '.join(written)}", 80, break_long_words=False, break_on_hyphens=False)
        print_answer(f"\n{files}")
    raise click.exceptions.Exit(0 if examination.healthy else FOUND)


@contextmanager
def fold_prints() -> Iterator[None]:
    """Print at the end, in one line, what trackers in processes of their own have printed."""
    from trackbench.driving.process import printing_to

    with TemporaryFile() as file:
        try:
            with printing_to(file):
                yield
        finally:
            file.seek(0)
            lines = file.read().decode(errors="replace").splitlines()
            if lines:
                first = textwrap.shorten(next(filter(str.strip, lines), ""), FIRST, placeholder=" ...")
                words = "a line" if len(lines) == 1 else f"{len(lines):,} lines; the first"
                click.echo(f"the tracker printed {words}: {first}", err=True)


def require_tracker(tracker: str) -> None:
    """Refuse a Python file in place of a class in it, and the folder of a run; run nothing in the file.

    Raises:
        InputError: a Python file, or the folder of a run, is named.
    """
    for run in Path(tracker).glob(f"**/{results.SUMMARY}") if Path(tracker).is_dir() else ():
        trackers = ", ".join(f"SCENARIO#{entry['name']}" for entry in json.loads(read_bytes(run))["trackers"])
        raise InputError(f"this is the folder of a run: name a tracker of its scenario: {trackers}", file=run.parent)
    file = Path(tracker) if tracker.endswith(".py") else Path(f"{tracker}.py")
    if ":" not in tracker and "#" not in tracker and file.is_file():
        raise InputError(f"name the class in it: {file.stem}:Class", file=file)


def _option(item: str) -> tuple[str, Any]:
    key, equals, value = item.partition("=")
    if not equals or not key.isidentifier():
        raise InputError(f"write KEY=VALUE, such as sigma=3, not {item!r}", key="--option")
    return key, parse_yaml(value, f"--option {item}").value
