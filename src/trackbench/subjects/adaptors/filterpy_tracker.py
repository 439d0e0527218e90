"""A tracker for each class of filters of FilterPy, and what each class takes."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, UnscentedKalmanFilter

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.base.units import difference
from trackbench.subjects.adaptors.layout import POSITION, Layout, Reader
from trackbench.subjects.adaptors.options import (
    OWN,
    FilterPyOptions,
    FilterPySensor,
    entry_of_sensor,
    import_function,
    made,
    takes_state,
)
from trackbench.subjects.adaptors.tracker import AdaptedTracker, Updated


class Kind(NamedTuple):
    """What one class of filters takes."""

    own: Mapping[str, str]
    """Its matrices that hold for one interval only, each with the option that replaces it by a function of dt."""
    options: tuple[str, ...]
    sensor: tuple[str, ...]


COMMON = ("filter", "filter_options", "state", "initial", "dt_s", "process_noise", "sensors")
MATRICES = {"F": "transition", "Q": "process_noise"}
KINDS: dict[type, Kind] = {
    KalmanFilter: Kind(MATRICES, ("transition",), ("measurement", "R")),
    ExtendedKalmanFilter: Kind(
        MATRICES, ("transition", "fx"), ("measurement", "R", "hx", "HJacobian", "residual", "args")
    ),
    UnscentedKalmanFilter: Kind({"Q": "process_noise"}, (), ("measurement", "R", "hx", "residual", "z_mean", "args")),
}


def filter_class(filter_: Any, options: FilterPyOptions) -> type:
    """The class of a filter, the options held against it.

    Raises:
        InputError: it is no filter that this adaptor knows, or an option does not go with it.
    """
    kind = next((kind for kind in KINDS if isinstance(filter_, kind)), None)
    if kind is None:
        names = ", ".join(kind.__name__ for kind in KINDS)
        raise InputError(f"filter: {options.filter!r} gives a {type(filter_).__name__}, not one of {names}")
    takes = KINDS[kind]
    _only(options.model_fields_set, (*COMMON, *takes.options), kind, "")
    for name, sensor in (options.sensors or {}).items():
        _only(sensor.model_fields_set, takes.sensor, kind, f"sensors.{name}.")
        if kind is ExtendedKalmanFilter and (sensor.hx is None) != (sensor.HJacobian is None):
            missing = "hx" if sensor.hx is None else "HJacobian"
            raise InputError(f"sensors.{name}.{missing}: missing: an ExtendedKalmanFilter needs hx and HJacobian")
        if kind is ExtendedKalmanFilter and sensor.hx == OWN:
            raise InputError(f"sensors.{name}.hx: an ExtendedKalmanFilter has none of its own; name a function")
    held = [name for name, option in takes.own.items() if getattr(options, option) is None]
    functions = " and ".join(takes.own[name] for name in held or takes.own)
    counted = "a function" if len(held) == 1 else "functions"
    if held and options.dt_s is None:
        raise InputError(
            f"dt_s: missing: the filter's own {' and '.join(held)} {'holds' if len(held) == 1 else 'hold'} for one "
            f"interval only; say which (s), or give {functions}, as {counted} of dt"
        )
    if not held and options.dt_s is not None:
        raise InputError(f"dt_s: not used beside {functions}; remove it")
    return kind


def _only(keys: set[str], used: tuple[str, ...], kind: type, where: str) -> None:
    for key in sorted(keys - set(used)):
        raise InputError(f"{where}{key}: not used with {kind.__name__}, which takes {', '.join(used)}")


class SensorUse(NamedTuple):
    """How the measurements of a sensor are given to the filter, its functions found."""

    reader: Reader
    states_noise: bool = True
    own: bool = False
    """Whether the user's functions say what is expected, not trackbench's sensor models."""
    hx: Callable[..., Array] | None = None
    jacobian: Callable[..., Array] | None = None
    residual: Callable[..., Array] | None = None
    mean: Callable[..., Array] | None = None
    args: tuple[str, ...] = ()


def sensing(options: FilterPyOptions, kind: type, layout: Layout) -> dict[str, SensorUse] | SensorUse:
    """How each sensor's measurements are given to the filter, by the sensor's name or kind, or how those of all are.

    Raises:
        InputError: a function cannot be found.
    """
    # A linear filter can be given nothing but a position, unless the user says what its own H is of.
    usual = POSITION if kind is KalmanFilter else None

    def use_of(name: str, sensor: FilterPySensor) -> SensorUse:
        def of(key: str) -> Callable[..., Array] | None:
            reference = getattr(sensor, key)
            return None if reference in (None, OWN) else import_function(f"sensors.{name}.{key}", reference)

        return SensorUse(
            Reader(layout, sensor.measurement or usual),
            sensor.states_noise,
            sensor.hx is not None,
            of("hx"),
            of("HJacobian"),
            of("residual"),
            of("z_mean"),
            tuple(sensor.args),
        )

    if options.sensors is None:
        return SensorUse(Reader(layout, usual))
    return {name: use_of(name, sensor) for name, sensor in options.sensors.items()}


#: The interval with which a user's function is tried, s.
TRIAL_DT = 0.1


class FilterPyTracker(AdaptedTracker):
    """Runs a copy of the user's filter; every step works on a copy of the one before."""

    def __init__(self, options: FilterPyOptions, kind: type, filter_: Any) -> None:
        super().__init__(options)
        self._filter = filter_
        self._sensing = sensing(options, kind, self.layout)
        self._noise = self._matrix("process_noise", options.process_noise)

    def measurement(self, x: Array, scan: Scan) -> Array:
        """``(m,)`` what the filter expects to measure of a state ``(n,)``."""
        return np.reshape(self._hx(self._of(scan), scan)(self._shaped(x)), -1)

    @abstractmethod
    def _move(self, running: Any, dt: float) -> None:
        """Predict in place."""

    @abstractmethod
    def _take(self, running: Any, how: SensorUse, scan: Scan, z: Array, r: Array | None) -> None:
        """Update in place with a measurement; its covariance is None where the filter's own is meant."""

    @abstractmethod
    def _hx(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        """What is expected to be measured of a state."""

    def _own(self, time: float) -> Any:
        return copy.deepcopy(self._filter)

    def _begun(self, belief: Gaussian, time: float) -> Any:
        running = copy.deepcopy(self._filter)
        placed = self._placed(belief, self._gaussian(running))
        running.x, running.P = self._shaped(placed.mean), placed.covariance
        return running

    def _gaussian(self, belief: Any) -> Gaussian:
        return Gaussian(np.array(belief.x, dtype=float).reshape(-1), np.array(belief.P, dtype=float))

    def _predict(self, belief: Any, elapsed: float) -> Any:
        running = copy.deepcopy(belief)
        for dt in self._intervals(elapsed):
            if self._noise is not None:
                running.Q = self._noise(running.x, dt)
            self._move(running, dt)
        return running

    def _update(self, belief: Any, scan: Scan) -> Updated:
        how = self._of(scan)
        measured = how.reader.measurement(scan)
        noise = measured.covariance if how.states_noise else None
        self._take(belief, how, scan, self._shaped(measured.mean), noise)
        return Updated(belief, np.reshape(belief.y, -1).astype(float), np.array(belief.S, dtype=float))

    def _of(self, scan: Scan) -> SensorUse:
        return self._sensing if isinstance(self._sensing, SensorUse) else entry_of_sensor(self._sensing, scan)

    def _shaped(self, vector: Array) -> Array:
        """A vector as FilterPy has the state: as it is, or as a column."""
        return vector.reshape(-1, 1) if np.ndim(self._filter.x) == 2 else vector.copy()

    def _matrix(self, option: str, reference: str | None) -> Callable[[Array, float], Array] | None:
        """The user's function of dt or of x and dt that gives a square matrix; one of dt is tried once."""
        if reference is None:
            return None
        call = import_function(option, reference)
        if takes_state(option, reference, call):
            return lambda x, dt: np.asarray(call(x, dt), dtype=float)
        try:
            shape = np.shape(call(self._dt or TRIAL_DT))
        except Exception as error:
            raise InputError(f"{option}: {reference!r} raises {type(error).__name__}: {error}") from error
        if shape != np.shape(self._filter.P):
            raise InputError(f"{option}: {reference!r} gives the shape {shape}, not {np.shape(self._filter.P)}")
        return lambda _, dt: np.asarray(call(dt), dtype=float)


def build_filterpy(values: Mapping[str, Any]) -> FilterPyTracker:
    """The tracker that the options describe.

    Raises:
        InputError: they do not fit the filter; says how.
        ValidationError: they are not valid by themselves.
    """
    options = FilterPyOptions.model_validate(values)
    filter_ = made("filter", options.filter, options.filter_options, lambda item: isinstance(item, tuple(KINDS)))
    kind = filter_class(filter_, options)
    size, named = np.size(filter_.x), len(options.state)
    if size != named or np.shape(filter_.P) != (named, named):
        sizes = f"x has {size} components and P the shape {np.shape(filter_.P)}"
        raise InputError(f"state: names {named} components, but the filter's {sizes}")
    return TRACKERS[kind](options, kind, copy.deepcopy(filter_))


class MatrixTracker(FilterPyTracker):
    """Runs a filter that predicts with the matrix F."""

    def __init__(self, options: FilterPyOptions, kind: type, filter_: Any) -> None:
        super().__init__(options, kind, filter_)
        self._f = self._matrix("transition", options.transition)

    def transition_jacobian(self, x: Array, dt: float) -> Array:
        """``(n, n)`` what the filter takes for the derivative of the transition."""
        return self._product_of_slopes(x, dt)

    def measurement_jacobian(self, x: Array, scan: Scan) -> Array:
        """``(m, n)`` what the filter takes for the derivative of the measurement."""
        return self._h(self._of(scan), scan)(self._shaped(x))

    @abstractmethod
    def _h(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        """The matrix H at a state."""

    def _slope(self, x: Array, dt: float) -> Array:
        return np.asarray(self._filter.F, dtype=float) if self._f is None else self._f(self._shaped(x), dt)

    def _moved(self, x: Array, dt: float) -> Array:
        return np.reshape(self._slope(x, dt) @ self._shaped(x), -1)

    def _move(self, running: Any, dt: float) -> None:
        if self._f is not None:
            running.F = self._f(running.x, dt)
        running.predict()


class LinearTracker(MatrixTracker):
    """Runs a ``KalmanFilter``: its own H, or that of a position where it has none."""

    def __init__(self, options: FilterPyOptions, kind: type, filter_: Any) -> None:
        super().__init__(options, kind, filter_)
        self._own_h = np.array(filter_.H, dtype=float) if np.any(filter_.H) else None
        for how in self._sensing.values() if isinstance(self._sensing, dict) else [self._sensing]:
            names = ("px", "py") if how.reader.take == POSITION else tuple(how.reader.take or ())
            if self._own_h is None and how.reader.take != POSITION:
                raise InputError(f"filter: its H is not set; the one that gives {', '.join(names)} is needed")
            if self._own_h is not None and self._own_h.shape != (len(names), len(options.state)):
                fits = f"not {(len(names), len(options.state))}, which maps the state to {', '.join(names)}"
                raise InputError(f"filter: its H has the shape {self._own_h.shape}, {fits}")

    def _h(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        own = self._own_h
        return lambda x: how.reader.slope(x.reshape(-1), scan) if own is None else own

    def _hx(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        return lambda x: self._h(how, scan)(x) @ x

    def _take(self, running: Any, how: SensorUse, scan: Scan, z: Array, r: Array | None) -> None:
        running.update(z, R=r, H=self._h(how, scan)(running.x))


class ExtendedTracker(MatrixTracker):
    """Runs an ``ExtendedKalmanFilter``."""

    def __init__(self, options: FilterPyOptions, kind: type, filter_: Any) -> None:
        super().__init__(options, kind, filter_)
        self._fx = None if options.fx is None else import_function("fx", options.fx)

    def _moved(self, x: Array, dt: float) -> Array:
        if self._fx is None:
            return super()._moved(x, dt)
        return np.asarray(self._fx(self._shaped(x), dt), dtype=float).reshape(-1)

    def _move(self, running: Any, dt: float) -> None:
        moved = None if self._fx is None else self._fx(running.x.copy(), dt)
        super()._move(running, dt)
        if moved is not None:
            running.x = np.reshape(moved, running.x.shape)

    def _h(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        if how.jacobian is not None:
            return _with(how.jacobian, *_args(how, scan))
        return lambda x: how.reader.slope(x.reshape(-1), scan)

    def _hx(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        if how.hx is not None:
            return _with(how.hx, *_args(how, scan))
        return lambda x: self._shaped(how.reader.expected(x.reshape(-1), scan))

    def _take(self, running: Any, how: SensorUse, scan: Scan, z: Array, r: Array | None) -> None:
        residual = (how.residual or np.subtract) if how.own else partial(how.reader.residual, scan=scan)
        running.update(z, self._h(how, scan), self._hx(how, scan), R=r, residual=residual)


class UnscentedTracker(FilterPyTracker):
    """Runs an ``UnscentedKalmanFilter``."""

    def _moved(self, x: Array, dt: float) -> Array:
        return np.reshape(self._filter.fx(x, dt), -1)

    def _own(self, time: float) -> Any:
        return _with_points(super()._own(time))

    def _predict(self, belief: Any, elapsed: float) -> Any:
        running = super()._predict(belief, elapsed)
        return _with_points(running) if elapsed == 0.0 else running

    def _move(self, running: Any, dt: float) -> None:
        running.predict(dt=dt)

    def _hx(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        if not how.own:
            return lambda x: how.reader.expected(x, scan)
        fields = dict(zip(how.args, _args(how, scan), strict=True))
        return partial(how.hx or self._filter.hx, **fields)

    def _take(self, running: Any, how: SensorUse, scan: Scan, z: Array, r: Array | None) -> None:
        before = running.residual_z, running.z_mean
        if how.own:
            residual, mean = how.residual or before[0], how.mean or before[1]
        else:
            residual = partial(how.reader.residual, scan=scan)
            mean = partial(_mean, angular=how.reader.angular(scan))
        running.residual_z, running.z_mean = residual, mean
        running.update(z, R=r, hx=self._hx(how, scan))
        running.residual_z, running.z_mean = before


def _args(how: SensorUse, scan: Scan) -> tuple[Any, ...]:
    return tuple(getattr(scan, name) for name in how.args)


def _with(call: Callable[..., Array], *args: Any) -> Callable[[Array], Array]:
    return lambda x: np.asarray(call(x, *args), dtype=float)


def _with_points(running: Any) -> Any:
    """The filter with the sigma points that an update without a prediction needs."""
    running.sigmas_f = running.points_fn.sigma_points(running.x, running.P)
    return running


def _mean(points: Array, weights: Array, angular: tuple[int, ...]) -> Array:
    """Weighted mean of sigma points ``(s, m)``, as offsets from the central one: an angle has no plain mean."""
    offsets = (points - points[0]).T
    return np.asarray(points[0] + difference(offsets, np.zeros(()), angular) @ weights)


TRACKERS: dict[type, type[FilterPyTracker]] = {
    KalmanFilter: LinearTracker,
    ExtendedKalmanFilter: ExtendedTracker,
    UnscentedKalmanFilter: UnscentedTracker,
}
