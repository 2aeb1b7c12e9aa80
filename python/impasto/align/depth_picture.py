"""A picture of a depth mesh: black is low and white is high, as in figure 11 of the third paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impasto.align.depth_search import FoundDepth
from impasto.align.pose import Pose
from impasto.depth_mesh import DepthMesh
from impasto.pictures import Panel, Picture, Series, contact_sheet, diagram_panel, ramp_panel
from impasto.pictures.diagrams import AMBER, GREEN, GROUND

Floats = NDArray[np.float64]

_SIZE = 560
_STRIP, _GAP = 16, 8


def depth_picture(
    mesh: DepthMesh, found: FoundDepth | None, cameras: Sequence[Pose] | None
) -> Picture:
    """``(y, x, 3)``: heights, their standard deviations, and disparities before and after.

    Parameters
    ----------
    mesh
        The heights.
    found
        How they were found; None for a mesh that was read.
    cameras
        Of all photographs.
    """
    panels = [_heights(mesh)]
    if np.isfinite(mesh.sigma_mm).any():
        whole = _enlarged(mesh, mesh.sigma_mm)
        panels.append(ramp_panel(whole, "Standard deviation of a node", unit="mm"))
    subtitle = f"{mesh.depth_mm.shape[1]} x {mesh.depth_mm.shape[0]} nodes"
    if found is not None and cameras is not None:
        panels.append(_disparities(found, cameras))
        before, after = found.left_px
        subtitle += f"; along epipolar lines {before:.2f} pixels before, {after:.3f} after"
    return contact_sheet(panels, title="Depth", subtitle=subtitle, width=_SIZE, columns=len(panels))


def _heights(mesh: DepthMesh) -> Panel:
    width, height = mesh.size_mm
    scale = _SIZE / max(width, height)
    columns, rows = max(2, round(width * scale)), max(2, round(height * scale))
    depth = mesh.on_grid(
        ((np.arange(columns) + 0.5) / columns - 0.5) * width,
        (0.5 - (np.arange(rows) + 0.5) / rows) * height,
    )
    low, high = float(depth.min()), float(depth.max())
    codes = np.rint(255.0 * (depth - low) / max(high - low, 1e-9)).astype(np.uint8)
    ramp = np.broadcast_to(np.linspace(0.0, 255.0, columns).astype(np.uint8), (_STRIP, columns))
    picture = np.full((rows + _GAP + _STRIP, columns, 3), GROUND, dtype=np.uint8)
    picture[:rows] = codes[..., None]
    picture[rows + _GAP :] = ramp[..., None]
    return Panel(
        "Height above the plane of the marks", picture, axis=(f"{low:.2f} mm", f"{high:.2f} mm")
    )


def _enlarged(mesh: DepthMesh, values: Floats) -> Floats:
    """Values of nodes as squares about them: no spline would make them smoother than they are."""
    times = max(1, _SIZE // max(mesh.depth_mm.shape))
    return np.asarray(values.repeat(times, axis=0).repeat(times, axis=1))


def _disparities(found: FoundDepth, cameras: Sequence[Pose]) -> Panel:
    tilt = np.degrees([cameras[number].tilt for number in found.photographs])
    highest = float(np.nanmax([found.before_px, found.after_px]))
    series = [
        Series(name, np.stack([tilt, values], axis=1), colour, dots=True)
        for name, values, colour in (
            ("before", found.before_px, AMBER), ("after", found.after_px, GREEN),
        )
    ]  # fmt: skip
    return diagram_panel(
        series, "Disparity of each photograph, pixels", x=(0.0, 90.0),
        y=(0.0, max(1.1 * highest, 1e-3)), axis=("tilt 0°", "90°"), size=(_SIZE * 3 // 4, _SIZE),
    )  # fmt: skip
