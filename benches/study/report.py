"""A study as files: a JSON with everything, a page of sentences and tables, figures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from impasto.io.files import atomic_bytes
from study.sentences import paragraphs
from study.tables import markdown, tables

TITLES = {
    "which": "Which fit for which rig and surface",
    "summary": "In the mean of the data sets with one view",
    "presets": "What each preset costs and gives",
    "halving": "The best fit in half the time: by how much its errors are larger (dB: more is "
    "better), and what it flags",
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
    "unbeaten": "Peers that no fit of ours beats in both time and error of relighting",
}

HEADS = {
    "choice": "Which effort?",
    "promises": "What presets promise",
    "enough": "How many lights?",
    "photographs": "Fewer lights, chosen in three ways",
    "bound": "How near to what no fit can beat",
    "views": "Can hundreds of views be cut to a few?",
    "doubt": "Weighing samples by what is left of them",
    "steps": "Steps of a search",
    "starts": "Normals to start from",
    "searches": "Lobes to start from",
    "precision": "Single or double precision",
    "excess": "How near a search comes to the least cost",
    "lobes": "What a further lobe is worth",
    "classes": "Only what a pixel calls for",
    "bits": "Coarser numbers",
    "reflectance": "Reflectance",
    "peers": "Which peers are beaten",
    "memory": "Memory",
    "size": "Large pictures",
    "wall": "CPU seconds and the clock",
    "again": "A second run",
}
"""Headings of the sentences."""
COLUMNS = """\
*CPU s*, *wall s*: seconds per megapixel of one photograph; *MB*: memory for it beyond the
photographs. *relative %*: root mean square error of held-out photographs in linear light, as a
share of their root mean square; *dB*: peak signal-to-noise ratio of held-out photographs on 8-bit
sRGB codes; *dE00*: their mean colour difference (CIEDE2000). *normal deg*: mean angle to the true
normal. *flagged %*: pixels whose status is not fitted. More decibels are better, less of all
else."""
LINK = re.compile(r"\[([^\]]+)\]\(#[^)]*\)")
"""A link within the page of the documentation."""


def write(found: dict[str, Any], out: str | Path, *, figures: bool = True) -> list[Path]:
    """Write ``study.json``, ``study.md`` and the figures (SVG and PNG).

    Parameters
    ----------
    found
        What :func:`study.run` returned.
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
    whole, page = out / "study.json", out / "study.md"
    made, said = tables(found["rows"]), paragraphs(found["rows"])
    text = json.dumps(found | made | {"sentences": said}, indent=1, allow_nan=False) + "\n"
    atomic_bytes(whole, text.encode("utf-8"))
    atomic_bytes(page, page_of(found).encode("utf-8"))
    written = [whole, page]
    if figures:
        from study.figures import draw

        written += draw(found, out)
    return written


def page_of(found: dict[str, Any]) -> str:
    """``study.md``: every sentence and every table of a study."""
    made, said = tables(found["rows"]), paragraphs(found["rows"])
    parts = [f"## {HEADS[name]}\n\n{_unlinked(said[name])}\n" for name in said]
    parts += [f"## {TITLES[name]}\n\n{markdown(table)}\n" for name, table in made.items()]
    return "\n".join(["# What accuracy costs in time\n", *_where(found), f"{COLUMNS}\n", *parts])


def _unlinked(text: str) -> str:
    """A sentence without links to other places of the documentation's page."""
    return LINK.sub(r"\1", text)


def _where(found: dict[str, Any]) -> list[str]:
    """Machine, commit, and what was not measured."""
    info = found["run"]
    commit = f" (commit {info['commit']})" if info["commit"] else ""
    kind = "quick study, on small pictures" if info["quick"] else "full study"
    lines = [
        f"impasto {info['impasto']}{commit} on {info['processor']} ({info['simd']}, "
        f"{info['cores']} cores); {kind}, seed {info['seed']}.\n"
    ]
    absent = [f"* Without {name}: {why}." for name, why in found["missing"].items()]
    absent += [f"* Not measured: {reason}." for reason in found["skipped"]]
    absent += [f"* **Failed**: {reason}." for reason in found["failed"]]
    return [*lines, *(["\n".join(absent) + "\n"] if absent else [])]
