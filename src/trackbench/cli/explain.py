"""``trackbench explain``: the page of a term. ``python -m trackbench.cli.explain`` prints docs/glossary.md of them."""

from __future__ import annotations

import textwrap
from itertools import chain
from pathlib import Path

import click
import yaml

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.subjects import TermPage, collected, offered, resolve
from trackbench.cli.answer import print_answer
from trackbench.cli.listing import rows
from trackbench.metrics.registry import METRICS, metric_paths
from trackbench.metrics.verdicts import MEANING

WIDTH = 80
#: Of what a scenario can name, by the heading of its list.
LISTED = {
    "filters": "filter",
    "motion-models": "motion model",
    "sensor-effects": "sensor effect",
    "functions": "function",
    "worlds": "world",
}
#: Terms that the glossary leaves to the doctor's reference and the scenario file, by the first heading of their pages.
ELSEWHERE = {"fault", "check", "motion model", "sensor effect", "function", "world"}
GLOSSARY = """\
# Glossary

<!-- Made by `python -m trackbench.cli.explain`. Change cli/vocabulary.yaml and docstrings, not this page. -->

A reference: every word that a table, a report or an examination uses, in alphabetical order. `trackbench explain TERM`
prints the same. [Metrics](metrics.md) has the formulas, [the doctor's reference](doctor-reference.md) faults and
checks, [the scenario file](scenario-file.md) motion models, effects of sensors and functions, [Worlds](worlds.md) the
worlds."""


def terms() -> dict[str, list[TermPage]]:
    """Every term, by subject."""
    vocabulary = yaml.safe_load(Path(__file__).with_name("vocabulary.yaml").read_text(encoding="utf-8"))
    plain = {group: (group.removesuffix("s"), words.items()) for group, words in vocabulary.items()}
    plain |= {what: (kind, rows(what)) for what, kind in LISTED.items()}
    plain["verdicts"] = ("a verdict on a covariance", MEANING.items())
    own = {group: [TermPage(name, ((kind, text),)) for name, text in of] for group, (kind, of) in plain.items()}
    lines: dict[str, list[tuple[str, str]]] = {}
    for entry in metric_paths([*collected("examples_of_metrics"), *METRICS.loaded().values()]):
        better = f"{entry.better} is better" if entry.better else ""
        notes = ", ".join(filter(None, [entry.unit * (entry.unit != "1"), better]))
        lines.setdefault(entry.name.partition(".")[0], []).append(
            (entry.name, entry.meaning + f" [{notes}]" * bool(notes))
        )
    own["metrics"] = [TermPage(name, tuple(page)) for name, page in lines.items()]
    return own | {name: list(resolve(target)()) for name, target in offered("terms")}


def _wrapped(text: str) -> str:
    flat = " ".join(text.split())
    return textwrap.fill(flat, WIDTH, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)


def glossary() -> str:
    """All terms as one page."""
    pages: dict[str, list[TermPage]] = {}
    for term in chain.from_iterable(terms().values()):
        if term.page[0][0] in ELSEWHERE:
            continue
        pages.setdefault(term.name.lower(), []).append(term)
    sections, letter = [GLOSSARY], ""
    for name, same in sorted(pages.items(), key=lambda item: item[0].strip("/")):
        if (first := name.strip("/")[0].upper()) != letter:
            sections.append(f"## {(letter := first)}")
        sections.append(f"### {same[0].name}")
        for heading, text in dict.fromkeys(entry for term in same for entry in term.page):
            label = f"`{heading}`: " if heading.startswith(name) else f"*{heading}*: "
            sections.append(label * (heading not in ("term", name)) + " ".join(text.split()))
    return "\n\n".join(sections) + "\n"


@click.command("explain")
@click.argument("term", required=False)
def explain_command(term: str | None) -> None:
    """Print the page of a term: of the field, a metric, a verdict, a fault, a check.

    Without one, all terms by subject.

    \b
    Examples:
      trackbench explain NEES
      trackbench explain azimuth_not_wrapped
    """
    subjects = terms()
    if term is None:
        lists = (f"{subject}: {', '.join(term.name for term in of)}" for subject, of in subjects.items())
        print_answer("\n\n".join(map(_wrapped, lists)))
        return
    every = [*chain.from_iterable(subjects.values())]
    pages = [entry for entry in every if entry.name.lower() == term.lower()]
    if not pages:
        hint = nearest_choices(term.lower(), [entry.name for entry in every])
        known = hint if hint.startswith("did") else "`trackbench explain` lists them"
        raise InputError(f"there is no page on {term!r}: {known}")
    for entry in pages:
        paragraphs = [part for heading, text in entry.page for part in f"{heading}: {text}".split("\n\n")]
        print_answer("\n\n".join([entry.name, *map(_wrapped, paragraphs)]))


if __name__ == "__main__":
    print(glossary(), end="")
