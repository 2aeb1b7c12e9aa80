"""Tables of docs/accuracy.md that join records: errors by rig and surface, and both papers' rigs.

Nothing is computed here but the choice of rows and columns: every number is one of a record in
benches/results.
"""

from __future__ import annotations

import json
from typing import Any

from record import RESULTS

SIX, RGB = "tominaga-six-band-adaptation", "tominaga-rgb-camera"
PIXEL = '`pooling="pixel"`'
PAINTING = '`pooling="painting"`'
CASES = (
    ("9 lights, RGB", RGB, "one varnish", "satin varnish, as photographed"),
    ("9 lights, RGB", RGB, "several varnishes", "patches of all three"),
    ("16 lights, six bands", SIX, "one varnish", "satin varnish, as photographed"),
    ("16 lights, six bands", SIX, "no varnish", "no varnish"),
    ("16 lights, six bands", SIX, "a lobe with long tails", "a lobe with long tails (GGX)"),
    ("16 lights, six bands", SIX, "several varnishes", "patches of all three"),
)
"""Rows of benches/results/accuracy.json: rig, its key, surface, case."""
LEFT_OUT = ("matte varnish", "gloss varnish", "two coats of satin", "cracks")
"""Cases that only the record has, for brevity."""


def tables() -> dict[str, list[dict[str, Any]]]:
    """Tables by name."""
    return {"which": _which(), "papers": _papers(), "normals": _normals(), "lamps": _lamps()}


def _record(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_text("utf-8"))


def _one(rows: list[dict[str, Any]], **wanted: str) -> dict[str, Any]:
    (row,) = [row for row in rows if all(row[key] == value for key, value in wanted.items())]
    return row


def _which() -> list[dict[str, Any]]:
    """Which errors to expect, by rig and surface."""
    accuracy, relighting = _record("accuracy"), _record("relighting")["rows"]
    lines = []
    for rig, key, surface, case in CASES:
        row = _one(accuracy[key], case=case)
        lines.append(_line(rig, surface, PAINTING, row["normal deg"], row["dE00 D65"], None))
    patches = _one(_record("pooling")["rows"], subject="simulated", fit="own lobes")
    angle = patches["normal deg, mean"]
    lines.append(
        _line("48 lights, RGB", "several varnishes, cracks, shadows", PIXEL, angle, None,
              patches["mean dB"])
    )  # fmt: skip
    materials = _one(_record("lobes")["materials"], method="fit_sbrdf, pixel")
    angle = materials["mean deg"]
    lines.append(_line("48 lights", "a hundred measured materials", PIXEL, angle, None, None))
    for ask, name in (
        (PIXEL, "impasto, own lobes per pixel"),
        ("nothing: the default", "impasto, the default call"),
    ):
        decibels = _one(relighting, method=name)["mean dB"]
        lines.append(_line("72 photographs", "gilded icon", ask, None, None, decibels))
    return lines


def _line(
    rig: str, surface: str, ask: str, angle: float | None, colour: float | None, dB: float | None
) -> dict[str, Any]:
    return {
        "rig": rig, "surface": surface, "ask for": ask, "normal deg": angle, "dE00": colour,
        "dB": dB,
    }  # fmt: skip


def _papers() -> list[dict[str, Any]]:
    """The same paintings under both papers' rigs, side by side."""
    accuracy = _record("accuracy")
    lines = []
    for first in accuracy[SIX]:
        if first["case"] in LEFT_OUT:
            continue
        second = _one(accuracy[RGB], case=first["case"])
        line = {"case": first["case"]}
        for rig, row in (("16", first), ("9", second)):
            line |= {f"{name}, {rig}": row[name] for name in row if name != "case"}
        lines.append(line)
    return lines


def _normals() -> list[dict[str, Any]]:
    """Mean errors of normals by method, on every rig and surface that they were measured on."""
    accuracy, lobes = _record("accuracy")["methods"], _record("lobes")
    found: dict[str, dict[str, Any]] = {}
    for row in (*accuracy, *lobes["normals"], *lobes["materials"]):
        found.setdefault(row["method"], {"method": row["method"]})
    for row in accuracy:
        found[row["method"]] |= row
    for what in ("normals", "materials"):
        for row in lobes[what]:
            found[row["method"]] |= {f"{what}, {name}": row[name] for name in row}
    names = list(dict.fromkeys(name for line in found.values() for name in line))
    return [{name: line.get(name) for name in names} for line in found.values()]


def _lamps() -> list[dict[str, Any]]:
    """One lobe per painting, two lobes per pixel and interpolation, by strengths of lamps."""
    methods = ("one lobe per painting", "up to two lobes per pixel", "RBF, thin plate")
    rows = _record("lamps")["rows"]
    return [row for row in rows if row["method"].removeprefix("impasto, ") in methods]
