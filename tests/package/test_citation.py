"""CITATION.cff is one of version 1.2.0 of the Citation File Format, and of this version of the package."""

from __future__ import annotations

import tomllib
from datetime import date

import jsonschema
import yaml
from tests.support.places import ROOT

TEXT = {"type": "string", "minLength": 1}
#: Of the schema of CFF 1.2.0 what the file uses: the keys that are required, and the form of each.
SCHEMA = {
    "type": "object",
    "additionalProperties": False,
    "required": ["cff-version", "message", "title", "authors"],
    "properties": {
        "cff-version": {"const": "1.2.0"},
        "message": TEXT,
        "title": TEXT,
        "type": {"enum": ["dataset", "software"]},
        "abstract": TEXT,
        "version": TEXT,
        "license": {"const": "MIT"},
        "date-released": {"type": "string", "pattern": "^[0-9]{4}-[0-9]{2}-[0-9]{2}$"},
        "keywords": {"type": "array", "items": TEXT, "minItems": 1, "uniqueItems": True},
        "authors": {
            "type": "array",
            "minItems": 1,
            "uniqueItems": True,
            # An entity, which has a name and no family name.
            "items": {"type": "object", "required": ["name"], "properties": {"name": TEXT}},
        },
    },
}


def test_the_citation_is_valid_and_of_this_version() -> None:
    stated = yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)
    jsonschema.validate(stated, SCHEMA)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (stated["version"], stated["license"]) == (project["version"], project["license"])
    assert stated["abstract"] == project["description"]
    released = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{stated['version']}] - {date.fromisoformat(stated['date-released'])}" in released
