"""The search for the worst run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.subjects.envelope.conftest import Commanded, small

import trackbench as tb
from trackbench.base.execution import executor
from trackbench.subjects.envelope.api import FinishedEnvelope
from trackbench.subjects.envelope.config import Search as SearchConfig
from trackbench.subjects.envelope.mapping import EnvelopeMap
from trackbench.subjects.envelope.task import task_of
from trackbench.subjects.envelope.worst import Candidate, WorstSearch

pytest.importorskip("cma")

#: The car turns once, at 18 degrees a second more than a straight-on filter bears: a peak in three dimensions.
TURN: dict[str, Any] = {
    "truth": {
        "source": "scripted",
        "duration_s": 4,
        "rate_hz": 10,
        "objects": {
            "car": {
                "start": {"x": 20, "y": 5, "speed_mps": 10},
                "pieces": [{"for_s": 1}, {"for_s": 1.5, "turn_rate_degps": 0}, {"for_s": 1.5}],
            }
        },
    },
}
OVER: dict[str, Any] = {
    "turn": {"key": "truth.objects.car.pieces.1.turn_rate_degps", "from": -40, "to": 40},
    "speed": {"key": "truth.objects.car.start.speed_mps", "from": 1, "to": 30},
    "noise": {"key": "sensors.lidar.position_sigma_m", "from": 0.1, "to": 0.6},
}


def searching(runs: int, seed: int = 0, **changes: Any) -> WorstSearch:
    """Over the turn, the speed and the noise of the small scenario."""
    task = task_of(small(**TURN, **changes))
    search = SearchConfig.model_validate({"runs": runs, "axes": OVER, "seed": seed})
    with executor(1) as chosen:
        return WorstSearch(EnvelopeMap(task, chosen), task.requirements[0], search)


@pytest.mark.slow
def test_the_planted_worst_corner_is_found() -> None:
    """The error grows with speed, with the turn rate to either side, and with the noise."""
    looking = searching(160)
    candidate, value = looking.worst()
    turn, speed, noise = candidate.shares
    assert abs(turn - 0.5) > 0.4
    assert speed > 0.9
    corner = looking.values([Candidate((1.0, 1.0, 1.0), number) for number in range(20)])
    assert value > np.median(corner)
    assert noise > 0.2


@pytest.mark.slow
def test_it_is_worse_than_random_search_with_as_many_runs() -> None:
    runs = 120
    found, random = [], []
    for seed in range(3):
        looking = searching(runs, seed)
        found.append(looking.worst()[1])
        shares = np.random.default_rng(seed).uniform(size=(runs, 3))
        random.append(
            max(looking.values([Candidate(tuple(row), number) for number, row in enumerate(shares.tolist())]))
        )
    assert np.mean(found) > np.mean(random)


class Search(NamedTuple):
    """A search that was made."""

    looking: WorstSearch
    tried: list[Candidate]
    worst: tuple[Candidate, float]


def made_search(runs: int, seed: int) -> Search:
    """A search, with every run that it tried."""
    looking = searching(runs, seed)
    tried, values = list[Candidate](), looking.values
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(looking, "values", lambda group: (tried.extend(group), values(group))[1])
        return Search(looking, tried, looking.worst())


@pytest.fixture(scope="module")
def search() -> Search:
    """Of 24 runs."""
    return made_search(24, 0)


def test_it_is_the_same_every_time_and_another_seed_tries_others(search: Search) -> None:
    second, other = made_search(24, 0), made_search(24, 1)
    assert (search.tried, search.worst) == (second.tried, second.worst)
    assert search.worst[0] != other.worst[0]


def test_what_it_finds_is_a_run_of_the_product(search: Search) -> None:
    looking, _, (candidate, value) = search
    loaded = tb.load(small(**TURN).text, looking.changes(candidate))
    result = tb.run(loaded, workers=1)
    runs = result.to_pandas("runs").query("tracker == 'kf'")
    assert runs["position_rmse_m"].iloc[result.summary.recorded_run] == pytest.approx(value, rel=1e-12)


def test_the_budget_is_kept(search: Search) -> None:
    assert len(search.tried) == 24
    # The last of them are other seeds at the worst point, and each generation before has one seed.
    assert len({candidate.shares for candidate in search.tried[-3:]}) == 1
    assert len({candidate.number for candidate in search.tried[-3:]}) == 3


def test_the_claim_and_the_page_say_that_it_was_found_by_search(searched: FinishedEnvelope) -> None:
    (worst,) = searched.claim.worst
    assert worst.runs == 20
    assert worst.axes == ["sigma"]
    assert "found by search in 20 runs" in str(searched)
    assert "says nothing of how often" in str(searched)


def test_choices_are_no_axes_of_a_search() -> None:
    axes = {"kind": {"key": "sensors.lidar.type", "choices": ["lidar", "radar"]}}
    with pytest.raises(tb.InputError, match="goes over numbers"):
        tb.load(
            {**small().document.value, "envelope": {**small().document.value["envelope"], "search": {"axes": axes}}}
        )


def test_the_command_says_what_was_found(commanded: Commanded) -> None:
    done, place, _ = commanded
    out = " ".join(done.stdout.split())
    assert "found by search in 20 runs" in out
    assert "Nearest counter-examples" in out
    (folder,) = (place / "results" / "small-envelope" / "counter_examples").iterdir()
    assert (folder / "scenario.yaml").is_file()
    assert not (folder / "recording.rrd").exists()
