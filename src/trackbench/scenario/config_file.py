"""YAML configuration files beside scenarios, whose errors state file, line and key."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from trackbench.base.config import Config
from trackbench.base.config.messages import explain, keyed_fields
from trackbench.base.errors import InputError, InputErrors
from trackbench.base.files import read_text
from trackbench.scenario.source import parse_yaml

C = TypeVar("C", bound=Config)


def read_config(kind: type[C], file: Path) -> tuple[C, str]:
    """Return the configuration of class ``kind`` in a YAML file, and the text of the file.

    Raises:
        InputErrors: all faults of the file, each with line and key.
    """
    text = read_text(file, "; save the file as UTF-8")
    document = parse_yaml(text, str(file))
    if not isinstance(document.value, dict):
        keys = ", ".join(name for name, field in kind.model_fields.items() if field.is_required())
        raise InputError(f"is not a mapping of keys to values; the keys {keys} are needed", file=file)
    try:
        return kind.model_validate(document.value), text
    except ValidationError as invalid:
        errors = [document.error(*problem) for problem in explain(invalid, keyed_fields(kind))]
        raise errors[0] if len(errors) == 1 else InputErrors(errors) from None
