"""``impasto height``: a map of the height from the normals of a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from impasto._internal.checks import length_mm
from impasto.cli.console import Stages
from impasto.cli.options import Flag, SomeWhole, check_threads
from impasto.cli.scenes import panel_of_heights
from impasto.errors import ArgumentError


def height(
    result: Annotated[Path, Parameter(name=["RESULT"])],
    /,
    *,
    out: Path,
    level: Annotated[bool, Parameter(negative="--no-level")] = True,
    pitch: float | None = None,
    threads: SomeWhole = None,
    quiet: Flag = False,
) -> None:
    """Integrate the normals of a fitted painting to a map of its height.

    Heights are in mm, towards the viewer, about their mean, if the width of a pixel is known, and
    in pixels otherwise. A .zarr of more than 16 million pixels is integrated tile by tile.

    Parameters
    ----------
    result
        The --out folder of impasto fit or demo, an sbrdf.npz, or the .zarr of impasto job run.
    out
        A .tif of 32-bit numbers.
    level
        Heights about the plane of the panel; --no-level keeps its lean. A round object has no
        plane.
    pitch
        Width of a pixel in mm, if the result does not contain it.
    threads
        Default: every core.
    quiet
        No progress, only errors.
    """
    import numpy as np

    import impasto
    from impasto.cli.scale import shown
    from impasto.io.images.bands_of_rows import TIFF_TILE, write_tiff_rows

    stages = Stages(quiet=quiet)
    check_threads(threads)
    if out.suffix.lower() not in {".tif", ".tiff"}:
        raise ArgumentError(
            f"--out: expected a name ending in .tif, found {out.name}; impasto export height "
            "writes .exr, .stl and .ply"
        )
    if pitch is not None:
        length_mm(pitch, "pitch_mm")
    part = shown(result, None, None, 1)
    plane = panel_of_heights(stages, part.panel, wanted=level)
    with stages.stage("height") as stage:
        out.parent.mkdir(parents=True, exist_ok=True)
        if part.in_parts:
            part.surface.height(
                out, pitch_mm=pitch, level=plane, threads=threads, progress=stage.advance
            )
        else:
            known = part.surface.pitch_mm if pitch is None else pitch
            heights = impasto.integrate_normals(
                part.surface.normal,
                known or 1.0,
                level=plane,
                threads=threads,
                progress=stage.advance,
            )
            rows = (
                heights[None, top : top + TIFF_TILE] for top in range(0, len(heights), TIFF_TILE)
            )
            write_tiff_rows(out, rows, heights.shape, planes=1, dtype=np.float32)
        in_mm = pitch is not None or part.surface.known_pitch_mm is not None
        unit = "in mm" if in_mm else "in pixels: --pitch says how wide one is"
        stage.note = f"{out}, {unit}"
