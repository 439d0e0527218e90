"""What the tests of the fused engine share: kernels, where there can be any."""

import pytest

from trackbench.engine.kernels import Kernels
from trackbench.engine.machine import unavailable


@pytest.fixture(scope="session")
def kernels() -> Kernels:
    """Kernels for this machine; without it what needs them is skipped."""
    reason = unavailable()
    if reason is not None:
        pytest.skip(reason)
    return Kernels()
