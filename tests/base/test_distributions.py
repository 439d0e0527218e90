"""Quantiles and probabilities against scipy.stats, which no command imports."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from trackbench.base.distributions import (
    chi_square_quantile,
    normal_density,
    normal_quantile,
    normal_within,
    t_probability,
    t_quantile,
)

PROBABILITIES = [1e-6, 0.025, 0.3, 0.5, 0.95, 0.975, 1 - 1e-6]
FREEDOMS = [1, 2, 2.5, 19, 1e4, np.inf]


@pytest.mark.parametrize("probability", PROBABILITIES)
def test_quantiles(probability):
    assert normal_quantile(probability) == pytest.approx(stats.norm.ppf(probability), rel=1e-12, abs=1e-12)
    for freedom in FREEDOMS:
        expected = stats.t.ppf(probability, freedom)
        assert t_quantile(probability, freedom) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    freedom = np.array(FREEDOMS[:-1])
    np.testing.assert_allclose(
        chi_square_quantile(probability, freedom), stats.chi2.ppf(probability, freedom), rtol=1e-12
    )


@pytest.mark.parametrize("x", [-40.0, -3.0, -0.1, 0.0, 2.0])
def test_probabilities(x):
    for freedom in FREEDOMS[:-1]:
        np.testing.assert_allclose(t_probability(np.array([x]), freedom), [stats.t.cdf(x, freedom)], rtol=1e-12)
    assert normal_density(x) == pytest.approx(stats.norm.pdf(x), rel=1e-12)
    assert normal_within(abs(x)) == pytest.approx(2 * stats.norm.cdf(abs(x)) - 1, rel=1e-12)


@pytest.mark.slow
def test_no_command_waits_for_scipy_stats(tiny: Path) -> None:
    """Nor ``run`` with a cached truth for the simulator."""
    commands = ["list trackers", "check tiny.yaml", "run tiny.yaml", "run tiny.yaml", "compare results/tiny"]
    loaded = [_loaded(command, tiny.parent) for command in commands]
    assert all("trackbench" in modules for modules in loaded)
    assert not any("scipy.stats" in modules for modules in loaded)
    assert "highway_env" not in loaded[3]


def _loaded(command: str, folder: Path) -> set[str]:
    """The modules that a command imports."""
    code = (
        "import atexit, sys; from trackbench.cli.commands import run_command_line as main; "
        f"atexit.register(lambda: print(*sys.modules)); sys.argv = {['trackbench', *command.split()]!r}; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())
