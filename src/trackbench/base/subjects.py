"""The subjects, and what each adds to the command line and the API.

Every package of ``trackbench.subjects`` names what it has in a ``SUBJECT``, by strings: it is imported when it is used.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

PACKAGE = "trackbench.subjects"


class Offer(NamedTuple):
    """What a subject adds to the command line, the folder of a run or a list."""

    target: str
    """``module:attribute``."""
    summary: str
    """What the help says of it."""


class TermPage(NamedTuple):
    """A page of ``trackbench explain``."""

    name: str
    page: tuple[tuple[str, str], ...]
    """Each a heading and its text, whose paragraphs are apart by an empty line."""


class FieldBlock(NamedTuple):
    """A key of a scenario at its top level whose value is no class of its own, such as a mapping by name."""

    type: Any
    field: Any
    """A field of pydantic, with the default and the description."""
    EXAMPLE: str
    """Lines of YAML."""


@dataclass(frozen=True)
class Subject:
    """What a user comes for beside a run. Each value is ``module:attribute``, alone or in an :class:`Offer`."""

    commands: Mapping[str, Offer] = field(default_factory=dict)
    """By name: a Click command, and the first sentence of its help."""
    api: Mapping[str, str] = field(default_factory=dict)
    """By the name in ``trackbench``."""
    lists: Mapping[str, Offer] = field(default_factory=dict)
    """For ``trackbench list``: a function that gives rows of a name and a description, and a sentence on them."""
    terms: Mapping[str, str] = field(default_factory=dict)
    """For ``trackbench explain``, by the heading of a group: a function that gives a :class:`TermPage` for each."""
    documents: Mapping[str, Offer] = field(default_factory=dict)
    """By the main file of a folder, for ``trackbench report``: a function from that file to a Document, and what to
    know of its formats."""
    artifacts: Mapping[str, Offer] = field(default_factory=dict)
    """By the file in the folder of a run: a function ``(result, path)`` that writes it, and what it is."""
    replays: Mapping[str, str] = field(default_factory=dict)
    """By the file that it writes: a function of a :class:`trackbench.document.replay.Replay` and a path."""
    blocks: Mapping[str, str] = field(default_factory=dict)
    """Top-level keys of a scenario, each with the class of its value, which has an ``EXAMPLE``, or a
    :class:`FieldBlock`."""
    examiners: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a scenario and the name of one of its trackers and return a sentence on what is wrong with
    the tracker, or None. The names are free, as are those of all functions below."""
    metrics: Mapping[str, str] = field(default_factory=dict)
    """Keys of blocks, each with a function that takes the block, and whether identities are hidden, and returns the
    metrics of a run."""
    examples_of_metrics: Mapping[str, str] = field(default_factory=dict)
    """Headings of lists, each with a function that returns one metric of each kind."""
    checks: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a scenario and yield the problems of the subject's blocks."""
    records: Mapping[str, str] = field(default_factory=dict)
    """Functions that take the :class:`trackbench.runner.work.Work` of a run, its evaluated trackers, and what each
    tracker left of the recorded run, and yield the name of a table with its records."""
    sections: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and the styles of its trackers and yield sections of the report."""
    tables: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and yield tables for the terminal."""
    clauses: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and yield clauses of its verdict."""
    shown_metrics: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and yield the paths of the metrics that the subject's sections show."""
    run_options: Mapping[str, str] = field(default_factory=dict)
    """By any name: a :class:`trackbench.cli.options.RunOptions`, for ``trackbench run``."""


@cache
def subjects() -> tuple[Subject, ...]:
    """All of them, in the order of their names."""
    package = import_module(PACKAGE)
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__))
    return tuple(import_module(f"{PACKAGE}.{name}").SUBJECT for name in names)


def offered(kind: str) -> Iterator[tuple[str, Any]]:
    """What all subjects have of one kind, by name.

    Args:
        kind: a field of :class:`Subject`.
    """
    for subject in subjects():
        yield from getattr(subject, kind).items()


def collected(kind: str, *arguments: Any) -> Iterator[Any]:
    """Yield what the functions of all subjects yield, one subject after the other.

    Args:
        kind: a field of :class:`Subject` whose functions yield something.
        arguments: that each function is called with.
    """
    for _, target in offered(kind):
        yield from resolve(target)(*arguments)


def kind_of_file(file: str) -> str:
    """What a file of a subject holds, such as "an examination" for ``examination.json``."""
    stem = file.rpartition(".")[0]
    return f"{'an' if stem[0] in 'aeiou' else 'a'} {stem}"


def resolve(target: str) -> Any:
    """The object that ``module:attribute`` names."""
    module, attribute = target.split(":")
    return getattr(import_module(module), attribute)
