"""The clock of the machine may jump: no number and no deadline depends on it."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

#: s; a step backwards with each look at the clock, and one forwards by more than any timeout.
JUMPS = {"back": -3600.0, "forth": 86_400.0}


def without_times(result: dict[str, Any]) -> str:
    """A result as text, without how long a step took and which command it was."""
    for tracker in result["trackers"]:
        tracker["metrics"].pop("step_time")
    other = ("command", "truth", "artifacts", "provenance")
    return json.dumps({key: value for key, value in result.items() if key not in other})


@pytest.mark.parametrize("jump", JUMPS)
def test_a_run_while_the_clock_jumps(
    cli: Callable[..., Any],
    tiny: Path,
    write_module: Callable[[Path, str], str],
    monkeypatch: pytest.MonkeyPatch,
    jump: str,
) -> None:
    code = "import numpy as np\nclass T:\n    def step(self, state, scan):\n"
    code += "        return 1, (np.full(4, np.nansum(scan.measurement)), np.eye(4))\n"
    arguments = ["run", "tiny.yaml", "--json", "--tracker-timeout", "60", "--set"]
    arguments.append(f"trackers.own.use={write_module(tiny.parent, code)}:T")
    wanted = cli(*arguments)
    looks = itertools.count()
    monkeypatch.setattr(time, "time", lambda: 1.8e9 + JUMPS[jump] * next(looks))
    done = cli(*arguments)
    assert (done.status, wanted.status) == (0, 0), done.err
    assert without_times(json.loads(done.out)) == without_times(json.loads(wanted.out))
