"""Choice between the engines: NumPy, the reference, or the fused engine, which compiles the same functions."""

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

#: Number of steps of single objects from which compiling saves more time than it takes.
WORTH_COMPILING = 20_000

log = logging.getLogger(__name__)


def require_engine(name: str) -> None:
    """Raise an error unless the engine with this name is available.

    Raises:
        InputError: no engine has this name, or the fused engine is not available on this machine.
    """
    if name not in ENGINE_NAMES:
        raise InputError(f"no engine {name!r}; {nearest_choices(str(name), ENGINE_NAMES)}", key="engine")
    reason = unavailable() if name == "fused" else None
    if reason is not None:
        raise InputError(f"the fused engine cannot be used: {reason}", key="engine")


def choose_engine(name: EngineName, steps: int) -> Engine:
    """Return the engine that computes a run.

    Args:
        name: ``auto``: the fused engine where it is available and there is enough work, else NumPy.
        steps: number of steps of single objects, over all trackers.

    Raises:
        InputError: no engine has this name, or the fused engine is not available on this machine.
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
    # The import takes a moment, which NumPy need not wait for.
    from trackbench.engine.filters import kernels

    return kernels()


def seconds_on_kernels(engine: Engine) -> float:
    """Return how long this process has spent on making kernels for an engine, s."""
    return 0.0 if engine == "numpy" else _kernels().seconds


def compute_by(engine: Engine) -> Compute:
    """Return the function that computes equations by an engine: by NumPy or by compiled kernels."""
    return by_numpy if engine == "numpy" else _kernels()


def kernels_of(compute: Compute, members: int) -> Kernels | None:
    """Return the kernels of ``compute`` if they can run sequences for groups of ``members`` members; else None."""
    if compute is by_numpy:
        return None
    from trackbench.engine.kernels import Kernels
    from trackbench.engine.vector_code import WIDTH

    return compute if isinstance(compute, Kernels) and members >= WIDTH else None


def filter_by(engine: Engine, filter: Filter[Any]) -> Filter[Any]:
    """Return a filter whose steps are computed by an engine."""
    if engine == "numpy":
        return filter
    from trackbench.engine.filters import fused_filter

    return fused_filter(filter)


@contextmanager
def users_kernels_compared(engine: Engine, compares: bool) -> Iterator[None]:
    """Set for the context whether kernels of users' models are compared with NumPy, as in the first block of a run."""
    if engine == "numpy":
        yield
        return
    before, _kernels().compares = _kernels().compares, compares
    try:
        yield
    finally:
        _kernels().compares = before


def engine_used_by(filter: Filter[Any]) -> EngineUsed:
    """Return the record of the engines that have computed the steps of a filter."""
    result: EngineUsed = getattr(filter, "used", EngineUsed("numpy"))
    return result
