"""A field whose class is a plug-in: looked up while it is validated, and asked for its own options.

In a file the class is named by a key of a mapping (``type: radar``), or by a single word beside which its options stand
(``motion: cv``). The location of an error in the options names the class, for ``places`` to find the way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any, NamedTuple, get_args

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError, ValidationInfo, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import (
    CoreSchema,
    ErrorDetails,
    InitErrorDetails,
    PydanticCustomError,
    PydanticKnownError,
    core_schema,
)

from trackbench.base.config import Config, KeyPath, problem_error
from trackbench.base.errors import InputError
from trackbench.base.plugins import Registry, one_line

#: The types of error that pydantic itself has.
KNOWN = frozenset(get_args(core_schema.ErrorType))
INSIDE, BESIDE = "<in ", "<beside "


@dataclass(frozen=True)
class Options:
    """The options of a plug-in, taken out of a file."""

    name: str
    values: Mapping[str, Any]
    beside: bool = False
    """Whether they stand beside the key that names the plug-in, not within."""
    refused: Mapping[str, str] = field(default_factory=dict)
    """Options that another key stands in for: why each may not be given."""


class Owner(NamedTuple):
    """The part of an error's location that says whose options the rest is in."""

    name: str
    beside: bool

    def __str__(self) -> str:
        return f"{BESIDE if self.beside else INSIDE}{self.name}>"

    @classmethod
    def read(cls, part: str | int) -> Owner | None:
        """The tag that a part of a location is; None for a key or an index."""
        for start in (INSIDE, BESIDE):
            if isinstance(part, str) and part.startswith(start) and part.endswith(">"):
                return cls(part[len(start) : -1], start == BESIDE)
        return None


@dataclass(frozen=True)
class PluginName:
    """Marks a text that names a plug-in."""

    registry: Registry[Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_after_validator_function(self._validate, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": self.named()}

    def named(self) -> list[dict[str, Any]]:
        """The JSON Schemas of a published name and of a reference."""
        published = list(self.registry.loaded())
        return [*([{"enum": published}] if published else []), {"type": "string", "pattern": ":"}]

    def _validate(self, name: str, info: ValidationInfo) -> str:
        self.find(name, info)
        return name

    def find(self, name: str, info: ValidationInfo) -> Any:
        """The class behind a name, in the folder that the validation's context names.

        Raises:
            PydanticCustomError, PydanticKnownError: it cannot be found.
        """
        if ":" not in name and name not in self.registry.names():
            raise PydanticKnownError("literal_error", {"expected": ", ".join(self.registry.names())})
        try:
            return self.registry.get(name, (info.context or {}).get("folder"))
        except InputError as error:
            raise problem_error(error.message) from None


@dataclass(frozen=True)
class Plugin(PluginName):
    """Marks a field that holds an instance of a plug-in's class."""

    key: str
    """What names the class in a mapping; a field of the class, or else no option of it."""
    word: bool = False
    """Whether a single word is short for ``{key: word}``."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(partial(self._made, source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        reference = {"type": "string", "pattern": ":"}
        if self.word:
            named = {"type": "object", "properties": {self.key: {"anyOf": self.named()}}, "required": [self.key]}
            return {"anyOf": [*self.named(), named]}
        forms = []
        for name, result in self.registry.loaded().items():
            form = handler.resolve_ref_schema(handler(result.__pydantic_core_schema__))
            forms.append(form)
            form["properties"][self.key] = {"const": name, "description": form["properties"][self.key]["description"]}
            form["required"] = list(dict.fromkeys([self.key, *form.get("required", ())]))
        other = {"type": "object", "properties": {self.key: reference}, "required": [self.key]}
        return {"oneOf": [*forms, other]}

    def options(self, value: Any) -> Options | None:
        """The name and the options that a value of this field states; None where it states none."""
        if isinstance(value, str) and self.word:
            return Options(value, {})
        name = value.get(self.key) if isinstance(value, dict) else None
        return Options(name, value) if isinstance(name, str) else None

    def _made(self, base: type[Config], value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, base):
            return value
        given = value if isinstance(value, Options) else self.options(value)
        if given is not None:
            try:
                return _validated(self.find(given.name, info), given, self.key, info)
            except (PydanticCustomError, PydanticKnownError) as error:
                if isinstance(value, dict):
                    raise _at((self.key,), error, given.name) from None
                raise
        if isinstance(value, dict):
            missing = PydanticKnownError("missing" if self.key not in value else "literal_error", {"expected": ""})
            raise _at((self.key,), missing, value.get(self.key))
        raise PydanticKnownError("literal_error", {"expected": ""}) if self.word else PydanticKnownError("dict_type")


class OptionsBeside(Config):
    """A class with a plug-in that a single word names, whose options stand beside that word or within a mapping."""

    @classmethod
    def replaced(cls, data: Mapping[str, Any], result: Any) -> dict[str, str]:
        """The plug-in's options that another key of ``data`` stands in for: why each may not be given."""
        return {}

    @model_validator(mode="before")
    @classmethod
    def _taken_out(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict):
            return data
        key, plugin = beside(cls)
        value = data.get(key)
        given = plugin.options(value)
        own = {field.alias or name for name, field in cls.model_fields.items()}
        try:
            result = None if given is None else plugin.find(given.name, info)
        except (PydanticCustomError, PydanticKnownError):
            result = None
        if given is None or result is None:
            # Whose options the others are is not known: the one mistake is said of the word.
            options = {} if isinstance(value, Config | dict) else plugin_options(plugin)
            unknown = given is not None and given.values is not value
            return {name: item for name, item in data.items() if name in own or not (unknown or name in options)}
        refused = cls.replaced(data, result)
        if isinstance(value, dict):
            return {**data, key: Options(given.name, value, refused=refused)}
        rest = {name: item for name, item in data.items() if name in own}
        options = {name: item for name, item in data.items() if name not in own}
        return {**rest, key: Options(given.name, options, beside=True, refused=refused)}


def beside(model: type[Config]) -> tuple[str, Plugin]:
    """The field of a class beside which a plug-in's options may stand, and its mark."""
    for name, info in model.model_fields.items():
        members = (getattr(member, "__metadata__", ()) for member in get_args(info.annotation))
        for mark in chain(info.metadata, *members):
            if isinstance(mark, Plugin) and mark.word:
                return name, mark
    raise TypeError(f"{model.__name__} has no field with a plug-in that a word names")


def plugin_options(plugin: Plugin) -> dict[str, FieldInfo]:
    """The options of every published plug-in."""
    return {name: info for result in plugin.registry.loaded().values() for name, info in result.model_fields.items()}


def _validated(result: type[Config], options: Options, key: str, info: ValidationInfo) -> Config:
    tag = (str(Owner(options.name, options.beside)),)
    values = {name: value for name, value in options.values.items() if name != key or key in result.model_fields}
    lines = [
        InitErrorDetails(type=problem_error(message), loc=(*tag, name), input=values[name])
        for name, message in options.refused.items()
        if name in values
    ]
    # What is replaced has to have some value that is valid; it ends as 0.
    values |= dict.fromkeys(options.refused, 1.0)
    try:
        made = result.model_validate(values, context=info.context)
    except ValidationError as invalid:
        lines += [_relocated(error, tag) for error in invalid.errors(include_url=False)]
    except Exception as error:
        message = f"{options.name!r} does not take these options: {one_line(error)}"
        problem = problem_error(message)
        lines.append(InitErrorDetails(type=problem, loc=tag, input=None))
    if lines:
        raise ValidationError.from_exception_data(result.__name__, lines)
    return made.model_copy(update=dict.fromkeys(options.refused, 0.0)) if options.refused else made


def _relocated(error: ErrorDetails, before: KeyPath) -> InitErrorDetails:
    kind: str | PydanticCustomError = error["type"]
    context = error.get("ctx", {})
    if kind not in KNOWN:
        kind = problem_error(error["msg"])
    return InitErrorDetails(type=kind, loc=(*before, *error["loc"]), input=error["input"], ctx=context)


def _at(path: KeyPath, error: PydanticCustomError | PydanticKnownError, value: Any) -> ValidationError:
    kind: Any = error if isinstance(error, PydanticCustomError) else error.type
    context = error.context or {}
    line = InitErrorDetails(type=kind, loc=path, input=value, ctx=context)
    return ValidationError.from_exception_data("plug-in", [line])
