"""A call that is begun in a copy of the process."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from trackbench.base.process import begun_beside

fork = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing is copied")


def printed(code: str) -> str:
    """What a process of one thread prints, as on a machine with two cores."""
    start = "import os; os.cpu_count = lambda: 2\nfrom trackbench.base.process import begun_beside\n"
    done = subprocess.run([sys.executable, "-c", start + code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


@fork
def test_another_process_makes_the_call_meanwhile() -> None:
    code = "made = begun_beside(lambda: (os.getpid(), 'x' * 10**6)); process, text = made()\n"
    assert printed(code + "print(process != os.getpid(), len(text))") == "True 1000000\n"


@fork
@pytest.mark.parametrize("end", ["os._exit(3)", "1 / 0", "os.kill(os.getpid(), 9)"])
def test_what_the_copy_does_not_give_is_made_here(end: str) -> None:
    code = f"""
own = os.getpid()
def call():
    if os.getpid() != own:
        {end}
    return "made here"
print(begun_beside(call)())
"""
    assert printed(code) == "made here\n"


@fork
def test_an_error_is_raised_where_the_result_is_asked_for() -> None:
    code = """
made = begun_beside(lambda: {}["missing"])
try:
    made()
except KeyError as error:
    print("raised", error)
"""
    assert printed(code) == "raised 'missing'\n"


def test_with_another_thread_nothing_is_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    try:
        assert begun_beside(os.getpid)() == os.getpid()
    finally:
        ended.set()
        thread.join()
