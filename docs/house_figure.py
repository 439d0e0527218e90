"""Draws the figure of docs/developing.md: the packages of trackbench by floors, from their imports."""

from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import grimp
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import FancyBboxPatch

from trackbench.document import Figure
from trackbench.document.drawing import INK, MUTED, svg_file

FILE = Path(__file__).parent / "images" / "house.svg"
SOURCE = Path(__file__).parents[1] / "src" / "trackbench"
CORE, SUBJECT = "#0072B2", "#E69F00"
#: Width of a room and of the gap beside it, in axes units; a floor is one unit high.
WIDTH, GAP = 1.5, 0.2


def package_of(module: str) -> str:
    """``trackbench.metrics.sums`` is in ``metrics``, ``trackbench.subjects.doctor.api`` in ``subjects.doctor``."""
    parts = module.split(".")[1:]
    return ".".join(parts[: 2 if parts[:1] == ["subjects"] else 1])


def imports_of_packages() -> dict[str, set[str]]:
    """By package, the packages that it imports."""
    graph = grimp.build_graph("trackbench", exclude_type_checking_imports=True)
    imported: dict[str, set[str]] = defaultdict(set)
    for module in graph.modules:
        package = package_of(module)
        if package in ("", "__main__", "scenarios", "subjects"):
            continue
        others = {package_of(other) for other in graph.find_modules_directly_imported_by(module)}
        imported[package] |= others - {package, ""}
    return dict(imported)


def floors(imported: Mapping[str, set[str]]) -> dict[str, int]:
    """The floor of each package: one above the highest that it imports; the lowest is 1."""

    @cache
    def floor(package: str) -> int:
        return 1 + max((floor(other) for other in imported[package]), default=0)

    return {package: floor(package) for package in imported}


def lines_of(package: str) -> int:
    """Lines of source of a package."""
    files = (SOURCE / package.replace(".", "/")).rglob("*.py")
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def draw(axes: Axes) -> None:
    """The packages, each on its floor with its lines of source; the subjects together on the top floor."""
    by_floor: dict[int, list[str]] = defaultdict(list)
    floor_of = floors(imports_of_packages())
    top = max(floor_of.values())
    for package, floor in floor_of.items():
        by_floor[top if package.startswith("subjects.") else floor].append(package)
    widest = max(map(len, by_floor.values()))
    for floor, packages in by_floor.items():
        left = (widest - len(packages)) * (WIDTH + GAP) / 2
        for column, package in enumerate(sorted(packages)):
            x, colour = left + column * (WIDTH + GAP), SUBJECT if package.startswith("subjects.") else CORE
            box = FancyBboxPatch(
                (x, floor), WIDTH, 0.62, boxstyle="round,pad=0.02", edgecolor=colour, facecolor="none", lw=1.4
            )
            axes.add_patch(box)
            name = package.removeprefix("subjects.")
            axes.text(x + WIDTH / 2, floor + 0.4, name, ha="center", va="center", fontsize=9, color=INK)
            size = f"{lines_of(package) / 1000:.1f}k lines"
            axes.text(x + WIDTH / 2, floor + 0.15, size, ha="center", va="center", fontsize=7, color=MUTED)
        axes.text(-0.4, floor + 0.3, str(floor), ha="right", va="center", fontsize=9, color=MUTED)
    axes.set_xlim(-0.8, widest * (WIDTH + GAP))
    axes.set_ylim(0.8, max(by_floor) + 0.9)
    axes.set_axis_off()


def paint(canvas: Canvas) -> None:
    """The figure on an empty canvas."""
    draw(canvas.add_axes((0, 0, 1, 1)))


def house() -> Figure:
    """The figure of the page."""
    return Figure(
        name="house",
        title="Packages by floors",
        caption="",
        alternative="Each package stands above all that it imports: base at the ground, the subjects at the top.",
        paint=paint,
        height=760,
        width=980,
    )


if __name__ == "__main__":
    FILE.write_text(svg_file(house()), encoding="utf-8")
