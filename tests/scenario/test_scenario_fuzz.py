"""Whatever is in a scenario file, loading it gives a scenario or an InputError."""

import copy
import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.fuzz.mutations import containers_of

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario
from trackbench.scenario.docs import EXAMPLES

pytestmark = pytest.mark.slow

TEXT = "".join(EXAMPLES.values())
VALID = yaml.safe_load(TEXT)

LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.sampled_from([10**400, -(10**400), 2**63, 0, -1]),
    st.floats(),
    st.text(max_size=20),
    st.sampled_from(["20 m", "5%", "ego", "all", "truth", "1e999", "cv", "ukf", "bosch_lrr3", "front_radar", "{}", ""]),
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=12), inner, max_size=3),
    max_leaves=6,
)
#: Keys of every section, so that mutations meet real ones in the wrong places.
KNOWN = """type rate_hz range_sigma_m azimuth_sigma_rad use filter motion preset from initial sensors observer targets
nearest ids mount x_m metric tracker is below better_than config options runs reference dropouts kappa"""
KEYS = st.text(max_size=15) | st.sampled_from(KNOWN.split())


@st.composite
def mutated(draw: st.DrawFn) -> Any:
    scenario = copy.deepcopy(VALID)
    for _ in range(draw(st.integers(1, 3))):
        node = draw(st.sampled_from(containers_of(scenario)))
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        action = draw(st.sampled_from(["replace", "remove", "add"]))
        if action == "add" or not keys:
            if isinstance(node, dict):
                node[draw(KEYS)] = draw(VALUES)
            else:
                node.append(draw(VALUES))
        elif action == "remove":
            del node[draw(st.sampled_from(keys))]
        else:
            node[draw(st.sampled_from(keys))] = draw(VALUES)
    return scenario


def _load(path: Path, *overrides: str) -> None:
    messages: list[str] = []
    try:
        load_scenario(path, overrides)
    except InputError as error:
        messages = [str(part) for part in getattr(error, "errors", [error])]
    assert all(message.startswith((str(path), "--set")) for message in messages)
    assert overrides or not any("\n" in message for message in messages)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "scenario.yaml"


FUZZ = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@FUZZ
@given(scenario=mutated())
def test_mutated_values(path: Path, scenario: Any) -> None:
    path.write_text(yaml.safe_dump(scenario, allow_unicode=True), encoding="utf-8", errors="surrogatepass")
    _load(path)


@FUZZ
@given(seed=st.integers(0, 2**32))
def test_mutated_text(path: Path, seed: int) -> None:
    chance = random.Random(seed)
    text = list(TEXT)
    for _ in range(chance.randint(1, 4)):
        start = chance.randrange(len(text))
        text[start : start + chance.randint(0, 5)] = chance.choices(
            "{}[]:,-&*!|>'\"%@`#\t\n \x00é0aé<<?", k=chance.randint(0, 3)
        )
    path.write_text("".join(text), encoding="utf-8")
    _load(path)


@FUZZ
@given(raw=st.binary(max_size=60))
def test_any_bytes(path: Path, raw: bytes) -> None:
    path.write_bytes(raw)
    _load(path)


@FUZZ
@given(parts=st.lists(KEYS, max_size=4), value=st.text(max_size=20))
def test_any_override(path: Path, parts: list[str], value: str) -> None:
    path.write_text(TEXT)
    _load(path, f"{'.'.join(parts)}={value}")
