"""Types, functions and modules have the field's names: a list of names that were replaced and may not come back."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.support.places import ROOT

REPLACED = {
    "About": "Linearisation",
    "Asked": "FilterCall",
    "BACK": "smoother_step",
    "Content": "SourceFingerprint",
    "Couples": "ObjectTrackPairs",
    "Doubt": "StepGuard",
    "Given": "Availability",
    "Givers": "TrackerSet",
    "Kept": "KernelCache",
    "Off": "NeesDeviation",
    "Passage": "CallPlan",
    "Settled": "Presolved",
    "Situation": "AssociationInput",
    "Taken": "ProcessedScan",
    "WithoutCourse": "CartesianFallback",
    "aside": "reference_kind",
    "forth": "filter_step",
    "primed": "with_initial_states",
    "take_in": "linear_update",
    "untold": "scan_placeholder",
}


def definitions(tree: ast.Module) -> Iterator[str]:
    """Names of classes, functions, methods, and of what a module or a class assigns."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        if isinstance(node, ast.Module | ast.ClassDef):
            for statement in node.body:
                targets = statement.targets if isinstance(statement, ast.Assign) else []
                targets = [statement.target] if isinstance(statement, ast.AnnAssign) else targets
                yield from (target.id for target in targets if isinstance(target, ast.Name))


def test_a_definition_is_seen() -> None:
    code = "BACK = 1\nclass Given:\n    aside: int\n    def forth(self) -> None: ...\n"
    assert set(definitions(ast.parse(code))) == {"BACK", "Given", "aside", "forth"}


def test_no_replaced_name_is_defined() -> None:
    defined = [
        (file.name, name, REPLACED[name.removeprefix("_")])
        for file in (ROOT / "src" / "trackbench").rglob("*.py")
        for name in definitions(ast.parse(file.read_text(encoding="utf-8")))
        if name.removeprefix("_") in REPLACED
    ]
    assert not defined, "file, replaced name, name of today"
