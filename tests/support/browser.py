"""Pages as a real browser shows them: how wide they are, what is in them, and what it has to say about them."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

# Measures each frame once all have loaded; a frame has exactly its width, while a window has a smallest one.
MEASURE = """
const frames = [...document.querySelectorAll('iframe')].map(frame => {
  const page = frame.contentDocument, width = frame.contentWindow.innerWidth;
  page.querySelectorAll('details').forEach(details => details.open = true);
  const inside = e => e.closest('.scroll, pre') && !e.matches('.scroll, pre') || e.closest('svg') && e.tagName != 'svg';
  const name = e => e.tagName.toLowerCase() + '.' + (e.getAttribute('class') || '');
  return {
    width,
    scrollWidth: page.documentElement.scrollWidth,
    overflowing: [...page.body.querySelectorAll('*')]
      .filter(e => !inside(e) && e.getBoundingClientRect().right > width + 1).map(name),
    figures: [...page.querySelectorAll('figure')].map(figure => ({
      id: figure.id,
      caption: figure.querySelector('figcaption')?.textContent.trim() || '',
      alternative: figure.querySelector('svg[role=img]')?.getAttribute('aria-label') || '',
      height: figure.querySelector('svg')?.getBoundingClientRect().height || 0,
    })),
    smallest: Math.min(...[...page.querySelectorAll('p, td, li, figcaption')]
      .map(e => parseFloat(frame.contentWindow.getComputedStyle(e).fontSize))),
  };
});
tell(frames);
"""

# Leaves a value in the page, as JSON.
TELL = """
const tell = value => {
  const found = document.createElement('pre');
  found.id = 'found';
  found.textContent = JSON.stringify(value);
  document.body.append(found);
};
"""


@dataclass(frozen=True)
class Seen:
    """What the browser found."""

    frames: dict[tuple[str, int], dict[str, Any]]
    """By page and width in pixels."""
    console: list[str]
    """Messages of any of the pages."""


def look(folder: Path, pages: Mapping[str, str], widths: Sequence[int]) -> Seen:
    """Open pages in headless Chromium, each in frames of the given widths; they and its profile go into ``folder``."""
    for name, text in pages.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    shown = [(name, width) for name in pages for width in widths]
    frames = "".join(
        f'<iframe src="{name}.html" style="width:{width}px;height:900px"></iframe>' for name, width in shown
    )
    told, console = _told(folder, frames, MEASURE)
    return Seen(dict(zip(shown, told, strict=True)), console)


def drive(folder: Path, page: str, script: str, width: int = 1280) -> tuple[Any, list[str]]:
    """Open a page in a frame of a width, run a script on it, and return what it returns, with the browser's messages.

    ``script`` is the body of an asynchronous function of ``page``, the document, and of ``sleep``, which waits for
    milliseconds.
    """
    (folder / "page.html").write_text(page, encoding="utf-8")
    frame = f'<iframe src="page.html" style="width:{width}px;height:900px"></iframe>'
    body = f"""
        const page = document.querySelector('iframe').contentDocument;
        const sleep = time => new Promise(done => setTimeout(done, time));
        (async () => {{ {script} }})().then(tell, error => tell(String(error)));
    """
    return _told(folder, frame, body)


def _told(folder: Path, body: str, script: str) -> tuple[Any, list[str]]:
    """Open a page with elements and a script that runs once they have loaded; return what the script tells."""
    wrapper = folder / "frames.html"
    script = f"<script>{TELL} window.onload = () => {{ {script} }}</script>"
    wrapper.write_text(f'<meta charset="utf-8"><link rel="icon" href="data:,">{body}{script}', encoding="utf-8")
    dom, console = shown_by_browser(folder, wrapper, "--allow-file-access-from-files")
    found = re.search(r'<pre id="found">(.*?)</pre>', dom, re.DOTALL)
    assert found, f"the script told nothing: {console}"
    return json.loads(html.unescape(found[1])), console


def shown_by_browser(folder: Path, page: Path, *options: str, query: str = "") -> tuple[str, list[str]]:
    """A page from the disk once its scripts have run, without a network: its elements, and the browser's messages.

    The browser's profile goes into ``folder``.
    """
    assert CHROMIUM is not None
    command = (
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync",
        "--disable-component-update", "--no-first-run", "--enable-logging=stderr",
        "--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=10000", "--hide-scrollbars",
        "--window-size=1400,1000", "--dump-dom", f"--user-data-dir={folder / 'profile'}", *options,
        page.as_uri() + query,
    )  # fmt: skip
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300, env=environment)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]
