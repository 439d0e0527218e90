"""Which engine a command computes by."""

from __future__ import annotations

import click

from trackbench.cli.choices import NearestChoice
from trackbench.engine.choice import ENGINE_NAMES

#: The command gets it as ``engine``.
engine_option = click.option(
    "--engine",
    type=NearestChoice(ENGINE_NAMES),
    default="auto",
    show_default=True,
    metavar="NAME",
    help="numpy, or fused (trackbench[fast]).",
)
