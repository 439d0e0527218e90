"""Files that a user names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any


def test_a_file_in_no_ones_home(cli: Callable[..., Any], tmp_path: Path) -> None:
    text = "name: a\ntruth: {source: recording, format: udacity, path: ~nobody_of_this_name/a.csv}\n"
    text += "sensors: {roof: {type: lidar, position_sigma_m: 1}}\ntrackers: {raw: {use: raw}}\nmonte_carlo: {runs: 1}\n"
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = cli("check", "a.yaml")
    assert done.status == 2
    assert "there is no file ~nobody_of_this_name/a.csv" in done.err
