"""Options that subjects add to ``trackbench run``, and what follows a run because of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any, NamedTuple

from trackbench.api.plan import Listener
from trackbench.base.subjects import offered, resolve
from trackbench.scenario import Scenario

#: Of the options of all subjects, by parameter.
OptionValues = Mapping[str, Any]


class RunOptions(NamedTuple):
    """The options of a subject."""

    add: Callable[[Callable[..., Any]], Callable[..., Any]]
    """Decorates the command with Click options."""
    check: Callable[[Sequence[Scenario], OptionValues], None]
    """Raises an InputError for scenarios that the options do not fit."""
    follow: Callable[[OptionValues], AbstractContextManager[Listener | None]]
    """What follows the run, None without such an option; an InputError where the options contradict each other."""


def subject_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of all subjects to a command."""
    for options in _registered():
        command = options.add(command)
    return command


def check_options(scenarios: Sequence[Scenario], values: OptionValues) -> None:
    """Make sure that the options of all subjects fit the scenarios.

    Raises:
        InputError: they do not.
    """
    for options in _registered():
        options.check(scenarios, values)


@contextmanager
def followers(values: OptionValues) -> Iterator[list[Listener]]:
    """What follows the run.

    Raises:
        InputError: options contradict each other.
    """
    with ExitStack() as stack:
        every = [stack.enter_context(options.follow(values)) for options in _registered()]
        yield [listener for listener in every if listener is not None]


def _registered() -> Iterator[RunOptions]:
    for _, target in offered("run_options"):
        yield resolve(target)
