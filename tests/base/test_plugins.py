"""From a name in a scenario to a tracker."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from trackbench.base.errors import InputError
from trackbench.trackers.published import TRACKERS, create
from trackbench.trackers.raw import RawTracker

Write = Callable[[Path, str], str]

TRACKER = """
class Mine:
    def __init__(self, gain=1):
        self.gain = gain

    def step(self, state, scan):
        return state, None
"""
BUILT_IN = {"raw", "kf", "ekf", "iekf", "ukf", "ckf"}


def test_the_built_in_trackers_are_published() -> None:
    assert set(TRACKERS.names()) >= BUILT_IN
    assert TRACKERS.get("raw") is RawTracker
    for name in BUILT_IN - {"raw"}:
        make = create(name, {"motion": "cv", "acceleration_sigma_mps2": 3})
        assert callable(make().step)


def test_a_class_of_a_module(tmp_path: Path, write_module: Write) -> None:
    module = write_module(tmp_path, TRACKER + "class Outer:\n    Inner = Mine\n")
    make = create(f"{module}:Mine", {"gain": 3}, tmp_path)
    first, second = make(), make()
    assert first.gain == 3
    assert first is not second
    assert TRACKERS.get(f"{module}:Outer.Inner") is TRACKERS.get(f"{module}:Mine")


@pytest.mark.parametrize("written", ["{}", "{}.py", "{}.Mine"])
def test_a_class_that_is_named_without_its_colon(tmp_path: Path, write_module: Write, written: str) -> None:
    module = write_module(tmp_path, TRACKER)
    with pytest.raises(InputError, match=r'choose from: .*raw.* \(a class is named "module:Class"\)'):
        create(written.format(module), {}, tmp_path)


def test_a_module_of_another_name(tmp_path: Path, write_module: Write) -> None:
    module = write_module(tmp_path, TRACKER)
    with pytest.raises(InputError, match=f"no module named '{module}s' \\(looked in {tmp_path}, the working directory"):
        create(f"{module}s:Mine", {}, tmp_path)


def test_a_package_of_modules(tmp_path: Path, write_module: Write) -> None:
    package = write_module(tmp_path, "")
    (tmp_path / package).mkdir()
    (tmp_path / f"{package}.py").rename(tmp_path / package / "__init__.py")
    (tmp_path / package / "gains.py").write_text("GAIN = 4\n")
    code = TRACKER.replace("gain=1", "gain=GAIN")
    (tmp_path / package / "mine.py").write_text(f"from {package}.gains import GAIN\n{code}")
    assert create(f"{package}.mine:Mine", {}, tmp_path)().gain == 4


def test_the_scenario_s_folder_comes_before_the_working_directory(
    tmp_path: Path, write_module: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scenario").mkdir()
    module = write_module(tmp_path, "WHERE = 'here'\n" + TRACKER)
    (tmp_path / "scenario" / f"{module}.py").write_text("WHERE = 'scenario'\n" + TRACKER)
    elsewhere = write_module(tmp_path, TRACKER)
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    TRACKERS.get(f"{module}:Mine", tmp_path / "scenario")
    assert sys.modules[module].WHERE == "scenario"
    TRACKERS.get(f"{elsewhere}:Mine", tmp_path / "scenario")
    assert sys.path == before


def test_two_modules_of_one_name_are_not_confused(tmp_path: Path, write_module: Write) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    module = write_module(tmp_path / "a", TRACKER)
    (tmp_path / "b" / f"{module}.py").write_text(TRACKER)
    TRACKERS.get(f"{module}:Mine", tmp_path / "a")
    TRACKERS.get(f"{module}:Mine", tmp_path / "a")
    with pytest.raises(InputError, match="which has the same name: rename one") as caught:
        TRACKERS.get(f"{module}:Mine", tmp_path / "b")
    assert str(tmp_path / "b" / f"{module}.py") in str(caught.value)


def test_a_published_name(tmp_path: Path, write_module: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """What an installed package leaves behind: a folder of metadata on the path."""
    module = write_module(tmp_path, TRACKER)
    info = tmp_path / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        f"[trackbench.trackers]\nmine = {module}:Mine\ngone = {module}:Gone\nlost = no_such_module:Lost\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert create("mine", {"gain": 5})().gain == 5
    with pytest.raises(InputError, match="no tracker is published as 'min': did you mean 'mine'"):
        TRACKERS.get("min")
    with pytest.raises(InputError, match=r"cannot import 'gone': AttributeError: .* 'Gone'"):
        TRACKERS.get("gone")
    with pytest.raises(InputError, match="cannot import 'lost': no module named 'no_such_module'"):
        TRACKERS.get("lost")


@pytest.mark.parametrize(
    ("use", "message"),
    [
        ("", r"no tracker is published as ''.*module:Class"),
        (":", "cannot import ':'"),
        ("{}:", "module '{}' has no ''"),
        ("{}:Mine.Inner", "module '{}' has no 'Inner'"),
        (
            "{}:VALUE",
            "'{}:VALUE' is no tracker: it is neither a class nor a function",
        ),
        ("..:Mine", "cannot import '..:Mine'"),
        ("no such module:Mine", "cannot import 'no such module:Mine': no module named 'no such module'"),
        ("{}", "no tracker is published as '{}'"),
    ],
)
def test_what_cannot_be_found_says_why(tmp_path: Path, write_module: Write, use: str, message: str) -> None:
    module = write_module(tmp_path, TRACKER + "VALUE = 3\n")
    with pytest.raises(InputError, match=message.format(module)) as caught:
        TRACKERS.get(use.format(module), tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gian": 1}, "does not start with these options: got an unexpected keyword argument 'gian' .it takes: gain."),
        ({"motion": "cv"}, "acceleration_sigma_mps2: missing"),
        (
            {"motion": "cv", "acceleration_sigma_mps2": -1},
            "acceleration_sigma_mps2: -1 is not possible: it must be at least 1e-09",
        ),
    ],
)
def test_options_that_do_not_fit(tmp_path: Path, write_module: Write, options: dict[str, object], message: str) -> None:
    use = f"{write_module(tmp_path, TRACKER)}:Mine" if "gian" in options else "ekf"
    with pytest.raises(InputError, match=message):
        create(use, options, tmp_path)
