"""One car of many has a reference: tracks on no object are nobody's business."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackbench.metrics.traffic import OF_FALSE_TRACKS

Cli = Callable[..., Any]
IGNORED = ("--set", "truth.reference={others: ignored}")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The boxes of one car, and tracks of it and of seven others, with a gap and a switch of the car's track."""
    time = np.arange(0, 30, 0.1)
    cars = [pd.DataFrame({"time": time, "id": car, "x": 12 * time + 7 * car, "y": 4.0 * car}) for car in range(8)]
    cars[0].to_csv(tmp_path / "boxes.csv", index=False)
    own = cars[0].assign(y=0.3)[(time < 10) | (time >= 12)]
    own = own.assign(id=np.where(own.time < 20, 0, 99))
    own.to_csv(tmp_path / "target.csv", index=False)
    pd.concat([own, *cars[1:]]).to_csv(tmp_path / "traffic.csv", index=False)
    return tmp_path


def metrics_of(cli: Cli, *arguments: str) -> dict[str, dict[str, dict[str, Any]]]:
    done = cli("score", "target.csv", "traffic.csv", "--truth", "boxes.csv", "--json", "--no-recording", *arguments)
    assert done.status == 0, done.err
    return {item["name"]: item["metrics"] for item in json.loads(done.out)["trackers"]}


def test_the_other_cars_do_not_change_a_score(files: Path, cli: Cli) -> None:
    counted, ignored = metrics_of(cli), metrics_of(cli, *IGNORED, "--out", "ignored")
    assert counted["traffic"]["false_tracks"]["value"] == pytest.approx(14, rel=0.01)
    assert counted["traffic"]["gospa"]["value"] > 3 * counted["target"]["gospa"]["value"]
    for path, own in ignored["target"].items():
        if path == "step_time":
            continue
        assert ignored["traffic"][path] == own, path
        if path in OF_FALSE_TRACKS:
            assert own["value"] is None
            assert own["reason"] == "tracks on no object are ignored (truth.reference.others)"
        elif not path.startswith("nees"):
            # The one tracked car has no false track, so that all else is as where these count.
            assert own["value"] == counted["target"][path]["value"], path
    assert ignored["traffic"]["matched_share"]["value"] == pytest.approx(280 / 300)
    assert ignored["traffic"]["id_switches"]["value"] == pytest.approx(2, rel=0.01)
    assert ignored["traffic"]["gospa_missed"]["value"] == pytest.approx(np.sqrt(12.5 * 20 / 300))


def test_it_is_said_and_a_gate_of_false_tracks_is_not_kept(files: Path, cli: Cli) -> None:
    done = cli("score", "traffic.csv", "--truth", "boxes.csv", "--no-recording", *IGNORED)
    assert "no score counts false tracks" in " ".join(done.out.split())
    done = cli("score", "traffic.csv", "--truth", "boxes.csv", "--no-recording", *IGNORED, "--gate", "false_tracks:1")
    assert done.status == 1
    assert "tracks on no object are ignored" in done.out
    done = cli("run", "results/boxes.yaml", "--set", "truth.reference.others=counted")
    assert done.status == 2
    assert "'counted' is not known; choose from: ignored" in done.err
