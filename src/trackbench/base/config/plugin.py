"""Fields whose class is a plug-in, which the file names and a registry holds.

In a file, a key of a mapping names the class (``type: radar``), or a single word does, with the options beside it
(``motion: cv``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, get_args

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError, ValidationInfo, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from trackbench.base.config import Config
from trackbench.base.config.messages import advise, explain, keyed_fields, mapping_needed, unknown_word
from trackbench.base.config.problems import KeyPath, Problem, problem_error, reject
from trackbench.base.errors import InputError
from trackbench.base.plugins import Registry, one_line

#: JSON Schema of a user's class, whose options no schema knows.
REFERENCE = {"type": "string", "pattern": ":"}


@dataclass(frozen=True)
class PluginName:
    """Mark of a text field whose text names a plug-in's class."""

    registry: Registry[Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        def validate(name: str, info: ValidationInfo) -> str:
            self.find(name, info)
            return name

        return core_schema.with_info_after_validator_function(validate, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"enum": list(self.registry.loaded())}, REFERENCE]}

    def find(self, name: Any, info: ValidationInfo) -> Any:
        """Return the plug-in's class with a name, searched also in the folder that the validation's context states.

        Raises:
            PydanticCustomError: there is no such class, or it cannot be imported.
        """
        names = self.registry.names()
        if not isinstance(name, str) or (names and ":" not in name and name not in names):
            raise problem_error(unknown_word(name, names))
        try:
            return self.registry.get(name, (info.context or {}).get("folder"))
        except InputError as error:
            raise problem_error(error.message) from None


@dataclass(frozen=True)
class Plugin(PluginName):
    """Mark of a field that holds an instance of a plug-in's class.

    A class is looked up while the field is validated. So a file loads only the plug-ins that it names, and may name a
    class of the user.
    """

    key: str
    """Key of the mapping whose value names the class, such as ``type``. The class gets the value only if it has a field
    of this name."""
    word: bool = False
    """Whether a single word may stand for the mapping ``{key: word}``."""
    options: str = ""
    """Key under which the plug-in's options stand in the mapping; empty where they stand beside ``key``."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(partial(self._made, source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        words = super().__get_pydantic_json_schema__(schema, handler)["anyOf"] if self.word else []
        forms = [self._form(name, model, handler) for name, model in self.registry.loaded().items()]
        return {"anyOf": [*words, *forms, _mapping({self.key: REFERENCE}, [self.key])]}

    def _form(self, name: str, model: type[Config], handler: GetJsonSchemaHandler) -> dict[str, Any]:
        reference = _schema_reference(model, handler)
        form = handler.resolve_ref_schema(reference)
        described = form["properties"].get(self.key, {}).get("description", f"{name}.")
        beside = {"$comment": self.key} if self.word else {}
        named = {self.key: {"const": name, "description": described, **beside}}
        if self.options:
            needed = [self.key, self.options] if form.get("required") else [self.key]
            return _mapping({**named, self.options: reference}, needed)
        form["properties"] = {**named, **{key: item for key, item in form["properties"].items() if key != self.key}}
        form["required"] = [self.key, *(key for key in form.get("required", ()) if key != self.key)]
        return reference

    def _made(self, base: type[Config], value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, base):
            return value
        if isinstance(value, str) and self.word:
            return _validated(self.find(value, info), value, {}, info)
        if not isinstance(value, dict):
            raise problem_error(mapping_needed(value))
        name = value.get(self.key)
        try:
            if self.key not in value:
                raise problem_error(f"missing; choose from: {', '.join(self.registry.names()) or 'module:Class'}")
            model = self.find(name, info)
        except PydanticCustomError as error:
            reject(base.__name__, [Problem((self.key,), error.message())])
        if not self.options:
            values = {key: item for key, item in value.items() if key != self.key or key in model.model_fields}
            return _validated(model, name, values, info)
        allowed: dict[str, FieldInfo | None] = {self.key: None, self.options: None}
        reject(base.__name__, [Problem((key,), advise(key, None, allowed)) for key in value if key not in allowed])
        try:
            return _validated(model, name, value.get(self.options) or {}, info)
        except ValidationError as invalid:
            reject(base.__name__, [Problem((self.options, *each.at), each.message) for each in explain(invalid, {})])


def _schema_reference(model: type[Config], handler: GetJsonSchemaHandler) -> dict[str, Any]:
    """Return a JSON Schema reference to a plug-in's options, which are stored once among the definitions."""
    model.model_rebuild()
    schema: Any = model.__pydantic_core_schema__
    name = {"ref": f"{model.__module__}.{model.__qualname__}:{id(model)}"}
    body, definitions = (schema["schema"], schema["definitions"]) if schema["type"] == "definitions" else (schema, [])
    return handler(core_schema.definitions_schema(body | name, definitions))


def _mapping(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "required": required}


def _validated(model: type[Config], name: Any, values: Any, info: ValidationInfo) -> Config:
    try:
        return model.model_validate(values, context=info.context)
    except ValidationError:
        raise
    except Exception as error:
        raise problem_error(f"{name!r} does not take these options: {one_line(error)}") from None


class OptionsBeside(Config):
    """Class with one plug-in named by a single word; the plug-in's options stand beside the word or in a mapping."""

    @classmethod
    def keys_of(cls, data: Any) -> Mapping[str, FieldInfo]:
        key, plugin = plugin_field(cls)
        name = data.get(key) if isinstance(data, dict) else None
        model = plugin.registry.plugins.get(name) if isinstance(name, str) else None
        return keyed_fields(cls) if model is None else {**keyed_fields(model), **keyed_fields(cls)}

    @model_validator(mode="before")
    @classmethod
    def _gather_options(cls, data: Any, info: ValidationInfo) -> Any:
        key, plugin = plugin_field(cls)
        word = data.get(key) if isinstance(data, dict) else None
        if not isinstance(word, str):
            return data
        class_fields = keyed_fields(cls)
        try:
            fields = keyed_fields(plugin.find(word, info))
        except PydanticCustomError:
            # Only the unknown word is reported: without its class, no option can be checked.
            return {name: item for name, item in data.items() if name in class_fields}
        if strange := [name for name in data if name not in class_fields and name not in fields]:
            of_other_plugins = {name for other in plugin.registry.loaded().values() for name in keyed_fields(other)}
            uses = f"{key} {word} does not use this; it uses {' and '.join(fields) or 'no option'}"
            reject(cls.__name__, [Problem((name,), uses) for name in strange if name in of_other_plugins])
        options = {name: item for name, item in data.items() if name in fields and name not in class_fields}
        rest = {name: item for name, item in data.items() if name not in options}
        return {**rest, key: {plugin.key: word, **options}}

    @classmethod
    def located(cls, path: KeyPath, data: Any) -> KeyPath:
        """Return the path in the file of the value at ``path``; the plugin's key is left out for options beside it."""
        key, _ = plugin_field(cls)
        return path[1:] if path[:1] == (key,) and len(path) > 1 and isinstance(data.get(key), str) else path

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        reference = handler(schema)
        form, (key, plugin) = handler.resolve_ref_schema(reference), plugin_field(cls)
        for model in plugin.registry.loaded().values():
            options = handler.resolve_ref_schema(_schema_reference(model, handler))["properties"]
            beside = {name: {**item, "$comment": key} for name, item in options.items() if name != plugin.key}
            form["properties"] = {**beside, **form["properties"]}
        form.pop("additionalProperties")
        own_class = {"properties": {key: REFERENCE}, "required": [key]}
        form["anyOf"] = [own_class, {"propertyNames": {"enum": [*form["properties"]]}}]
        return reference


def plugin_field(model: type[Config]) -> tuple[str, Plugin]:
    """Return the name of the field of ``model`` that a single word fills with a plug-in, and the field's mark."""
    for name, field in model.model_fields.items():
        members = (getattr(member, "__metadata__", ()) for member in get_args(field.annotation))
        for mark in chain(field.metadata, *members):
            if isinstance(mark, Plugin) and mark.word:
                return name, mark
    raise TypeError(f"{model.__name__} has no field with a plug-in that a word names")
