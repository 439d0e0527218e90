"""Ways of moving states ``(4, points, members)`` as no motion model should, where a filter of sigma points asks.

Each is made anew for each engine, so that it begins as it was.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

#: From states and the time step to the states after it.
Motion = Callable[[Any, Any], Any]
#: Where few of the objects come, and late.
FAR = 45.0


def straight(x: Any, dt: Any) -> Any:
    return np.stack([x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]])


def faster(x: Any, dt: Any, factor: Any) -> Any:
    """By a factor ``(points, members)`` or for all."""
    return straight(x, dt * factor)


def remembers_who_was_far() -> Motion:
    far = np.zeros(12, dtype=bool)

    def moved(x: Any, dt: Any) -> Any:
        np.logical_or(far, np.any(x[0] > FAR, axis=0), out=far)
        return faster(x, dt, np.where(far, 1.2, 1.0))

    return moved


def remembers_the_mean() -> Motion:
    before: list[Any] = []

    def moved(x: Any, dt: Any) -> Any:
        before.append(x[:, 0])
        return faster(x, dt, 1.0 + 1e-3 * np.tanh(before[-2][0] - before[-1][0]) if len(before) > 1 else 1.0)

    return moved


def counts_where_far() -> Motion:
    calls = [0]

    def moved(x: Any, dt: Any) -> Any:
        if np.any(x[0] > FAR):
            calls[0] += 1
        return faster(x, dt, 1.0 + 0.01 * calls[0])

    return moved


def counts_in_an_argument() -> Motion:
    def moved(x: Any, dt: Any, calls: Any = np.zeros(1)) -> Any:  # noqa: B008
        calls += 1.0
        return faster(x, dt, 1.0 if calls[0] < 50 else 1.2)

    return functools.partial(moved, calls=np.zeros(1))


def writes_speeds(x: Any, dt: Any) -> Any:
    x[2:] *= 0.99
    return straight(x, dt)


def writes_where_far(x: Any, dt: Any) -> Any:
    x[2] = np.where(x[0] > FAR, 0.9 * x[2], x[2])
    return straight(x, dt)


def writes_if_far(x: Any, dt: Any) -> Any:
    if np.any(x[0] > FAR):
        x[2] *= 0.9
    return straight(x, dt)


def writes_the_centre(x: Any, dt: Any) -> Any:
    x[:, 0] += 0.01
    return straight(x, dt)


def moves_in_place(x: Any, dt: Any) -> Any:
    x[:2] += dt * x[2:]
    return x


def fills_in_place(x: Any, dt: Any) -> Any:
    np.multiply(x[2:], 0.99, out=x[2:])
    return straight(x, dt)


def writes_by_mask(x: Any, dt: Any) -> Any:
    speed = np.copy(x[2])
    speed[x[0] > FAR] = 0.0
    return np.stack([x[0] + dt * speed, x[1] + dt * x[3], speed, x[3]])


def puts_by_mask(x: Any, dt: Any) -> Any:
    np.putmask(x[2], x[0] > FAR, 0.0)
    return straight(x, dt)


def caches_by_id() -> Motion:
    """Of an object that is kept, so that no other has its id."""
    cache: dict[int, Any] = {}

    def moved(x: Any, dt: Any) -> Any:
        first, result = cache.setdefault(id(x), (x, straight(x, dt)))
        return result if first is x else straight(x, dt)

    return moved


def caches_by_shape() -> Motion:
    cache: dict[Any, Any] = {}

    def moved(x: Any, dt: Any) -> Any:
        return faster(x, dt, cache.setdefault(x.shape, 1.0 + 1e-3 * np.tanh(x[2])))

    return moved


def caches_by_lru() -> Motion:
    @functools.lru_cache
    def factor(points: int) -> Any:
        return 1.0 + 0.01 * points

    return lambda x, dt: faster(x, dt, factor(x.shape[1]))


def wraps_by_a_loop(x: Any, dt: Any) -> Any:
    angle = 0.3 * x[0]
    while np.any(angle > np.pi):
        angle = np.where(angle > np.pi, angle - 2.0 * np.pi, angle)
    while np.any(angle < -np.pi):
        angle = np.where(angle < -np.pi, angle + 2.0 * np.pi, angle)
    return faster(x, dt, 1.0 + 0.01 * angle)


def wraps_all_by_a_loop(x: Any, dt: Any) -> Any:
    """While one of them is too large, from all of them."""
    angle = 0.3 * x[0]
    while np.any(angle > np.pi):
        angle = angle - 2.0 * np.pi
    return faster(x, dt, 1.0 + 0.01 * angle)


def halves_by_a_loop(x: Any, dt: Any) -> Any:
    speed = np.abs(x[2]) + 1e-3
    for _ in range(20):
        if np.all(speed < 4.0):
            break
        speed = np.where(speed < 4.0, speed, 0.5 * speed)
    return faster(x, dt, 1.0 + 0.01 * speed)


def loops_over_members(x: Any, dt: Any) -> Any:
    result = straight(x, dt)
    for member in range(x.shape[-1]):
        result[2, :, member] *= 1.0 - 1e-3 * member
    return result


def loops_over_points(x: Any, dt: Any) -> Any:
    return np.stack([straight(x[:, point], dt * (1.0 + 1e-3 * point)) for point in range(x.shape[1])], axis=1)


def of_the_dtype(x: Any, dt: Any) -> Any:
    return faster(x, dt, 1.0 if x.dtype == np.float64 else 1.2)


def in_single_precision(x: Any, dt: Any) -> Any:
    return straight(x.astype(np.float32), np.float32(dt)).astype(float)


def in_integers(x: Any, dt: Any) -> Any:
    return faster(x, dt, 1.0 + 1e-3 * x[2].astype(int))


def of_the_layout(x: Any, dt: Any) -> Any:
    return faster(x, dt, 1.0 if getattr(x, "flags", None) is None else 1.2)


def of_the_base(x: Any, dt: Any) -> Any:
    return faster(x, dt, 1.0 if getattr(x, "base", None) is None else 1.2)


def raises_out_of_domain(x: Any, dt: Any) -> Any:
    try:
        with np.errstate(invalid="raise"):
            root = np.sqrt(x[2] - 1.0)
    except FloatingPointError:
        root = np.sqrt(np.abs(x[2] - 1.0))
    return faster(x, dt, 1.0 + 0.01 * root)


def warns_out_of_domain(x: Any, dt: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            root = np.sqrt(x[2] - 1.0)
        except RuntimeWarning:
            root = np.zeros_like(x[2])
    return faster(x, dt, 1.0 + 0.01 * root)


def replaces_if_nan(x: Any, dt: Any) -> Any:
    root = np.sqrt(x[2] - 1.0)
    if np.any(np.isnan(root)):
        root = np.zeros_like(root)
    return faster(x, dt, 1.0 + 0.01 * root)


def points_out_of_domain(x: Any, dt: Any) -> Any:
    root = np.sqrt(x[2] - 1.0)
    return faster(x, dt, 1.0 + 0.01 * np.where(np.any(np.isnan(root), axis=0), 0.0, root))


def squeezed(x: Any, dt: Any) -> Any:
    return faster(x, dt, 1.0 + 1e-3 * np.squeeze(x[2:3]))


def of_one_call(x: Any, dt: Any) -> Any:
    """As for one state, where the last axis is that of the points."""
    return faster(x, dt, 1.0 + 1e-3 * (x[2] - x[2].mean(axis=-1, keepdims=True)))


def root(x: Any) -> Any:
    return np.sqrt(x[2] - 1.0)


OWN_STATE: dict[str, Callable[[], Motion]] = {
    "remembers who was far": remembers_who_was_far,
    "remembers the mean": remembers_the_mean,
    "counts where far": counts_where_far,
    "counts in an argument": counts_in_an_argument,
    "caches by id": caches_by_id,
    "caches by shape": caches_by_shape,
    "caches by lru_cache": caches_by_lru,
}
WITHOUT_STATE: dict[str, Motion] = {
    "writes speeds": writes_speeds,
    "writes where far": writes_where_far,
    "writes if far": writes_if_far,
    "writes the centre": writes_the_centre,
    "moves in place": moves_in_place,
    "fills in place": fills_in_place,
    "writes by mask": writes_by_mask,
    "putmask": puts_by_mask,
    "wraps by a loop": wraps_by_a_loop,
    "wraps all by a loop": wraps_all_by_a_loop,
    "halves by a loop": halves_by_a_loop,
    "loops over members": loops_over_members,
    "loops over points": loops_over_points,
    "dtype": of_the_dtype,
    "float32": in_single_precision,
    "int": in_integers,
    "flags": of_the_layout,
    "base": of_the_base,
    "errstate": raises_out_of_domain,
    "warnings": warns_out_of_domain,
    "if NaN": replaces_if_nan,
    "where NaN": points_out_of_domain,
    "squeeze": squeezed,
    "mean of the last axis": of_one_call,
    "if a point is far": lambda x, dt: faster(x, dt, 1.2 if np.any(x[0] > FAR) else 1.0),
    "if the centre is far": lambda x, dt: faster(x, dt, 1.2 if np.any(x[0, 0] > FAR) else 1.0),
    "if all points are far": lambda x, dt: faster(x, dt, 1.2 if np.all(x[0] > FAR) else 1.0),
    "if one state is far": lambda x, dt: faster(x, dt, 1.2 if x[0].max() > FAR else 1.0),
    "if many are far": lambda x, dt: faster(x, dt, 1.2 if np.count_nonzero(x[0] > FAR) > 3 else 1.0),
    "if the points are apart": lambda x, dt: faster(x, dt, 1.2 if np.ptp(x[0]) > 1.0 else 1.0),
    "number of points": lambda x, dt: faster(x, dt, 1.0 + 0.01 * x.shape[1]),
    "number of points and members": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[0].size),
    "the last axis": lambda x, dt: faster(x, dt, 1.2 if x.shape[-1] == 9 else 1.0),
    "number of axes": lambda x, dt: faster(x, dt, 1.2 if x.ndim == 3 else 1.0),
    "len": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * len(x[0])),
    "order of members": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.argsort(x[0], axis=-1)),
    "order of points": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.argsort(x[0], axis=0)),
    "sorted points": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.sort(x[2], axis=0)),
    "the median point": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.median(x[2], axis=0)),
    "the mean point": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.mean(x[2], axis=0)),
    "sum of points": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2].sum(axis=0)),
    "sum of members": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2].sum(axis=1, keepdims=True)),
    "the largest point": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2].max(axis=0)),
    "cumulative over points": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.cumsum(x[2], axis=0)),
    "from the centre": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * (x[2] - x[2, :1])),
    "points backwards": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2, ::-1]),
    "members backwards": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2, :, ::-1]),
    "the next point": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.roll(x[2], 1, axis=0)),
    "the next of all": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.roll(x[2], 1)),
    "flat": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2].reshape(-1)[:1]),
    "transposed": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * x[2].T[:1, :1]),
    "norm of all": lambda x, dt: faster(x, dt, 1.0 + 1e-4 * np.linalg.norm(x[2])),
    "norm of members": lambda x, dt: faster(x, dt, 1.0 + 1e-4 * np.linalg.norm(x[2], axis=-1, keepdims=True)),
    "nan_to_num": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.nan_to_num(root(x))),
    "where positive": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.where(x[2] > 1.0, root(x), 0.0)),
    "fmax": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.fmax(root(x), 0.0)),
    "maximum": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.maximum(root(x), 0.0)),
    "clip": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.clip(root(x), 0.0, 2.0)),
    "nanmean of points": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.nanmean(root(x), axis=0)),
    "NaN as zero": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.where(root(x) >= 0.0, root(x), 0.0)),
    "not less": lambda x, dt: faster(x, dt, np.where(~(root(x) < 2.0), 1.1, 1.0)),
    "NaN to the end": lambda x, dt: faster(x, dt, 1.0 + 0.01 * root(x)),
    "logarithm": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.log(x[2])),
    "sigmoid": lambda x, dt: faster(x, dt, 1.0 + 0.1 / (1.0 + np.exp(-400.0 * (x[2] - 3.0)))),
    "1 / 0": lambda x, dt: faster(x, dt, 1.0 + 0.1 * np.arctan(1.0 / np.maximum(x[2] - 3.0, 0.0))),
    "sign of zero": lambda x, dt: faster(x, dt, 1.0 + 0.1 * np.arctan2(-0.0 * x[2], -1.0)),
    "copysign": lambda x, dt: faster(x, dt, 1.0 + 0.1 * np.copysign(1.0, 0.0 * (x[2] - 3.0))),
    "tolist": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.array(x[2].tolist())),
    "tobytes": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * (x.tobytes()[6] % 2)),
    "a float of all": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * float(x[2].mean())),
    "interpolated": lambda x, dt: faster(x, dt, np.interp(x[0], [0.0, FAR], [1.0, 1.2])),
    "rounded": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.round(x[2], 1)),
    "floor": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.floor(x[2])),
    "modulo": lambda x, dt: faster(x, dt, 1.0 + 0.01 * (0.3 * x[0] % (2.0 * np.pi))),
    "power": lambda x, dt: faster(x, dt, 1.0 + 0.01 * np.abs(x[2]) ** 0.3),
    "broadcast by hand": lambda x, dt: faster(x, dt, 1.0 + 1e-3 * np.arange(x.shape[-1])),
    "ones of the shape": lambda x, dt: faster(x, dt, np.ones(x.shape[1:])),
    "linspace": lambda x, dt: faster(x, dt, np.linspace(1.0, 1.1, x.shape[-1])),
}
