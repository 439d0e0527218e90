"""What the code of a function reads."""

from __future__ import annotations

import dis
from functools import cache
from types import CodeType
from typing import Any, NamedTuple

from trackbench.base.user_code import Frame, last_of_user
from trackbench.engine.graph import Untraceable

CONSTRUCTORS = {"__init__", "__new__", "__post_init__", "model_post_init"}
#: Behind ``type`` where a method asks for its own class.
OF_SELF = "of self"
#: By these instructions, and by %, methods are called that give a text.
FORMATS = {"FORMAT_VALUE", "FORMAT_SIMPLE", "FORMAT_WITH_SPEC", "CONVERT_VALUE"}
TEXTS = {"__str__", "__repr__", "__format__"}
LOADS = {"LOAD_ATTR", "LOAD_METHOD", "LOAD_SUPER_ATTR"}
#: Instructions that change something, or read what cannot be followed.
REFUSED = {
    "STORE_GLOBAL": "sets the global",
    "DELETE_GLOBAL": "deletes the global",
    "STORE_ATTR": "sets the attribute",
    "DELETE_ATTR": "deletes the attribute",
    "STORE_DEREF": "sets the outer variable",
    "IMPORT_NAME": "imports",
    "MATCH_CLASS": "matches a class",
}


class CodeReads(NamedTuple):
    """What the code of a function reads."""

    names: list[tuple[str, ...]]
    """Global names, each with the attributes that are taken of it at once."""
    lines: list[int]
    """Of each."""
    attributes: set[str]
    """All attributes that are taken of anything."""


@cache
def code_reads(code: CodeType) -> CodeReads:
    """What a function reads by its code, and by the functions within it.

    Raises:
        Untraceable: it changes something, or reads what cannot be followed.
    """
    result, chain, before, last = CodeReads([], [], set()), False, None, ""
    steps = [step for step in dis.get_instructions(code) if step.opname != "EXTENDED_ARG"]
    for number, step in enumerate(steps):
        name, line = step.argval, step.positions.lineno if step.positions else None
        if last == "PUSH_EXC_INFO" and step.opname != "WITH_EXCEPT_START":
            # Symbols may raise others than arrays do.
            raise untraceable_at("it handles errors", code, line)
        if step.opname in FORMATS or step.argrepr in ("%", "%="):
            result.attributes.update(TEXTS)
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            after = [step.argval if step.opname.startswith("LOAD") else "" for step in steps[number + 1 : number + 3]]
            result.names.append((name, OF_SELF) if name == "type" and after == [_self(code), ""] else (name,))
            result.lines.append(line or code.co_firstlineno)
        elif step.opname in LOADS:
            if chain:
                result.names[-1] += (name,)
            # By a string's format other attributes are read.
            # Dataclasses compare the class of another with their own.
            of_class = name == "__name__" or (
                name == "__class__" and (before == _self(code) or code.co_name == "__eq__")
            )
            if "format" in name or (name.startswith("__") and name not in CONSTRUCTORS and not of_class):
                raise untraceable_at(f"it reads {name}", code, line)
            result.attributes.add(name)
        elif step.opname in REFUSED and not _harmless(step.opname, name, before, code):
            raise untraceable_at(f"it {REFUSED[step.opname]} {name}", code, line)
        chain = step.opname == "LOAD_GLOBAL" or (chain and step.opname in LOADS)
        before, last = step.argval[-1] if isinstance(step.argval, tuple) else step.argval, step.opname
    for part in (part for part in code.co_consts if isinstance(part, CodeType)):
        names, lines, attributes = code_reads(part)
        result.names.extend(names)
        result.lines.extend(lines)
        result.attributes.update(attributes)
    return result


def _harmless(operation: str, name: str, before: Any, code: CodeType) -> bool:
    """Whether an instruction sets a variable of its own, or an attribute of the object that it constructs."""
    if operation == "STORE_DEREF":
        return name in code.co_cellvars
    return operation == "STORE_ATTR" and code.co_name in CONSTRUCTORS and before == code.co_varnames[0]


def _self(code: CodeType) -> str | None:
    """The name of a method's first argument, if it is the usual one."""
    return next((name for name in code.co_varnames[:1] if name in ("self", "cls")), None)


def untraceable_at(what: str, code: CodeType, line: int | None) -> Untraceable:
    """Why a function cannot be traced, and where it says so."""
    where = last_of_user([Frame(code.co_filename, line or code.co_firstlineno, code.co_name)])
    return Untraceable(f"{what} ({where})" if where else what)
