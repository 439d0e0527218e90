"""What ``make`` installs: versions with the hashes of their files, for every dependency, from any index."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from tests.support.places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PINNED = re.compile(r"^(?P<name>[\w.-]+)==(?P<version>\S+)(?: ; (?P<marker>.+?))?(?: \\)?$", re.MULTILINE)
HASH = re.compile(r"--hash=(sha256:[0-9a-f]{64})\b")
UV = Path(sys.executable).with_name("uv")


class Pin(NamedTuple):
    version: Version
    hashes: frozenset[str]
    marker: str | None


def pins_of(text: str) -> dict[str, Pin]:
    """The pins of a file of requirements, by name."""
    starts = [*PINNED.finditer(text)]
    ends = [*(start.start() for start in starts[1:]), len(text)]
    return {
        canonicalize_name(start["name"]): Pin(
            Version(start["version"]), frozenset(HASH.findall(text[start.end() : end])), start["marker"]
        )
        for start, end in zip(starts, ends, strict=True)
    }


def text_of(name: str) -> str:
    return (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")


def stated(extra: str) -> list[Requirement]:
    """The dependencies of an extra, and of those that it takes in."""
    own = [Requirement(line) for line in PROJECT["project"]["optional-dependencies"][extra]]
    inside = [name for entry in own if entry.name == "trackbench" for name in sorted(entry.extras)]
    return [
        *(entry for entry in own if entry.name != "trackbench"),
        *(each for name in inside for each in stated(name)),
    ]


@pytest.mark.parametrize(("name", "extra"), [("run", "fast"), ("dev", "dev")])
def test_every_dependency_is_pinned_in_its_range(name: str, extra: str) -> None:
    pins = pins_of(text_of(name))
    base = map(Requirement, [*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"]])
    for wanted in [*base, *stated(extra)]:
        assert wanted.specifier.contains(pins[canonicalize_name(wanted.name)].version), wanted


@pytest.mark.parametrize("name", ["run", "dev"])
def test_every_pin_has_hashes_and_no_address(name: str) -> None:
    text = text_of(name)
    assert all(pin.hashes for pin in pins_of(text).values())
    # A line is a pin or a hash: no option, no comment, no address.
    assert all(PINNED.match(line) or HASH.search(line) for line in text.splitlines())
    assert "/" not in text


def test_a_run_has_the_versions_of_the_tests() -> None:
    run, dev = pins_of(text_of("run")), pins_of(text_of("dev"))
    assert {name: dev[name] for name in run} == run


def compiled(lines: Iterable[str]) -> dict[str, Pin]:
    """What the index has for some requirements; skips where none can be reached."""
    if not UV.is_file():
        pytest.skip("uv is not installed beside this Python (make .venv/.installed-dev)")
    command = [UV, "pip", "compile", "-", "--universal", "--python-version", "3.11", "--no-deps", "--generate-hashes"]
    done = subprocess.run(
        [*command, "--no-header", "--no-annotate"],
        input="\n".join(lines), capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    if done.returncode and re.search("fetch|connect|dns|timed out|network", done.stderr, re.IGNORECASE):
        pytest.skip(f"no package index can be reached: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert "yanked" not in done.stderr
    return pins_of(done.stdout)


def _marked(name: str, specifier: str, pin: Pin) -> str:
    return f"{name}{specifier}" + (f" ; {pin.marker}" if pin.marker else "")


def test_the_hashes_are_those_of_the_index() -> None:
    pins = pins_of(text_of("dev"))
    index = compiled(_marked(name, f"=={pin.version}", pin) for name, pin in pins.items())
    assert {name for name, pin in pins.items() if not pin.hashes <= index[name].hashes} == set()
