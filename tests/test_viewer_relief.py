"""The relief in the page, seen from the side, where tiles meet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import chromium
from impasto.surface import Surface
from impasto.viewer import write_site

SEAM = 256
"""Column where the second tile begins."""


@pytest.mark.parametrize("towards", [0, 90, 215])
def test_tiles_of_a_relief_have_no_gap_between_them(
    browser: chromium.Chromium, tmp_path: Path, towards: int
) -> None:
    """Grids of two tiles end at pixels of their own, which stand at other heights.

    Brush marks of half a pixel: each side of the seam is moved by up to 0.4 pixels of the painting,
    3 of the canvas, so a gap would be seen. The ground shows through nowhere inside the painting.
    """
    random = np.random.default_rng(4)
    shape = (40, 300)
    height = random.uniform(-0.25, 0.25, shape).astype(np.float32)
    normal = np.zeros((3, *shape), np.float32)
    normal[2] = 1.0
    diffuse = np.full((3, *shape), 0.5, np.float32)
    write_site(Surface(normal, diffuse, height=height), tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    browser.value(
        "(() => { const { viewer } = window.impasto;"
        f" viewer.set({{ ...viewer.first, tilt: 55, towards: {towards},"
        f" view: [{SEAM}, 20, 8] }}); }})()"
    )
    browser.until("document.documentElement.dataset.ready")
    through, seen = browser.value(
        "(() => { const { viewer } = window.impasto, { gl, canvas } = viewer.renderer;"
        " viewer.draw(0); const { width, height } = canvas;"
        " const data = new Uint8Array(4 * width * height); let through = 0, seen = 0;"
        " gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);"
        " for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {"
        "   const [column, row] = viewer.place([x + 0.5, y + 0.5]);"
        f"   if (Math.abs(column - {SEAM}) > 8 || row < 3 || row > 37) continue;"
        "   seen++; through += data[4 * ((height - 1 - y) * width + x) + 3] === 0; }"
        " return [through, seen]; })()"
    )
    assert seen > 5000
    assert through == 0
