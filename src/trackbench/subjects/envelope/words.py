"""The form of the command: ``trackbench envelope SCENARIO``, or a word that names what is done with finished maps."""

from __future__ import annotations

from typing import Any, NoReturn

import click
from click.shell_completion import CompletionItem

from trackbench.base.errors import alike
from trackbench.base.subjects import resolve
from trackbench.cli.options import scenario_paths

_PACKAGE = "trackbench.subjects.envelope"
#: Commands on claims: the first word of the line, and of ``--verify`` any.
WORDS = {
    "--verify": f"{_PACKAGE}.claim_commands:verify_command",
    "diff": f"{_PACKAGE}.claim_commands:diff_command",
    "badge": f"{_PACKAGE}.claim_commands:badge_command",
}


class EnvelopeGroup(click.Group):
    """Takes a scenario where its first word names no command."""

    allow_extra_args = False
    allow_interspersed_args = True

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        words = [part for item in args for part in _parts(item)]
        word = "--verify" if "--verify" in words else words[0] if words else ""
        if word not in WORDS:
            return super().make_context(info_name, args, parent, **extra)
        words.remove(word)
        command: click.Command = resolve(WORDS[word])
        return command.make_context(f"{info_name} {word}", words, parent, **extra)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        first = args[0] if args else ""
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            close = alike(first, WORDS, 0.6)
            if close and "extra argument" in error.message:
                _mistaken(ctx, first, close[0])
            raise

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(WORDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        command: click.Command | None = resolve(WORDS[cmd_name]) if cmd_name in WORDS else None
        return command


def _parts(item: str) -> list[str]:
    """``--verify=CLAIM`` as two words."""
    return item.split("=", 1) if item.startswith("--verify=") else [item]


def _mistaken(ctx: click.Context, word: str, meant: str) -> NoReturn:
    raise click.UsageError(f"a scenario stands alone, and {word!r} is no command. Did you mean {meant!r}?", ctx)


def first_words(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The commands and the scenarios."""
    words = [CompletionItem(word) for word in WORDS if word.startswith(incomplete) and not word.startswith("-")]
    return words + scenario_paths(ctx, parameter, incomplete)
