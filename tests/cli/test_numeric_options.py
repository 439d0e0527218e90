"""Numbers on the command line: finite ones, in the digits 0 to 9, and whole ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackbench.base.errors import InputError
from trackbench.base.execution import MOST_WORKERS, executor
from trackbench.base.numbers import stated_number
from trackbench.cli.commands import cli as root
from trackbench.cli.options import Finite
from trackbench.compare.limits import Limit
from trackbench.subjects.score.gate import Gate

Cli = Callable[..., Any]
#: What Python takes for a number, and nobody means on a command line.
DIGITS = (
    "\N{ARABIC-INDIC DIGIT THREE}",
    "\N{FULLWIDTH DIGIT ONE}",
    "\N{DEVANAGARI DIGIT SEVEN}.5",
    "\N{SUPERSCRIPT TWO}",
)
ODD = (*DIGITS, "nan", "NaN", "inf", "-inf", "Infinity", "1e999", "1_000", "1 000", "0x10", "1,5", "", "x")


def parameters(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Parameter]]:
    """Every option and argument of a command and of those below it, with the words that name it."""
    for parameter in command.params:
        yield " ".join([*words, *parameter.opts]), parameter
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from parameters(inner, (*words, name))


NUMERIC = {
    name: parameter
    for name, parameter in parameters(root)
    if isinstance(parameter.type, click.types.IntParamType | click.types.FloatParamType | click.Tuple)
}


def test_every_numeric_option_has_one_of_these_types() -> None:
    assert len(NUMERIC) > 30
    others = [name for name, parameter in NUMERIC.items() if not isinstance(parameter.type, Finite | click.IntRange)]
    assert others == []


@pytest.mark.parametrize("name", ["check --tracker-timeout", "score --time-offset"])
def test_an_odd_number_is_refused(name: str) -> None:
    parameter = NUMERIC[name]
    for text in [*ODD, "9" * 5000]:
        for written in (text, f"-{text}", f"{text}%"):
            with pytest.raises(click.BadParameter) as caught:
                parameter.type.convert(written, parameter, None)
            assert len(str(caught.value)) < 200


@pytest.mark.parametrize("name", [name for name in NUMERIC if name.endswith("--workers")])
def test_more_workers_than_anybody_has_are_refused(name: str) -> None:
    parameter = NUMERIC[name]
    assert parameter.type.convert(str(MOST_WORKERS), parameter, None) == MOST_WORKERS
    for text in (str(MOST_WORKERS + 1), "999999", "99999999999999999999", "0", "-1"):
        with pytest.raises(click.BadParameter, match=f"is not in the range 1<=x<={MOST_WORKERS}"):
            parameter.type.convert(text, parameter, None)


@pytest.mark.parametrize("workers", [0, -1, True, 1.5, MOST_WORKERS + 1, 10**20, "2", float("nan")])
def test_so_are_they_in_a_program(workers: Any) -> None:
    with pytest.raises(InputError, match=f"^workers: .* is not a number of processes; give .* 1 to {MOST_WORKERS}"):
        executor(workers).__enter__()


@pytest.mark.parametrize(
    "address", ["local:0", "local:1025", "local:99999999999999999999", "local:\u0663", "tcp://a:\u0663"]
)
def test_so_are_they_on_a_cluster(cli: Cli, address: str) -> None:
    done = cli("run", "highway", "--cluster", address)
    assert (done.status, done.out, done.err.count("\n")) == (2, "", 1)
    assert done.err.startswith("--cluster: write ")


@pytest.mark.parametrize("text", ODD)
def test_limits_and_gates_are_finite_too(text: str) -> None:
    for parse in (Limit.parse, Gate.parse):
        for end in ("", "%"):
            with pytest.raises(InputError):
                parse(f"gospa:{text}{end}")


@given(st.text())
def test_a_text_is_a_number_only_in_ascii(text: str) -> None:
    assert stated_number(text) != stated_number(text) or (text.isascii() and "_" not in text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_finite_number_is_read_back(number: float) -> None:
    assert stated_number(repr(number)) == number
    assert Finite().convert(repr(number), None, None) == number
    assert Finite().convert(number, None, None) == number
