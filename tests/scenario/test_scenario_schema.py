"""The JSON Schema and the page that is made from it."""

from functools import cache
from inspect import cleandoc
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from tests.support.places import DOCS, SCENARIOS

from trackbench.metrics.registry import by_path
from trackbench.scenario import load_scenario
from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.docs import EXAMPLES, scenario_pages
from trackbench.scenario.schema import json_schema
from trackbench.scenario.source import parse_yaml

SHIPPED = sorted((SCENARIOS).rglob("*.yaml"))
EXAMPLE = "".join(EXAMPLES.values())


@cache
def validator() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(json_schema())


def errors(text: str) -> list[Any]:
    return list(validator().iter_errors(parse_yaml(text, "example").value))


def test_schema_is_a_schema() -> None:
    schema = json_schema()

    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["$id"].startswith("urn:")


@pytest.mark.parametrize("path", SHIPPED, ids=[path.stem for path in SHIPPED])
def test_shipped_scenarios_fit_the_schema(path: Path) -> None:
    assert errors(path.read_text(encoding="utf-8")) == []
    assert load_scenario(path).config.name


def test_the_examples_of_the_page_are_one_valid_scenario(tmp_path: Path) -> None:
    path = tmp_path / "example.yaml"
    path.write_text(EXAMPLE)

    assert errors(EXAMPLE) == []
    assert load_scenario(path).config.name == "highway_overtake"
    assert set(yaml.safe_load(EXAMPLE)) == set(ScenarioConfig.model_fields)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("seed: 1", "sed: 1"),
        ("rate_hz: 20", "rate_hz: fast"),
        ("range_sigma_m: 0.3", "range_sigma_m: -0.3"),
        ("    range_sigma_m: 0.3\n", ""),
        ("preset: velodyne_vlp16", "preset: velodyne"),
        ("filter: ekf", "filter: ekf\n    use: raw"),
        ("below: 1.0", "below: 1.0, above: 0.1"),
        ("observer: ego", "observer: {z: 1}"),
        ("from: first_measurement, velocity_sigma_mps", "from: birth, velocity_sigma_mps"),
        ("  front_radar:\n", "  front.radar:\n"),
    ],
)
def test_schema_refuses(old: str, new: str) -> None:
    assert old in EXAMPLE
    assert errors(EXAMPLE.replace(old, new, 1))


def test_the_pages_are_up_to_date() -> None:
    pages = {file.relative_to(DOCS).as_posix(): file for file in DOCS.glob("scenario-file*/*.md")}
    pages["scenario-file.md"] = DOCS / "scenario-file.md"
    written = {name: file.read_text(encoding="utf-8") for name, file in pages.items()}

    assert written == scenario_pages(), "run: make docs/scenario-file.md"


def test_the_pages_have_every_class() -> None:
    pages = "".join(scenario_pages().values())

    assert all(cleandoc(part["description"]) in pages for part in json_schema()["$defs"].values())


def test_each_key_has_a_page_with_an_example() -> None:
    pages = scenario_pages()
    for key in ScenarioConfig.model_fields:
        assert f"(scenario-file/{key}.md)" in pages["scenario-file.md"]
        assert set(yaml.safe_load(pages[f"scenario-file/{key}.md"].split("```")[1].removeprefix("yaml"))) == {key}


def test_metric_paths_name_the_sensors() -> None:
    paths = by_path(["front"])

    assert "nis.front.inside95" in paths
    assert "whiteness.front.verdict" in paths
    assert not any("<" in path for path in paths)
