"""Whatever is in a file of tracks, its rows are taken to instants, or it is refused in one line."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from tests.fuzz.mutations import cases, edited_bytes, edited_table, edited_text
from tests.support.traffic_files import OPTIONS, WRITERS

from trackbench.base.errors import InputError
from trackbench.runner.filed_tracks import at_instants
from trackbench.truth.tracks import TRAFFIC_FORMATS

TIME = np.arange(41) * 0.1


def damaged(form: str, chance: random.Random, folder: Path) -> Path:
    file = WRITERS[form](folder)
    if form == "parquet" and chance.random() < 0.5:
        pq.write_table(edited_table(chance, pq.read_table(file)), file)
    elif form != "parquet" and chance.random() < 0.6:
        text = edited_text(chance, file.read_text(encoding="utf-8"))
        file.write_text(text, encoding="utf-8", errors="surrogatepass")
    else:
        file.write_bytes(edited_bytes(chance, file.read_bytes()))
    return file


@pytest.mark.parametrize("form", ["csv", "parquet", "motchallenge", "kitti"])
@pytest.mark.filterwarnings("error")
def test_a_damaged_file_of_tracks_is_one_line(form: str, tmp_path: Path) -> None:
    reader = TRAFFIC_FORMATS[form](**OPTIONS.get(form, {}))
    messages: list[str] = []
    for case in cases(60):
        file = damaged(form, random.Random(f"{form} {case}"), tmp_path)
        try:
            filed = at_instants(reader.rows(file).ordered(file), TIME, 0.0)
        except InputError as error:
            messages.append(str(error))
        else:
            there = filed.history.ids >= 0
            assert np.isfinite(filed.history.mean[:2][:, there]).all(), case
    assert len(messages) > 10
    assert all(0 < len(message) < 600 and "\n" not in message for message in messages)
