"""Whatever is in the results of a history, or in one that was kept, it is shown, or refused in one line."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest
from tests.fuzz.mutations import cases, damage
from tests.support.past_results import past

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.subjects.history.report import saved_document


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("kept", [False, True], ids=["results", "kept"])
def test_a_damaged_history_is_one_line(kept: bool, tmp_path: Path) -> None:
    for number, kf in enumerate((0.1, 0.1, 0.14)):
        past(number, {"raw": 0.2, "kf": kf}).save(tmp_path / f"night{number}")
    file = tmp_path / "history.json"
    file.write_text(json.dumps(tb.history(tmp_path).json()), encoding="utf-8")
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
                str(saved_document(file))
            else:
                str(tb.history(tmp_path, limits={"position_rmse": 5}).report())
        except InputError as error:
            messages.append(str(error))
        chosen.write_bytes(raw)
    assert messages
    assert [message for message in messages if not 0 < len(message) < 1000 or "\n" in message] == []
