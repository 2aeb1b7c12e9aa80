"""Lights inside the JSON of other programs: relight's dome and project files, AliceVision."""

from __future__ import annotations

import sys
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import CorruptInputError
from impasto.io.lights.light_file import LightFile, finish
from impasto.io.notes import Notebook


def parse_dome(
    content: dict[str, Any],
    path: Path,
    notebook: Notebook,
    *,
    format_: str = "dome",
    names: tuple[str, ...] | None = None,
    **extra: Any,
) -> LightFile:
    """The lights of relight's ``.dome``: directions, directions on a sphere, or positions in mm."""
    configuration = str(content.get("lightConfiguration", "")).lower()
    width = _length(content, "imageWidth", path)
    diameter = _length(content, "domeDiameter" if "domeDiameter" in content else "diameter", path)
    offset = content.get("verticalOffset") or 0.0
    if not (isinstance(offset, int | float) and _fits(offset)):
        found = short(offset)
        raise CorruptInputError(path, f"verticalOffset: expected a number in mm, found {found}")
    positions = _vectors(content, ("positions3d", "positions"), path)
    directions = _vectors(content, ("directions", "positionsSphere"), path)
    if configuration == "lights3d" and positions is None:
        raise CorruptInputError(path, "lightConfiguration is lights3d but positions3d is empty")
    use_positions = positions is not None and configuration in {"", "lights3d"}
    if not use_positions and configuration == "spherical" and directions is not None and diameter:
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        positions = directions / np.maximum(lengths, 1e-12) * diameter / 2 + (0, 0, float(offset))
        use_positions = True
    vectors = positions if use_positions else directions
    if vectors is None:
        raise CorruptInputError(
            path, "holds no lights: expected directions, positionsSphere or positions3d"
        )
    if use_positions and width is None and extra.get("pitch_mm") is None:
        notebook.repair(
            "position",
            path,
            "light positions without imageWidth (mm): read as distant lights, so fall-off "
            "and change of direction over the painting are not known",
        )
        use_positions = False
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        # A position of length 0 stays as it is; the error names it.
        vectors = vectors / np.where(lengths > 0, lengths, 1.0)
    adjust = content.get("ledAdjust")
    if isinstance(adjust, list) and len(adjust) == len(vectors):
        extra["intensities"] = _adjustments(adjust, path)
    return finish(
        path,
        format_,
        vectors,
        [f"light {i + 1}" for i in range(len(vectors))],
        notebook,
        names=names,
        positions=vectors if use_positions else None,
        width_mm=width,
        **extra,
    )


def _adjustments(adjust: list[Any], path: Path) -> NDArray[np.float64]:
    """``ledAdjust``: red, green and blue strength of each light, 1 if missing."""
    try:
        rows = [[float(led.get(c, 1.0)) for c in ("r", "g", "b")] for led in adjust]
    except (AttributeError, TypeError, ValueError) as error:
        raise CorruptInputError(path, "ledAdjust: expected {r, g, b} for each light") from error
    return np.array(rows)


def parse_relight(content: dict[str, Any], path: Path, notebook: Notebook) -> LightFile:
    """The lights of the images of a ``.relight`` project that are not skipped."""
    folder = str(content.get("folder") or "").strip("/")
    images = [i for i in content["images"] if isinstance(i, dict) and not i.get("skip")]
    skipped = len(content["images"]) - len(images)
    if skipped:
        notebook.say("skip", path, f"{skipped} image(s) are marked as skipped and left out")
    prefix = f"{folder}/" if folder not in {"", "."} else ""
    names = tuple(prefix + str(image.get("filename", "")) for image in images)
    pitch = _length(content, "pixelSize", path)
    rows = [image.get("direction") for image in images]
    if all(row is not None for row in rows) and rows:
        vectors = _vectors({"images": rows}, ("images",), path)
        if vectors is not None and bool((np.linalg.norm(vectors, axis=1) > 0).all()):
            labels = [f"image {i + 1} ({name})" for i, name in enumerate(names)]
            return finish(path, "relight", vectors, labels, notebook, names=names, pitch_mm=pitch)
    dome = content.get("dome")
    if not isinstance(dome, dict):
        raise CorruptInputError(path, "the images have no light directions and there is no dome")
    file = parse_dome(dome, path, notebook, format_="relight", names=names, pitch_mm=pitch)
    if len(file) != len(names):
        raise CorruptInputError(
            path, f"the dome has {len(file)} lights for {len(names)} images that are not skipped"
        )
    return file


def parse_alicevision(content: dict[str, Any], path: Path, notebook: Notebook) -> LightFile:
    """AliceVision: ``{"lights": {stem: {"intensity": [3], "direction": [3]}}}``."""
    entries = sorted(content["lights"].items())
    try:
        directions = [entry["direction"] for _, entry in entries]
        intensities = [entry.get("intensity", [1.0, 1.0, 1.0]) for _, entry in entries]
    except (KeyError, TypeError, AttributeError) as error:
        raise CorruptInputError(path, "every light needs a direction of three numbers") from error
    vectors = _vectors({"lights": directions}, ("lights",), path)
    if vectors is None:
        raise CorruptInputError(path, "holds no lights")
    strengths = _vectors({"lights": intensities}, ("lights",), path)
    if bool((vectors[:, 2] < 0).all()):
        notebook.repair(
            "frame",
            path,
            "every light lies below the horizon: AliceVision's camera frame (y down, z away) "
            "was converted to x right, y up, z towards the camera",
        )
        vectors = vectors * (1.0, -1.0, -1.0)
    return finish(
        path,
        "alicevision",
        vectors,
        [f"light {name!r}" for name, _ in entries],
        notebook,
        names=tuple(name for name, _ in entries),
        intensities=strengths,
    )


def _vectors(
    content: dict[str, Any], keys: tuple[str, ...], path: Path
) -> NDArray[np.float64] | None:
    """The first non-empty list among ``keys`` as ``(n, 3)``: [x, y, z] or {x, y, z} each."""
    for key in keys:
        rows = content.get(key)
        if not isinstance(rows, list) or not rows:
            continue
        try:
            listed = [
                [row["x"], row["y"], row["z"]] if isinstance(row, dict) else list(row)
                for row in rows
            ]
            array = np.array(listed, dtype=np.float64)
        except (KeyError, TypeError, ValueError) as error:
            raise CorruptInputError(path, f"{key}: expected three numbers per light") from error
        if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
            raise CorruptInputError(path, f"{key}: expected three finite numbers per light")
        return array
    return None


def _length(content: dict[str, Any], key: str, path: Path) -> float | None:
    """A length in mm; None where it is not said, as by 0 or a text."""
    value = content.get(key)
    if not (isinstance(value, int | float) and value > 0):
        return None
    if not _fits(value):
        raise CorruptInputError(path, f"{key}: expected a length in mm, found {short(value)}")
    return float(value)


def _fits(value: float) -> bool:
    """Whether a number is finite, also as a float: whole numbers of JSON have any size."""
    return abs(value) <= sys.float_info.max
