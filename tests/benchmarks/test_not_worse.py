"""Tables name as good as the best whom the product does not call worse."""

from __future__ import annotations

from types import SimpleNamespace

from benchmarks.tuned.scores import best_and_not_worse
from benchmarks.worlds import _with_not_worse


class Errors(dict):
    """Errors by tracker, with the verdicts between them."""

    def __init__(self, verdicts: dict[tuple[str, str], str | None], **errors: float) -> None:
        super().__init__(
            {name: SimpleNamespace(position_rmse=SimpleNamespace(value=of)) for name, of in errors.items()}
        )
        self.differences = [
            SimpleNamespace(a=a, b=b, metric="position_rmse", better=better, verdict=better and f"{better} better")
            for (a, b), better in verdicts.items()
        ]


def test_a_tracker_with_a_larger_error_is_named_unless_it_is_called_worse() -> None:
    result = Errors({}, a=0.1, b=0.11, c=0.2)
    for pair, better in ((("a", "b"), ""), (("c", "a"), "a"), (("b", "c"), "")):
        result.differences += Errors({pair: better}).differences
    assert best_and_not_worse(result, "position_rmse", ["a", "b", "c"]) == {"best": "a", "not worse": ["b"]}


def test_nothing_is_said_of_what_is_not_judged() -> None:
    result = Errors({("a", "b"): None}, a=0.1, b=0.11)
    assert best_and_not_worse(result, "position_rmse", ["a", "b"]) == {"best": "a", "not worse": []}


def test_a_cell_names_trackers_without_their_world() -> None:
    assert _with_not_worse({"best": "a-ideal", "not worse": ["b-ideal", "c-ideal"]}, "-ideal") == "a (b, c)"
