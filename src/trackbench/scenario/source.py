"""YAML text as plain values, with the place of each value for error messages.

Scalars follow the core schema of YAML 1.2: ``1e-3`` is a number, and ``on``, ``1:30`` and dates are text. Keys are
always text.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import yaml

from trackbench.base.config import KeyPath
from trackbench.base.errors import InputError, shortened_text

TOO_DEEP = "nested too deeply"
CONTROL = "a control character, which a scenario cannot hold"


class Origin(NamedTuple):
    """File and line, or command-line option, where a value was written."""

    file: str
    """Name of the file, or of the option of the command line."""
    line: int | None = None
    """Number of the line, from 1; None for an option."""


@dataclass(frozen=True)
class YamlDocument:
    """YAML document as plain values (dict, list, str, int, float, bool, None)."""

    value: Any
    file: str
    node: yaml.Node | None
    """YAML node of the whole file, with the lines of all values; None without a file."""
    settings: dict[KeyPath, str] = field(default_factory=dict)
    """Option, such as ``--set``, that replaced the file's value, by the path of the value."""
    written: dict[KeyPath, KeyPath] = field(default_factory=dict)
    """Path in the file where a derived value, such as one of a sweep, was written, by the path of the value."""

    def as_written(self, path: KeyPath) -> KeyPath:
        """Return the path at which the value at ``path`` was written in the file."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.written:
                return (*self.written[path[:length]], *path[length:])
        return path

    def origin(self, path: KeyPath) -> Origin:
        """Return file and line, or option, of the value at ``path``, or of the nearest mapping or list around it."""
        path = self.as_written(path)
        for length in range(len(path), 0, -1):
            if path[:length] in self.settings:
                return Origin(self.settings[path[:length]])
        return Origin(self.file, _line(self.node, path))

    def error(self, path: KeyPath, message: str) -> InputError:
        """Return an error with file, line and key of the value at ``path``."""
        origin = self.origin(path)
        return InputError(message, key=dotted(self.as_written(path)) or None, file=origin.file, line=origin.line)


def _line(node: yaml.Node | None, path: KeyPath) -> int:
    line = 1 if node is None else node.start_mark.line + 1
    for part in path:
        if isinstance(node, yaml.MappingNode):
            # Entries that were merged in stand before the mapping's own, which win.
            key, node = next((pair for pair in reversed(node.value) if pair[0].value == part), (None, None))
        else:
            is_there = isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value)
            key = node = node.value[part] if node is not None and is_there else None
        if key is None:
            break
        line = key.start_mark.line + 1
    return line


def dotted(path: KeyPath) -> str:
    """Return a path such as ``("sensors", "front", "rate_hz")`` as users write it: ``sensors.front.rate_hz``."""
    return ".".join(part if (part := str(raw)).isprintable() else repr(part) for raw in path)


def parse_yaml(text: str, file: str) -> YamlDocument:
    """Parse one YAML document.

    Raises:
        InputError: a syntax error, a repeated key, an anchor that contains itself, or an unknown tag.
    """
    try:
        loader = _Loader(text)
        loader.name = file
        node = loader.get_single_node()
        return YamlDocument(None if node is None else _plain(node, (), (), file), file, node)
    except yaml.MarkedYAMLError as error:
        problem = error.problem or "syntax error"
        mark = ("find expected ':'" in problem and error.context_mark) or error.problem_mark or error.context_mark
        message = next((own for part, own in _SYNTAX.items() if part in problem), f"not valid YAML: {problem}")
        raise InputError(message, file=file, line=mark.line + 1 if mark else None) from None
    except yaml.reader.ReaderError as error:
        raise InputError(CONTROL, file=file, line=text.count("\n", 0, error.position) + 1) from None
    except RecursionError:
        raise InputError(TOO_DEEP, file=file) from None


class _Loader(yaml.SafeLoader):
    """YAML loader that resolves scalars by the core schema of YAML 1.2."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Return a mapping node with the entries that ``<<`` merges in; refuse a repeated key."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise InputError("a key must be a single word", file=self.name, line=line)
            if key.value in lines and key.tag != f"{_PREFIX}merge":
                message = f"this key is given twice, first in line {lines[key.value]}; remove one"
                raise InputError(message, key=key.value, file=self.name, line=line)
            lines.setdefault(key.value, line)
        self.flatten_mapping(node)
        return node


_PREFIX = "tag:yaml.org,2002:"
_READ: dict[str, Callable[[str], Any]] = {
    "null": lambda _: None,
    "bool": lambda text: {"true": True, "false": False}[text.lower()],
    "int": lambda text: int(text, 0) if text[:2] in ("0o", "0x") else int(text),
    "float": lambda text: float(text.lower().replace(".inf", "inf").replace(".nan", "nan")),
    "str": str,
    "merge": str,
}
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
    _Loader.add_implicit_resolver(f"{_PREFIX}{_tag}", re.compile(rf"^(?:{_pattern})$"), _first)


def _plain(node: Any, path: KeyPath, around: tuple[yaml.Node, ...], file: str) -> Any:
    """Return a YAML node as a plain value; refuse a node that contains itself, so is among ``around``, its parents."""
    problem = None
    if any(node is outer for outer in around):
        problem = "an anchor that contains itself"
    elif isinstance(node, yaml.SequenceNode):
        return [_plain(child, (*path, number), (*around, node), file) for number, child in enumerate(node.value)]
    elif isinstance(node, yaml.MappingNode):
        return {key.value: _plain(child, (*path, key.value), (*around, node), file) for key, child in node.value}
    elif yaml.reader.Reader.NON_PRINTABLE.search(node.value):
        problem = CONTROL
    elif (read := _READ.get(node.tag.removeprefix(_PREFIX))) is None:
        problem = f"the tag {shortened_text(node.tag, 40)!r} is not known; remove it"
    else:
        try:
            return read(node.value)
        except (ValueError, KeyError):
            problem = f"{node.value[:40]!r} does not fit its tag or is too long"
    raise InputError(problem, key=dotted(path) or None, file=file, line=node.start_mark.line + 1)


#: Part of a message of the parser, and the message that replaces it.
_SYNTAX = {
    "'\\t'": "a tab where YAML needs spaces",
    "mapping values are not allowed": "not valid YAML: a colon is missing in or before this line, or there is a "
    "second ': ' in it, or its indentation is wrong; quote text that contains ': '",
    "could not find expected ':'": "not valid YAML: a key is followed by a colon and a space",
    "<block": "not valid YAML: wrong indentation: the keys of one mapping begin below each other",
    "another document": "a second YAML document; a scenario file holds one",
}
