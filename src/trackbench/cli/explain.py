"""``trackbench explain``: the page of a term. ``python -m trackbench.cli.explain`` prints docs/glossary.md."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click
import yaml

from trackbench.base.errors import InputError, did_you_mean, similar_names
from trackbench.base.subjects import TermPage, offered, resolve
from trackbench.cli.answer import print_answer
from trackbench.cli.listing import rows
from trackbench.metrics.verdicts import MEANING

#: Lists of `trackbench list` that are terms too, with the heading of their pages; empty for the name of each entry.
LISTED = {"filters": "filter", "worlds": "world", "metrics": ""}
GLOSSARY = """\
# Glossary

<!-- Made by `python -m trackbench.cli.explain`. Change cli/vocabulary.yaml and docstrings, not this page. -->

A reference: every word of a table, a report or an examination. `trackbench explain TERM` prints the same."""


def terms() -> dict[str, list[TermPage]]:
    """Return the pages of all terms, by group of terms, such as metrics or verdicts."""
    vocabulary = yaml.safe_load(Path(__file__).with_name("vocabulary.yaml").read_text(encoding="utf-8"))
    pages = {subject: _pages(subject.removesuffix("s"), words.items()) for subject, words in vocabulary.items()}
    pages |= {subject: _pages(heading, rows(subject)) for subject, heading in LISTED.items()}
    pages["verdicts"] = _pages("a verdict on a covariance", MEANING.items())
    return pages | {subject: list(resolve(target)()) for subject, target in offered("terms")}


def _pages(heading: str, entries: Iterable[tuple[str, str]]) -> list[TermPage]:
    """Return a page for each term; an entry such as ``rmse.px`` is on the page of ``rmse``."""
    pages: dict[str, list[tuple[str, str]]] = {}
    for path, text in entries:
        pages.setdefault(path.partition(".")[0], []).append((heading or path, text))
    return [TermPage(name, tuple(page)) for name, page in pages.items()]


def glossary() -> str:
    """Return the glossary page, with all terms in alphabetical order, as Markdown."""
    pages = [page for key, part in terms().items() if key not in ("faults", "checks", "worlds") for page in part]
    sections: dict[str, dict[str, None]] = {}
    for name, entries in sorted(pages, key=lambda page: page.name.strip("/").lower()):
        section = sections.setdefault(name.lower(), {f"## {name}": None})
        for heading, text in entries:
            label = f"*{heading}*: " if heading not in ("term", name) else ""
            section[label + " ".join(text.split())] = None
    return "\n\n".join([GLOSSARY, *(line for section in sections.values() for line in section)]) + "\n"


def _names(page: TermPage) -> list[str]:
    """Return the words that a page explains, in lower case: one, or several between commas."""
    return page.name.lower().split(", ")


@click.command("explain")
@click.argument("term", required=False)
def explain_command(term: str | None) -> None:
    """Print the page of a term, metric, verdict, fault or check; without one, list all of them by subject.

    \b
    Example:
      trackbench explain NEES
    """
    subjects = terms()
    pages = [page for listed in subjects.values() for page in listed]
    if term is None:
        paragraphs = [f"{subject}: {', '.join(page.name for page in listed)}" for subject, listed in subjects.items()]
    else:
        matching = [page for page in pages if term.lower() in _names(page)]
        paragraphs = [part for page in matching for part in (page.name, *map(": ".join, page.page))]
    if not paragraphs:
        near = did_you_mean(similar_names(str(term).lower(), [name for page in pages for name in _names(page)]))
        raise InputError(f"there is no page on {term!r}: {near or '`trackbench explain` lists them'}")
    print_answer("\n\n".join(click.wrap_text(text, 80, "", "  ", preserve_paragraphs=True) for text in paragraphs))


if __name__ == "__main__":
    print(glossary(), end="")
