"""Makes the picture of docs/edit.md: the page with marks and with mirror balls, in Chromium.

    python benches/python/edit_page.py

Simulated photographs, the page of `impasto edit` in light and in dark colours, side by side in
docs/_static/edit.jpg.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import cv2
import numpy as np

from impasto.editing import BallOutlines, EditServer, Marks, Subject
from impasto.io import write_jpeg

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from chromium import Chromium  # noqa: E402

SIZE = (1120, 720)
MARKERS = "aruco:4x4_50:8.192mm"
"""Those of a rehearsed painting of 256 pixels of 0.2 mm."""
SIDE_MM = 51.2


def shown(subject: Subject, browser: Chromium, folder: Path) -> np.ndarray:
    """The page with a subject, ``(y, x, 3)``."""
    server = EditServer(subject)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        browser.open(server.url)
        # All that a picture needs was drawn once the loupe was, one frame later.
        browser.until("performance.getEntriesByType('resource').some(r => r.name.includes('pict'))")
        browser.value("new Promise((done) => setTimeout(done, 1000))")
        browser.screenshot(folder / "page.png")
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    picture = cv2.imread(str(folder / "page.png"))
    assert picture is not None
    return np.ascontiguousarray(picture[..., ::-1])


def main() -> None:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        words = ["rehearse", "--out", str(folder / "rehearsal"), "--photographs", "--quiet"]
        subprocess.run([sys.executable, "-m", "impasto", *words], check=True)
        photographs = folder / "rehearsal" / "painting" / "photographs"
        marks = Marks(folder / "points.json", photographs, (SIDE_MM, SIDE_MM), MARKERS)
        with Chromium(folder / "light", size=SIZE) as browser:
            light = shown(marks, browser, folder)
        with Chromium(folder / "dark", dark=True, size=SIZE) as browser:
            dark = shown(BallOutlines(photographs), browser, folder)
    path = ROOT / "docs" / "_static" / "edit.jpg"
    write_jpeg(path, np.concatenate([light, dark], axis=1), quality=82)
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
