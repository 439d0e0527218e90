"""Tuning on recorded logs: stretches of time are held out, or whole logs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.support.udacity import synthetic_lines

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.subjects.tuning.trial_sums import LogTime

SCENARIO = """
name: log
truth: {source: recording, format: udacity, path: PATH}
sensors:
  lidar: {type: lidar, position_sigma_m: 0.15}
  radar: {type: radar, range_sigma_m: 0.3, azimuth_sigma_deg: 1.718873, range_rate_sigma_mps: 0.3}
trackers:
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}
monte_carlo: {runs: 1}
"""
RANGE = ["acceleration_sigma_mps2=0.1:60"]


def scenario(folder: Path, path: str, *lines: int) -> tb.Scenario:
    (folder / "logs").mkdir()
    for number, count in enumerate(lines):
        (folder / "logs" / f"log{number}.txt").write_text("\n".join(synthetic_lines(count, seed=number)))
    (folder / "log.yaml").write_text(SCENARIO.replace("PATH", path))
    return tb.load(folder / "log.yaml")


def test_stretches_that_are_held_out_alternate_with_gaps_between_them() -> None:
    time = np.linspace(3.0, 63.0, 1201)
    train, test = (LogTime(2.0, held_out).stretch(time) for held_out in (False, True))
    whole = LogTime(2.0).stretch(time)
    assert set(whole) == set(range(15))
    assert set(train) == set(test) == {-1, 0, 1, 2, 3, 4}
    assert not ((train >= 0) & (test >= 0)).any()
    pieces = [(time[part == number][[0, -1]], held) for held, part in enumerate((train, test)) for number in range(5)]
    pieces.sort(key=lambda piece: piece[0][0])
    assert [held for _, held in pieces] == [0, 1] * 5
    ends = np.array([piece for piece, _ in pieces])
    assert (np.diff(ends, axis=1) >= 4.0 - 0.1 - 1e-9).all()
    assert (ends[1:, 0] - ends[:-1, 1] >= 2.0 - 1e-9).all()


def test_the_held_out_score_is_that_of_the_estimates_in_the_held_out_stretches(tmp_path: Path) -> None:
    loaded = scenario(tmp_path, "logs/log0.txt", 500)
    tuning = tb.tune(loaded, ["ekf"], ranges=RANGE, objective="position_rmse", trials=8)["ekf"]
    assert tuning.apart == ("other stretches of the same log",)
    trained = []
    for which, values in (("start", tuning.start), ("tuned", tuning.best.values)):
        q = values["acceleration_sigma_mps2"]
        result = tb.run(tb.load(tmp_path / "log.yaml", {"trackers.ekf.acceleration_sigma_mps2": q}))
        table = result.tables.estimates
        time, error, velocity = (
            table[name].to_numpy() for name in ("time_s", "position_error_m", "velocity_error_mps")
        )
        part = LogTime(1.0, held_out=True).stretch(time)
        for measure, errors in (("position_rmse", error), ("velocity_rmse", velocity)):
            (comparison,) = tuning.held_out.of(measure)
            expected = np.sqrt(np.mean(errors[part >= 0] ** 2))
            assert getattr(comparison, which).value == pytest.approx(expected, rel=1e-6)
            assert len(getattr(comparison, which).influence) == part.max() + 1 == 2
        train = LogTime(1.0, held_out=False).stretch(time)
        trained.append(np.sqrt(np.mean(error[train >= 0] ** 2)))
    assert math.exp(tuning.best.loss) == pytest.approx(trained[1] / trained[0], rel=1e-6)


def test_of_several_logs_every_second_is_held_out(tmp_path: Path) -> None:
    loaded = scenario(tmp_path, "[logs/log0.txt, logs/log1.txt, logs/log2.txt]", 300, 200, 200)
    tuning = tb.tune(loaded, ["ekf"], ranges=RANGE, trials=8)["ekf"]
    assert tuning.apart == ("other logs",)
    assert (tuning.train_scenes, tuning.held_out.scenes) == ((2,), {"log": 1})
    alone = tb.run(tb.load(tmp_path / "log.yaml", {"truth.path": "logs/log1.txt"}))
    (comparison,) = tuning.held_out.of("position_rmse")
    assert comparison.start.value == pytest.approx(alone["ekf"].position_rmse.value, rel=1e-9)
    assert comparison.difference.ci95 is not None
    with pytest.raises(InputError, match="every second log of log is held out"):
        tb.tune(loaded, ["ekf"], trials=8, train_scenes=1)


def test_a_log_too_short_to_hold_anything_out_says_so(tmp_path: Path) -> None:
    found = tb.tune(scenario(tmp_path, "logs/log0.txt", 180), ["ekf"], ranges=RANGE, trials=8)
    assert found.json()["scenarios"][0]["held_out"] is None
    assert "nothing could be held out; a second log in truth.path" in found.json()["trackers"][0]["verdict"]


def test_the_written_scenario_finds_the_logs_from_another_folder(tmp_path: Path) -> None:
    loaded = scenario(tmp_path, "[logs/log0.txt, logs/log1.txt]", 60, 60)
    out = tmp_path / "elsewhere" / "tuned.yaml"
    out.parent.mkdir()
    tb.tune(loaded, ["ekf"], ranges=RANGE, trials=2).save(out)
    assert len(tb.load(out).config.truth.scenes()) == 2
    assert tb.run(out).summary.fingerprints == tb.run(loaded).summary.fingerprints
