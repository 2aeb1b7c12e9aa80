"""Photographs in; maps, one picture of them all and a report out."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from impasto import pictures
from impasto.cli import console
from impasto.report import report, status_counts, write_report

if TYPE_CHECKING:
    from impasto.fit.sbrdf import Sbrdf
    from impasto.stack import Stack

RESULT = "surface.npz"


def measure(
    source: Path,
    out: Path,
    *,
    stages: console.Stages,
    reading: dict[str, Any],
    fitting: dict[str, Any],
    command: str = "fit",
) -> dict[str, Any]:
    """Read a stack, fit it, write everything into ``out``; returns the report."""
    import impasto

    given = {name: value for name, value in reading.items() if value is not None}
    with stages.stage("photographs", source.name) as stage:
        stack = impasto.read_stack(source, **given)
        stage.note = _stack_words(stack)
    stages.notes(stack.notes)
    with stages.stage("surface", fitting["model"]) as stage:
        sbrdf = impasto.fit_sbrdf(stack, progress=stage.advance, **fitting)
        stage.note = _surface_words(sbrdf)
    out.mkdir(parents=True, exist_ok=True)
    with stages.stage("maps", str(out)):
        write_maps(out, sbrdf, stack)
    with stages.stage("overview", "overview.png"):
        write_overview(out / "overview.png", sbrdf, stack, title=source.stem)
    content = report(
        command,
        inputs=input_files(source, stack, reading),
        options=reading | fitting,
        results=results(sbrdf, stack),
        timings=stages.timings,
    )
    write_report(out / "report.json", content)
    return content


def write_maps(folder: Path, sbrdf: Sbrdf, stack: Stack) -> None:
    """Every map as 32-bit OpenEXR, normals and diffuse colour also as 16-bit PNG or TIFF."""
    from impasto.io import write_exr, write_png8, write_png16, write_tiff16

    sbrdf.save(folder / RESULT)
    x, y, z = sbrdf.normal
    write_exr(folder / "normal.exr", {"R": x, "G": y, "B": z})
    write_png16(folder / "normal.png", (sbrdf.normal + 1.0) / 2.0)
    diffuse = sbrdf.diffuse
    names = ("R", "G", "B") if len(diffuse) == 3 else stack.bands
    write_exr(folder / "diffuse.exr", dict(zip(names, diffuse, strict=True)))
    write_tiff16(folder / "diffuse.tif", diffuse, attributes={"bands": list(stack.bands)})
    normals = sbrdf.normals
    write_exr(
        folder / "trust.exr",
        {"residual": sbrdf.residual, "sigma": normals.sigma, "used": normals.used},
    )
    write_png8(folder / "status.png", sbrdf.status)


def write_overview(path: Path, sbrdf: Sbrdf, stack: Stack, *, title: str) -> None:
    """One picture of all maps, side by side."""
    from impasto.io import write_png8

    sheet = pictures.contact_sheet(
        panels(sbrdf, stack), title=title, subtitle=_subtitle(sbrdf, stack)
    )
    write_png8(path, sheet)


def panels(sbrdf: Sbrdf, stack: Stack) -> list[pictures.Panel]:
    """The maps in the order in which they are estimated."""
    frontal = int(np.argmax(stack.rig.directions[:, 2]))
    photograph = np.nan_to_num(stack.linear(frontal), posinf=1.0)
    white = _white(photograph)
    normals = sbrdf.normals
    return [
        pictures.colour_panel(
            photograph, "Photograph", note=f"light {_angles(stack, frontal)}", white=white
        ),
        pictures.normal_panel(sbrdf.normal),
        pictures.colour_panel(
            sbrdf.diffuse,
            "Diffuse colour",
            note="no gloss, no shading",
            white=_white(sbrdf.diffuse),
        ),
        pictures.ramp_panel(
            specular(sbrdf, stack), "Specular part", unit="strongest, white board = 1"
        ),
        pictures.ramp_panel(sbrdf.residual, "Residual", unit="white board = 1", low=0.0),
        pictures.ramp_panel(
            normals.sigma, "Error of the normal", unit="1 sigma, degrees", low=0.0, scale=180 / math.pi
        ),
        pictures.ramp_panel(
            normals.used.astype(np.float32), "Photographs used", low=0.0, high=len(stack.rig)
        ),
        pictures.status_panel(sbrdf.status),
    ]


def specular(sbrdf: Sbrdf, stack: Stack) -> NDArray[np.float32]:
    """The strongest excess over the diffuse part in any photograph ``(y, x)``, mean of the bands."""
    strongest = np.full(sbrdf.status.shape, np.nan, dtype=np.float32)
    directions = stack.rig.directions.astype(np.float32)
    for index, direction in enumerate(directions):
        shading = np.maximum(np.einsum("cyx,c->yx", sbrdf.normal, direction), 0.0)
        measured = np.minimum(stack.linear(index), 1.0) / stack.rig.intensities[index]
        strongest = np.fmax(strongest, np.mean(measured - sbrdf.diffuse * shading, axis=0))
    return np.maximum(strongest, 0.0)
