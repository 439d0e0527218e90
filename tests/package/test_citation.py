"""CITATION.cff is of this version of the package."""

from __future__ import annotations

import tomllib
from datetime import date

import yaml
from tests.support.places import ROOT


def test_the_citation_is_of_this_version() -> None:
    stated = yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (stated["version"], stated["license"]) == (project["version"], project["license"])
    assert stated["abstract"] == project["description"]
    released = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{stated['version']}] - {date.fromisoformat(stated['date-released'])}" in released
