"""Whatever is in the folder of an envelope or in an ``envelope:`` block, it is read, or refused in one message."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import pytest
import yaml
from tests.fuzz.conftest import Tried
from tests.fuzz.mutations import cases, damage, edited_tree
from tests.subjects.envelope.conftest import SMALL

SHORT = {"cells": 6, "runs": {"first": 25, "most": 50}}
RATE = {"key": "sensors.lidar.rate_hz", "values": [5, 10]}
KIND = {"choices": {"narrow": {"sensors.lidar.fov_deg": 90}, "wide": {"sensors.lidar.fov_deg": 360}}}
LINKED = {
    "keys": {"trackers.kf.acceleration_sigma_mps2": {"factor": 2, "offset": 1}},
    "from": 0.5,
    "to": 5,
    "levels": 2,
}


def scenario(**envelope: object) -> dict[str, object]:
    """The small one with another block."""
    return SMALL | {"envelope": SMALL["envelope"] | SHORT | envelope}


@pytest.fixture
def whole(tried: Tried, tmp_path: Path) -> Path:
    """A folder of two maps."""
    axes = SMALL["envelope"]["axes"] | {"rate": RATE}
    for name, seed in (("a", 1), ("b", 2)):
        (tmp_path / "small.yaml").write_text(yaml.safe_dump(scenario(axes=axes, cells=10)))
        options = ["--set", f"monte_carlo.seed={seed}", "--counter-examples", "1", "--no-recording"]
        assert tried(-1, "envelope", "small.yaml", "--out", f"whole/{name}", *options) == 0
    return tmp_path / "whole"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_mutated_claims(whole: Path, tried: Tried, tmp_path: Path) -> None:
    refused = 0
    for case in cases(60):
        chance = random.Random(case)
        folder = tmp_path / "damaged"
        shutil.copytree(whole, folder, dirs_exist_ok=True)
        file = folder / "a" / "small-envelope" / chance.choice(["claim.json"] * 3 + ["parts.parquet"])
        damage(chance, file)
        a, b = "damaged/a/small-envelope", "damaged/b/small-envelope"
        commands = [
            ["envelope", "diff", a, b, "--junit", "cells.xml"],
            ["envelope", "diff", b, a, "--json"],
            ["report", a, "--format", "markdown", "--out", "report"],
        ]
        for arguments in chance.sample(commands, 2):
            refused += tried(case, *arguments, statuses=(0, 1, 2)) == 2
        shutil.rmtree(folder)
    assert refused > 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_mutated_blocks(tried: Tried, tmp_path: Path) -> None:
    file, made = tmp_path / "scenario.yaml", 0
    axes = {"sigma": {**SMALL["envelope"]["axes"]["sigma"], "levels": 2}, "rate": RATE, "kind": KIND, "linked": LINKED}
    for case in cases(60):
        chance = random.Random(case)
        some = {name: axes[name] for name in chance.sample([*axes], chance.choice([1, 2]))}
        block = edited_tree(chance, SMALL["envelope"] | SHORT | {"axes": some})
        file.write_text(yaml.safe_dump(SMALL | {"envelope": block}, allow_unicode=True), "utf-8", "surrogatepass")
        short = ["--set", "envelope.runs={first: 25, most: 25}", "--set", "envelope.cells=4"]
        if tried(case, "check", file) == 0:
            made += tried(case, "envelope", file, *short, "--counter-examples", "0", statuses=(0, 2)) == 0
    assert made > 0
