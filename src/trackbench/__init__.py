"""trackbench: a test bench for radar and lidar vehicle trackers.

What a program or a notebook needs is here, and is imported when it is first used::

    import trackbench as tb

    result = tb.run("highway", workers=2)
    result["ekf_cv"].position_rmse.value
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trackbench.api.compare import Comparison, compare
    from trackbench.api.result import Result
    from trackbench.api.run import run
    from trackbench.api.scenario import load
    from trackbench.api.scene import sense, truth
    from trackbench.errors import InputError, TrackbenchError
    from trackbench.scenario import LoadedScenario as Scenario
    from trackbench.testing import check_tracker
    from trackbench.types import Estimate, Scan, Truth

    __version__: str

_MODULES = {
    "Comparison": "api.compare",
    "Estimate": "types",
    "InputError": "errors",
    "Result": "api.result",
    "Scan": "types",
    "TrackbenchError": "errors",
    "Truth": "types",
    "check_tracker": "testing",
    "compare": "api.compare",
    "load": "api.scenario",
    "run": "api.run",
    "sense": "api.scene",
    "truth": "api.scene",
}

__all__ = [
    "Comparison",
    "Estimate",
    "InputError",
    "Result",
    "Scan",
    "Scenario",
    "TrackbenchError",
    "Truth",
    "check_tracker",
    "compare",
    "load",
    "run",
    "sense",
    "truth",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("trackbench")
    elif name == "Scenario":
        from trackbench.scenario import LoadedScenario as found
    elif name in _MODULES:
        found = getattr(import_module(f"trackbench.{_MODULES[name]}"), name)
    else:
        raise AttributeError(f"module 'trackbench' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})


class _Package(ModuleType):
    """``compare`` and ``truth`` are functions here, and packages that are imported by their full names."""

    def __setattr__(self, name: str, value: object) -> None:
        # Importing a subpackage puts it here under its name, where the function would then be gone.
        if name not in __all__ or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
