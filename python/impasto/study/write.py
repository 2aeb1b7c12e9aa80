"""A study as files: everything in one JSON, the tables as a page, the figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from impasto.io.files import atomic_bytes
from impasto.study.tables import markdown, tables
from impasto.study.words import words

TITLES = {
    "summary": "In the mean of the data sets with one view",
    "presets": "What each preset costs and gives",
    "halving": "The best fit in half the time, and what it is off by",
    "derived": "The presets that these numbers call for",
    "checks": "What presets promise, and whether it is so",
    "classes": "Pixels by the lobes that they get",
    "excess": "Cost above the least where searches end, as a share of it",
    "front": "Fits that no other beats in both time and error",
    "effort": "Rounds, steps and starts",
    "precision": "What searches compute in",
    "pixels": "Pixels that the painting's lobe is looked for among",
    "robust": "Doubting photographs and samples",
    "stereo": "Steps of reweighting in photometric stereo",
    "starts": "Normals that pixels' own lobes start from",
    "lobes": "Lobes",
    "lights": "Lights",
    "bits": "Numbers that the samples are stored in",
    "normals": "Photometric stereo alone",
    "views": "Photographs of 770 views",
    "reflectance": "Reflectance of measured pigments",
    "peer": "Peers",
    "unbeaten": "Peers that show photographs, and no fit of ours beats in both time and error",
}


def write(found: dict[str, Any], out: str | Path, *, figures: bool = True) -> list[Path]:
    """Write ``study.json``, ``study.md`` and the figures (SVG and PNG).

    Parameters
    ----------
    found
        What :func:`impasto.study.run` returned.
    out
        A folder that is there.
    figures
        Whether to draw; needs matplotlib.

    Returns
    -------
    list
        Paths of what was written.
    """
    out = Path(out)
    made = tables(found["rows"])
    whole = out / "study.json"
    said = words(found["rows"])
    text = json.dumps(found | made | {"words": said}, indent=1, allow_nan=False) + "\n"
    atomic_bytes(whole, text.encode("utf-8"))
    page = out / "study.md"
    parts = [f"{paragraph}\n" for paragraph in said.values()]
    parts += [f"## {TITLES[name]}\n\n{markdown(table)}\n" for name, table in made.items()]
    text = "\n".join(["# What accuracy costs in time\n", *parts])
    atomic_bytes(page, text.encode("utf-8"))
    written = [whole, page]
    if figures:
        from impasto.study.figures import draw

        written += draw(found, out)
    return written
