"""Kernels over batches of every form: what they compute, and what they leave to NumPy."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from tests.engine.compared import compared, equations_of

from trackbench.engine import kernels as engine
from trackbench.engine.equations import Equations, Values
from trackbench.engine.kernels import LEAST_GROUP, Kernels
from trackbench.engine.layout import Input
from trackbench.engine.trace import Trace

RANKS = {"x": 1, "p": 2, "dt": 0, "valid": 0, "sigma": 1}


def given(batch: tuple[int, ...] = (19,), seed: int = 0) -> dict[str, Any]:
    """A state, a covariance, a mask; a time and standard deviations that are the same for all."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(3, 3, *batch))
    return {
        "x": rng.normal(size=(3, *batch)),
        "p": np.einsum("ik...,jk...->ij...", a, a),
        "dt": 0.1,
        "valid": rng.random(batch) < 0.7,
        "sigma": np.array([0.5, 1.0, 2.0]),
    }


def step(values: Values) -> Values:
    """Some of all: a mean, a covariance, a mask."""
    x, p, dt = values["x"], values["p"], values["dt"]
    moved = np.stack([x[0] + dt * x[1], x[1] * np.cos(dt * x[2]), x[2]])
    sigma = values["sigma"].reshape(3, *(1,) * (x.ndim - 1)) * np.sqrt(dt)
    grown = p + np.einsum("i...,j...->ij...", sigma, sigma)
    moved = np.where(values["valid"], moved, x)
    return {"x": moved, "p": grown, "far": np.hypot(moved[0], moved[1]) > 1.0, "nothing": None}


STEP = equations_of(step, RANKS)


@pytest.mark.parametrize("batch", [(1,), (7,), (8,), (9,), (17,), (2, 3), (4, 1, 5), (1, 1)])
def test_batches_of_any_size_and_axes(kernels: Kernels, batch: tuple[int, ...]) -> None:
    found = kernels(STEP, given(batch))
    expected = step(given(batch))
    assert "nothing" not in found
    for name in ("x", "p", "far"):
        assert found[name].shape == expected[name].shape
        assert found[name].dtype == expected[name].dtype
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-14)
    assert STEP.key not in kernels.untraced


def test_without_batch_axes(kernels: Kernels) -> None:
    found, expected = kernels(STEP, given(())), step(given(()))
    assert found["p"].shape == (3, 3)
    assert found["far"].shape == ()
    np.testing.assert_allclose(found["x"], expected["x"], rtol=1e-14)


def test_batch_axes_that_broadcast(kernels: Kernels) -> None:
    def moved(values: Values) -> Values:
        return {"y": values["x"] * values["t"] + values["pose"], "late": values["t"] > 1.0}

    rng = np.random.default_rng(0)
    values = {
        "x": rng.normal(size=(2, 4, 3, 5)),
        "t": rng.normal(size=(4, 1, 1)),
        "pose": rng.normal(size=(2, 4, 3, 1)),
    }
    found = kernels(equations_of(moved, {"x": 1, "t": 0, "pose": 1}), values)
    np.testing.assert_allclose(found["y"], moved(values)["y"], rtol=1e-14)
    # All batch axes, as the contract has it.
    np.testing.assert_array_equal(found["late"], np.broadcast_to(values["t"] > 1.0, (4, 3, 5)))


def scaled(values: Values) -> Values:
    """A branch on what may be the same for a group."""
    t = values["t"]
    if np.any(t > 1.0):
        t = np.where(t > 1.0, 1.0, t)
    return {"y": values["x"] * t, "late": np.broadcast_to(t > 0.5, values["x"][0].shape)}


@pytest.mark.parametrize(("size", "shared"), [(LEAST_GROUP - 1, False), (LEAST_GROUP, True), (LEAST_GROUP + 9, True)])
@pytest.mark.parametrize("way", ["as it is", "of two groups", "a slice"])
def test_what_a_group_shares(
    kernels: Kernels, size: int, shared: bool, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: dict[str, bool] = {}
    trace = engine.trace

    def seen(equations: Equations, inputs: Sequence[Input]) -> Trace:
        read.update((item.name, item.shared) for item in inputs)
        return trace(equations, inputs)

    monkeypatch.setattr(engine, "trace", seen)
    t = np.array([[0.3, 0.7], [1.5, -0.2], [0.1, 0.9]])[..., None]
    t = {"as it is": t, "of two groups": t[:, :1], "a slice": t.repeat(2, axis=1)[:, ::2]}[way]
    values = {"x": np.random.default_rng(0).normal(size=(2, 3, 2, size)), "t": t}
    by_numpy = 2 * size if way == "of two groups" else size
    assert compared(kernels, equations_of(scaled, {"x": 1, "t": 0}), values) == by_numpy
    assert read == {"x": False, "t": shared}


@pytest.mark.parametrize("way", ["every other", "backwards", "columns", "read only", "other bytes", "not aligned"])
def test_arrays_however_they_lie(kernels: Kernels, way: str) -> None:
    values = given((40,))
    x = values["x"]
    if way == "every other":
        values = {name: value[..., ::2] if np.ndim(value) > RANKS[name] else value for name, value in values.items()}
    elif way == "backwards":
        values["x"] = x[::-1, ::-1]
    elif way == "columns":
        values["p"] = np.asfortranarray(values["p"])
    elif way == "read only":
        x.flags.writeable = False
    elif way == "other bytes":
        assert compared(kernels, STEP_TWICE, values) == 0
        values["x"] = x.astype(x.dtype.newbyteorder())
    else:
        raw = np.zeros(x.nbytes + 1, dtype=np.uint8)
        values["x"] = raw[1:].view(float).reshape(x.shape)
        values["x"][...] = x
    assert compared(kernels, STEP_TWICE, values) == 0


def twice(values: Values) -> Values:
    found = dict(step(values))
    del found["nothing"]
    return found


STEP_TWICE = equations_of(twice, RANKS)


@pytest.mark.parametrize("name", ["x", "dt", "sigma"])
@pytest.mark.parametrize("kind", [np.float32, np.int64, np.longdouble, np.complex128])
def test_other_types_are_left_to_numpy(kernels: Kernels, name: str, kind: Any) -> None:
    values = given()
    assert compared(kernels, STEP_TWICE, values) == 0
    values[name] = np.asarray(values[name]).astype(kind)
    equations = equations_of(lambda given: {"y": given["x"] * given["dt"] + given["sigma"][0]}, RANKS)
    assert "not given as doubles" in str(compared(kernels, equations, values))


def test_equations_of_one_name_are_told_apart(kernels: Kernels) -> None:
    values = given()
    for factor in (2.0, 3.0):
        scaled = equations_of(lambda given, factor=factor: {"y": given["x"] * factor}, {"x": 1})
        assert compared(kernels, scaled, values) == 0


class KernelCache:
    """A function that remembers."""

    def __init__(self) -> None:
        self.first: Any = None

    def __call__(self, values: Values) -> Values:
        if self.first is None:
            self.first = values["x"] * 2.0
        return {"y": values["x"] + self.first}


@lru_cache
def remembered(dt: float) -> float:
    return 2.0 * dt


def filled(values: Values) -> Values:
    y = np.empty(values["x"].shape)
    y[:] = values["x"]
    return {"y": y}


def caught(values: Values) -> Values:
    try:
        return {"y": float(values["dt"]) * values["x"]}
    except TypeError:
        return {"y": values["x"]}


def steps_until(values: Values) -> Values:
    x = values["x"]
    while np.max(np.abs(x)) > 0.5:
        x = 0.5 * x
    return {"y": x}


UNTRACEABLE: dict[str, Callable[[Values], Any]] = {
    "truth of one value": lambda v: {"y": v["x"] if v["dt"] > 0 else -v["x"]},
    "float": lambda v: {"y": v["x"] * float(v["dt"])},
    "asarray": lambda v: {"y": np.asarray(v["x"])},
    "array": lambda v: {"y": np.array([v["x"][0], v["x"][1]])},
    "linalg": lambda v: {"y": np.linalg.norm(v["x"], axis=0)},
    "loop on data": steps_until,
    "filled": filled,
    "complex": lambda v: {"y": (v["x"] * 1j).imag},
    "not known": lambda v: {"y": np.arcsinh(v["x"])},
    "reduce": lambda v: {"y": np.add.reduce(v["x"])},
    "modulo": lambda v: {"y": v["x"] % 2.0},
    "broken power": lambda v: {"y": np.abs(v["x"]) ** 1.5},
    "power of a mask": lambda v: {"y": v["valid"] ** 2},
    "mask as index": lambda v: {"y": np.where(v["valid"], v["x"][:, v["valid"]].sum(), v["x"])},
    "index that is computed": lambda v: {"y": v["x"][v["valid"].argmax()]},
    "extreme of all": lambda v: {"y": v["x"] / np.max(v["x"])},
    "error that it catches": caught,
    "objects": lambda v: {"y": np.stack(list(np.array([*v["x"], None], dtype=object)[:3])).astype(float)},
    "single precision": lambda v: {"y": v["x"] * np.full((3, 1), 1.1, dtype=np.float32)},
    "where without choices": lambda v: {"y": v["x"] * len(np.where(v["valid"]))},
    "integers": lambda v: {"y": v["x"].astype(int)},
    "a slice of the batch": lambda v: {"y": v["x"] + v["x"][:, 1:2]},
}


@pytest.mark.parametrize("name", UNTRACEABLE)
def test_what_cannot_be_traced_is_computed_by_numpy(kernels: Kernels, name: str) -> None:
    assert isinstance(compared(kernels, equations_of(UNTRACEABLE[name], RANKS), given()), str)


@pytest.mark.parametrize(
    "change",
    [
        lambda x: x.__setitem__(0, 1.0),
        lambda x: np.negative(x, out=x),
        lambda x: x[1:].__imul__(2.0),
        lambda x: x[0].__iadd__(1.0),
        lambda x: x.reshape(-1).__setitem__(0, 7.0),
        lambda x: np.swapaxes(x, 0, 1).__setitem__(0, 7.0),
    ],
)
def test_a_function_that_changes_its_input_is_left_to_numpy(kernels: Kernels, change: Callable[[Any], Any]) -> None:
    def changing(values: Values) -> Values:
        change(values["x"])
        return {"y": 2.0 * values["x"]}

    values, same = given(), given()
    equations = equations_of(changing, RANKS)
    found, expected = kernels(equations, values), changing(same)
    np.testing.assert_array_equal(found["y"], expected["y"])
    np.testing.assert_array_equal(values["x"], same["x"])
    assert equations.key in kernels.untraced


@pytest.mark.parametrize("said", [[1.0, 2.0], np.zeros((0, 19)), np.ones(19), np.ones((19, 1)), np.ones(0)])
def test_an_output_without_the_batch_axes_is_left_to_numpy(kernels: Kernels, said: Any) -> None:
    equations = equations_of(lambda v: {"y": v["x"], "odd": said}, {"x": 1})
    found = kernels(equations, given((3, 5)))["odd"]
    assert found is said
    assert "does not end with the batch axes" in kernels.untraced[equations.key][1]


def test_an_error_is_that_of_numpy(kernels: Kernels) -> None:
    def wrong(values: Values) -> Values:
        raise LookupError("not found")

    with pytest.raises(LookupError, match="not found"):
        kernels(equations_of(wrong, {"x": 1}), given())


def test_a_value_kept_from_another_call(kernels: Kernels) -> None:
    values = given()
    equations = equations_of(lambda v: {"y": v["x"] * remembered(v["dt"])}, {"x": 1, "dt": 0})
    for batch in ((19,), (2, 3)):
        assert compared(kernels, equations, {**given(batch), "dt": 0.1}) == 0
    first = KernelCache()
    kernels(equations_of(first, {"x": 1}), values)
    # What it kept is of another graph than the one of the second trace.
    second = equations_of(lambda v: {"y": v["x"] + first.first}, {"x": 1})
    kernels(second, values)
    assert "kept from" in kernels.untraced[second.key][1]


def test_a_function_too_large_to_compile_is_left_to_numpy(kernels: Kernels, monkeypatch: pytest.MonkeyPatch) -> None:
    def long(values: Values) -> Values:
        y = values["x"][0]
        for i in range(400):
            y = y * values["x"][1] + float(i)
        return {"y": np.tanh(y) if False else np.where(np.isfinite(y), 1.0, 0.0)}

    monkeypatch.setattr("trackbench.engine.graph.LARGEST", 500)
    assert "more than 500" in str(compared(kernels, equations_of(long, {"x": 1}), given()))


def reset(values: Values) -> Values:
    """A branch that is seldom taken."""
    x = values["x"]
    if np.any(x[0] > 1.0):
        x = np.where(x[0] > 1.0, 0.0, x)
    return {"x": x}


def test_members_of_which_a_branch_goes_the_other_way_are_computed_again(kernels: Kernels) -> None:
    values = given((100,))
    assert compared(kernels, equations_of(reset, {"x": 1}), values) == np.sum(values["x"][0] > 1.0) > 0


@pytest.mark.parametrize("batch", [(), (1,), (5,), (3, 4), (2, 1, 3)])
def test_a_branch_in_batches_of_other_axes(kernels: Kernels, batch: tuple[int, ...]) -> None:
    for seed in range(5):
        values = given(batch, seed)
        assert compared(kernels, equations_of(reset, {"x": 1}), values) == np.sum(values["x"][0] > 1.0)


def test_a_given_mask_takes_the_general_branch(kernels: Kernels) -> None:
    taken = []

    def general(values: Values) -> Values:
        x, valid, seen = values["x"], values["valid"], values["seen"]
        ways = np.all(valid), valid.all(), np.any(valid), np.all(~valid), (valid & seen).any(), not np.any(valid | seen)
        taken.append(ways)
        if np.all(valid):
            return {"y": 2.0 * x}
        return {"y": np.where(valid, 2.0 * x, x)}

    values = {**given(), "seen": np.ones(19, dtype=bool)}
    equations = equations_of(general, {"x": 1, "valid": 0, "seen": 0})
    for valid in (values["valid"], np.ones(19, dtype=bool), np.zeros(19, dtype=bool)):
        taken.clear()
        assert compared(kernels, equations, {**values, "valid": valid}) == 0
        if valid is values["valid"]:
            assert (False, False, True, False, True, False) in taken


DROPPED: dict[str, Callable[[Any, Any], Any]] = {
    "product with zero": lambda a, b: 0.0 * a + b,
    "row of a matrix": lambda a, b: np.einsum("ij,j...->i...", np.array([[1.0, 0.0], [1.0, 0.0]]), np.stack([b, a]))[0],
    "difference": lambda a, b: (a - a) + b,
    "quotient": lambda a, b: np.where(np.zeros_like(a) / a == 0.0, b, -1.0),
    "hidden by a quotient": lambda a, b: b + 0.0 * a + 1.0 / (1.0 + a * a),
    "hidden by a choice": lambda a, b: np.where(b > 0.0, b, a) * 0.0 + b,
    "hidden by a limit": lambda a, b: np.clip(0.0 * a, -1.0, 1.0) + b,
    "quotient that is computed": lambda a, b: 0.0 * (b / a) + b,
    "function": lambda a, b: 0.0 * np.exp(a) + b,
    "overflow": lambda a, b: 0.0 * (a * a) + b,
}


@pytest.mark.parametrize("name", DROPPED)
def test_what_is_left_out_hides_no_infinity(kernels: Kernels, name: str) -> None:
    odd = np.array([1.0, 0.0, -0.0, np.inf, -np.inf, np.nan, 1e200, 5e-324, -2.0, 800.0])
    a, b = (part.ravel() for part in np.meshgrid(odd, odd))
    equations = equations_of(lambda v: {"y": DROPPED[name](v["a"], v["b"])}, {"a": 0, "b": 0})
    assert isinstance(compared(kernels, equations, {"a": a, "b": b}), int)


def test_what_is_not_counted_need_not_be_finite(kernels: Kernels) -> None:
    def update(values: Values) -> Values:
        x, valid = values["x"], values["valid"]
        innovation = values["z"] - x[0]
        gain = np.stack([innovation, 0.0 * innovation, 2.0 * innovation])
        return {"x": x + np.where(valid, gain, 0.0), "innovation": innovation}

    values = given((50,))
    values["z"] = np.where(values["valid"], 1.0, np.nan)
    ranks = {"x": 1, "z": 0, "valid": 0}
    counted = equations_of(update, ranks, counted={"innovation": "valid"})
    assert compared(kernels, counted, values) == 0
    assert compared(kernels, equations_of(update, ranks), values) == np.sum(~values["valid"])
    values["z"][values["valid"]] = np.inf
    assert compared(kernels, counted, values) == np.sum(values["valid"])
