"""Every verdict on a tracker that starts later than another is on what they estimate, not on who starts first."""

import pytest
from tests.support.late_start import write_scene

import trackbench as tb
from trackbench.document.markdown import to_markdown

pytestmark = pytest.mark.slow

MINE = {"use": "alpha_beta:AlphaBeta", "options": {"alpha": 0.3}}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = write_scene(tmp_path_factory.mktemp("late_start"))

    def run_with(changes=(), **options):
        return tb.run(tb.load(path, {"expect": [], **dict(changes)}, **options))

    run_with.path = path
    return run_with


def test_the_covariance_of_the_one_is_judged_and_of_the_other_not(run):
    """Its fixed covariance is far too large; of the EKF the first estimates are missing, which may be the worst."""
    result = run()
    assert result["mine"].nees.verdict == "pessimistic"
    assert 0.95 < result["ekf"].metrics["coverage"].value < 0.99
    assert result["ekf"].nees.verdict == "undecided"
    assert "too many estimates are missing to say" in to_markdown(result.report().document)
    assert run({"score.settle_s": 1})["ekf"].nees.verdict != "undecided"


def test_of_two_versions_the_one_that_starts_later_is_better_and_passes(run):
    later, first = run(trackers=["ekf"]), run({"trackers.ekf": MINE}, trackers=["ekf"])
    for versions, verdict, outcome in (((first, later), "better", "passed"), ((later, first), "worse", "failed")):
        compared = tb.compare(*versions, limits={"position_rmse": 5})
        (item,) = compared.differences
        assert (item.verdict, item.paired_runs) == (verdict, 20)
        (gate,) = compared.gates
        assert gate.outcome == outcome


def test_so_it_is_over_the_stretches_of_a_single_run(run):
    (item,) = tb.compare(run({"truth.duration_s": 30}, runs=1, trackers=["ekf", "mine"])).differences
    assert (item.entrant.tracker, item.verdict) in (("ekf", "better"), ("mine", "worse"))


def test_a_version_that_changes_nothing_is_equivalent(run):
    nearly = {"use": "alpha_beta:AlphaBeta", "options": {"alpha": 0.3001}}
    (item,) = tb.compare(run(trackers=["mine"]), run({"trackers.mine": nearly}, trackers=["mine"])).differences
    assert item.verdict == "equivalent"


def test_tuned_values_are_judged_by_what_they_reach(run):
    tuned = tb.tune(
        tb.load(run.path, {"expect": [], "trackers.mine.options.alpha": 0.05}),
        ["mine"],
        objective="position_rmse",
        ranges=["options.alpha=0.05:0.9"],
        trials=4,
        train_runs=2,
        test_runs=8,
    )
    (item,) = tuned["mine"].held_out.of("position_rmse")
    assert item.verdict == "better"
