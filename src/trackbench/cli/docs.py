"""Reference page of the command line, made from its help texts.

``python -m trackbench.cli.docs`` prints it.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator

import click

from trackbench.cli.commands import cli
from trackbench.cli.run import run_command

#: Examples in a help text, which are left out: other pages have them.
EXAMPLES = re.compile(r"\n\n  Examples?:(?:\n    .*)+")
INTRODUCTION = """\
# The command line

<!-- Made from the help by `python -m trackbench.cli.docs`. Change the help texts, not this page. -->

A reference: what each command prints with `--help`, but for its examples. Options that a command shares with
`trackbench run` are explained there, and named below the others.

The result goes to stdout; progress, warnings and errors go to stderr. A progress bar is shown where stderr is a
terminal; elsewhere a line every 30 s, and neither with `--quiet`. Colour is shown only where stdout is a terminal, and
none if `NO_COLOR` is set. A message on bad input says where and what would be right; it is never a traceback.

The exit status is 0 if all is well, 2 after bad input or usage, and 4 if the result cannot be written: the disk or
standard output is full or closed. What 1 and 3 mean is said below where they occur; 1 is never the status of an error.
An interrupted command ends with 130, one whose reader has gone with 141, and a fault of trackbench itself with 70 and
a traceback.

`--quiet` leaves the outcome and what failed. `--verbose` says on stderr what is done: what came from the cache, how
long each part took, what was written.

The shell completes commands, options and files after one of these lines:

```sh
eval "$(_TRACKBENCH_COMPLETE=bash_source trackbench)"    # in ~/.bashrc
eval "$(_TRACKBENCH_COMPLETE=zsh_source trackbench)"     # in ~/.zshrc
_TRACKBENCH_COMPLETE=fish_source trackbench > ~/.config/fish/completions/trackbench.fish
```
"""


def command_line_markdown() -> str:
    """Return the page on all commands, their options and exit status, as Markdown."""
    root = click.Context(cli, info_name="trackbench", terminal_width=80, **cli.context_settings)
    blocks = [INTRODUCTION, *_commands(cli, root)]
    return "\n\n".join(block.rstrip("\n") for block in blocks) + "\n"


def _commands(command: click.Command, context: click.Context) -> Iterator[str]:
    shown, shared = copy.copy(command), []
    if command is not run_command:
        shared = [option for option in command.params if option.get_help_record(context) in _options_of_run(context)]
        shown.params = [option for option in command.params if option not in shared]
    shown.add_help_option = False
    if command is not cli:
        yield f"## {context.command_path}"
        yield f"```text\n{EXAMPLES.sub('', shown.get_help(context))}\n```"
    if shared:
        yield f"Options shared with [run](#trackbench-run): {', '.join(f'`{option.opts[-1]}`' for option in shared)}."
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from _commands(inner, click.Context(inner, info_name=name, parent=context))


def _options_of_run(context: click.Context) -> list[tuple[str, str] | None]:
    return [option.get_help_record(context) for option in run_command.params if isinstance(option, click.Option)]


if __name__ == "__main__":
    print(command_line_markdown(), end="")
