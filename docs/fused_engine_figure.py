"""Draws the figure of docs/fused-engine.md: the graph of the EKF's prediction along one axis, as it is compiled."""

from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import FancyArrowPatch

from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import INK, MUTED, svg_file
from trackbench.engine.equations import Equations, Values
from trackbench.engine.graph import Node, ordered
from trackbench.engine.layout import Input
from trackbench.engine.trace import Trace, trace
from trackbench.filters import Belief, ExtendedKalmanFilter
from trackbench.models.motion import ConstantVelocity

FILE = Path(__file__).parent / "images" / "fused-graph.svg"
ONCE, MEMBER, GUARD = "#0072B2", "#E69F00", "#CC79A7"


class Drawn(NamedTuple):
    """A node where it is drawn."""

    name: str
    label: str
    x: float
    y: float
    colour: str
    arguments: tuple[str, ...]


#: By how it is made of others: its own name, what is written at it, column and row.
PLACES = {
    "sigma 0": ("sigma", "sigma", 0, 2.2),
    "dt 0": ("dt", "dt", 0, 0.8),
    "mul dt dt": ("square", "*", 1, 0),
    "mul square 0.5": ("half", "* 0.5", 2, 0),
    "mul sigma half": ("gain", "* sigma", 3, 0),
    "mul dt sigma": ("rate", "*", 1, 1.6),
    "mean 0": ("p", "px", 0, 6.9),
    "mean 2": ("v", "vx", 0, 8.1),
    "fma v dt p": ("new p", "+ * dt", 2, 6.9),
    "covariance 0": ("P", "P[px, px]", 0, 3.2),
    "covariance 8": ("C", "P[px, vx]", 0, 4.4),
    "covariance 10": ("V", "P[vx, vx]", 0, 5.6),
    "fma C dt P": ("P first", "+ * dt", 2, 3.2),
    "fma V dt C": ("C moved", "+ * dt", 2, 4.4),
    "fma dt C moved P first": ("P moved", "+ * dt", 4.2, 3.2),
    "fma gain gain P moved": ("new P", "+ **2", 5.2, 3.2),
    "fma gain rate C moved": ("new C", "+ *", 5.2, 4.4),
    "fma rate rate V": ("new V", "+ **2", 5.2, 5.6),
    # A computed variance is rounded up by 2^-46 of itself.
    "mul new P 1": ("rounded P", "up", 6.2, 3.2),
    "mul new V 1": ("rounded V", "up", 6.2, 5.6),
}
#: By what is predicted, its name and row.
RESULTS = {
    "rounded P": ("P[px, px]", 3.2),
    "new C": ("P[px, vx]", 4.4),
    "rounded V": ("P[vx, vx]", 5.6),
    "new p": ("px", 6.9),
}
#: Whose uses are written at the operation, and not drawn as lines.
WRITTEN = ("dt", "sigma")


def main() -> None:
    FILE.write_text(picture(), encoding="utf-8")


def picture() -> str:
    """The text of the SVG file."""
    legend = (
        LegendEntry("once for all members", ONCE, "box"),
        LegendEntry("for each member", MEMBER, "box"),
        LegendEntry("guard", GUARD, "box"),
    )
    alternative = (
        "Graph of operations from the state and its covariance on the left to the predicted ones, and to the guard, "
        "on the right; the process noise is computed once for all members"
    )
    return svg_file(Figure("graph", "", "", alternative, _paint, 400, 720, legend))


def traced() -> Trace:
    """The prediction of position and velocity along x, and of their covariance."""

    def predicted(values: Values) -> Values:
        any_sigma = ConstantVelocity(acceleration_sigma_mps2=1)
        motion = any_sigma.model_copy(update={"acceleration_sigma_mps2": values["sigma"]})
        belief = Belief(values["mean"], values["covariance"])
        mean, covariance = ExtendedKalmanFilter(motion).predict(belief, values["dt"])[:2]
        both = {"P": (0, 0), "C": (2, 0), "C, transposed": (0, 2), "V": (2, 2)}
        return {"p": mean[0], **{name: covariance[place] for name, place in both.items()}}

    ranks = {"mean": 1, "covariance": 2, "dt": 0, "sigma": 0}
    equations = Equations("prediction", predicted, ranks, symmetric=frozenset({"covariance"}))
    shapes = {"mean": (4,), "covariance": (4, 4), "dt": (), "sigma": ()}
    return trace(equations, [Input(name, shape, 1 if shape else 0, "d") for name, shape in shapes.items()])


def _drawn() -> list[Drawn]:
    known: dict[int, Drawn] = {}
    for node in ordered(traced().outputs):
        if not node.constant:
            arguments = tuple(_constant(item) or known[item.number].name for item in node.arguments)
            name, label, x, y = PLACES[_formula(node, arguments)]
            known[node.number] = Drawn(name, label, x, y, ONCE if node.uniform else MEMBER, arguments)
    results = [Drawn(f"result {name}", label, 7.3, y, MEMBER, (name,)) for name, (label, y) in RESULTS.items()]
    # The condition is drawn as one: that a sum is finite, of these and of what was left out as a product with zero.
    guard = Drawn("guard", "finite?", 8.6, 5, GUARD, tuple(item.name for item in results))
    return [*known.values(), *results, guard]


def _constant(node: Node) -> str:
    return f"{node.value:g}" if node.constant else ""


def _formula(node: Node, arguments: tuple[str, ...]) -> str:
    if isinstance(node.value, tuple):
        return "{} {}".format(*node.value)
    # The order of exchangeable arguments depends on what was traced first.
    first, second, *rest = arguments
    ways = (" ".join((node.op, *order, *rest)) for order in ((first, second), (second, first)))
    return next(way for way in ways if way in PLACES)


def _paint(canvas: Canvas) -> None:
    axes = canvas.add_subplot()
    axes.set(xlim=(-0.75, 9.1), ylim=(8.5, -0.5))
    axes.set_axis_off()
    drawn = {item.name: item for item in _drawn()}
    for item in drawn.values():
        for argument in dict.fromkeys(item.arguments):
            if argument in drawn and not (argument in WRITTEN and len(item.label) > 1):
                _line(axes, drawn[argument], item)
    for item in drawn.values():
        _box(axes, item)


def _line(axes: Axes, start: Drawn, end: Drawn) -> None:
    # Clear of the boxes, which are as wide as what is written in them.
    clear = [7 + 2.5 * len(item.label) for item in (start, end)]
    axes.add_patch(
        FancyArrowPatch(
            (start.x, start.y), (end.x, end.y), arrowstyle="-|>", mutation_scale=7, shrinkA=clear[0], shrinkB=clear[1],
            color=MUTED, linewidth=0.9, zorder=1,
        )
    )  # fmt: skip


def _box(axes: Axes, item: Drawn) -> None:
    box = {"boxstyle": "round,pad=0.35", "facecolor": "#ffffff", "edgecolor": item.colour, "linewidth": 1.6}
    axes.text(item.x, item.y, item.label, fontsize=10, ha="center", va="center", color=INK, bbox=box, zorder=2)


if __name__ == "__main__":
    main()
