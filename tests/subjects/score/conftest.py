"""Scores without their pages, which take most of the time of a small one."""

from __future__ import annotations

import pytest


@pytest.fixture
def pages() -> None:
    """The pages of a result are written, as for a user."""


@pytest.fixture(autouse=True)
def _without_pages(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "pages" not in request.fixturenames:
        monkeypatch.setattr("trackbench.report.result.result_document", lambda result: None)
        for kind in ("html", "markdown"):
            monkeypatch.setattr(f"trackbench.document.{kind}.to_{kind}", lambda document: "")
