"""What the tests of the fused engine share: kernels, where there can be any."""

from collections.abc import Iterator

import pytest

from trackbench.engine.kernels import Kernels
from trackbench.engine.machine import unavailable


@pytest.fixture
def kernels() -> Kernels:
    """Kernels for this machine, kept on disk for the whole session; what needs them is skipped where there are none."""
    reason = unavailable()
    if reason is not None:
        pytest.skip(reason)
    return Kernels()


@pytest.fixture(autouse=True)
def asked_anew() -> Iterator[None]:
    """Some tests take llvmlite away: whether machine code can be made is asked again in each test, and after it."""
    unavailable.cache_clear()
    yield
    unavailable.cache_clear()
