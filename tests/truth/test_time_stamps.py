"""Time stamps of ISO 8601."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trackbench.base.errors import InputError
from trackbench.truth.config.columns import Column
from trackbench.truth.formats.tables import Csv, Parquet
from trackbench.truth.recorded.rows import TimeColumn, rows_of_columns

START = Decimal(1_714_564_800)  # 2024-05-01 12:00 UTC


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2024-05-01T12:00:00Z", "0"),
        ("2024-05-01T12:00:00.25Z", "0.25"),
        ("2024-05-01T12:00:00.123456789Z", "0.123456789"),
        ("2024-05-01T04:30:00-0730", "0"),
        ("2024-05-01 13:00:00+01", "0"),
        ("2024-05-01 12:00:00.000001 UTC", "0.000001"),
        ("20240501T120001Z", "1"),
        ("2024-05-01t12:00z", "0"),
        (" 2024-05-01T12:00:00 ", "0"),
    ],
)
def test_spellings_of_a_time_stamp(text: str, seconds: str) -> None:
    clock = times([text])
    assert clock.first - START == Decimal(seconds)


def times(cells: list[str | None]) -> TimeColumn:
    return rows_of_columns(Path("a.csv"), {"time": cells}).times(Column("time"))


@pytest.mark.parametrize("text", ["2024-05-01", "12:00:00Z", "2024-13-01T00:00:00Z", "2024-05-01T25:00:00", None])
def test_what_is_no_time_stamp(text: str | None) -> None:
    with pytest.raises(InputError, match="row 1: time is"):
        times([text])


def test_random_time_stamps_keep_their_nanoseconds_and_their_order() -> None:
    random = np.random.default_rng(7)
    whole = random.integers(0, 4_000_000_000, 300).tolist()
    nanoseconds = random.integers(0, 1_000_000_000, 300).tolist()
    for second, nanosecond, minutes in zip(whole, nanoseconds, random.integers(-840, 840, 300).tolist(), strict=True):
        local = datetime.fromtimestamp(second, UTC) + timedelta(minutes=minutes)
        sign, (hours, rest) = "+-"[minutes < 0], divmod(abs(minutes), 60)
        clock = times([f"{local:%Y-%m-%dT%H:%M:%S}.{nanosecond:09d}{sign}{hours:02d}:{rest:02d}"])
        assert clock.first == Decimal(second) + Decimal(nanosecond).scaleb(-9)


def table(stamps: list[Any]) -> str:
    return "time,id,x,y\n" + "".join(f"{stamp},1,{row},0\n" for row, stamp in enumerate(stamps))


def test_tables_have_time_stamps(tmp_path: Path) -> None:
    stamps = pd.to_datetime(START_NS + np.array([0, 100_000_001, 1_200_000_000]), utc=True)
    (tmp_path / "zulu.csv").write_text(table([stamp.isoformat().replace("+00:00", "Z") for stamp in stamps]))
    (tmp_path / "cest.csv").write_text(table([stamp.tz_convert("Europe/Berlin").isoformat() for stamp in stamps]))
    (tmp_path / "local.csv").write_text(table([stamp.tz_localize(None).isoformat(sep=" ") for stamp in stamps]))
    frame = pd.DataFrame({"time": stamps, "id": 1, "x": 0.0, "y": 0.0})
    frame.to_parquet(tmp_path / "zulu.parquet")
    frame.assign(time=stamps.tz_convert("Asia/Tokyo")).to_parquet(tmp_path / "tokyo.parquet")
    frame.assign(time=stamps.tz_localize(None)).to_parquet(tmp_path / "local.parquet")
    frame.assign(time=frame.time.map(str)).to_parquet(tmp_path / "text.parquet")
    for file in sorted(tmp_path.iterdir()):
        rows = (Csv if file.suffix == ".csv" else Parquet)().rows(file)
        assert rows.start == START, file.name
        np.testing.assert_allclose(rows.time, [0, 0.100000001, 1.2], atol=1e-9, err_msg=file.name)


START_NS = int(START) * 1_000_000_000


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_parquet_has_time_stamps_of_any_unit(tmp_path: Path, unit: str) -> None:
    per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    stamps = pa.array([int(START) * per_second, (int(START) + 2) * per_second], pa.timestamp(unit, tz="UTC"))
    pq.write_table(pa.table({"time": stamps, "id": [1, 1], "x": [0.0, 1.0], "y": [0.0, 0.0]}), tmp_path / "a.parquet")
    rows = Parquet().rows(tmp_path / "a.parquet")
    assert (rows.start, rows.time.tolist()) == (START, [0.0, 2.0])


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (["2024-05-01T12:00:00Z", "1.5"], "time is no time of ISO 8601: '1.5'"),
        (["0.5", "2024-05-01T12:00:01"], "time is not a finite number: '2024-05-01T12:00:01'"),
        (["2024-05-01T12:00:00Z", "01.05.2024"], "time is no time of ISO 8601: '01.05.2024'"),
        (["2024-05-01T12:00:00Z", ""], "time is no time of ISO 8601: ''"),
    ],
)
def test_mixed_time_stamps_are_refused_with_their_line(tmp_path: Path, stamps: list[str], message: str) -> None:
    file = tmp_path / "tracks.csv"
    file.write_text(table(stamps))
    with pytest.raises(InputError, match=message) as caught:
        Csv().rows(file)
    assert caught.value.line == 3
