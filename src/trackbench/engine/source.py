"""The source of the package's own equations, by which their kernels are found again without a trace."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable, Sequence
from functools import cache
from pathlib import Path

from trackbench import STARTED
from trackbench.engine.equations import Equations
from trackbench.engine.layout import Input, KernelLayout, Output

PACKAGE = Path(__file__).parent.parent


def source_key(equations: Equations, inputs: Sequence[Input]) -> str | None:
    """What equations of the package compute of certain inputs, as text; None of others, whose source may change."""
    source = package_source()
    if source is None or not equations.function.__module__.startswith("trackbench."):
        return None
    said = _told(equations.key)
    return None if said is None else repr((source, equations.name, said, tuple(inputs)))


@cache
def package_source() -> str | None:
    """A checksum of the package.

    None where there are no sources, they cannot be read, or a file was changed after the process began, which may have
    read it.
    """
    files = sorted(PACKAGE.rglob("*.py"))
    total = hashlib.sha256()
    try:
        if not files or max(file.stat().st_mtime for file in files) >= STARTED:
            return None
        for file in files:
            total.update(file.read_bytes())
    except OSError:
        return None
    return total.hexdigest()


def _told(value: Hashable) -> str | None:
    """A key as text that means the same in another process."""
    if isinstance(value, tuple):
        parts = [_told(item) for item in value]
        return None if None in parts else f"({', '.join(map(str, parts))})"
    if isinstance(value, type):
        name = f"{value.__module__}.{value.__qualname__}"
        return name if name.startswith("trackbench.") else None
    if value is None or isinstance(value, str | float | int | bytes):
        return repr(value)
    own = _told(type(value))
    return None if own is None or "object at 0x" in repr(value) else repr(value)


def packed(layout: KernelLayout, code: bytes) -> bytes:
    """A layout and its code as one."""
    return json.dumps(layout).encode() + b"\n" + code


def unpacked(data: bytes) -> tuple[KernelLayout, bytes]:
    """What ``packed`` made."""
    head, _, code = data.partition(b"\n")
    inputs, outputs, same = json.loads(head)
    return KernelLayout(
        tuple(Input(name, tuple(shape), *more) for name, shape, *more in inputs),
        tuple(Output(name, tuple(shape), boolean) for name, shape, boolean in outputs),
        same,
    ), code
