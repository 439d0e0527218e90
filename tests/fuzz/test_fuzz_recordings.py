"""Whatever is in a recorded log, it is read and run, or refused in one message."""

from __future__ import annotations

import csv
import io
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from tests.fuzz.conftest import Tried
from tests.fuzz.mutations import EXTREMES, cases, edited_bytes, edited_table, edited_text
from tests.support.udacity import synthetic_lines

HEAD = ["t", "who", "x", "y", "vx", "vy", "r", "az", "rr"]
ROWS = [
    [k * 0.05, name, x, y, 8.0, 0.5, math.hypot(x, y) + 0.1, math.atan2(y, x), (8 * x + 0.5 * y) / math.hypot(x, y)]
    for k in range(30)
    for i, name in enumerate(["a", "b"])
    for x, y in [(10 + 5 * i + 0.4 * k, 3 - 4 * i + 0.025 * k)]
]
#: Of the same motion as boxes, with a don't-care box; and detections with a false alarm in each scan.
BOX_HEAD = ["t", "who", "type", "x", "y", "vx", "vy", "yaw", "l", "w"]
BOXES = [[t, name, "car", x, y, vx, vy, 0.06, 4.5, 1.8] for t, name, x, y, vx, vy, *_ in ROWS]
SCAN_HEAD = ["t", "who", "r", "az", "rr"]
SCANS = [
    *([t, name, *polar] for t, name, _, _, _, _, *polar in ROWS),
    *([k * 0.05, "", 40.0 - k, 0.02 * k, -3.0] for k in range(30)),
]
UDACITY = "\n".join(synthetic_lines(40))
RADAR = {"type": "radar", "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1}
LIDAR = {"type": "lidar", "position_sigma_m": 0.15}
TRACKERS = {"raw": {"use": "raw"}, "ekf": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}}
COLUMNS = {"time": "t", "object": "who", "px": "x", "py": "y", "vx": "vx", "vy": "vy"}
READINGS = {"front": {"range": "r", "azimuth": "az", "range_rate": "rr"}}
BOX_COLUMNS = {**COLUMNS, "class": "type", "heading": "yaw", "length": "l", "width": "w"}
REFERENCE = {"range_m": 50, "classes": ["car"]}
GNN = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": "gnn"}}
#: Of the cases that are valid, these shares are run and audited.
RUN, AUDIT = 0.3, 0.1


def scenario(form: str, file: Path, name: str) -> dict[str, Any]:
    if form in ("boxes", "labels"):
        return of_boxes(file, name, labelled=form == "labels")
    truth = {"source": "recording", "format": form, "path": file.name}
    if form != "udacity":
        truth |= {"columns": COLUMNS, "readings": READINGS}
    lidar = LIDAR if form == "udacity" else {**LIDAR, "rate_hz": 10}
    sensors = {"front": RADAR, "roof": lidar}
    return {"name": name, "truth": truth, "sensors": sensors, "trackers": TRACKERS, "monte_carlo": {"runs": 1}}


def of_boxes(file: Path, name: str, *, labelled: bool) -> dict[str, Any]:
    """Hidden identities with a reference; where ``labelled``, a blank object is a false alarm."""
    readings = {"path": "scans.csv", **READINGS["front"], **({"object": "who"} if labelled else {})}
    truth = {"source": "recording", "format": "csv", "path": file.name, "columns": BOX_COLUMNS, "reference": REFERENCE}
    return {
        "name": name,
        "truth": {**truth, "readings": {"front": readings}},
        "sensing": {"identities": "hidden"},
        "sensors": {"front": {**RADAR, "fov_deg": 120, "max_range_m": 80, "occlusion": True}},
        "trackers": {"gnn": GNN},
        "monte_carlo": {"runs": 1},
    }


def udacity(chance: random.Random, file: Path) -> None:
    lines = [line.split() for line in UDACITY.splitlines()]
    if chance.random() < 0.5:
        _edit_cells(chance, lines)
        text = "\n".join(chance.choice([" ", "\t"]).join(map(str, line)) for line in lines)
        file.write_text(text, encoding="utf-8", errors="surrogatepass")
    else:
        _damaged(chance, UDACITY, file)


def comma_separated(chance: random.Random, file: Path) -> None:
    _table(chance, file, HEAD, ROWS)


def boxes(chance: random.Random, file: Path) -> None:
    """One of the two files is damaged."""
    tables = [(file, BOX_HEAD, BOXES), (file.with_name("scans.csv"), SCAN_HEAD, SCANS)]
    chance.shuffle(tables)
    _table(chance, *tables[0])
    sound, head, rows = tables[1]
    with sound.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([head, *rows])


def _table(chance: random.Random, file: Path, head: list[str], content: list[list[Any]]) -> None:
    rows: list[list[Any]] = [list(head), *map(list, content)]
    text = io.StringIO()
    if chance.random() < 0.5:
        _edit_cells(chance, rows)
        csv.writer(text, escapechar="\\").writerows(rows)
        file.write_text(text.getvalue(), encoding="utf-8", errors="surrogatepass")
    else:
        csv.writer(text).writerows(rows)
        _damaged(chance, text.getvalue(), file)


def parquet(chance: random.Random, file: Path) -> None:
    table = pa.table(dict(zip(HEAD, zip(*ROWS, strict=True), strict=True)))
    edited = chance.random() < 0.5
    pq.write_table(edited_table(chance, table) if edited else table, file)
    if not edited:
        file.write_bytes(edited_bytes(chance, file.read_bytes()))


def _edit_cells(chance: random.Random, rows: list[list[Any]]) -> None:
    for _ in range(chance.choice([1, 1, 2, 10])):
        row = chance.choice(rows)
        match chance.randrange(8):
            case 0:
                rows.remove(row) if len(rows) > 1 else None
            case 1:
                rows.insert(chance.randrange(len(rows)), list(row))
            case 2:
                row.append(chance.choice(EXTREMES))
            case _:
                if row:
                    row[chance.randrange(len(row))] = chance.choice(EXTREMES)


def _damaged(chance: random.Random, text: str, file: Path) -> None:
    if chance.random() < 0.5:
        file.write_text(edited_text(chance, text), encoding="utf-8", errors="surrogatepass")
    else:
        file.write_bytes(edited_bytes(chance, text.encode(), UDACITY.encode()))


FORMATS: dict[str, Callable[[random.Random, Path], None]] = {
    "csv": comma_separated,
    "parquet": parquet,
    "udacity": udacity,
}
OF_BOXES: dict[str, Callable[[random.Random, Path], None]] = {"boxes": boxes, "labels": boxes}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("forms", [FORMATS, OF_BOXES], ids=["labelled", "boxes"])
def test_mutated_recordings(
    tried: Tried, tmp_path: Path, forms: dict[str, Callable[[random.Random, Path], None]]
) -> None:
    valid = 0
    for form in forms:
        text = yaml.safe_dump(scenario(form, tmp_path / f"log.{form}", form))
        (tmp_path / f"{form}.yaml").write_text(text)
    for case in cases(50):
        chance = random.Random(case)
        form = chance.choice(list(forms))
        file = tmp_path / f"{form}.yaml"
        forms[form](chance, tmp_path / f"log.{form}")
        if tried(case, "check", file) == 0:
            valid += 1
            if chance.random() < RUN:
                writing = ["--no-recording"] if chance.random() < 0.8 else []
                tried(case, "run", file, *writing, statuses=(0, 2, 3))
            if chance.random() < AUDIT:
                tried(case, "audit", file, statuses=(0, 1, 2))
    assert valid > 0
