"""``trackbench explain``: the page of a term that a table, a report or an examination uses."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator
from itertools import product

import click

from trackbench.base.errors import InputError, nearest
from trackbench.base.subjects import TermPage, offered, resolve

WIDTH = 80
#: What computes a metric, by the first part of its name: its docstring has the formula and the source.
FORMULAS = {
    "rmse": "trackbench.metrics.built_in.basic:RootMeanSquare",
    "nees": "trackbench.metrics.consistency:normalised_square",
    "nis": "trackbench.metrics.consistency:normalised_square",
    "whiteness": "trackbench.metrics.built_in.basic:Whiteness",
    "gospa": "trackbench.metrics.traffic.set_distances:gospa",
    "ospa": "trackbench.metrics.traffic.set_distances:ospa",
    "ospa2": "trackbench.metrics.traffic.set_distances:ospa2",
    "tgospa": "trackbench.metrics.traffic.tgospa:tgospa",
    "hota": "trackbench.metrics.traffic.mot_metrics:hota",
    "idf1": "trackbench.metrics.traffic.mot_metrics:identity",
    "mota": "trackbench.metrics.traffic.mot_metrics:clear_matches",
    "siap": "trackbench.metrics.traffic.track_quality:siap",
    "confirm_latency": "trackbench.metrics.traffic.track_quality:confirmation",
}
#: Those whose parts have the formula of the whole.
FAMILIES = {"deta": "hota", "assa": "hota", "motp": "mota"}
#: Of the other columns of a table.
TABLE = {
    "group": "The letters beside a metric. Between trackers that share a letter no difference beyond the stated margin "
    "is shown, at 95 % for all pairs together. Those without a common letter differ.",
    "/ref": "The error over that of the reference: the filter that knows the sensors' noise and assumes white "
    "acceleration, on the same measurements.",
}


def terms() -> dict[str, list[TermPage]]:
    """Every term, by subject."""
    own = {"metrics": list(_metrics()), "verdicts": list(_verdicts()), "tables": list(_table())}
    return own | {name: list(resolve(target)()) for name, target in offered("terms")}


def _metrics() -> Iterator[TermPage]:
    from trackbench.metrics.registry import METRICS, metric_paths

    own = list(METRICS.loaded().values())
    fields = metric_paths(metric for metric in own if metric.scores == "estimates")
    of_tracks = metric_paths((metric for metric in own if metric.scores == "tracks"), hidden=True)
    of_tracks += metric_paths(hidden=True, truth=False)
    lines: dict[str, dict[str, str]] = {}
    for hidden, entry in [*product([False], fields), *product([True], of_tracks)]:
        unit = f" [{entry.unit}]" if entry.unit not in ("", "1") else ""
        name = entry.name.partition(".")[0]
        where = "with hidden identities: " if hidden and entry.name in lines.get(name, {}) else ""
        lines.setdefault(name, {})[entry.name + " " * bool(where)] = f"{where}{entry.meaning}{unit}"
    for name, entries in lines.items():
        page = [(entry.strip(), text) for entry, text in entries.items()]
        families = (FAMILIES.get(name, name), name.partition("_")[0], name.rpartition("_")[2])
        page += [("formula", _formula(FORMULAS[family])) for family in families if family in FORMULAS][:1]
        yield TermPage(name, tuple(page))


def _formula(target: str) -> str:
    """The docstring of what computes it, without its arguments and without markup."""
    text = re.split(r"\n\n(?:Args|Returns|Raises):", inspect.getdoc(resolve(target)) or "")[0]
    return re.sub(r":\w+:`~?([^`]*)`", r"\1", text).replace("``", "")


def _verdicts() -> Iterator[TermPage]:
    from trackbench.metrics.verdicts import MEANING, TOLERANCE, WHITENESS_TOLERANCE, verdict

    source = "Schuirmann 1987" + (inspect.getdoc(verdict) or "").partition("Schuirmann 1987")[2].partition(")")[0]
    for word, meaning in MEANING.items():
        of = "share of the NEES beyond a point" if word == "heavy-tailed" else "mean NEES"
        right = "that of chi-square" if word == "heavy-tailed" else f"4 +- {100 * TOLERANCE:g} %"
        test = f"the 95 % interval of the {of} against {right}, an equivalence test ({source})"
        yield TermPage(word, (("a verdict on a covariance", meaning), ("test", test)))
    near = f"the correlation of successive innovations is within {WHITENESS_TOLERANCE:g} of zero"
    yield TermPage("white", (("a verdict on innovations", near),))
    yield TermPage("coloured", (("a verdict on innovations", near.replace("is within", "is shown to be beyond")),))
    from trackbench.metrics.registry import HEALTH, metric_paths

    diverged = next(field for field in metric_paths() if field.name == HEALTH + "diverged_runs")
    yield TermPage("diverged", ((diverged.name, diverged.meaning),))


def _table() -> Iterator[TermPage]:
    return (TermPage(name, (("in a table", text),)) for name, text in TABLE.items())


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


@click.command("explain")
@click.argument("term", required=False)
def explain_command(term: str | None) -> None:
    """Print the page of a term: a fault, a check, a metric or a verdict.

    Without one, all terms by subject.

    \b
    Examples:
      trackbench explain NEES
      trackbench explain azimuth_not_wrapped
    """
    subjects = terms()
    if term is None:
        click.echo("\n".join(_contents(subjects))[1:])
        return
    pages = [entry for of in subjects.values() for entry in of if entry.name.lower() == term.lower()]
    if not pages:
        raise InputError(f"there is no page on {term!r}: {_nearest(term, subjects.values())}")
    click.echo("\n\n".join(map(page, pages)))


def _nearest(term: str, subjects: Iterable[Iterable[TermPage]]) -> str:
    hint = nearest(term.lower(), [entry.name for of in subjects for entry in of])
    return hint if hint.startswith("did") else "`trackbench explain` lists them"
