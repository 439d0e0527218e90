"""Which configuration class and field a pydantic error location stands for."""

from __future__ import annotations

import types
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import Tag
from pydantic.fields import FieldInfo

from trackbench.config import Config
from trackbench.scenario.source import KeyPath

KEY = "[key]"
"""How pydantic marks that the key of a mapping is at fault, not its value."""


class Place(NamedTuple):
    """One place in the scenario."""

    path: KeyPath
    """Keys and list indices as in the file."""
    model: type[Config] | None
    """The class that the last key belongs to; None inside free mappings and lists."""
    annotation: Any
    """The type that is wanted here; None where the key is unknown."""
    is_key: bool
    """Whether the name of the last key is at fault."""


def find(root: type[Config], location: tuple[str | int, ...]) -> Place:
    """Follow a location of pydantic, which names members of unions beside keys, through the types."""
    path: KeyPath = ()
    model: type[Config] | None = None
    annotation: Any = root
    for part in location:
        tagged = members(annotation)
        if part in tagged:
            annotation = tagged[str(part)]
            continue
        if part == KEY:
            return Place(path, None, annotation, True)
        annotation = _bare(annotation)
        path = (*path, part)
        if isinstance(annotation, type) and issubclass(annotation, Config):
            model = annotation
            field = keyed_fields(model).get(str(part))
            annotation = field.annotation if field is not None else None
        else:
            model, annotation = None, _item(annotation)
    return Place(path, model, annotation, False)


def keyed_fields(model: type[Config]) -> dict[str, FieldInfo]:
    """The fields of a class by their keys in the file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def words(annotation: Any) -> list[str]:
    """The words that a field accepts."""
    bare = _bare(annotation)
    if get_origin(bare) is Literal:
        return [str(word) for word in get_args(bare)]
    return [word for member in _union(bare) for word in words(member)]


def models(annotation: Any) -> list[type[Config]]:
    """The configuration classes that a type mentions, at any depth."""
    bare = _bare(annotation)
    if isinstance(bare, type) and issubclass(bare, Config):
        return [bare]
    return [model for part in get_args(bare) for model in models(part)]


def distinction(model: Any) -> tuple[str, str] | None:
    """The key and the word that tell a class from the others in its union: ``("type", "radar")``."""
    for key, field in getattr(model, "model_fields", {}).items():
        if get_origin(field.annotation) is Literal and len(get_args(field.annotation)) == 1:
            return key, str(get_args(field.annotation)[0])
    return None


def _bare(annotation: Any) -> Any:
    """Without ``Annotated`` and without ``None``."""
    while get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    members = [member for member in _union(annotation) if member is not type(None)]
    return _bare(members[0]) if len(members) == 1 else annotation


def _union(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else ()


def members(annotation: Any) -> dict[str, Any]:
    """The members of a union by the tags that pydantic names them with."""
    return {_tag(member): member for member in _union(_bare(annotation))}


def _tag(member: Any) -> str:
    for mark in getattr(member, "__metadata__", ()):
        if isinstance(mark, Tag):
            return mark.tag
    word = distinction(member)
    return str(member) if word is None else word[1]


def _item(annotation: Any) -> Any:
    """The type of the values of a mapping or a list."""
    arguments = get_args(annotation)
    return arguments[-1] if get_origin(annotation) in (dict, list) else None
