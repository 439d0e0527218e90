"""trackbench: a test bench for radar and lidar vehicle trackers.

The public names of a program or a notebook, each imported at its first use::

    import trackbench as tb

    result = tb.run("highway", workers=2)
    print(result["ekf_cv"].position_rmse)
"""

import sys
import time
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trackbench.api.compare import ReportableComparison as Comparison
    from trackbench.api.compare import compare
    from trackbench.api.live import live
    from trackbench.api.result import ReportableResult as Result
    from trackbench.api.run import run
    from trackbench.api.scenario import load, sense, truth, worlds
    from trackbench.base.errors import InputError, TrackbenchError
    from trackbench.base.types import Estimate, Scan, Tracks, Truth
    from trackbench.scenario import Scenario
    from trackbench.subjects.doctor.api import doctor
    from trackbench.subjects.doctor.report import Examination
    from trackbench.subjects.export.api import export
    from trackbench.subjects.log_audit.api import ReportableAudit as LogAudit
    from trackbench.subjects.log_audit.api import audit
    from trackbench.subjects.score.api import score
    from trackbench.subjects.tuning.api import tune
    from trackbench.testing import check_tracker

    __version__: str
    __all__ = [
        "Comparison",
        "Estimate",
        "Examination",
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
        "doctor",
        "export",
        "live",
        "load",
        "run",
        "score",
        "sense",
        "truth",
        "tune",
        "worlds",
    ]

#: Time at which the package was imported, seconds since 1970.
STARTED = time.time()

#: ``module:attribute`` of the core's public names; each subject lists its own.
_CORE = {
    "Comparison": "api.compare:ReportableComparison",
    "Estimate": "base.types:Estimate",
    "InputError": "base.errors:InputError",
    "Result": "api.result:ReportableResult",
    "Scan": "base.types:Scan",
    "Scenario": "scenario:Scenario",
    "TrackbenchError": "base.errors:TrackbenchError",
    "Tracks": "base.types:Tracks",
    "Truth": "base.types:Truth",
    "check_tracker": "testing:check_tracker",
    "compare": "api.compare:compare",
    "live": "api.live:live",
    "load": "api.scenario:load",
    "run": "api.run:run",
    "sense": "api.scenario:sense",
    "truth": "api.scenario:truth",
    "worlds": "api.scenario:worlds",
}


def _targets() -> dict[str, str]:
    """Return ``module:attribute`` of every public name."""
    from trackbench.base.subjects import offered

    return {**{name: f"trackbench.{target}" for name, target in _CORE.items()}, **dict(offered("api"))}


def __getattr__(name: str) -> Any:
    value: Any
    if name == "__version__":
        from importlib.metadata import version

        value = version("trackbench")
    elif name == "__all__":
        value = sorted(_targets())
    elif not name.startswith("_") and (target := _targets().get(name)):
        module, attribute = target.split(":")
        value = getattr(import_module(module), attribute)
    else:
        raise AttributeError(f"module 'trackbench' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*_targets(), "__version__"])


class _Package(ModuleType):
    """Package whose attributes ``compare`` and ``truth`` are functions, although it has subpackages of these names."""

    def __setattr__(self, name: str, value: object) -> None:
        # Importing a subpackage sets it as an attribute, which would replace the function.
        if name not in _CORE or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
