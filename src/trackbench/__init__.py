"""trackbench: a test bench for radar and lidar vehicle trackers.

What a program or a notebook needs is here, and is imported when it is first used::

    import trackbench as tb

    result = tb.run("highway", workers=2)
    result["ekf_cv"].position_rmse.value
"""

import sys
import time
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trackbench.api.audit import ReportableAudit as LogAudit
    from trackbench.api.audit import audit
    from trackbench.api.compare import ReportableComparison as Comparison
    from trackbench.api.compare import compare
    from trackbench.api.result import ReportableResult as Result
    from trackbench.api.run import run
    from trackbench.api.scenario import load
    from trackbench.api.scene import sense, truth
    from trackbench.api.tuned import tune
    from trackbench.errors import InputError, TrackbenchError
    from trackbench.scenario import Scenario
    from trackbench.testing import check_tracker
    from trackbench.types import Estimate, Scan, Tracks, Truth

    __version__: str

#: When the first of the package was read, seconds since 1970.
STARTED = time.time()

#: Where each name comes from.
_HOMES = {
    "Comparison": ("api.compare", "ReportableComparison"),
    "Estimate": ("types", "Estimate"),
    "LogAudit": ("api.audit", "ReportableAudit"),
    "InputError": ("errors", "InputError"),
    "Result": ("api.result", "ReportableResult"),
    "Scan": ("types", "Scan"),
    "Scenario": ("scenario", "Scenario"),
    "TrackbenchError": ("errors", "TrackbenchError"),
    "Tracks": ("types", "Tracks"),
    "Truth": ("types", "Truth"),
    "audit": ("api.audit", "audit"),
    "check_tracker": ("testing", "check_tracker"),
    "compare": ("api.compare", "compare"),
    "load": ("api.scenario", "load"),
    "run": ("api.run", "run"),
    "sense": ("api.scene", "sense"),
    "truth": ("api.scene", "truth"),
    "tune": ("api.tuned", "tune"),
}

__all__ = [
    "Comparison",
    "Estimate",
    "InputError",
    "LogAudit",
    "Result",
    "Scan",
    "Scenario",
    "TrackbenchError",
    "Tracks",
    "Truth",
    "audit",
    "check_tracker",
    "compare",
    "load",
    "run",
    "sense",
    "truth",
    "tune",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("trackbench")
    elif name in _HOMES:
        module, own_name = _HOMES[name]
        found = getattr(import_module(f"trackbench.{module}"), own_name)
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
