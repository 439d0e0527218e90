"""Whatever a tracker does, it fails alone: the others' numbers, the files and the exit status are as without it."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.udacity import telemetry

from trackbench.driving.isolation import Isolation
from trackbench.results import Result, json_text
from trackbench.scenario import load_scenario
from trackbench.subjects.serve.session import Client, TrackerError, load_served

TIMEOUT = 3.0

HEAD = """
import atexit, ctypes, faulthandler, gc, os, signal, subprocess, sys, threading, time, warnings
import numpy as np

GOOD = np.zeros(4), np.eye(4)


class Strange(BaseException):
    pass


class Mute(Exception):
    def __str__(self):
        raise RuntimeError("no text")


class Evil:
    def __array__(self, *args, **kwargs):
        os._exit(0)


def truth_in(frames):
    names = {"Truth", "Scene", "Work", "TrackerRun", "Targets", "LoadedTruth"}
    return any(type(value).__name__ in names for frame in frames for value in frame.f_locals.values())


class Base:
    def __init__(self):
        self.steps = 0

    def step(self, state, scan):
        self.steps += 1
        return state, (self.bad(scan) if self.steps == 3 else None) or GOOD
"""

# What a tracker does at its third step; how the cause of its failure starts, None where it goes on; and whether the
# line of its code is known.
STEPS: dict[str, tuple[str, str | None, bool]] = {
    "leaves": ("os._exit(0)", "its process ended itself, with status 0", True),
    "leaves_with_status": ("os._exit(7)", "its process ended itself, with status 7", True),
    "interrupts": ("raise KeyboardInterrupt", "KeyboardInterrupt", True),
    "ends_generators": ("raise GeneratorExit", "GeneratorExit", True),
    "stops_iteration": ("raise StopIteration", "StopIteration", True),
    "raises_strangely": ("raise Strange('odd')", "Strange: odd", True),
    "raises_without_text": ("raise Mute", "Mute", True),
    "raises_a_lot": ("raise ValueError('x' * 10**7)", "ValueError: xxx", True),
    "raises_control": ("raise ValueError('\\x1b[31mred\\x00')", "ValueError: [31mred", True),
    "raises_surrogate": ("raise ValueError('\\udcff')", "ValueError", True),
    "segfaults": ("ctypes.string_at(0)", "its process was killed by signal 11 (SIGSEGV)", True),
    "segfaults_silently": (
        "faulthandler.disable(); ctypes.string_at(0)",
        "its process was killed by signal 11 (SIGSEGV)",
        False,
    ),
    "aborts": ("os.abort()", "its process was killed by signal 6 (SIGABRT)", True),
    "kills_itself": ("os.kill(os.getpid(), signal.SIGKILL)", "its process was killed by signal 9 (SIGKILL)", False),
    "kills_its_group": ("os.killpg(0, signal.SIGKILL)", "its process was killed by signal 9 (SIGKILL)", False),
    "loops": ("while True: pass", "it gave no answer within 3 s", True),
    "sleeps_on": (
        "signal.signal(signal.SIGABRT, signal.SIG_IGN); time.sleep(1e6)",
        "it gave no answer within 3 s",
        False,
    ),
    "forces_the_scan_open": ("scan.measurement.base.setflags(write=True); scan.measurement.base[:] = 1e6", "", True),
    "moves_away": ("os.chdir('/')", None, False),
    "closes_stdout": ("os.closerange(1, 3)", None, False),
    "closes_everything": ("os.closerange(0, 4096)", "its process ended itself", False),
    "talks": ("print('x' * 10**5)", None, False),
    "babbles": ("[os.write(n, b'x' * 64) for n in range(3, 64) if is_pipe(n)]", "its output is no message", False),
    "looks_for_the_truth": (
        "assert not truth_in(sys._current_frames().values())\n        frame = sys._getframe()\n"
        "        while frame: assert not truth_in([frame]); frame = frame.f_back",
        None,
        False,
    ),
    "collects_the_truth": (
        "assert not {'Truth', 'Scene', 'Work'} & {type(value).__name__ for value in gc.get_objects()}",
        None,
        False,
    ),
    "breaks_numpy": ("np.asarray = np.shape = np.full = None", "TypeError", False),
    "forgets_modules": ("sys.modules.clear()", None, False),
    "changes_the_path": ("sys.path.clear()", None, False),
    "changes_the_environment": ("os.environ.clear()", None, False),
    "raises_for_numpy": ("np.seterr(all='raise'); np.ones(1) / 0", "FloatingPointError", True),
    "leaves_a_thread": (
        "threading.Thread(target=time.sleep, args=(1e6,)).start()",
        None,
        False,
    ),
    "leaves_a_child": (
        "subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1e6)'], close_fds=False); os._exit(3)",
        "its process ended itself, with status 3",
        True,
    ),
    "returns_much": ("return np.zeros((4, 10**6)), GOOD[1]", "the mean has the shape (4, 1000000)", False),
    "returns_evil": ("return Evil(), GOOD[1]", "its process ended itself, with status 0", True),
    "warns": ("warnings.simplefilter('error'); warnings.warn('careful')", "UserWarning: careful", True),
    "exits_later": ("atexit.register(os._exit, 5)", None, False),
}

EXTRA = """

def is_pipe(number):
    import fcntl, stat
    try:
        return stat.S_ISFIFO(os.fstat(number).st_mode) and fcntl.fcntl(number, fcntl.F_GETFL) & os.O_WRONLY
    except OSError:
        return False

"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory, write_module: Any, run_tiny: Callable[..., Result]) -> Result:
    """A run of all of them beside the tiny scenario's own trackers."""
    folder = tmp_path_factory.mktemp("hostile")
    code = HEAD + EXTRA
    for name, (body, _, _) in STEPS.items():
        code += f"class {name}(Base):\n    def bad(self, scan):\n        {body}\n"
    module = write_module(folder, code)
    before = Path.cwd()
    settings = [f"trackers.{name}.use={module}:{name}" for name in STEPS]
    result = run_tiny(*settings, folder=folder, isolation=Isolation(timeout=TIMEOUT))
    assert Path.cwd() == before
    return result


@pytest.mark.parametrize("name", STEPS)
def test_the_cause_and_the_line_are_reported(outcome: Result, name: str) -> None:
    _, cause, known = STEPS[name]
    failed = outcome[name].failed
    if cause is None:
        assert failed is None, failed
        return
    assert failed is not None
    assert failed.cause.startswith(cause)
    assert failed.cause.isprintable()
    # What it does to its own process may show at the next scan.
    assert failed.step in (1, 2)
    if known:
        assert failed.place is not None
        assert failed.place.endswith(", in bad") or "__array__" in failed.place


def test_the_others_have_the_numbers_that_they_have_alone(outcome: Result, tiny_result: Result) -> None:
    assert outcome.summary.fingerprints == tiny_result.summary.fingerprints
    for name in ("raw", "ekf"):
        found, alone = (result[name].metrics for result in (outcome, tiny_result))
        for metric in ("position_rmse", "velocity_rmse"):
            # Where one of them fails the sums of the others are added in another order.
            assert found[metric].value == pytest.approx(alone[metric].value, rel=1e-12)


def test_the_result_can_be_written(outcome: Result) -> None:
    json.loads(json_text(outcome.json()).encode("utf-8"))


#: What a module does when it is imported, or its class when it is made.
STARTS = {
    "leaves": "import os\nos._exit(0)\n",
    "segfaults": "import ctypes\nctypes.string_at(0)\n",
    "loops": "while True: pass\n",
    "raises": "raise BaseException('odd')\n",
    "interrupts": "raise KeyboardInterrupt\n",
}
CLASS = "class T:\n    def step(self, state, scan): ...\n"
MAKES = {
    "leaves": "    def __init__(self):\n        import os\n        os._exit(0)\n",
    "loops": "    def __init__(self):\n        while True: pass\n",
    "raises": "    def __init__(self):\n        raise BaseException('odd')\n",
    "batched_raises": "    @property\n    def batched(self):\n        raise KeyboardInterrupt\n",
}


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize("name", STARTS)
def test_a_module_that_cannot_be_imported(cli: Any, tiny: Path, write_module: Any, name: str, command: str) -> None:
    module = write_module(tiny.parent, STARTS[name] + CLASS)
    _use(tiny, f"{module}:T")
    done = cli(command, "tiny.yaml", "--tracker-timeout", str(TIMEOUT))
    assert done.status == 2
    assert done.err.startswith("tiny.yaml:15: trackers.raw.use: cannot ")
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize("name", MAKES)
def test_a_class_that_cannot_be_made(cli: Any, tiny: Path, write_module: Any, name: str) -> None:
    module = write_module(tiny.parent, CLASS + MAKES[name])
    _use(tiny, f"{module}:T")
    assert cli("check", "tiny.yaml").status == 0
    done = cli("run", "tiny.yaml", "--tracker-timeout", str(TIMEOUT))
    assert done.status == 2
    assert done.err.startswith("tiny.yaml:15: trackers.raw.use: ")
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("body", "cause"),
    [
        ("os._exit(0)", "its process ended itself, with status 0"),
        ("while True: pass", "it gave no answer within 3 s (see --tracker-timeout)"),
    ],
)
def test_the_doctor(cli: Any, tmp_path: Path, write_module: Any, body: str, cause: str) -> None:
    module = write_module(tmp_path, f"import os\nclass T:\n    def step(self, state, scan):\n        {body}\n")
    done = cli("doctor", f"{module}:T", "--tracker-timeout", str(TIMEOUT))
    assert done.status == 3
    # On a busy machine a line of progress comes first.
    *_, message = done.err.splitlines()
    assert message.startswith(f"{module}:T cannot be examined: {cause} ({module}.py:4, in step, at ")


def test_the_server(tmp_path: Path, write_module: Any) -> None:
    code = "import os\nclass T:\n    def step(self, state, scan):\n        os._exit(0)\n"
    module = write_module(tmp_path, code)
    file = tmp_path / "live.yaml"
    text = (
        "name: live\nscore: {settle_s: 0}\ntruth: {source: scripted, duration_s: 1, rate_hz: 10,\n"
        "  objects: {a: {start: {x: 9}, pieces: [{for_s: 1}]}}}\n"
        "sensors: {lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}}\n"
        f"trackers: {{mine: {{use: '{module}:T'}}}}\n"
    )
    file.write_text(text, encoding="utf-8")
    loaded = load_scenario(file)
    for _ in range(2):
        client = Client(load_served(loaded, "mine"), "client 1")
        with pytest.raises(TrackerError, match=r"^at measurement 1: its process ended itself, with status 0 \("):
            client.answer(telemetry("L\t1\t1\t0\t1\t1\t0\t0"))


def test_in_process_for_a_debugger(cli: Any, tiny: Path, write_module: Any) -> None:
    code = "import os\nclass T:\n    def step(self, state, scan):\n        raise ValueError(os.getpid())\n"
    _use(tiny, f"{write_module(tiny.parent, code)}:T")
    done = cli("run", "tiny.yaml", "--json", "--in-process")
    assert done.status == 3
    assert json.loads(done.out)["trackers"][0]["failed"]["cause"] == f"ValueError: {os.getpid()}"


#: What a tracker may do with its own streams, as anywhere.
STREAMS = {
    "prints": "print('said')",
    "prints in parts": "print('said'[:2], end=''); print('said'[2:], flush=True)",
    "reconfigures": "sys.stdout.reconfigure(encoding='utf-8', line_buffering=True); print('said')",
    "writes bytes": "sys.stdout.buffer.write(b'said\\n'); sys.stdout.buffer.flush()",
    "writes to the descriptor": "os.write(1, b'said\\n')",
    "writes to standard error": "sys.stderr.write('said\\n')",
    "reads to the end": "print('said', sys.stdin.read(), end='\\n')",
    "warns": "import warnings; warnings.warn('said')",
    "logs": "import logging; logging.getLogger('mine').warning('said')",
    "starts a program": "import subprocess; subprocess.run(['echo', 'said'], check=True)",
}


def test_its_own_streams_work_as_anywhere(tiny: Path, write_module: Any, trackbench: str) -> None:
    code = "import os, sys\nimport numpy as np\n"
    for number, body in enumerate(STREAMS.values()):
        code += f"class T{number}:\n    def step(self, state, scan):\n"
        code += f"        {body.replace('said', f'said{number};')}\n        return 0, (np.zeros(4), np.eye(4))\n"
    module = write_module(tiny.parent, code)
    command = [trackbench, "run", "tiny.yaml", "--json", "--no-recording", "--runs", "1"]
    for number in range(len(STREAMS)):
        command += ["--set", f"trackers.t{number}.use={module}:T{number}"]
    done = subprocess.run(command, cwd=tiny.parent, capture_output=True, text=True, check=False, timeout=120)
    assert [tracker["name"] for tracker in json.loads(done.stdout)["trackers"] if tracker["failed"]] == []
    for number, name in enumerate(STREAMS):
        assert f"said{number};" in done.stderr, name


def test_input_is_at_its_end(tiny: Path, cli: Any, write_module: Any) -> None:
    code = "class T:\n    def step(self, state, scan):\n        return input(), None\n"
    _use(tiny, f"{write_module(tiny.parent, code)}:T")
    (failed, *_) = json.loads(cli("run", "tiny.yaml", "--json", "--no-recording").out)["trackers"]
    assert failed["failed"]["cause"].startswith(
        "EOFError: EOF when reading a line (a process of its own has no terminal"
    )


def test_an_own_tracker_has_the_same_bits_in_either_process(
    run_tiny: Callable[..., Result], tmp_path: Path, write_module: Any
) -> None:
    code = (
        "import numpy as np\nfrom trackbench.trackers.raw import RawTracker\nclass T(RawTracker):\n    pass\n"
        "class One:\n    def step(self, state, scan):\n        n = (state or 0) + 1\n"
        "        return n, (np.array([n / 3, 1, 0, 0]), np.eye(4) * n)\n"
    )
    module = write_module(tmp_path, code)
    settings = [f"trackers.batch.use={module}:T", f"trackers.one.use={module}:One"]
    apart, together = (
        run_tiny(*settings, folder=tmp_path, isolation=Isolation(in_process=here)) for here in (False, True)
    )
    for name, table in apart.tables.items():
        for column in table.column_names:
            found, wanted = (each.tables[name][column].to_pandas() for each in (apart, together))
            if found.dtype == float:
                np.testing.assert_array_equal(found, wanted, err_msg=f"{name}: {column}")
            else:
                assert list(found) == list(wanted)


def _use(tiny: Path, use: str) -> None:
    text = tiny.read_text(encoding="utf-8").replace("use: raw", f'use: "{use}"')
    tiny.write_text(text.replace('["radar"', '["radar"]') if "sensors: [" in use else text, encoding="utf-8")


def test_a_copy_of_its_process_that_it_forks_does_not_answer(
    run_tiny: Callable[..., Result], tmp_path: Path, write_module: Any
) -> None:
    code = (
        "import os\nimport numpy as np\nclass T:\n    batched, steps, forks_at = True, 0, 3\n"
        "    def step(self, state, scan):\n"
        "        self.steps += 1\n        if self.steps == self.forks_at: os.fork()\n        n = scan.valid.size\n"
        "        return 0, (np.full((4, n), float(self.steps)), np.eye(4)[:, :, None] * np.ones(n))\n"
        "class Same(T):\n    forks_at = 0\n"
    )
    use = f"trackers.mine.use={write_module(tmp_path, code)}:T"
    apart = run_tiny(use, folder=tmp_path)["mine"]
    assert apart.failed is None
    together = run_tiny(use.replace(":T", ":Same"), folder=tmp_path, isolation=Isolation(in_process=True))["mine"]
    assert apart.metrics["position_rmse"].value == together.metrics["position_rmse"].value
