"""SciPy's functions without the packages around them: the same functions, and the packages stay whole."""

import subprocess
import sys

import numpy as np
import pytest
import scipy.optimize
import scipy.special

from trackbench.base.scipy_functions import largest_assignment, scipy_function

FUNCTIONS = ("ndtri", "stdtrit", "stdtr", "gammaincinv")


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_compiled_function_gives_the_bits_of_the_package(name: str) -> None:
    random = np.random.default_rng(1)
    function, public = scipy_function("scipy.special", "_ufuncs", name), getattr(scipy.special, name)
    arguments = [random.uniform(0.01, 0.99, 1000)]
    if name != "ndtri":
        arguments.insert(0, random.uniform(0.5, 2000.0, 1000))
    np.testing.assert_array_equal(function(*arguments), public(*arguments))


def test_a_function_that_is_not_in_the_module_comes_from_the_package() -> None:
    for module in ("_ufuncs", "_no_such_module"):
        assert scipy_function("scipy.special", module, "logsumexp") is scipy.special.logsumexp


def test_the_largest_assignment_is_that_of_scipy() -> None:
    value = np.random.default_rng(2).uniform(size=(7, 5))
    expected = scipy.optimize.linear_sum_assignment(value, maximize=True)
    np.testing.assert_array_equal(largest_assignment(value), expected)


def test_the_packages_are_whole_for_whoever_imports_them_later() -> None:
    code = """
import sys
from trackbench.base.distributions import chi_square_quantile, t_quantile
from trackbench.base.scipy_functions import largest_assignment
chi_square_quantile(0.5, 2.0), t_quantile(0.975, 9.0), largest_assignment([[1.0]])
print("scipy._lib._array_api" in sys.modules, "scipy.optimize._minimize" in sys.modules)
import scipy
from scipy import optimize, special, stats
from scipy.special import *
print(scipy.special is special is sys.modules["scipy.special"], type(special).__name__, type(optimize).__name__)
print(erf(0.0), special.logsumexp([0.0]), optimize.linprog([1.0]).x[0], stats.norm.ppf(0.5), special._ufuncs.erf is erf)
import scipy.special._ufuncs as ufuncs
print(ufuncs.ndtri is special.ndtri, "jv" in dir(special))
"""
    lines = python(code).splitlines()
    assert lines == [
        "False False",
        "True module module",
        "0.0 0.0 0.0 0.0 True",
        "True True",
    ]


def test_two_threads_get_the_whole_package() -> None:
    code = """
import threading
from trackbench.base.distributions import t_quantile
t_quantile(0.975, 9.0)
found = []
def ask():
    from scipy import special
    found.append(special.logsumexp([0.0]))
threads = [threading.Thread(target=ask) for _ in range(4)]
[thread.start() for thread in threads]; [thread.join() for thread in threads]
print([float(value) for value in found])
"""
    assert python(code).strip() == "[0.0, 0.0, 0.0, 0.0]"
