"""Modules that are imported when they are first used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any


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


def defer_pandas() -> None:
    """Let pyarrow look for pandas once it is imported, and not find it; tell pyarrow when pandas is imported."""
    finder = _PandasFinder()
    sys.meta_path.insert(0, finder)
    if "pyarrow" in sys.modules:
        finder.look(sys.modules["pyarrow"])


class _PandasFinder(MetaPathFinder):
    hidden = False

    def look(self, pyarrow: ModuleType) -> None:
        if "pandas" not in sys.modules:
            self.hidden = True
            pyarrow.array([])
            self.hidden = False

    def tell(self, pandas: ModuleType) -> None:
        sys.meta_path.remove(self)
        if "pyarrow" in sys.modules:
            # To read this attribute, pyarrow imports pandas again.
            assert sys.modules["pyarrow.lib"]._pandas_api.pd is pandas

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname == "pandas" and self.hidden:
            raise ModuleNotFoundError(name=fullname)
        then = {"pyarrow": self.look, "pandas": self.tell}.get(fullname)
        return None if then is None else self._followed(fullname, then)

    def _followed(self, name: str, then: Callable[[ModuleType], None]) -> ModuleSpec | None:
        sys.meta_path.remove(self)
        spec = find_spec(name)
        sys.meta_path.insert(0, self)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                then(module)

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
