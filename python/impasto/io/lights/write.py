"""Write light files: ``.lp``, ``.csv`` where every photograph has its own view, ``.dome``."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError
from impasto.io.files import atomic_bytes
from impasto.io.lights.light_file import LightFile
from impasto.io.lights.tables import CAMERA_COLUMNS, COLUMNS, LAMP_COLUMNS, VIEW_COLUMNS
from impasto.io.notes import LOG
from impasto.rig import FRONTAL, Rig

RELIGHT_LIMIT = 1000
"""More lights than this are refused by relight, the most common reader of ``.lp`` files."""

Directions = NDArray[np.float64]


def write_lights(
    path: str | Path,
    lights: Rig | LightFile | ArrayLike,
    names: Sequence[str] | None = None,
) -> None:
    """Write a light file that reads back to the same directions, bit for bit.

    Parameters
    ----------
    path
        The file to write (replaced atomically). Any ending but ``.csv``: the ``.lp`` format, which
        has lights only. ``.csv``: a table with a header, whose columns are the photograph, the
        direction to the light, and the direction to the eye; of a :class:`LightFile` that knows the
        places of cameras or lamps and the width of a pixel, also their distances and this, in mm.
        ``.dome``: positions of near lamps in mm, in the format of relight, which has no names:
        photographs follow in its order.
    lights
        ``(n, 3)`` directions, a :class:`~impasto.Rig` or a :class:`LightFile`. Of near lamps and
        cameras, the directions from the middle of the painting.
    names
        The file name of each photograph; default: those of the :class:`LightFile`.

    Raises
    ------
    ArgumentError
        Names are missing, do not match the lights in number, or contain a line break; views that
        an ``.lp`` file cannot hold; a ``.dome`` without positions and ``width_mm``.
    """
    if Path(path).suffix.lower() == ".dome":
        atomic_bytes(path, _dome(path, lights).encode("utf-8"))
        return
    table = Path(path).suffix.lower() == ".csv"
    if isinstance(lights, LightFile):
        names = lights.names if names is None else names
    directions, views = _directions(lights)
    if directions.ndim != 2 or directions.shape[1:] != (3,) or not np.isfinite(directions).all():
        raise ArgumentError(f"lights: expected finite (n, 3), found shape {directions.shape}")
    if names is None or len(names) != len(directions):
        found = "none" if names is None else str(len(names))
        raise ArgumentError(f"names: expected {len(directions)} file names, found {found}")
    for name in names:
        if not name.strip() or name != name.strip() or "\n" in name or "\r" in name:
            raise ArgumentError(f"names: {name!r} is not possible in a light file")
    if not table and views is not None and (views != FRONTAL).any():
        raise ArgumentError(
            f"path: {path} is an .lp file, which has no views; give a name that ends in .csv"
        )
    if table:
        views = np.broadcast_to(FRONTAL, directions.shape) if views is None else views
        near, columns = _near(lights)
        text = _csv(names, np.hstack([directions, views, *near]), columns)
    else:
        if len(names) > RELIGHT_LIMIT:
            message = "%s: %d lights; relight reads at most %d"
            LOG.warning(message, path, len(names), RELIGHT_LIMIT)
        text = _lp(names, directions)
    atomic_bytes(path, text.encode("utf-8"))


def _dome(path: str | Path, lights: Any) -> str:
    positions = lights.positions if isinstance(lights, LightFile) else None
    if positions is None or not isinstance(lights, LightFile) or lights.width_mm is None:
        raise ArgumentError(
            f"lights: {path} holds positions in mm and the width of the photograph in mm: give a "
            "LightFile with positions= and width_mm=, or a name that ends in .lp for directions"
        )
    content = {
        "lightConfiguration": "lights3d",
        "lightCount": len(positions),
        "imageWidth": lights.width_mm,
        "positions3d": positions.tolist(),
    }
    return json.dumps(content, indent=2) + "\n"


def _directions(lights: Any) -> tuple[Directions, Directions | None]:
    """Of the lights and, where known, of the views."""
    if isinstance(lights, Rig | LightFile):
        return lights.directions, lights.views
    return np.asarray(lights, dtype=np.float64), None


def _lp(names: Sequence[str], directions: Directions) -> str:
    rows = zip(names, directions.tolist(), strict=True)
    lines = [str(len(names)), *(f"{name} {x!r} {y!r} {z!r}" for name, (x, y, z) in rows)]
    return "\n".join(lines) + "\n"


def _near(lights: Any) -> tuple[list[Directions], tuple[str, ...]]:
    """Distances of cameras and lamps and the width of a pixel, in mm, and their columns.

    Nothing where not known; the camera is at 0 where only the lamps are near.
    """
    if not isinstance(lights, LightFile):
        return [], ()
    cameras, lamps = lights.view_positions, lights.positions
    if cameras is None and lamps is None:
        return [], ()
    if lights.pitch_mm is None:
        raise ArgumentError(
            "lights: places of cameras and lamps need the width of a pixel, pitch_mm="
        )
    count = len(lights)
    far = np.zeros(count) if cameras is None else np.linalg.norm(cameras, axis=1)
    columns = [far, np.full(count, lights.pitch_mm)]
    if lamps is None:
        return [np.column_stack(columns)], CAMERA_COLUMNS
    columns.append(np.linalg.norm(lamps, axis=1))
    return [np.column_stack(columns)], (*CAMERA_COLUMNS, *LAMP_COLUMNS)


def _csv(names: Sequence[str], numbers: Directions, more: tuple[str, ...]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["photograph", *COLUMNS, *VIEW_COLUMNS, *more])
    for name, row in zip(names, numbers.tolist(), strict=True):
        writer.writerow([name, *map(repr, row)])
    return text.getvalue()
