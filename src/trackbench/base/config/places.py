"""Which configuration class and field a pydantic error location stands for."""

from __future__ import annotations

import types
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, Tag
from pydantic.fields import FieldInfo

from trackbench.base.config import KeyPath
from trackbench.base.config.plugin import OptionsBeside, Owner, Plugin, PluginName, beside, plugin_options

KEY = "[key]"
"""How pydantic marks that the key of a mapping is at fault, not its value."""


class Place(NamedTuple):
    """One place in the scenario."""

    path: KeyPath
    """Keys and list indices as in the file."""
    model: type[BaseModel] | None
    """The class that the last key belongs to; None inside free mappings and lists."""
    annotation: Any
    """The type that is wanted here; None where the key is unknown."""
    is_key: bool = False
    """Whether the name of the last key is at fault."""
    beside: Beside | None = None
    """The plug-in that a single word may name, if the last key is one of its options: beside that word or within."""


class Beside(NamedTuple):
    """A plug-in that a single word may name."""

    key: str
    """The key with the word."""
    name: str
    plugin: Plugin
    model: type[BaseModel]
    """The class that the key belongs to; within a mapping the plug-in's own."""


def find_place(root: type[BaseModel], location: tuple[str | int, ...]) -> Place:
    """Follow a location of pydantic, which names members of unions beside keys, through the types."""
    path: KeyPath = ()
    model: type[BaseModel] | None = None
    annotation: Any = root
    named: Beside | None = None
    plugged: Beside | None = None
    for part in location:
        plugin, tag = marked(annotation), Owner.read(part)
        if isinstance(plugin, Plugin) and tag is not None:
            if tag.beside and model is not None:
                named = Beside(str(path[-1]), tag.name, plugin, model)
                path = path[:-1]
            annotation = plugin.registry[tag.name]
            if plugin.word and not tag.beside:
                named = Beside(plugin.key, tag.name, plugin, annotation)
            continue
        tagged = members(annotation)
        if part in tagged:
            annotation = tagged[str(part)]
            continue
        if part == KEY:
            return Place(path, None, annotation, True)
        path = (*path, part)
        plugged, named = named, None
        if isinstance(plugin, Plugin) and part == plugin.key:
            # What names the class: the choice is between the plug-ins.
            model = None
            continue
        annotation = _bare(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            model = annotation
            field = keyed_fields(model).get(str(part))
            annotation = whole(field) if field is not None else None
        else:
            model, annotation = None, _item(annotation)
    return Place(path, model, annotation, beside=plugged)


def marked(annotation: Any) -> PluginName | None:
    """The mark of a field that names a plug-in."""
    for part in getattr(annotation, "__metadata__", ()):
        if isinstance(part, PluginName):
            return part
    return None


def keyed_fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a class by their keys in the file, the options that may stand beside a plug-in's name included."""
    fields = {field.alias or name: field for name, field in model.model_fields.items()}
    if issubclass(model, OptionsBeside):
        fields = {**plugin_options(beside(model)[1]), **fields}
    return fields


def words(annotation: Any) -> list[str]:
    """The words that a field accepts."""
    plugin = marked(annotation)
    if plugin is not None:
        return plugin.registry.names()
    bare = _bare(annotation)
    if get_origin(bare) is Literal:
        return [str(word) for word in get_args(bare)]
    return [word for member in _union(bare) for word in words(member)]


def config_classes(annotation: Any) -> list[type[BaseModel]]:
    """The configuration classes that a type mentions, at any depth; of a plug-in, the published ones."""
    plugin = marked(annotation)
    if isinstance(plugin, Plugin):
        return [*plugin.registry.loaded().values()]
    bare = _bare(annotation)
    if isinstance(bare, type) and issubclass(bare, BaseModel):
        return [bare]
    return [model for part in get_args(bare) for model in config_classes(part)]


def _tag(member: Any) -> str:
    """The tag of a member of a union: its mark, or the only word of one of its fields."""
    for mark in getattr(member, "__metadata__", ()):
        if isinstance(mark, Tag):
            return mark.tag
    for field in getattr(member, "model_fields", {}).values():
        if get_origin(field.annotation) is Literal and len(get_args(field.annotation)) == 1:
            return str(get_args(field.annotation)[0])
    return str(member)


def whole(field: FieldInfo) -> Any:
    """The type of a field with its marks and limits, which pydantic takes off."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


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


def _item(annotation: Any) -> Any:
    """The type of the values of a mapping or a list."""
    arguments = get_args(annotation)
    return arguments[-1] if get_origin(annotation) in (dict, list) else None
