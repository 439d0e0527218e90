"""Options and arguments that several commands share, and options that subjects add."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import click

from trackbench.base.errors import did_you_mean, shortened_text, similar_names
from trackbench.base.execution import MOST_WORKERS
from trackbench.base.numbers import stated_number
from trackbench.base.subjects import offered, resolve
from trackbench.cli.answer import kept_path
from trackbench.engine.choice import ENGINE_NAMES

if TYPE_CHECKING:
    from trackbench.api.plan import Listener
    from trackbench.compare.comparison import GateOutcome
    from trackbench.report.junit import Suite
    from trackbench.scenario import Scenario

#: Exit status where an expectation or a limit was not met.
FAILED_EXPECTATION = 1


def junit_option(summary: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the decorator that adds ``--junit FILE`` to a command, with ``summary`` as its help."""
    return click.option("--junit", type=click.Path(path_type=Path), metavar="FILE", help=summary)


def write_suites(suites: Sequence[Suite], junit: Path | None) -> None:
    """Write test cases as JUnit XML to the file ``junit``; None writes nothing."""
    from trackbench.report.junit import to_xml
    from trackbench.results import write_bytes

    if junit is not None:
        write_bytes(kept_path(junit), to_xml(suites).encode())


def end_with_limits(outcomes: Sequence[GateOutcome], status: int = 0) -> NoReturn:
    """Exit with status 0 if tests prove every limit on a difference kept, else with 1; print the reason on stderr.

    Args:
        outcomes: outcome of the statistical test of each limit, such as "passed".
        status: exit status for another failure, such as a failed tracker, which has precedence; 0 for none.

    Raises:
        click.exceptions.Exit: always.
    """
    from trackbench.compare.limits import exit_line

    status = status or (0 if all(outcome == "passed" for outcome in outcomes) else FAILED_EXPECTATION)
    if outcomes:
        click.echo(exit_line(outcomes, status), err=True)
    raise click.exceptions.Exit(status)


def out_option(summary: str, default: str | None = None) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the decorator that adds ``--out DIR`` to a command, with ``summary`` as its help."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        metavar="DIR",
        default=default,
        show_default=default is not None,
        help=summary,
    )


class NearestChoice(click.Choice[str]):
    """Click type of a choice of words, whose error message proposes the nearest word."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        words = [str(choice) for choice in self.choices]
        begun = [word for word in words if word.startswith(str(value))]
        hint = did_you_mean(begun[:1] or similar_names(str(value), words))
        return f"{super().get_invalid_choice_message(value, ctx)} {hint[:1].upper()}{hint[1:]}".rstrip()


#: Type of the options ``--workers``.
WORKERS = click.IntRange(1, MOST_WORKERS)


class Finite(click.FloatRange):
    """Click type of a finite number in a range, written with the digits 0 to 9."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a text to a number; refuse NaN, infinities, underscores and digits of other scripts."""
        if not math.isfinite(stated_number(str(value).strip())):
            self.fail(f"{shortened_text(str(value), 40)!r} is not a finite number", param, ctx)
        return super().convert(value, param, ctx)


#: Option ``--engine``; the command gets its value as ``engine``.
engine_option = click.option(
    "--engine",
    type=NearestChoice(ENGINE_NAMES),
    default="auto",
    show_default=True,
    metavar="NAME",
    help="numpy, or fused (faster; needs trackbench[fast]).",
)


def isolation_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that limit plug-ins; the command gets them as ``isolation``, an ``Isolation``."""

    @click.option(
        "--tracker-timeout",
        type=Finite(0, 86_400, min_open=True),
        default=300,
        show_default=True,
        metavar="S",
        help="Longest time that your own tracker may take for a scan, s.",
    )
    @click.option(
        "--tracker-memory",
        type=Finite(0, min_open=True),
        metavar="GB",
        help="Most memory that your own tracker may take; default: a quarter of the machine's.",
    )
    @click.option("--in-process", is_flag=True, help="Run your own tracker in this process, for a debugger.")
    @functools.wraps(command)
    def wrapped(
        *arguments: Any, tracker_timeout: float, tracker_memory: float | None, in_process: bool, **options: Any
    ) -> Any:
        from trackbench.driving.isolation import Isolation

        return command(*arguments, isolation=Isolation(in_process, tracker_timeout, tracker_memory), **options)

    return wrapped


def artifact_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--no-NAME`` for each optional file of a run's folder; the command gets chosen files as ``left_out``."""
    offers = dict(offered("artifacts"))

    @functools.wraps(command)
    def wrapped(*arguments: Any, **options: Any) -> Any:
        left_out = frozenset(file for file in offers if options.pop(f"no_{Path(file).stem}"))
        return command(*arguments, left_out=left_out, **options)

    for file, offer in offers.items():
        wrapped = click.option(f"--no-{Path(file).stem}", is_flag=True, help=f"Do not write {offer.summary}.")(wrapped)
    return wrapped


#: Argument with one or more scenarios.
scenarios_argument = click.argument(
    "scenarios",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    metavar="SCENARIO...",
)


def names_in(text: str) -> list[str]:
    """Split an option's value such as ``A,B`` into names."""
    return [name for item in text.split(",") if (name := item.strip())]


#: Values of the options of all subjects, by parameter.
OptionValues = Mapping[str, Any]


class RunOptions(NamedTuple):
    """Options that a subject (optional part of the bench) adds to ``trackbench run``, and their effect on a run."""

    add: Callable[[Callable[..., Any]], Callable[..., Any]]
    """Decorator that adds the Click options to a command."""
    follow: Callable[[Sequence[Scenario], OptionValues], AbstractContextManager[Listener | None]]
    """Function from scenarios and option values to a context manager, which gives a listener to the run, or None if no
    option asks for one."""


def subject_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of all subjects (optional parts of the bench), such as ``--live``, to a command."""
    for options in _registered():
        command = options.add(command)
    return command


@contextmanager
def followers(scenarios: Sequence[Scenario], values: OptionValues) -> Iterator[list[Listener]]:
    """Yield a list of the listeners to the run that options of subjects, such as ``--live``, ask for.

    Raises:
        InputError: options contradict each other, or do not fit the scenarios.
    """
    with ExitStack() as stack:
        listeners = [stack.enter_context(options.follow(scenarios, values)) for options in _registered()]
        yield [listener for listener in listeners if listener is not None]


def _registered() -> Iterator[RunOptions]:
    for _, target in offered("run_options"):
        yield resolve(target)
