"""Filters whose equations are computed by kernels, the machine code of the fused engine."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

from trackbench.base.types import Array, Gaussian, Scan
from trackbench.engine import options
from trackbench.engine.beliefs import (
    REUSED,
    belief_of,
    belief_values,
    component_axes,
    scan_of,
    scan_placeholder,
    scan_values,
)
from trackbench.engine.equations import ComputedBy, EngineUsed, Equations, Values
from trackbench.engine.kernels import Kernel, Kernels
from trackbench.engine.symbols import is_traced
from trackbench.engine.user_types import is_user_type, says_pure, user_types
from trackbench.filters import (
    AnyBelief,
    Belief,
    Filter,
    InteractingMultipleModel,
    Measured,
    PredictedMeasurement,
    Step,
    StepGuard,
    Update,
)
from trackbench.models.motion import MotionModel
from trackbench.models.sensors import SENSOR_MODELS

#: Outputs of an update that mean nothing without a measurement.
OF_MEASUREMENT = ("innovation", "whitened", "log_likelihood")
#: Placeholder for the time step of a prediction, s: one kernel serves all time steps.
ANY_TIME = 0.1


class FusedFilter:
    """Filter that computes each step by one kernel of the fused engine, and by NumPy where a step cannot be traced."""

    def __init__(self, filter: Filter[Any], kernels: Kernels) -> None:
        self.filter = filter
        self._kernels = kernels
        self._chain = filter.chain if isinstance(filter, InteractingMultipleModel) else None
        self.modes = 0 if self._chain is None else len(filter.motions)
        self.options = options.options(filter)
        self.form = options.form(filter)
        # A state that begins with px, py, vx, vy needs no conversion.
        self._cartesian_state = type(filter.motions[0]).cartesian_belief is MotionModel.cartesian_belief
        self._sensors_matter = any(motion.sensors_with_errors for motion in filter.motions)
        self._equations: dict[Hashable, Equations] = {}
        self._scan: Any = None
        """Scan that the current call depends on; a kernel gets only its arrays."""
        self._user_types = user_types(filter.motions)
        self._by_kernels, self._again, self._of_pure, self._differs = False, 0, False, False
        self._untraced: dict[str, str] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        # Machine code is not pickled.
        return fused_filter, (self.filter,)

    @property
    def used(self) -> EngineUsed:
        """Record of the engines that computed the steps so far."""
        engine: ComputedBy = "fused and numpy" if self._untraced or self._again else "fused"
        if self._untraced and not self._by_kernels:
            engine = "numpy"
        # A reason that several kinds of steps share is reported for the first kind.
        firsts = {why: name for name, why in reversed(self._untraced.items())}
        reasons = "; ".join(f"{name}: {why}" for name, why in self._untraced.items() if firsts[why] == name)
        return EngineUsed(engine, reasons, self._again, self._of_pure, self._differs)

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        return self.filter.motions

    @property
    def begin(self) -> Callable[[Callable[[MotionModel], Gaussian]], AnyBelief]:
        return self.filter.begin

    @cached_property
    def measured(self) -> Callable[[Scan], Measured]:
        return self.filter.measured

    def predict(self, belief: AnyBelief, dt: float) -> AnyBelief:
        values = belief_values(belief) | self.time(dt)
        return belief_of(self.computed("prediction", _predicted, values), self.modes)

    def predict_measurement(self, belief: AnyBelief, scan: Scan) -> PredictedMeasurement:
        """Return the predicted measurement for a scan, computed by NumPy."""
        return self.filter.predict_measurement(belief, scan)

    def update(self, belief: AnyBelief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Any]:
        """Return the belief updated with a scan; the kernel does not use ``predicted`` and computes it anew."""
        values = belief_values(belief) | scan_values(scan)
        return self._update_of(self.computed("update", _updated, values, scan))

    def step(self, belief: AnyBelief, dt: float, scan: Scan, guard: StepGuard | None = None) -> Step[Any]:
        """Predict by ``dt`` seconds and update with a scan; mark members whose prediction the test ``guard`` fails."""
        values = belief_values(belief, without=REUSED) | self.time(dt) | scan_values(scan)
        result = self.computed("step", partial(_step, guard=guard), values, scan, guard)
        cartesian = Gaussian(result["cartesian"], result["cartesian covariance"])
        refused: Any = result.get("refused")
        return Step(self._update_of(result), cartesian, refused)

    def smooth(self, belief: AnyBelief, later: AnyBelief, dt: float) -> AnyBelief:
        """Return the smoothed belief, computed by NumPy."""
        self._untraced.setdefault("smoothing", "smoothers are computed by NumPy")
        result: AnyBelief = self.filter.smooth(belief, later, dt)
        return result

    def cartesian(self, belief: AnyBelief) -> Gaussian:
        if self._cartesian_state and isinstance(belief, Belief):
            return Gaussian(belief.mean[:4], belief.covariance[:4, :4])
        result = self.computed("cartesian", _cartesian, belief_values(belief, without=REUSED))
        return Gaussian(result["cartesian"], result["cartesian covariance"])

    def time(self, dt: float) -> dict[str, Any]:
        """Return the inputs of a prediction that depend on the time step ``dt`` in s, by name."""
        return {"dt": dt} if self._chain is None else {"dt": dt, "chain": self._chain(dt)}

    def _update_of(self, result: Mapping[str, Array]) -> Update[Any]:
        return Update(
            belief_of(result, self.modes),
            result["innovation"],
            result["innovation covariance"],
            result["whitened"],
            mixture=result.get("log_likelihood"),
        )

    def step_kernel(self, belief: AnyBelief, scan: Scan, guard: StepGuard | None) -> Kernel | None:
        """Return machine code that predicts and updates beliefs like this one; None if only NumPy can do it."""
        values = belief_values(belief, without=REUSED) | self.time(ANY_TIME) | scan_values(scan)
        return self._kernel(self._equations_of("step", partial(_step, guard=guard), values, scan, guard), values)

    def prediction_kernel(self, belief: AnyBelief) -> Kernel | None:
        """Return machine code that predicts beliefs like this one; None if only NumPy can do it."""
        values = belief_values(belief, without=REUSED) | self.time(ANY_TIME)
        return self._kernel(self._equations_of("prediction", _predicted, values), values)

    def cartesian_kernel(self, belief: AnyBelief) -> Kernel | None:
        """Return machine code that converts beliefs like this one to px, py, vx, vy; None if only NumPy can do it."""
        values = belief_values(belief, without=REUSED)
        return self._kernel(self._equations_of("cartesian", _cartesian, values), values)

    def _kernel(self, equations: Equations, values: Mapping[str, Any]) -> Kernel | None:
        inputs = {**values, **self.options}
        # Kernels of users' models are compared with NumPy step by step.
        is_compared = bool(equations.user_types) and self._kernels.compares
        if is_compared or equations.ranks.keys() != inputs.keys():
            return None
        return self._kernels.plan(equations, inputs)[0].kernel

    def computed(
        self,
        name: str,
        function: Callable[[FilterCall, Values], Values],
        values: dict[str, Any],
        scan: Scan | None = None,
        made_for: Hashable = None,
    ) -> dict[str, Array]:
        """Compute a function of the filter and of named arrays, by a kernel where possible.

        Args:
            name: name of the result, for messages.
            function: function of the filter's arguments and of the named arrays, which can be traced.
            values: arrays by their names in ``beliefs``.
            scan: scan on which the result depends; None if it depends on no scan.
            made_for: key that distinguishes functions with the same ``name``.
        """
        self._scan = scan
        equations = self._equations_of(name, function, values, scan, made_for)
        values = values | self.options
        before = self._kernels.members_by_numpy
        try:
            return self._kernels(equations, values)
        finally:
            self._scan = None
            self._again += self._kernels.members_by_numpy - before
            self._differs |= equations.key in self._kernels.differing
            if equations.key in self._kernels.untraced:
                title, why = self._kernels.untraced[equations.key]
                self._untraced[title] = why
                self._of_pure |= bool(equations.user_types) and all(map(says_pure, equations.user_types))
            else:
                self._by_kernels = True

    def _equations_of(
        self,
        name: str,
        function: Callable[[FilterCall, Values], Values],
        values: Mapping[str, Any],
        scan: Scan | None = None,
        made_for: Hashable = None,
    ) -> Equations:
        """Return the equations that :meth:`computed` uses, from a cache, with the motion models' options as inputs."""
        kind = "" if scan is None else scan.kind
        sensor = scan.sensor if scan is not None and self._sensors_matter else None
        # Editing a sensor in a notebook makes another class of the same name.
        place = name, SENSOR_MODELS.plugins.get(kind), sensor, made_for, tuple(values)
        if place in self._equations:
            return self._equations[place]
        sensors = () if scan is None else (SENSOR_MODELS[kind],)
        inputs = {item: component_axes(item) for item in values}
        symmetric = frozenset(item for item in inputs if item.partition(" ")[0] in ("covariance", "spread"))
        counted = dict.fromkeys(OF_MEASUREMENT, "valid") if kind else {}
        title = f"{name} by {_filter_in_words(self.filter)}{f' from a {kind}' if kind else ''}"

        def any_filter(values: Values) -> Values:
            call_scan = scan_placeholder(kind, sensor) if is_traced(values) else self._scan
            return function(FilterCall(options.with_options(self.filter, values), self.modes, call_scan), values)

        key = name, self.form, *sensors, sensor, made_for, tuple(inputs)
        users = (*self._user_types, *filter(is_user_type, sensors))
        ranks = inputs | dict.fromkeys(self.options, 0)
        equations = Equations(title, any_filter, ranks, symmetric, counted, key, user_types=users)
        self._equations[place] = equations
        return equations


@cache
def kernels() -> Kernels:
    """Return this process's only engine that compiles and stores kernels."""
    return Kernels()


def fused_filter(filter: Filter[Any]) -> FusedFilter:
    """Return a filter that computes with the kernels of this process."""
    return FusedFilter(filter, kernels())


class FilterCall(NamedTuple):
    """Arguments with which a filter's function is traced, apart from the arrays, which are passed by name."""

    filter: Any
    modes: int
    """Number of the beliefs' motion models; 0 for beliefs without modes."""
    scan: Scan
    """Scan on which the function depends; its arrays are passed separately by name."""


def _filter_in_words(filter: Filter[Any]) -> str:
    return f"{type(filter).__name__} with {', '.join(type(motion).__name__ for motion in filter.motions)}"


def predicted_belief(call: FilterCall, values: Values) -> AnyBelief:
    """Return the prediction of the belief in ``values`` by the time step in ``values``."""
    belief = belief_of(values, call.modes)
    # With no time passed modes are not mixed, so that one that is not finite does not affect the others.
    if call.modes and (is_traced(values) or values["dt"] > 0.0):
        result: AnyBelief = call.filter.predict_by(belief, values["dt"], values["chain"])
    else:
        result = call.filter.predict(belief, values["dt"])
    return result


def _predicted(call: FilterCall, values: Values) -> Values:
    return belief_values(predicted_belief(call, values))


def _updated(call: FilterCall, values: Values) -> Values:
    belief = belief_of(values, call.modes)
    return _update_values(call.filter.update(belief, scan_of(values, call.scan)))


def _step(call: FilterCall, values: Values, guard: StepGuard | None) -> Values:
    predicted = predicted_belief(call, values)
    update = call.filter.update(predicted, scan_of(values, call.scan))
    result = {**_update_values(update), **_cartesian_values(call.filter.cartesian(update.belief))}
    # The next step recomputes reusable values, which is quicker than writing and reading them.
    result = {name: value for name, value in result.items() if not name.startswith(("factor", "points"))}
    return result if guard is None else {**result, "refused": guard(predicted)}


def _cartesian(call: FilterCall, values: Values) -> Values:
    return _cartesian_values(call.filter.cartesian(belief_of(values, call.modes)))


def _cartesian_values(cartesian: Gaussian) -> Values:
    return {"cartesian": cartesian.mean, "cartesian covariance": cartesian.covariance}


def _update_values(update: Update[Any]) -> Values:
    return {
        **belief_values(update.belief),
        "innovation": update.innovation,
        "innovation covariance": update.innovation_covariance,
        "whitened": update.whitened_innovation,
        "log_likelihood": update.mixture,
    }
