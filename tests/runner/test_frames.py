"""How far it is from ``tb.run`` to the prediction of a built-in filter: what somebody reads who follows one step."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from types import FrameType
from typing import Any

import trackbench as tb

SOURCE = Path(tb.__file__).parent
FRAMES, FILES = 9, 6


def test_from_run_to_predict_there_are_few_frames_and_files() -> None:
    loaded = tb.load("highway", {"truth.duration_s": 3}, runs=2, trackers=["ekf_cv"])
    stack: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if (
            not stack
            and event == "call"
            and code.co_name == "predict"
            and Path(code.co_filename).parent.name == "filters"
        ):
            frames = [each for each in traceback.extract_stack(frame) if Path(each.filename).is_relative_to(SOURCE)]
            stack.extend((str(Path(each.filename).relative_to(SOURCE)), each.name) for each in frames)

    sys.setprofile(note)
    try:
        tb.run(loaded, engine="numpy", workers=1)
    finally:
        sys.setprofile(None)
    assert [stack[0][1], stack[-1][1]] == ["run", "predict"]
    assert len(stack) <= FRAMES, stack
    assert len({file for file, _ in stack}) <= FILES, stack
