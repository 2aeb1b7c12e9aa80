"""axe-core, which finds what keeps people from using a page, in the browser of the tests."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

import chromium


def source() -> str:
    """Its script, where ``NODE_PATH`` has the npm package; without it the test is skipped."""
    for folder in os.environ.get("NODE_PATH", "").split(os.pathsep):
        path = Path(folder) / "axe-core" / "axe.min.js"
        if folder and path.is_file():
            return path.read_text(encoding="utf-8")
    if os.environ.get("IMPASTO_EXPECT_AXE") == "1":
        pytest.fail("axe-core is not in NODE_PATH")
    pytest.skip("axe-core is not in NODE_PATH (npm install axe-core)")


def violations(browser: chromium.Chromium, script: str) -> list[tuple[str, str, list[Any]]]:
    """Rule, what it demands, and the elements that break it, of all that the page shows.

    The rules of WCAG 2.2 at levels A and AA, and those that axe-core calls best practices.
    """
    browser.value(f"window.axe ? 0 : (() => {{ {script}; return 0; }})()")
    found: list[tuple[str, str, list[Any]]] = browser.value(
        "axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa',"
        " 'best-practice'] }).then(({ violations, passes }) => {"
        " if (passes.length < 15) throw new Error(`only ${passes.length} rules apply`);"
        " return violations.map(one => [one.id, one.help, one.nodes.map(node => node.html)]); })"
    )
    return found
