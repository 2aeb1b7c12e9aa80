"""What an alignment did, in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from impasto.align.depth_search import FoundDepth
from impasto.align.pose import Pose
from impasto.align.refinement import Shift
from impasto.depth_mesh import DepthMesh
from impasto.frontal_view import FrontalView
from impasto.lens import Lens
from impasto.rectification import Grid


@dataclass(frozen=True, eq=False)
class AlignedPhotograph:
    """One photograph of an aligned stack.

    Attributes
    ----------
    source, name
        Its file before and after.
    view
        The plane of the painting in it.
    pose
        Where its camera stood; None without a lens.
    shift
        What refinement found; None without refinement, and for the reference.
    covered
        Share of the painting that it shows.
    move_px
        Columns and rows by which it lies elsewhere than the other photographs of a fixed camera;
        None for none that counts, and where each photograph has a view of its own.
    """

    source: str
    name: str
    view: FrontalView
    pose: Pose | None
    shift: Shift | None
    covered: float
    move_px: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Aligned:
    """An aligned stack.

    Attributes
    ----------
    grid
        Its pixels.
    lens
        The lens that was given.
    photographs
        In their order.
    covered
        Share of the painting that all photographs show.
    lights
        Name of the light file; empty for none.
    depth
        The relief; None for a flat painting.
    parallax
        How it was found; None if it was given.
    """

    grid: Grid
    lens: Lens | None
    photographs: tuple[AlignedPhotograph, ...]
    covered: float
    lights: str
    depth: DepthMesh | None = None
    parallax: FoundDepth | None = None

    @property
    def residual_px(self) -> float | None:
        """Root mean square of the marks' residuals; None where 4 marks leave none."""
        known = [rms for one in self.photographs if (rms := one.view.rms) is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None

    @property
    def largest_shift_px(self) -> float | None:
        """Of those that were applied; None without refinement."""
        shifts = [one.shift for one in self.photographs if one.shift is not None]
        return max((float(np.hypot(one.x, one.y)) for one in shifts), default=None)

    @property
    def moved(self) -> dict[str, float]:
        """Photographs that a fixed camera took from elsewhere, and how many pixels they moved."""
        return {
            one.source: float(np.hypot(*one.move_px))
            for one in self.photographs
            if one.move_px is not None
        }

    @property
    def refused(self) -> dict[str, str]:
        """Photographs whose shift was not applied, and why."""
        return {
            one.source: one.shift.refused
            for one in self.photographs
            if one.shift is not None and one.shift.refused
        }


def report_of(result: Aligned) -> dict[str, Any]:
    """As JSON: what each step left, in pixels."""
    lens = result.lens
    return {
        "kind": "impasto alignment",
        "version": 1,
        "size_mm": list(result.grid.size_mm),
        "pixel_mm": result.grid.pixel_mm,
        "size_px": [result.grid.columns, result.grid.rows],
        "encoding": "linear",
        "lights": result.lights or None,
        "covered": result.covered,
        "lens": None if lens is None else {"model": lens.model, "residual_px": lens.residual_px},
        "marks_residual_px": result.residual_px,
        "depth": None if result.depth is None else _depth(result.depth, result.parallax),
        "photographs": [_photograph(one) for one in result.photographs],
    }


def _depth(mesh: DepthMesh, found: FoundDepth | None) -> dict[str, Any]:
    rows, columns = mesh.depth_mm.shape
    content: dict[str, Any] = {
        "file": "depth.csv",
        "nodes": [columns, rows],
        "lowest_mm": float(mesh.depth_mm.min()),
        "highest_mm": float(mesh.depth_mm.max()),
        "sigma_mm": None,
        "estimated": found is not None,
    }
    if found is not None:
        before, after = found.left_px
        content["sigma_mm"] = float(np.sqrt(np.square(mesh.sigma_mm).mean()))
        content["pixel_mm"] = found.pixel_mm
        content["along_px_before"], content["along_px_after"] = before, after
        content["compared_with"] = found.reference
        content["photographs"] = [
            {
                "number": number,
                "before_px": _known(before),
                "after_px": _known(after),
                "across_px": _known(across),
            }
            for number, before, after, across in zip(
                found.photographs, found.before_px.tolist(), found.after_px.tolist(),
                found.across_px.tolist(), strict=True,
            )
        ]  # fmt: skip
    return content


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _photograph(one: AlignedPhotograph) -> dict[str, Any]:
    view, shift = one.view, one.shift
    off = np.linalg.norm(view.residual, axis=1)
    worst = int(off.argmax())
    pose = one.pose
    content: dict[str, Any] = {
        "source": one.source,
        "file": one.name,
        "marks": len(view.names),
        "marks_residual_px": view.rms,
        "worst_mark": None if view.rms is None else view.names[worst],
        "worst_mark_px": None if view.rms is None else float(off[worst]),
        "pixel_mm": view.pixel_mm(),
        "homography": view.matrix.tolist(),
        "camera_mm": None if pose is None else pose.place_mm.tolist(),
        "camera_sigma_mm": None if pose is None else pose.place_sigma_mm.tolist(),
        "camera_rotation": None if pose is None else pose.rotation.tolist(),
        "tilt_degrees": None if pose is None else float(np.degrees(pose.tilt)),
        "view_sigma_degrees": None if pose is None else float(np.degrees(pose.view_sigma)),
        "covered": one.covered,
        "move_px": None if one.move_px is None else list(one.move_px),
        "shift_px": None,
    }
    if shift is not None:
        content["shift_px"] = [shift.x, shift.y]
        content["shift_correlation"] = shift.score
        content["shift_by_phase_px"] = [shift.phase_x, shift.phase_y]
        content["shift_refused"] = shift.refused or None
    return content
