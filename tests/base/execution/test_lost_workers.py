"""A plug-in that ends workers is named, and the run ends: of this machine, and of a cluster on it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from tests.support.hostile import OF_THE_BENCH, PLUG_INS, scenario

WHERE = ["--workers 2", "--cluster local:2"]
#: By kind of plug-in: what it does in a worker, how that is told, and whether the line is known.
ACTS = {
    "motion": ("posix._exit(0)", "ended itself, with status 0", True),
    "metric": ("ctypes.string_at(0)", "was killed by signal 11 (SIGSEGV)", True),
    "sensor": ("os.kill(os.getpid(), signal.SIGKILL)", "was killed by signal 9 (SIGKILL)", False),
}


@pytest.mark.slow
@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("kind", ACTS)
def test_a_plug_in_that_ends_workers_is_named(tmp_path: Path, trackbench: str, where: str, kind: str) -> None:
    act, cause, known = ACTS[kind]
    (tmp_path / "plug.py").write_text(PLUG_INS.replace("{act}", act) + OF_THE_BENCH, encoding="utf-8")
    (tmp_path / "plugged.yaml").write_text(scenario(kind), encoding="utf-8")
    command = [trackbench, "run", "plugged.yaml", "--no-recording", "--quiet", "--runs", "4000", *where.split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=240)
    place = " (plug.py:19, in misbehave)" if known else ""
    how = "a second worker has ended" if "workers" in where else "2 of 2 workers have ended"
    assert done.stderr == (
        f"trackbench: no result: {how}: its process {cause}{place}, while 'plug:{kind}' was at work\n"
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert list((tmp_path / "results").iterdir()) == []
