"""The options that say which moment of a recording is meant."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from trackbench.subjects.recording.focus import Opening

TRACKER = click.option(
    "--tracker",
    metavar="NAME",
    help="With --worst: of this tracker alone. With hidden identities also at a time: its tracks.",
)


class MomentCommand(click.Command):
    """A command whose ``--worst`` may stand without a number, which is 1 then."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        filled: list[str] = []
        for arg, following in zip(args, [*args, ""][1:], strict=True):
            filled += [arg, "1"] if arg == "--worst" and not following.isdigit() else [arg]
        return super().parse_args(ctx, filled)


def worst_option(help: str) -> Callable[[Any], Any]:
    """``--worst [N]``"""
    return click.option("--worst", type=click.IntRange(1), metavar="[N]", help=help)


def opening_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """``--at``, ``--worst``, ``--vehicle`` and ``--tracker`` of a command that shows a recording."""
    for option in (
        TRACKER,
        click.option("--vehicle", metavar="NAME", help="Scene and plots of this vehicle; with --worst: its moments."),
        worst_option("Stop at the moment of the largest position error, or of the Nth largest, at its vehicle."),
        click.option("--at", type=float, metavar="T", help="Stop at this time, in seconds."),
    ):
        command = option(command)
    return command


def opening(at: float | None, worst: int | None, vehicle: str | None, tracker: str | None) -> Opening:
    """What the options say.

    Raises:
        click.UsageError: they contradict each other.
    """
    from trackbench.subjects.recording.focus import Opening

    if at is not None and worst is not None:
        raise click.UsageError("--at and --worst are two times: give one of them")
    return Opening(at, worst, vehicle, tracker)
