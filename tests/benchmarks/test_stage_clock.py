"""The benchmark's clock of stages."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import stage_clock
from trackbench.engine.machine import unavailable


def test_every_stage_is_still_there():
    for places in stage_clock.STAGES.values():
        for module, _, path in (place.partition(":") for place in places):
            owner, attribute = stage_clock.owner_of(importlib.import_module(module), path)
            assert callable(getattr(owner, attribute)), (module, path)


def test_only_the_innermost_stage_counts():
    clock, burn = stage_clock.StageClock(), lambda: sum(range(300_000))
    inner = clock.timed("inner", lambda: [burn() for _ in range(8)])
    clock.timed("outer", lambda: (burn(), inner()))()
    spent = {stage: cpu for stage, (cpu, _) in clock.stop().items()}
    assert spent["inner"] > 2 * spent["outer"] > 0


@pytest.mark.skipif(unavailable() is not None, reason=unavailable() or "")
def test_a_command_is_timed_by_stage(tiny: Path):
    file = tiny.parent / "stages.json"
    command = [sys.executable, stage_clock.__file__, file, "run", "tiny.yaml", "--engine", "fused"]
    # Kernels are compiled where none is cached.
    environment = {**os.environ, "TRACKBENCH_CACHE": str(tiny.parent / "cache")}
    subprocess.run(command, cwd=tiny.parent, env=environment, check=True, capture_output=True)
    spent = json.loads(file.read_text(encoding="utf-8"))
    worked = set(stage_clock.STAGES) - {"comparison"}
    assert worked <= set(spent)
    assert all(cpu >= 0 and elapsed > 0 for cpu, elapsed in spent.values())
