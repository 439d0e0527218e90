"""Files that only some machines have."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.udacity import data_folder


@pytest.fixture
def recorded_traffic() -> Path:
    """The folder of recorded traffic."""
    folder = data_folder() / "recorded_traffic"
    if not folder.is_dir():
        pytest.skip("TRACKBENCH_DATA names no folder with recorded_traffic")
    return folder
