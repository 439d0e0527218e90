"""``score.metrics``: metrics beside the built-in ones, each looked up while the scenario is validated."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import GetJsonSchemaHandler, PlainValidator, ValidationError, ValidationInfo
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

from trackbench.base.config import PROBLEM, KeyPath
from trackbench.base.config.explain import explain
from trackbench.base.config.plugin import PluginName
from trackbench.base.errors import InputError, nearest
from trackbench.base.plugins import one_line
from trackbench.metrics import Metric
from trackbench.metrics.registry import METRICS

KEYS = ("use", "options")


def _made(value: Any, info: ValidationInfo) -> Metric:
    if isinstance(value, Metric):
        return value
    given = {"use": value} if isinstance(value, str) else value
    if not isinstance(given, dict) or not isinstance(given.get("use"), str):
        raise _problem('a name, a "module:Class" or a mapping with use is needed')
    unknown = next((str(key) for key in given if key not in KEYS), None)
    if unknown is not None:
        raise _at([((unknown,), f"is not known here; {nearest(unknown, KEYS)}")])
    options = given.get("options") or {}
    if not isinstance(options, dict):
        raise _at([(("options",), "a mapping of keys to values is needed")])
    try:
        metric = METRICS.get(given["use"], (info.context or {}).get("folder"))
        return metric.model_validate(options)
    except InputError as error:
        raise _problem(error.message) from None
    except ValidationError as invalid:
        problems = explain(invalid.errors(include_url=False), metric)
        raise _at([(("options", *path), message) for path, message in problems]) from None
    except Exception as error:
        raise _problem(f"{given['use']!r} does not take these options: {one_line(error)}") from None


def _problem(message: str) -> PydanticCustomError:
    return PydanticCustomError(PROBLEM, "{message}", {"message": message})


def _at(problems: list[tuple[KeyPath, str]]) -> ValidationError:
    lines = [InitErrorDetails(type=_problem(message), loc=path, input=None) for path, message in problems]
    return ValidationError.from_exception_data("metrics", lines)


class _Forms:
    """The JSON Schema: a name, or a mapping with the options of the metric that it names."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        mappings = [_mapping({"const": name}, _options(found, handler)) for name, found in METRICS.loaded().items()]
        *names, reference = PluginName(METRICS).named()
        return {"anyOf": [*names, reference, *mappings, _mapping(reference, {"type": "object"})]}


def _options(metric: type[Metric], handler: GetJsonSchemaHandler) -> dict[str, Any]:
    return handler.resolve_ref_schema(handler(metric.__pydantic_core_schema__))


def _mapping(use: dict[str, Any], options: dict[str, Any]) -> dict[str, Any]:
    needed = ["use", "options"] if options.get("required") else ["use"]
    properties = {"use": use, "options": options}
    return {"type": "object", "properties": properties, "required": needed, "additionalProperties": False}


#: A metric by its published name or ``"module:Class"``, or as a mapping with its options.
AnyMetric = Annotated[Metric, PlainValidator(_made), _Forms()]
