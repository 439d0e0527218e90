"""Write results/published/README.md: published numbers beside ours, and where we differ."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from .association import association
from .projects import range_3km, udacity_ekf, ukf_copy, ukf_own
from .rows import Source, differing
from .single import acceleration, air_traffic, car
from .williams import williams

OUT = Path(__file__).parents[2] / "results" / "published" / "README.md"

INTRODUCTION = """\
# Published numbers beside ours

Made by `make published` with `TRACKBENCH_DATA`. A number agrees inside the 95 % beside it; without such a range,
where both sides have the same data, if every printed digit is the same. Of several numbers the largest difference is
shown."""


def sources() -> tuple[Source, ...]:
    """Run every source."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder)
        recorded = (ukf_copy(), ukf_own(), udacity_ekf(), car(target), williams(target))
    return (*recorded, acceleration(), air_traffic(), association(), range_3km())


def page(of: Sequence[Source]) -> Iterator[str]:
    """Yield the lines of the page."""
    yield from (INTRODUCTION, "")
    for source in of:
        yield from source.section()
    yield from ("## Where we differ from published code, and why", "", *differing(of))


def main() -> None:
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text("\n".join(page(sources())).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
