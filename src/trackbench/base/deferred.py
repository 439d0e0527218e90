"""Modules that are imported when they are first used."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

#: The environment variable that OpenBLAS reads when it is loaded.
THREADS = "OPENBLAS_NUM_THREADS"


class _StandIn(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if sys.modules.get(self.__name__) is self:
            raise AttributeError(name)
        return getattr(import_module(self.__name__), name)


@contextmanager
def imported_when_used(*names: str) -> Iterator[None]:
    """Meanwhile whoever imports one of these gets a stand-in, which imports the module when a name of it is used.

    Args:
        names: of modules, packages before what is in them; those that are imported already stay.
    """
    stand_ins = {name: _StandIn(name) for name in names if name not in sys.modules}
    for name, module in stand_ins.items():
        package, _, attribute = name.rpartition(".")
        if package in stand_ins:
            setattr(stand_ins[package], attribute, module)
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for name in stand_ins:
            sys.modules.pop(name)


def lighten_imports() -> None:
    """Let NumPy start one thread of OpenBLAS, and pyarrow do without pandas until somebody imports it.

    The matrices here have a few rows, and the other threads would wait busily for a tenth of a second.
    """
    finder = _Finder()
    sys.meta_path.insert(0, finder)
    if "pyarrow" in sys.modules:
        finder.look(sys.modules["pyarrow"])


class _Finder(MetaPathFinder):
    hidden = False

    def look(self, pyarrow: ModuleType) -> None:
        """Let pyarrow look for pandas now, and not find it."""
        if "pandas" not in sys.modules:
            self.hidden = True
            pyarrow.array([])
            self.hidden = False

    def tell(self, pandas: ModuleType) -> None:
        """Tell pyarrow of pandas."""
        if "pyarrow" in sys.modules:
            # To read this attribute, pyarrow imports pandas again.
            assert sys.modules["pyarrow.lib"]._pandas_api.pd is pandas

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in ("numpy", "pandas", "pyarrow"):
            return None
        if fullname == "pandas" and self.hidden:
            raise ModuleNotFoundError(name=fullname)
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        sys.meta_path.insert(0, self)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                own = fullname == "numpy" and THREADS not in os.environ
                if own:
                    os.environ[THREADS] = "1"
                execute(module)
                if own:
                    # Processes that are started later have as many as they like.
                    del os.environ[THREADS]
                {"pyarrow": self.look, "pandas": self.tell}.get(fullname, id)(module)

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
