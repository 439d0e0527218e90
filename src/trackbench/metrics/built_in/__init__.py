"""Metrics of every run with known identities: each class with a ``name`` in a module of this folder."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable, Iterator
from importlib import import_module

from trackbench.metrics.protocol import Metric


def metrics_in(folder: Iterable[str], package: str) -> Iterator[Metric]:
    """Yield the metrics in the modules of a package's folder: modules by name, classes as they are defined."""
    for module in sorted(item.name for item in pkgutil.iter_modules(folder, package + ".")):
        classes = [item for item in vars(import_module(module)).values() if isinstance(item, type)]
        metrics = [item for item in classes if issubclass(item, Metric) and item.__module__ == module]
        yield from (metric() for metric in metrics if hasattr(metric, "name"))


#: Built-in metrics of estimates, in the order of a result.
BUILT_IN: tuple[Metric, ...] = tuple(metrics_in(__path__, __name__))
