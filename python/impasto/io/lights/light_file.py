"""The contents of a light file, and the checks common to all formats."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import CorruptInputError
from impasto.io.notes import Note, Notebook, few
from impasto.lights import DistantLight, Light, PointLight

SHORTEST = 1e-4
"""Shorter vectors have no direction (the limit of the relight reader)."""


@dataclass(frozen=True, eq=False)
class LightFile:
    """The lights of one file.

    Parameters
    ----------
    path
        The file.
    format
        ``"lp"``, ``"text"``, ``"csv"``, ``"dome"``, ``"relight"`` or ``"alicevision"``.
    names
        The image each light belongs to, exactly as written; None where the file names none.
    directions
        ``(n, 3)`` unit vectors from the surface to the light (x right, y up, z to the camera).
    lengths
        ``(n,)`` lengths of the vectors as they stood in the file.
    positions
        ``(n, 3)`` in mm where the file knows them (point lights), else None.
    intensities
        ``(n,)`` or ``(n, band)`` where the file knows them, else None.
    views
        ``(n, 3)`` unit vectors from the surface to the eye where the file knows them, else None:
        one frontal view.
    view_positions
        ``(n, 3)`` places of the cameras in mm where the file knows them, else None: far away.
    pitch_mm, width_mm
        Width of a pixel / of the image on the painting, where the file knows it.
    notes
        Every repair and everything odd.
    """

    path: Path
    format: str
    names: tuple[str, ...] | None
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    positions: NDArray[np.float64] | None = None
    intensities: NDArray[np.float64] | None = None
    views: NDArray[np.float64] | None = None
    view_positions: NDArray[np.float64] | None = None
    pitch_mm: float | None = None
    width_mm: float | None = None
    notes: tuple[Note, ...] = ()

    def __len__(self) -> int:
        return len(self.directions)

    @property
    def lights(self) -> tuple[Light, ...]:
        """One :class:`PointLight` or :class:`DistantLight` for each entry."""
        if self.positions is not None:
            return tuple(PointLight((x, y, z)) for x, y, z in self.positions.tolist())
        return tuple(DistantLight((x, y, z)) for x, y, z in self.directions.tolist())


def number(token: str) -> float | None:
    """A finite decimal number, or None."""
    try:
        value = float(token)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def comma_numbers(tokens: list[str]) -> list[float] | None:
    """Numbers written with decimal commas, only if every token parses so."""
    if any("." in token for token in tokens) or not any("," in token for token in tokens):
        return None
    values = [number(token.replace(",", ".")) for token in tokens]
    return None if None in values else [v for v in values if v is not None]


def finish(
    path: Path,
    format_: str,
    vectors: NDArray[np.float64],
    labels: list[str],
    notebook: Notebook,
    *,
    names: tuple[str, ...] | None,
    **extra: Any,
) -> LightFile:
    """Normalise the vectors, note anything unusual, and build the result.

    ``labels`` say where each vector came from (``"line 7 (a.jpg)"``).
    """
    if len(vectors) == 0:
        raise CorruptInputError(path, "holds no lights: one line per photograph is expected")
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(vectors, axis=1)
    for label, vector, length in zip(labels, vectors.tolist(), lengths.tolist(), strict=True):
        if length < SHORTEST:
            raise CorruptInputError(
                path, f"{label}: the light direction {tuple(vector)} has no length"
            )
        if not np.isfinite(length):
            raise CorruptInputError(
                path, f"{label}: the light direction {tuple(vector)} is too long for a number"
            )
    off = np.abs(lengths - 1.0)
    if extra.get("positions") is None and bool((off > 0.01).any()):
        count = int((off > 0.01).sum())
        worst = int(off.argmax())
        hint = (
            "; numbers that long look like positions, not directions: check the file"
            if lengths.min() > 2.0
            else ""
        )
        notebook.repair(
            "length",
            path,
            f"{count} of {len(vectors)} light directions are not unit vectors (lengths "
            f"{lengths.min():.3f} to {lengths.max():.3f}, worst {labels[worst]}): "
            f"normalised{hint}",
        )
    below = [labels[i] for i in np.flatnonzero(vectors[:, 2] < 0.0)]
    if below:
        notebook.warn(
            "horizon",
            path,
            f"{len(below)} light(s) lie below the painting's plane (z < 0): {few(below)}; kept",
        )
    if names is not None:
        folded = [name.replace("\\", "/").casefold() for name in names]
        spelled = dict(zip(folded, names, strict=True))
        twice = sorted(spelled[name] for name, count in Counter(folded).items() if count > 1)
        if twice:
            notebook.warn("duplicate", path, f"lists these more than once: {few(twice)}; kept")
    return LightFile(
        path,
        format_,
        names,
        vectors / lengths[:, None],
        lengths,
        notes=tuple(notebook.notes),
        **extra,
    )
