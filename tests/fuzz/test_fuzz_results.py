"""Whatever is in the folder of a run, or of several, it is read, reported and shown, or refused in one message."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest
from tests.fuzz.conftest import Tried
from tests.fuzz.mutations import cases, damage
from tests.support.past_results import past

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.compare import load_comparison
from trackbench.report.comparison.document import comparison_document
from trackbench.subjects.recording import viewer

FORMATS = ["terminal", "html", "markdown", "latex", "csv", "svg"]


@pytest.fixture
def whole(tried: Tried, tiny: Path, tmp_path: Path) -> Path:
    """Folders ``base`` and ``other`` of two runs, their comparison and an examination."""
    for name in ("base", "other"):
        assert tried(-1, "run", tiny, "--out", name, "--runs", "3", statuses=(0, 1)) in (0, 1)
    assert tried(-1, "compare", "base/tiny", "other/tiny", "--out", "base/comparison.json") == 0
    assert tried(-1, "doctor", f"{tiny}#ekf", "--out", "base/examination", statuses=(0, 1)) in (0, 1)
    return tmp_path / "base"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_mutated_results(whole: Path, tried: Tried, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "pictures", lambda file, times: [file.read_bytes()])
    files = sorted(file for file in whole.rglob("*") if file.suffix in (".json", ".parquet", ".rrd"))
    # Each recording takes a process of its own to be read.
    weights = [8 if file.suffix == ".json" else 1 if file.suffix == ".rrd" else 3 for file in files]
    refused = 0
    for case in cases(40):
        chance = random.Random(case)
        folder = tmp_path / "damaged"
        shutil.copytree(whole, folder, dirs_exist_ok=True)
        (file,) = chance.choices(files, weights)
        _damage(chance, folder / file.relative_to(whole), whole)
        if file.suffix != ".rrd" and chance.random() < 0.9:
            # Such a run is read from its tables.
            (folder / "tiny" / "recording.rrd").unlink()
        commands = _commands(chance, file.relative_to(whole))
        for arguments in chance.sample(commands, 2) if len(commands) > 2 else commands:
            refused += tried(case, *arguments) == 2
        shutil.rmtree(folder)
    assert refused > 0


def _damage(chance: random.Random, file: Path, whole: Path) -> None:
    kind = chance.random()
    if kind < 0.05:
        file.unlink()
    elif kind < 0.1:
        shutil.copy(chance.choice([other for other in whole.rglob("*") if other.is_file()]), file)
    else:
        damage(chance, file)


def _commands(chance: random.Random, damaged: Path) -> list[list[str]]:
    """Commands that read the damaged file."""
    form = ["--format", chance.choice(FORMATS), "--out", "report"]
    if damaged.parts[0] == "comparison.json":
        return [["report", "damaged/comparison.json", *form]]
    if damaged.parts[0] == "examination":
        return [["report", "damaged/examination", *form], ["snapshot", "damaged/examination", "--at", "1", "out.png"]]
    run = "damaged/tiny"
    moment = chance.choice([[], ["--worst"], ["--at", "1"], ["--worst", "2"]])
    whole = ["--vehicle", "v1"] if chance.random() < 0.3 else []
    if damaged.suffix == ".rrd":
        return [["inspect", run, *moment], ["snapshot", run, "--worst", "1", *whole, "out.png"]]
    others = chance.choice(
        [["other/tiny"], [run], [run, "--metric", "nees.mean"], ["other", "--metric", "velocity_rmse"]]
    )
    picture = ["snapshot", run, "--at", "1", *whole, "out.png"]
    return [["compare", run, *others], ["compare", run], ["report", run, *form], ["inspect", run, *moment], picture]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("kept", [False, True], ids=["results", "kept"])
def test_damaged_results_over_time_are_one_line(kept: bool, tmp_path: Path) -> None:
    nights = [tmp_path / f"night{number}" for number in range(3)]
    for number, (night, kf) in enumerate(zip(nights, (0.1, 0.1, 0.14), strict=True)):
        past(number, {"raw": 0.2, "kf": kf}).save(night)
    file = tmp_path / "comparison.json"
    file.write_text(json.dumps(tb.compare(*nights).json()), encoding="utf-8")
    # Of tables the one that intervals are made of.
    files = [file] if kept else [*tmp_path.rglob("result.json")] * 5 + [*tmp_path.rglob("runs.parquet")]
    messages: list[str] = []
    for case in cases(20):
        chance = random.Random(case)
        chosen = chance.choice(files)
        raw = chosen.read_bytes()
        damage(chance, chosen)
        try:
            if kept:
                str(comparison_document(load_comparison(file)))
            else:
                str(tb.compare(*nights, limits={"position_rmse": 5}).report())
        except InputError as error:
            messages.append(str(error))
        chosen.write_bytes(raw)
    assert messages
    assert [message for message in messages if not 0 < len(message) < 1000 or "\n" in message] == []
