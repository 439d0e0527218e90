"""YAML text to plain values, with the place of each one for error messages.

Scalars follow the core schema of YAML 1.2: ``1e-3`` is a number, and ``on``, ``1:30`` and dates are text. Keys are
always text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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
        incomplete = "could not find expected ':'" in (error.problem or "")
        mark = (incomplete and error.context_mark) or error.problem_mark or error.context_mark
        around = "\n".join(text.splitlines()[max(mark.line - 1, 0) : mark.line + 2]) if mark else ""
        raise InputError(_syntax(error, around), file=file, line=mark.line + 1 if mark else None) from None
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

    def _mapping(self, node: yaml.Node, path: KeyPath) -> dict[str, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if key.value in lines and key.tag != _MERGE:
                message = f"this key is given twice, first in line {lines[key.value]}; remove one"
                self.repeated.append(self._error(message, key, (*path, key.value)))
            if not isinstance(key, yaml.ScalarNode):
                raise self._error("a key must be a single word", key, path)
            lines.setdefault(key.value, key.start_mark.line + 1)
        return {key.value: self._item(value, (*path, key.value), key) for key, value in self._merged(node, path)}

    def _merged(self, node: yaml.Node, path: KeyPath) -> Iterator[tuple[yaml.Node, yaml.Node]]:
        """Yield the entries of a mapping after those that it merges in, so that its own come last and win."""
        for key, value in node.value:
            if key.tag == _MERGE:
                for part in reversed(value.value if isinstance(value, yaml.SequenceNode) else [value]):
                    if not isinstance(part, yaml.MappingNode) or part in self._open:
                        raise self._error("<< needs a mapping that was given before", key, path)
                    self._open.append(part)
                    yield from self._merged(part, path)
                    self._open.remove(part)
        for key, value in node.value:
            if key.tag != _MERGE:
                yield key, value

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


#: A key that its mapping or list follows, or the more indented lines of it, without a colon.
_KEY_ALONE = re.compile(r"^( *)(?:- )?([\w.-]+) *(?:[{[]|\n\1 +[\w.-]+ *:)", re.MULTILINE)


#: A key whose colon the value follows without a space.
_NO_SPACE = re.compile(r"^ *(?:- )?([\w.-]+):[^\s/:]", re.MULTILINE)


def _syntax(error: yaml.MarkedYAMLError, around: str) -> str:
    """What is wrong; ``around``: the line and its neighbours."""
    problem = error.problem or "syntax error"
    colon = "mapping values are not allowed" in problem or "could not find expected ':'" in problem
    if colon and (key := _KEY_ALONE.search(around)):
        return f"not valid YAML: a colon is missing after {key[2]!r}"
    if colon and (key := _NO_SPACE.search(around)):
        return f"not valid YAML: a space is missing after the colon of {key[1]!r}"
    if "'\\t'" in problem:
        return "a tab where YAML needs spaces"
    if "mapping values are not allowed" in problem:
        return "not valid YAML: a second ': ' in one line, or wrong indentation; quote text that contains ': '"
    if "could not find expected ':'" in problem:
        return "not valid YAML: a key is followed by a colon and a space"
    if "<block" in problem:
        return "not valid YAML: wrong indentation: the keys of one mapping begin below each other"
    if "another document" in problem:
        return "a second YAML document; a scenario file holds one"
    return f"not valid YAML: {problem}"
