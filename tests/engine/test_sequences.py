"""Sequences of calls: each as the kernel by itself, however many members there are."""

from typing import Any

import numpy as np
import pytest
from tests.engine.compared import equations_of

from trackbench.engine.equations import Equations, Values
from trackbench.engine.kernels import Kernels
from trackbench.engine.layout import ADDED, SUMMED, Input
from trackbench.engine.sequences import ArrayPlace, CallSequence, place, total_of_vectors

GROUPS, CALLS = 3, 5


def turned(values: Values) -> Values:
    x, y = values["state"]
    c, s = np.cos(values["angle"]), np.sin(values["angle"])
    state = np.stack([c * x - s * y + values["push"], s * x + c * y])
    far = np.where(values["counts"], np.sqrt(x * x + y * y), 0.0)
    return {"state": state, "total": far, "own": np.stack([far, 2.0 * far]), "left": x < 0.0}


TURNED = equations_of(turned, {"state": 1, "angle": 0, "push": 0, "counts": 0})._replace(
    modes={"total": SUMMED, "own": ADDED}
)
INPUTS = (
    Input("state", (2,), 1, "d"),
    Input("angle", (), 0, "d"),
    Input("push", (), 1, "d", shared=True),
    Input("counts", (), 1, "?"),
)


@pytest.mark.parametrize("size", [8, 9, 15, 16, 71, 263, 600])
def test_a_sequence_gives_what_numpy_gives_call_by_call(kernels: Kernels, size: int) -> None:
    random = np.random.default_rng(size)
    state = np.empty((2, 2, GROUPS, size))
    state[:, 0] = random.normal(size=(2, GROUPS, size))
    angle, push = random.normal(size=CALLS), random.normal(size=(CALLS, GROUPS, 1))
    counts = random.random((CALLS, GROUPS, size)) < 0.7
    total, own = np.zeros((CALLS, 8)), random.normal(size=(2, size))
    left = np.empty((CALLS, GROUPS, size), dtype=bool)
    expected, sums, each = state[:, 0].copy(), np.zeros(CALLS), own.copy()
    lefts = left.copy()
    for call in range(CALLS):
        values = {"state": expected, "angle": angle[call], "push": push[call], "counts": counts[call]}
        result: dict[str, Any] = dict(turned(values))
        expected, lefts[call], sums[call] = result["state"], result["left"], result["total"].sum()
        each += result["own"].sum(axis=1)

    kernel, at = kernels.kernel(TURNED, INPUTS), np.arange(CALLS)
    assert kernel is not None
    sequence = CallSequence(kernels, GROUPS, size, CALLS)
    nothing = np.zeros(CALLS, dtype=np.intp)
    inputs = {
        "state": place(state, 1, at % 2),
        "angle": place(angle, 0, at),
        "push": place(push, 0, at),
        "counts": place(counts, 0, at),
    }
    outputs = {
        "state": place(state, 1, (at + 1) % 2),
        "total": ArrayPlace(total.ctypes.data + at * total.strides[0], 0),
        "own": place(own[:, None, None], 1, nothing),
        "left": place(left, 0, at),
    }
    sequence.call(kernel, at, inputs, outputs)
    assert sequence.run()
    np.testing.assert_allclose(state[:, CALLS % 2], expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(total_of_vectors(total), sums, rtol=1e-13)
    np.testing.assert_allclose(own, each, rtol=1e-13)
    np.testing.assert_array_equal(left, lefts)


def test_a_member_of_which_the_trace_does_not_hold_is_noticed(kernels: Kernels) -> None:
    roots = Equations("roots", lambda values: {"y": np.sqrt(values["x"])}, {"x": 0})
    kernel = kernels.kernel(roots, (Input("x", (), 1, "d"),))
    assert kernel is not None
    x, at = np.ones((1, 2, 100)), np.zeros(1, dtype=np.intp)

    def held() -> bool:
        sequence = CallSequence(kernels, 2, 100, 1)
        sequence.call(kernel, at, {"x": place(x, 0, at)}, {})
        return sequence.run()

    assert held()
    for member in (0, 64, 99):
        x[0, 1, member] = -1.0
        assert not held()
        x[0, 1, member] = 1.0
