"""Makes the pictures of the tutorials: the figures that their own code writes, on one sheet each.

    python benches/python/tutorials.py [rgb | six-band | lafortune ...] [--size 128]

Rehearses the session of each tutorial, runs the Python of its page there, and writes
docs/_static/tutorial-NAME.jpg. With --folder, sessions that lie there are taken as they are.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from impasto.io import write_jpeg
from impasto.pictures import Panel, Picture, contact_sheet

DOCS = Path(__file__).resolve().parents[2] / "docs"
LARGEST = 300_000
"""Bytes: what tests/test_docs.py allows a picture of a page."""

REHEARSALS: dict[str, list[str]] = {
    "rgb": ["tominaga-rgb-camera", "--out", "rehearsal"],
    "six-band": ["tominaga-six-band-adaptation", "--out", "rehearsal-six"],
    "lafortune": ["snel-lafortune", "--out", "rehearsal-snel", "--views", "72"],
}
PANELS: dict[str, list[tuple[str, str, str]]] = {
    "rgb": [
        ("figure-8", "Surface normals", "figure 8"),
        ("figure-11", "Specular component", "figure 11"),
        ("figure-9", "Areas", "figure 9"),
        ("figure-12", "Measured, under D65", "figure 12"),
        ("figure-13", "The painting, under D65", "figure 13"),
    ],
    "six-band": [
        ("figure-8-front", "Illuminant A", "figure 8"),
        ("figure-8-slanted", "Slanted", "figure 8"),
        ("figure-9-front", "Adapted by 0.56", "figure 9"),
        ("figure-9-slanted", "Slanted", "figure 9"),
    ],
    "lafortune": [
        ("figure-20-church", "In a church", "figure 20"),
        ("figure-20-outside", "Outside", ""),
        ("figure-20-kitchen", "In a kitchen", ""),
    ],
}
COLUMNS = {"rgb": 3, "six-band": 2, "lafortune": 3}
WIDTH = 400


def picture(path: Path) -> Picture:
    """8-bit RGB, enlarged to the width of a panel."""
    codes = cv2.imread(str(path))
    assert codes is not None
    scale = WIDTH / codes.shape[1]
    how = cv2.INTER_CUBIC if scale > 1.0 else cv2.INTER_AREA
    large = cv2.resize(codes, None, fx=scale, fy=scale, interpolation=how)
    return np.ascontiguousarray(large[..., ::-1])


def run_page(name: str) -> None:
    """Run the Python of a page here."""
    text = (DOCS / f"tutorial-{name}.md").read_text(encoding="utf-8")
    exec("\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL)), {})


def sheet(name: str, size: int) -> Picture:
    """The figures of a tutorial, from a session that lies here or is rehearsed here."""
    if not Path(REHEARSALS[name][2]).is_dir():
        words = [sys.executable, "-m", "impasto", "rehearse", *REHEARSALS[name], "--quiet"]
        subprocess.run([*words, "--size", str(size)], check=True)
    run_page(name)
    panels = [Panel(title, picture(Path(f"{one}.png")), note) for one, title, note in PANELS[name]]
    return contact_sheet(panels, columns=COLUMNS[name], width=WIDTH)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("names", nargs="*", default=list(REHEARSALS))
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--folder", type=Path, help="where sessions lie that were rehearsed before")
    options = parser.parse_args()
    for name in options.names:
        with tempfile.TemporaryDirectory() as folder:
            before = Path.cwd()
            os.chdir(folder if options.folder is None else options.folder)
            try:
                made = sheet(name, options.size)
            finally:
                os.chdir(before)
        path = DOCS / "_static" / f"tutorial-{name}.jpg"
        for quality in (90, 85, 80, 75, 70):
            write_jpeg(path, made, quality=quality)
            if path.stat().st_size < LARGEST:
                break
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
