"""Files made to take long, to say much, or to be shown: refused soon, in a short message that does not show them."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import yaml
from tests.support.places import DATA

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario

GOOD = (DATA / "scenario.yaml").read_text(encoding="utf-8")
#: A file is refused in at most so many times the CPU time in which PyYAML reads a list of 10,000 values.
PATIENCE = 30.0
#: Characters of a message.
LONGEST = 20_000
SECRET = "root:*:20228:0:99999:7:::"

HOSTILE = {
    "words": (f"name: a\nx: &a '{'y' * 100_000}'\nworlds: [{'*a, ' * 35}]\n", "is not known; choose from: human"),
    "tag": (f"name: !{'a' * 100_000} a\n", "is not known; remove it"),
    "keys": ("name: a\n" + "".join(f"k{n}: 1\n" for n in range(45_000)), "more errors"),
    "long_key": (f"name: a\n{'k' * 1000}: 1\n", "kkk...kkk"),
    "long_word": (f"name: a\ntruth: {{source: {'k' * 100_000}}}\n", "is not known"),
    "rate": (GOOD.replace("rate_hz: 10", "rate_hz: 1e-320", 1), "does not divide truth.rate_hz"),
    "slow_rate": (GOOD.replace("rate_hz: 10", "rate_hz: 3e-8", 1), "does not divide truth.rate_hz"),
    "half_a_character": ('name: "\\ud800"\n', "a control character, which a scenario cannot hold"),
}


@pytest.fixture(scope="module")
def patience() -> float:
    begin = time.process_time()
    yaml.load("[" + ", ".join(["1.5"] * 10_000) + "]", Loader=yaml.SafeLoader)
    return PATIENCE * (time.process_time() - begin)


@pytest.mark.parametrize("name", HOSTILE)
def test_is_refused_soon_and_shortly(tmp_path: Path, name: str, patience: float) -> None:
    content, expected = HOSTILE[name]
    file = tmp_path / "scenario.yaml"
    file.write_text(content, encoding="utf-8")
    begin = time.process_time()
    with pytest.raises(InputError) as caught:
        load_scenario(file)
    assert time.process_time() - begin < patience
    message = str(caught.value)
    assert expected in message
    assert len(message) < LONGEST


@pytest.mark.parametrize("text", [f"{SECRET}\n", "password: hunter2\n"])
def test_a_file_of_another_kind_is_not_shown(tmp_path: Path, text: str) -> None:
    file = tmp_path / "secret"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_scenario(file)
    message = str(caught.value).removeprefix(str(file))
    assert not any(word in message for word in ("root", "99999", "password", "hunter2"))
