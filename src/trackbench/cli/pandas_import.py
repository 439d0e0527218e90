"""pandas is imported only where it is used: pyarrow imports it at the first array that it makes, which takes .3 s."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType


def defer_pandas() -> None:
    """Let pyarrow, where it is imported, look for pandas now and not find it; tell pyarrow when pandas is imported."""
    if "pyarrow" not in sys.modules or "pandas" in sys.modules:
        return
    import pyarrow as pa

    finder = _PandasFinder()
    sys.meta_path.insert(0, finder)
    pa.array([])
    finder.hidden = False


class _PandasFinder(MetaPathFinder):
    """Hides pandas at first; then finds it once, and pyarrow knows its types from the end of the import on."""

    hidden = True

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "pandas":
            return None
        if self.hidden:
            raise ModuleNotFoundError(name=fullname)
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                from pyarrow.lib import _pandas_api

                # To read this attribute, pyarrow imports pandas again.
                assert _pandas_api.pd is module

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
