"""The same bits from every processor, however a batch is split; and the form of the code."""

from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from tests.engine.compared import equations_of
from tests.engine.programs import random_program, random_values

from trackbench.engine.equations import Values
from trackbench.engine.kernels import Kernels
from trackbench.engine.machine import KernelCache, Processor

#: By the name of a kind of processor, what it must have.
PROCESSORS = {"x86-64": "sse2", "x86-64-v2": "sse4.2", "x86-64-v3": "avx2", "x86-64-v4": "avx512f"}


def of_processor(name: str, folder: Path, kernels: Kernels) -> Kernels:
    """Kernels for a kind of processor, kept apart; ``kernels``: the machine has an engine at all."""
    import llvmlite.binding as llvm

    if not llvm.get_default_triple().startswith("x86_64"):
        pytest.skip("this is another kind of machine")
    if not llvm.get_host_cpu_features().get(PROCESSORS[name]):
        pytest.skip(f"this processor has no {PROCESSORS[name]}")
    return Kernels(Processor(name), KernelCache(folder))


def every_operation(values: Values) -> Values:
    """All that a kernel can compute, of members and of what is the same for all."""
    x, y, t, valid = values["x"], values["y"], values["t"], values["valid"]
    found: dict[str, Any] = {}
    for name, (a, b) in {"members": (x, y), "uniform": (t + 0.0 * x, 2.0 * t), "both": (x, t)}.items():
        far = np.hypot(a, b)
        angles = np.sin(2.0 * a), np.sin(a), np.cos(3.0 * a), np.arctan2(a, b)
        grown = np.exp(np.minimum(a, 3.0)), np.log(far + 1.0), np.sqrt(np.abs(a)), a**3 / (1.0 + b * b), a**-2
        whole = np.floor(a), np.ceil(b), np.rint(a), -a, np.maximum(a, b), np.clip(b, -1.0, 1.0)
        compared = a < b, a <= b, a > b, a >= b, a == b, a != b, np.isnan(a), np.isfinite(b), ~valid | (a > 0.0) & valid
        chosen = np.where(compared[0] & valid, a, b), np.where(compared[2], compared[3], compared[8])
        every = [
            *angles,
            *grown,
            *whole,
            *compared,
            *chosen,
            far,
            np.sum(np.abs(np.stack(np.broadcast_arrays(a, b))), axis=0),
        ]
        found |= {f"{name}{i}": value + np.zeros_like(x) for i, value in enumerate(every)}
        found |= {f"{name} {i}": value & (x == x) for i, value in enumerate(compared)}
    return found


EVERY = equations_of(every_operation, {"x": 0, "y": 0, "t": 0, "valid": 0})


def values_of(members: int) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    x = rng.normal(size=members) * 10.0 ** rng.integers(-5, 5, members)
    y = np.where(rng.random(members) < 0.1, x, rng.normal(size=members))
    return {"x": x, "y": y, "t": 0.37, "valid": rng.random(members) < 0.5}


def same_bits(found: Values, expected: Values) -> None:
    assert found.keys() == expected.keys()
    for name, value in found.items():
        assert value.tobytes() == np.ascontiguousarray(expected[name]).tobytes(), name


@pytest.mark.parametrize("name", PROCESSORS)
def test_every_processor_computes_the_same_bits(kernels: Kernels, name: str, tmp_path: Path) -> None:
    values = values_of(203)
    found = of_processor(name, tmp_path, kernels)(EVERY, values)
    same_bits(found, kernels(EVERY, values))
    # Bits alone might be of something else.
    for key, value in every_operation(values).items():
        np.testing.assert_allclose(found[key], value, rtol=1e-13, err_msg=key)
    assert EVERY.key not in kernels.untraced


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 60))])
def test_random_functions_give_the_same_bits(kernels: Kernels, seed: int, tmp_path: Path) -> None:
    random = Random(seed)
    values = random_values(random, (21,), special=0.05)
    equations = random_program(random, values, (21,), 20).equations()
    with np.errstate(all="ignore"):
        expected = kernels(equations, values)
        for name in ("x86-64", "x86-64-v3"):
            same_bits(of_processor(name, tmp_path / name, kernels)(equations, values), expected)


def test_values_of_one_member_and_of_all_have_the_same_bits(kernels: Kernels) -> None:
    """What is the same for all is computed once, and as it would be for each."""
    values = values_of(50)
    each = {**values, "t": np.full(50, values["t"])}
    same_bits(kernels(EVERY, each), kernels(EVERY, values))


@pytest.mark.parametrize("name", ["x86-64", "x86-64-v3", "x86-64-v4"])
@pytest.mark.parametrize("batch", [(1, 64), (3, 71), (2, 2, 100)])
def test_values_of_a_group_and_of_each_member_have_the_same_bits(
    kernels: Kernels, name: str, batch: tuple[int, ...], tmp_path: Path
) -> None:
    members = int(np.prod(batch))
    each = {key: value.reshape(batch) for key, value in values_of(members).items() if key != "t"}
    rng = np.random.default_rng(2)
    # Numbers and a mask, the first also the same along an axis before the last.
    t, valid = rng.normal(size=(batch[0], *[1] * (len(batch) - 1))), rng.random((*batch[:-1], 1)) < 0.5
    whole = {**each, "t": np.broadcast_to(t, batch).copy(), "valid": np.broadcast_to(valid, batch).copy()}
    expected = kernels(EVERY, whole)
    found = of_processor(name, tmp_path, kernels)
    same_bits(found(EVERY, {**each, "t": t, "valid": valid}), expected)
    same_bits(found(EVERY, {**each, "t": whole["t"], "valid": valid}), expected)
    assert found.members_by_numpy == 0
    assert not found.untraced
