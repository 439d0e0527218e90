"""The options of tracks that another program wrote."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from trackbench.base.config import problem_error
from trackbench.base.config.plugin import OptionsBeside, Plugin
from trackbench.truth.tracks import TRAFFIC_FORMATS, TrafficFormat

AUTO = "auto"


class TracksConfig(OptionsBeside):
    """Tracks that another program wrote into a file."""

    use: Literal["tracks"] = Field(description="tracks.")
    path: str = Field(
        min_length=1,
        description="The file. A relative path starts in the scenario's folder, or in the working directory; "
        "environment variables such as $TRACKBENCH_DATA are filled in.",
    )
    format: Annotated[TrafficFormat, Plugin(TRAFFIC_FORMATS, "name", word=True)] = Field(
        description="The format of the file (`trackbench list truth` shows them), or one of your own as "
        "`module:Class`. Its options, such as columns and units, stand beside it. auto, or none: by the ending of the "
        "file, where it tells."
    )
    time_offset_s: float = Field(
        0,
        ge=-3600,
        le=3600,
        description="Added to the time stamps, s; negative where they are late. An offset is estimated and shown, and "
        "taken out by this alone.",
    )

    @model_validator(mode="before")
    @classmethod
    def _by_ending(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("format", AUTO) != AUTO or not isinstance(data.get("path"), str):
            return data
        return {**data, "format": format_of(data["path"])}

    @property
    def sensors(self) -> None:
        """It names none."""

    @property
    def sensors_used(self) -> list[str]:
        """It reads none of the scenario's."""
        return []


def format_of(path: str) -> str:
    """The name of the format of a file's ending.

    Raises:
        PydanticCustomError: no format has it, or several.
    """
    ending = PurePath(path).suffix.lower()
    names = [name for name, form in TRAFFIC_FORMATS.loaded().items() if ending in form.endings]
    if len(names) == 1:
        return names[0]
    endings = sorted({each for form in TRAFFIC_FORMATS.loaded().values() for each in form.endings})
    known = f"files of {' and of '.join(names)} end in it" if names else f"known are {', '.join(endings)}"
    what = f"the ending {ending!r}" if ending else "a name without an ending"
    message = f"{what} does not tell the format ({known}); name it in format"
    raise problem_error(message)
