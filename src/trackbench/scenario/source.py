"""YAML text to plain values, with the place of each one for error messages.

Scalars follow the core schema of YAML 1.2: ``1e-3`` is a number, and ``on``, ``1:30`` and dates are text. Keys are
always text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import yaml

from trackbench.base.config import KeyPath
from trackbench.base.errors import InputError, InputErrors, shortened_text

TOO_DEEP = "nested too deeply"
CONTROL = "a control character, which a scenario cannot hold"


class Origin(NamedTuple):
    """Where a value was written."""

    file: str
    """The file, or the option of the command line."""
    line: int | None = None
    """From 1; None for an option."""


@dataclass(frozen=True)
class YamlDocument:
    """A YAML document as plain values (dict, list, str, int, float, bool, None)."""

    value: Any
    origins: dict[KeyPath, Origin]
    written: dict[KeyPath, KeyPath] = field(default_factory=dict)
    """For a value that was made from another: the path at which that one was written."""

    def as_written(self, path: KeyPath) -> KeyPath:
        """The path in the file of the value at ``path``."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.written:
                return (*self.written[path[:length]], *path[length:])
        return path

    def origin(self, path: KeyPath) -> Origin:
        """Where the value at ``path``, or the nearest mapping or list around it, was written."""
        path = self.as_written(path)
        for length in range(len(path), 0, -1):
            if path[:length] in self.origins:
                return self.origins[path[:length]]
        return self.origins[()]


def dotted(path: KeyPath) -> str:
    """``("sensors", "front", "rate_hz")`` as users write it: ``sensors.front.rate_hz``."""
    return ".".join(part if (part := str(raw)).isprintable() else repr(part) for raw in path)


def parse_yaml(text: str, file: str) -> YamlDocument:
    """Parse one YAML document.

    Raises:
        InputError: a syntax error, a key given twice, an anchor that contains itself, an unknown tag.
    """
    try:
        node = _Loader(text).get_single_node()
        builder = _Builder(file)
        value = builder.build(node, ()) if node is not None else None
    except yaml.MarkedYAMLError as error:
        problem = error.problem or "syntax error"
        mark = ("find expected ':'" in problem and error.context_mark) or error.problem_mark or error.context_mark
        message = next((told for part, told in _SYNTAX.items() if part in problem), f"not valid YAML: {problem}")
        raise InputError(message, file=file, line=mark.line + 1 if mark else None) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(CONTROL, file=file, line=line) from None
    except RecursionError:
        raise InputError(TOO_DEEP, file=file) from None
    if builder.repeated:
        raise InputErrors(builder.repeated)
    builder.origins[()] = Origin(file, node.start_mark.line + 1 if node is not None else 1)
    return YamlDocument(value, builder.origins)


class _Loader(yaml.SafeLoader):
    """Reads by the core schema of YAML 1.2."""


_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
    ("merge", r"<<", ["<"]),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), _first)


class _Builder:
    """Plain values of nodes, and where each was written."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.origins: dict[KeyPath, Origin] = {}
        self.repeated: list[InputError] = []
        self._open: list[yaml.Node] = []
        self._flat: set[int] = set()
        self._constructor = yaml.constructor.SafeConstructor()

    def build(self, node: yaml.Node, path: KeyPath) -> Any:
        if any(node is outer for outer in self._open):
            raise self._error("an anchor that contains itself", node, path)
        if node.tag not in _TAGS[type(node)]:
            raise self._error(f"the tag {shortened_text(node.tag, 40)!r} is not known; remove it", node, path)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, path)
        self._open.append(node)
        if isinstance(node, yaml.SequenceNode):
            value: Any = [self._item(child, (*path, i), child) for i, child in enumerate(node.value)]
        else:
            value = self._mapping(node, path)
        self._open.pop()
        return value

    def _item(self, node: yaml.Node, path: KeyPath, place: yaml.Node) -> Any:
        self.origins[path] = Origin(self.file, place.start_mark.line + 1)
        return self.build(node, path)

    def _mapping(self, node: Any, path: KeyPath) -> dict[str, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value if id(node) not in self._flat else ():
            if str(key.value) in lines and key.tag != _MERGE:
                message = f"this key is given twice, first in line {lines[str(key.value)]}; remove one"
                self.repeated.append(self._error(message, key, (*path, key.value)))
            lines.setdefault(str(key.value), key.start_mark.line + 1)
        if id(node) not in self._flat:
            # Entries that are merged in come before its own, which win.
            self._flat.add(id(node))
            self._constructor.flatten_mapping(node)
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self._error("a key must be a single word", key, path)
        return {key.value: self._item(value, (*path, key.value), key) for key, value in node.value}

    def _scalar(self, node: yaml.Node, path: KeyPath) -> Any:
        text = node.value
        if yaml.reader.Reader.NON_PRINTABLE.search(text):
            raise self._error(CONTROL, node, path)
        try:
            match node.tag.removeprefix(_PREFIX):
                case "null":
                    return None
                case "bool":
                    return {"true": True, "false": False}[text.lower()]
                case "int":
                    return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
                case "float":
                    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        except (ValueError, KeyError):
            raise self._error(f"{text[:40]!r} does not fit its tag or is too long", node, path) from None
        return text

    def _error(self, message: str, node: yaml.Node, path: KeyPath) -> InputError:
        return InputError(message, key=dotted(path) or None, file=self.file, line=node.start_mark.line + 1)


_PREFIX = "tag:yaml.org,2002:"
_MERGE = _PREFIX + "merge"
_TAGS = {
    yaml.ScalarNode: {_PREFIX + name for name in ("null", "bool", "int", "float", "str", "merge")},
    yaml.SequenceNode: {_PREFIX + "seq"},
    yaml.MappingNode: {_PREFIX + "map"},
}


#: Part of what the parser says, and what is said instead.
_SYNTAX = {
    "'\\t'": "a tab where YAML needs spaces",
    "mapping values are not allowed": "not valid YAML: a colon is missing in or before this line, or there is a "
    "second ': ' in it, or its indentation is wrong; quote text that contains ': '",
    "could not find expected ':'": "not valid YAML: a key is followed by a colon and a space",
    "<block": "not valid YAML: wrong indentation: the keys of one mapping begin below each other",
    "another document": "a second YAML document; a scenario file holds one",
}
