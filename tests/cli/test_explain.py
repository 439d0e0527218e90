"""``trackbench explain``"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from trackbench.cli.explain import terms
from trackbench.metrics.registry import metric_paths
from trackbench.metrics.verdicts import CONSISTENCY, TRUST
from trackbench.subjects.doctor.findings import known_faults, questions


def test_every_term_of_a_table_and_an_examination_has_a_page() -> None:
    names = {term.name for of in terms().values() for term in of}
    metrics = {field.name.partition(".")[0] for field in metric_paths()}
    words = {"diverged", "group", "shown", "likely", "unclear"}
    assert names >= {*metrics, *known_faults(), *questions(), *CONSISTENCY, *TRUST, *words}


@pytest.mark.parametrize(
    ("term", "said"),
    [
        ("velocity_rmse", "velocity_rmse: "),
        ("GOSPA_missed", "gospa_missed: "),
        ("azimuth_not_wrapped", "found by: azimuth_wrapping"),
        ("noise_per_step", "finds: q_constant_per_step"),
        ("worse", "it is shown to exceed the margin"),
        ("not shown", "take more runs or scenes"),
        ("undecided", "too few runs or scenes to say"),
        ("Margin", "The largest difference of two trackers that does not matter"),
        ("optimistic", "the errors are larger than its covariance states"),
    ],
)
def test_a_page(cli: Callable[..., Any], term: str, said: str) -> None:
    done = cli("explain", term)
    assert (done.status, done.err) == (0, "")
    assert said in " ".join(done.out.split())


def test_without_a_term_all_are_listed(cli: Callable[..., Any]) -> None:
    done = cli("explain")
    assert [line.partition(":")[0] for line in done.out.splitlines() if line[:1].strip()] == [*terms()]


@pytest.mark.parametrize(
    ("term", "said"),
    [("azimuth_not_wraped", "did you mean 'azimuth_not_wrapped'?"), ("?", "`trackbench explain` lists them")],
)
def test_an_unknown_term_names_the_nearest(cli: Callable[..., Any], term: str, said: str) -> None:
    done = cli("explain", term)
    assert (done.status, done.out) == (2, "")
    assert done.err == f"there is no page on {term!r}: {said}\n"


def test_checks_of_trackers_of_several_objects_are_listed(cli: Callable[..., Any]) -> None:
    shown = cli("list", "checks").out
    assert all(f"{term.name}  " in shown or f"{term.name}\n" in shown for term in terms()["checks"])
