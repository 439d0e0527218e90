"""Files that a user names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any


def test_a_file_in_no_ones_home(cli: Callable[..., Any], tmp_path: Path) -> None:
    text = "name: a\ntruth: {source: recording, format: csv, path: ~nobody_of_this_name/a.csv, columns: {time: t}}\n"
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = cli("check", "a.yaml")
    assert done.status == 2
    assert "Could not determine home directory" in done.err
