"""The options of boxes that a file has, of whatever format, without measurements."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from trackbench.base.config.plugin import OptionsBeside, Plugin
from trackbench.truth.config.recording import ReferenceTruth
from trackbench.truth.tracks import TRAFFIC_FORMATS, TrafficFormat


class BoxesOptions(ReferenceTruth, OptionsBeside):
    """Boxes of a reference as they stand in a file: an id is one object, due at the time stamps of the file."""

    format: Annotated[TrafficFormat, Plugin(TRAFFIC_FORMATS, "name", word=True)] = Field(
        description="The format of the file (`trackbench list truth` shows them), or one of your own as "
        "`module:Class`. Its options stand beside it."
    )
    path: str = Field(
        min_length=1,
        description="The file. A relative path starts in the scenario's folder, or in the working directory; "
        "environment variables such as $TRACKBENCH_DATA are filled in.",
    )
