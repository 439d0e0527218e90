"""SciPy's compiled functions without the packages around them.

To import ``scipy.special`` takes .2 s and ``scipy.optimize`` .5 s. The compiled modules in them, where the functions
are that are used here, take .01 s.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import Any

from trackbench.base.types import Array, Indices

#: Held while a compiled module or the package around it is imported.
_LOCK = threading.RLock()


@cache
def scipy_function(package: str, module: str, name: str) -> Callable[..., Any]:
    """The function ``package.name`` from the compiled module in which it is defined.

    Args:
        package: such as ``scipy.special``; it is imported where the module has no such function.
        module: of the package, such as ``_ufuncs``; which modules there are differs between versions of SciPy.
        name: of the function.
    """
    with _LOCK:
        if package not in sys.modules:
            _defer(package)
        try:
            function = getattr(import_module(f"{package}.{module}"), name)
        except (ImportError, AttributeError):
            function = getattr(import_module(package), name)
    result: Callable[..., Any] = function
    return result


def largest_assignment(value: Array) -> tuple[Indices, Indices]:
    """Rows and columns of the assignment with the largest total ``value`` ``(rows, columns)``."""
    rows, columns = scipy_function("scipy.optimize", "_lsap", "linear_sum_assignment")(value, maximize=True)
    return rows, columns


class _DeferredPackage(ModuleType):
    """A package whose ``__init__`` is run when a name is asked for that is not there yet."""

    def __getattr__(self, name: str) -> Any:
        # Tools that look at every module ask for names such as __wrapped__.
        if name.startswith("__") and name != "__all__":
            raise AttributeError(name)
        with _LOCK:
            if "__deferred__" in self.__dict__:
                del self.__dict__["__deferred__"]
                _initialise(self)
        return ModuleType.__getattribute__(self, name)


def _defer(package: str) -> None:
    spec = find_spec(package)
    if spec is None:
        raise ImportError(f"no package {package}", name=package)
    module = module_from_spec(spec)
    module.__dict__["__deferred__"] = True
    module.__class__ = _DeferredPackage
    sys.modules[package] = module
    parent, _, name = package.rpartition(".")
    setattr(sys.modules[parent], name, module)


def _initialise(module: ModuleType) -> None:
    spec = module.__spec__
    assert spec is not None
    assert spec.loader is not None
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(module.__name__, None)
        raise
    module.__class__ = ModuleType
