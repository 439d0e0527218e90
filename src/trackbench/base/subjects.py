"""Registry of the subjects (optional parts of the bench), with what each adds to the command line and the API.

Every package of ``trackbench.subjects`` lists its additions in a ``SUBJECT``, as strings, imported when they are used.
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
    """Addition of a subject (optional part of the bench): a command, a file of a run or a list, with its help text."""

    target: str
    """Import path ``module:attribute`` of the added object."""
    summary: str
    """Sentence for the help texts on what the added object does."""


class TermPage(NamedTuple):
    """Page of ``trackbench explain`` on one term."""

    name: str
    page: tuple[tuple[str, str], ...]
    """Sections of the page: pairs of a heading and a text, with an empty line between paragraphs."""


class FieldBlock(NamedTuple):
    """Top-level key of a scenario whose value is not a configuration class, such as a mapping by name."""

    type: Any
    field: Any
    """Pydantic field of the key, with its default value and its description."""
    EXAMPLE: str
    """Example of the key and its value, in lines of YAML."""


@dataclass(frozen=True)
class Subject:
    """Optional part of the bench beside the run of trackers, such as tuning: its commands, API calls and pages.

    Each value is an import target ``module:attribute``, alone or in an :class:`Offer`.
    """

    commands: Mapping[str, Offer] = field(default_factory=dict)
    """Click commands by name, each with the first sentence of its help."""
    api: Mapping[str, str] = field(default_factory=dict)
    """Import targets of the names that the subject adds to the API, ``trackbench.NAME``, by name."""
    lists: Mapping[str, Offer] = field(default_factory=dict)
    """Lists of ``trackbench list`` by name: functions that return rows (name, description), and a sentence about the
    list."""
    terms: Mapping[str, str] = field(default_factory=dict)
    """Groups of ``trackbench explain`` by heading: functions that return a :class:`TermPage` for each term."""
    documents: Mapping[str, Offer] = field(default_factory=dict)
    """Pages of ``trackbench report`` by the main file of a folder: functions that turn the file into a Document, each
    with a sentence about the page's formats."""
    artifacts: Mapping[str, Offer] = field(default_factory=dict)
    """Files in the folder of a run by name: functions ``(result, path)`` that write the file, each with a description
    of its content."""
    replays: Mapping[str, str] = field(default_factory=dict)
    """Replay files by name: functions that write a :class:`trackbench.document.replay.Replay` to a path."""
    blocks: Mapping[str, str] = field(default_factory=dict)
    """Top-level keys of a scenario, each with the class of its value, which has an ``EXAMPLE``, or a
    :class:`FieldBlock`."""
    examiners: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a scenario and a tracker's name, and return a sentence about a fault of the tracker, or None.
    Here and in the mappings of functions below, keys only tell the functions apart, unless their meaning is stated."""
    metrics: Mapping[str, str] = field(default_factory=dict)
    """Functions that return the metrics of a run, by the scenario's top-level key that they belong to. Arguments are
    the value of the key, and whether identities are hidden."""
    examples_of_metrics: Mapping[str, str] = field(default_factory=dict)
    """Functions that return an example of each kind of metric, by the heading under which they are listed."""
    checks: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a scenario and yield the problems of the subject's top-level keys."""
    records: Mapping[str, str] = field(default_factory=dict)
    """Functions that take the :class:`trackbench.runner.work.Work` of a run, its evaluated trackers and the tables of
    its recorded run, and yield the name of each table with its records."""
    sections: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and the styles of its trackers and yield sections of the report."""
    tables: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and yield tables for the terminal."""
    clauses: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and yield clauses of its verdict."""
    shown_metrics: Mapping[str, str] = field(default_factory=dict)
    """Functions that take a result and yield the paths of the metrics that the subject's sections show."""
    run_options: Mapping[str, str] = field(default_factory=dict)
    """Further options of ``trackbench run``, each a :class:`trackbench.cli.options.RunOptions`."""


@cache
def subjects() -> tuple[Subject, ...]:
    """Return all subjects (optional parts of the bench, such as tuning), sorted by name."""
    package = import_module(PACKAGE)
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__))
    return tuple(import_module(f"{PACKAGE}.{name}").SUBJECT for name in names)


def offered(kind: str) -> Iterator[tuple[str, Any]]:
    """Yield key and value of each item in the mapping ``kind`` of each subject (optional part of the bench).

    Args:
        kind: name of a field of :class:`Subject`, such as ``commands``.
    """
    for subject in subjects():
        yield from getattr(subject, kind).items()


def collected(kind: str, *arguments: Any) -> Iterator[Any]:
    """Yield all that the functions in the mapping ``kind`` of each subject (optional part of the bench) yield.

    Args:
        kind: name of a field of :class:`Subject` whose functions yield something, such as ``sections``.
        arguments: arguments of each function.
    """
    for _, target in offered(kind):
        yield from resolve(target)(*arguments)


def kind_of_file(file: str) -> str:
    """Return in words what a result file contains, from its name: "an examination" for ``examination.json``."""
    stem = file.rpartition(".")[0]
    return f"{'an' if stem[0] in 'aeiou' else 'a'} {stem}"


def resolve(target: str) -> Any:
    """Import and return the object that ``module:attribute`` names."""
    module, attribute = target.split(":")
    return getattr(import_module(module), attribute)
