"""Which channels of an OpenEXR file are the bands of a photograph, and in which order."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from impasto.errors import ArgumentError, CorruptInputError

_ALPHA = frozenset({"A", "AR", "AG", "AB"})


def pick_channels(path: Path, names: list[str], layer: str | None) -> list[str]:
    """The channels of one layer in band order: R, G, B first, then by number in the name."""
    layers: dict[str, list[str]] = {}
    for name in names:
        prefix, _, last = name.rpartition(".")
        # "T.380,000000nm" of spectral files: the layer is T and the rest a wavelength.
        if last not in _ALPHA:
            layers.setdefault(prefix, []).append(name)
    if not layers:
        raise CorruptInputError(path, "holds no channel but alpha")
    if layer is None:
        plain = set(layers.get("", ()))
        if {"R", "G", "B"} <= plain:
            return ["R", "G", "B"]
        if "Y" in plain:
            return ["Y"]
        if len(layers) > 1:
            raise ArgumentError(
                f"{path}: holds the layers {sorted(name or '(unnamed)' for name in layers)}; "
                "choose one with layer="
            )
        layer = next(iter(layers))
    if layer not in layers:
        raise ArgumentError(f"{path}: has no layer {layer!r}, only {sorted(layers)}")
    return sorted(layers[layer], key=_band_order)


def _band_order(name: str) -> tuple[Any, ...]:
    last = name.rpartition(".")[2]
    fixed = {"R": 0, "G": 1, "B": 2, "X": 0, "Y": 1, "Z": 2}.get(last.upper())
    if fixed is not None:
        return (0, fixed, name)
    digits = re.sub(r"(\d),(\d)", r"\1.\2", name)
    return (1, *[float(n) for n in re.findall(r"\d+(?:\.\d+)?", digits)], name)
