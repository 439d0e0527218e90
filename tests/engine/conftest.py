"""What the tests of the fused engine share: kernels, where there can be any."""

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
