"""Whatever is in a file of tracks or of recorded traffic, or in a log in MCAP, it is read, or refused in one line."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from tests.fuzz.mutations import cases, edited_bytes, edited_mcap, edited_table, edited_text
from tests.support.mcap_files import write_tracks
from tests.support.ros_bags import Messages, write_bag
from tests.support.traffic_files import OPTIONS, WRITERS

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.runner.external_tracks import tracks_at_instants
from trackbench.truth.tracks import TRAFFIC_FORMATS

TIME = np.arange(41) * 0.1
#: As another program writes them: tracks with covariances in MCAP, and bags.
OTHERS = ("mcap tracks", "ros odometry", "ros markers", "ros detections", "ros mcap")


def sound(form: str, folder: Path) -> Path:
    """A file without damage, perhaps with others beside it."""
    if form == "mcap tracks":
        rows = TRAFFIC_FORMATS["csv"]().rows(WRITERS["csv"](folder)).ordered(folder)  # type: ignore[attr-defined]
        columns = {name: np.zeros(len(rows)) for name in ("vx", "vy")}
        write_tracks(type(rows)(rows.id, rows.time, rows.px, rows.py, **columns), folder / "tracks.mcap")
        return folder / "tracks.mcap"
    if form in OTHERS:
        make = Messages()
        kind = {"ros odometry": make.odometry, "ros markers": make.markers}.get(form, make.detections)
        return write_bag(folder, [("/a", kind(0.1 * k)) for k in range(41)], mcap=form == "ros mcap")
    return WRITERS[form](folder)


def damage(chance: random.Random, file: Path, raw: bytes) -> None:
    """Write the file again, with damage of one kind."""
    file.write_bytes(raw)
    if file.suffix == ".parquet" and chance.random() < 0.5:
        pq.write_table(edited_table(chance, pq.read_table(file)), file)
    elif file.suffix in (".csv", ".txt", ".xml", ".yaml") and chance.random() < 0.6:
        file.write_text(edited_text(chance, raw.decode()), encoding="utf-8", errors="surrogatepass")
    elif file.suffix == ".mcap" and chance.random() < 0.8:
        file.write_bytes(edited_mcap(chance, raw))
    else:
        file.write_bytes(edited_bytes(chance, raw))


def messages_of(form: str, folder: Path, read: Callable[[], Any]) -> list[str]:
    """What is said of each case that is refused."""
    files = [file for file in folder.rglob("*") if file.is_file()]
    whole = {file: file.read_bytes() for file in files}
    messages: list[str] = []
    for case in cases(5):
        chance = random.Random(f"{form} {case}")
        chosen = chance.choice(files)
        damage(chance, chosen, whole[chosen])
        try:
            read()
        except InputError as error:
            messages.append(str(error))
        chosen.write_bytes(whole[chosen])
    assert all(0 < len(message) < 1000 for message in messages)
    return messages


def as_tracks(form: str, file: Path) -> None:
    """The rows at the instants of a scene."""
    reader: Any = TRAFFIC_FORMATS[form](**OPTIONS.get(form, {}))
    filed = tracks_at_instants(reader.rows(file).ordered(file), TIME, 0.0)
    there = filed.history.ids >= 0
    assert np.isfinite(filed.history.mean[:2][:, there]).all()


def as_traffic(form: str, file: Path) -> None:
    """The truth of a scenario, perhaps repaired."""
    truth = {"source": "recorded-traffic", "format": form, "path": str(file), "observer": {"x": 5, "y": -5}}
    truth |= {**OPTIONS.get(form, {}), "audit": "repair"}
    sensors = {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2}}
    moved = tb.truth(
        yaml.safe_dump({"name": "a", "truth": truth, "sensors": sensors, "trackers": {"raw": {"use": "raw"}}})
    )
    assert np.isfinite(moved.px[moved.alive]).all()


@pytest.mark.parametrize("form", [*WRITERS, *OTHERS])
@pytest.mark.filterwarnings("error")
def test_a_damaged_file_of_tracks_is_one_line(form: str, tmp_path: Path) -> None:
    file = sound(form, tmp_path)
    form, _, _ = form.partition(" ")
    if hasattr(TRAFFIC_FORMATS[form], "rows"):
        assert all("\n" not in message for message in messages_of(form, tmp_path, partial(as_tracks, form, file)))
    assert messages_of(form, tmp_path, partial(as_traffic, form, file))
