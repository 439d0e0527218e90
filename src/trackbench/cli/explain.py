"""``trackbench explain``: the page of a term. ``python -m trackbench.cli.explain`` prints docs/glossary.md of them."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import click
import yaml

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.subjects import TermPage, collected, offered, resolve
from trackbench.cli.answer import print_answer
from trackbench.cli.listing import rows

WIDTH = 80
#: Of what a scenario can name, by the heading of its list.
LISTED = {
    "filters": "filter",
    "motion-models": "motion model",
    "sensor-effects": "sensor effect",
    "functions": "function",
    "worlds": "world",
}
#: What computes a metric, by the first part of its name: its docstring has the formula and the source.
FORMULAS = {
    "rmse": "trackbench.metrics.built_in.basic:RootMeanSquare",
    "nees": "trackbench.metrics.consistency:normalised_square",
    "nis": "trackbench.metrics.consistency:normalised_square",
    "whiteness": "trackbench.metrics.built_in.basic:Whiteness",
    "gospa": "trackbench.metrics.traffic.set_distances:gospa",
    "ospa": "trackbench.metrics.traffic.set_distances:ospa",
    "tgospa": "trackbench.metrics.traffic.tgospa:tgospa",
    "hota": "trackbench.metrics.traffic.mot_metrics:hota",
    "idf1": "trackbench.metrics.traffic.mot_metrics:identity",
    "mota": "trackbench.metrics.traffic.mot_metrics:clear_matches",
    "confirm_latency": "trackbench.metrics.traffic.track_quality:confirmation",
}
#: Those whose parts have the formula of the whole.
FAMILIES = {"deta": "hota", "assa": "hota", "motp": "mota", "gospa_switch": "tgospa"}
#: Headings that the glossary leaves to the terminal.
LEFT_OUT = {"formula", "test", "to decide more", "every run is the same"}
#: Terms that the glossary leaves to the doctor's reference and the scenario file, by the first heading of their pages.
ELSEWHERE = {"fault", "check", "motion model", "sensor effect", "function"}
GLOSSARY = """\
# Glossary

<!-- Made by `python -m trackbench.cli.explain`. Change cli/vocabulary.yaml and docstrings, not this page. -->

A reference: every word that a table, a report or an examination uses, in alphabetical order. `trackbench explain TERM`
prints the same, with the formula and its source. [The doctor's reference](doctor-reference.md) has faults and checks,
[the scenario file](scenario-file.md) motion models, effects of sensors and functions."""


def terms() -> dict[str, list[TermPage]]:
    """Every term, by subject."""
    vocabulary = yaml.safe_load(Path(__file__).with_name("vocabulary.yaml").read_text(encoding="utf-8"))
    plain = {group: (group.removesuffix("s"), words.items()) for group, words in vocabulary.items()}
    plain |= {what: (kind, rows(what)) for what, kind in LISTED.items()}
    own = {group: [TermPage(name, ((kind, text),)) for name, text in of] for group, (kind, of) in plain.items()}
    own |= {"metrics": list(_metrics()), "verdicts": list(_verdicts())}
    return own | {name: list(resolve(target)()) for name, target in offered("terms")}


def _metrics() -> Iterator[TermPage]:
    from trackbench.metrics.registry import METRICS, metric_paths

    lines: dict[str, list[tuple[str, str]]] = {}
    for entry in metric_paths([*collected("examples_of_metrics"), *METRICS.loaded().values()]):
        notes = [
            *[entry.unit] * (entry.unit not in ("", "1")),
            *([f"{entry.better} is better"] if entry.better else []),
        ]
        unit = f" [{', '.join(notes)}]" if notes else ""
        lines.setdefault(entry.name.partition(".")[0], []).append((entry.name, f"{entry.meaning}{unit}"))
    for name, page in lines.items():
        families = (FAMILIES.get(name, name), name.partition("_")[0], name.rpartition("_")[2])
        page += [("formula", _formula(FORMULAS[family])) for family in families if family in FORMULAS][:1]
        yield TermPage(name, tuple(page))


def _formula(target: str) -> str:
    """The docstring of what computes it, without its arguments and without markup."""
    text = re.split(r"\n\n(?:Args|Returns|Raises):", inspect.getdoc(resolve(target)) or "")[0]
    return re.sub(r":\w+:`~?([^`]*)`", r"\1", text).replace("``", "")


def _verdicts() -> Iterator[TermPage]:
    from trackbench.metrics import verdicts

    stated = inspect.getdoc(verdicts.mean_verdict) or ""
    source = "Schuirmann 1987" + stated.partition("Schuirmann 1987")[2].partition(")")[0]
    near, far, below, above = (
        f"{100 * share:g} %" for share in (verdicts.TOLERANCE, verdicts.FAR_TOLERANCE, verdicts.BELOW, verdicts.ABOVE)
    )
    test = (
        f"an equivalence test ({source}) of 95 % intervals: the mean NEES within {near} of 4; under a condition, of "
        f"position or velocity alone, and along or across the motion from {below} below to {above} above; the shares "
        f"beyond points of chi-square within those of a covariance that is {near} wrong, beyond the far points {far}. "
        "Where the mean is undecided, one of the others may give the word."
    )
    for word, meaning in verdicts.MEANING.items():
        yield TermPage(word, (("a verdict on a covariance", meaning), ("test", test)))
    white = f"the correlation of successive innovations is within {verdicts.WHITENESS_TOLERANCE:g} of zero"
    yield TermPage("white", (("a verdict on innovations", white),))
    yield TermPage("coloured", (("a verdict on innovations", white.replace("is within", "is shown to be beyond")),))
    from trackbench.metrics.registry import HEALTH, metric_paths

    diverged = next(field for field in metric_paths() if field.name == HEALTH + "diverged_runs")
    yield TermPage("diverged", ((diverged.name, diverged.meaning),))


def page(term: TermPage) -> str:
    """A term for a terminal of 80 columns."""
    lines = [term.name]
    for heading, text in term.page:
        first, *rest = text.split("\n\n")
        lines += ["", *_wrapped(f"{heading}: {' '.join(first.split())}")]
        for paragraph in rest:
            lines += ["", *_wrapped(f"  {' '.join(paragraph.split())}")]
    return "\n".join(lines)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)


def _contents(subjects: dict[str, list[TermPage]]) -> Iterator[str]:
    for subject, of in subjects.items():
        yield from ["", *_wrapped(f"{subject}: {', '.join(term.name for term in of)}")]


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
        for heading, text in dict.fromkeys(entry for term in same for entry in term.page if entry[0] not in LEFT_OUT):
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
        print_answer("\n".join(_contents(subjects))[1:])
        return
    pages = [entry for of in subjects.values() for entry in of if entry.name.lower() == term.lower()]
    if not pages:
        raise InputError(f"there is no page on {term!r}: {_nearest(term, subjects.values())}")
    print_answer("\n\n".join(map(page, pages)))


def _nearest(term: str, subjects: Iterable[Iterable[TermPage]]) -> str:
    hint = nearest_choices(term.lower(), [entry.name for of in subjects for entry in of])
    return hint if hint.startswith("did") else "`trackbench explain` lists them"


if __name__ == "__main__":
    print(glossary(), end="")
