"""Which engine computes: NumPy, the reference, or the fused one, which compiles the same functions."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal, get_args

from trackbench.base.errors import InputError, nearest_choices
from trackbench.engine.equations import Compute, EngineUsed, by_numpy
from trackbench.engine.machine import unavailable

if TYPE_CHECKING:
    from trackbench.engine.kernels import Kernels
    from trackbench.filters import Filter

Engine = Literal["numpy", "fused"]
EngineName = Literal["auto", "numpy", "fused"]
ENGINE_NAMES: tuple[EngineName, ...] = get_args(EngineName)

#: Steps of single objects from which the fused engine saves more time than it takes to compile.
WORTH_COMPILING = 20_000

log = logging.getLogger(__name__)


def require_engine(name: str) -> None:
    """Make sure that an engine can be had.

    Raises:
        InputError: there is none of this name, or it is the fused one, which cannot be had here; says why.
    """
    if name not in ENGINE_NAMES:
        raise InputError(f"no engine {name!r}; {nearest_choices(str(name), ENGINE_NAMES)}", key="engine")
    reason = unavailable() if name == "fused" else None
    if reason is not None:
        raise InputError(f"the fused engine cannot be used: {reason}", key="engine")


def chosen(name: EngineName, steps: int) -> Engine:
    """The engine that computes.

    Args:
        name: ``auto``: the fused one where it can be had and there is work enough, else NumPy.
        steps: how many steps of single objects all trackers together take.

    Raises:
        InputError: there is none of this name, or it is the fused one, which cannot be had here; says why.
    """
    require_engine(name)
    if name != "auto":
        return name
    reason = f"{steps} steps are not worth compiling" if steps < WORTH_COMPILING else unavailable()
    if reason is not None:
        log.info("computed by NumPy: %s", reason)
        return "numpy"
    log.info("computed by the fused engine: %s steps", f"{steps:,}")
    return "fused"


def _kernels() -> Kernels:
    # Its import takes a moment.
    from trackbench.engine.filters import kernels

    return kernels()


def seconds_on_kernels(engine: Engine) -> float:
    """How long this process has spent on making kernels so far."""
    return 0.0 if engine == "numpy" else _kernels().seconds


def compute_by(engine: Engine) -> Compute:
    """How an engine computes equations."""
    return by_numpy if engine == "numpy" else _kernels()


def kernels_of(compute: Compute, members: int) -> Kernels | None:
    """The kernels that compute, where they can make sequences of calls for groups of so many members."""
    if compute is by_numpy:
        return None
    from trackbench.engine.kernels import Kernels
    from trackbench.engine.vector_code import WIDTH

    return compute if isinstance(compute, Kernels) and members >= WIDTH else None


def filter_by(engine: Engine, filter: Filter[Any]) -> Filter[Any]:
    """A filter as an engine computes it."""
    if engine == "numpy":
        return filter
    from trackbench.engine.filters import fused_filter

    return fused_filter(filter)


@contextmanager
def users_kernels_compared(engine: Engine, compares: bool) -> Iterator[None]:
    """Choose whether kernels of users' models are compared with NumPy; only the first block of a run needs it."""
    if engine == "numpy":
        yield
        return
    before, _kernels().compares = _kernels().compares, compares
    try:
        yield
    finally:
        _kernels().compares = before


def used(filter: Filter[Any]) -> EngineUsed:
    """What computed the steps of such a filter so far."""
    result: EngineUsed = getattr(filter, "used", EngineUsed("numpy"))
    return result
