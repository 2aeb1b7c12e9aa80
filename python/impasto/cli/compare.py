"""``impasto compare``: what changed between two states of a painting."""

from __future__ import annotations

import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter
from rich.markup import escape

from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.options import Flag, Whole
from impasto.comparison.registration import Align, Exposure
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from impasto.comparison import Comparison

STORE, SINGLE = "comparison.impasto.zarr", "comparison.npz"
PICTURE = "comparison.png"


def compare(
    before: Annotated[Path, Parameter(name=["BEFORE"])],
    after: Annotated[Path, Parameter(name=["AFTER"])],
    /,
    *,
    out: Path | None = None,
    align: Align = "found",
    exposure: Exposure = "measured",
    illuminant: str = "D65",
    camera: Annotated[tuple[str, ...], Parameter(negative="", show_default=False)] = (),
    alpha: float = 0.001,
    exposure_sigma: float = 0.01,
    cells: Whole = 8,
    regions: Annotated[Path | None, Parameter(metavar="PICTURE")] = None,
    height: Flag = False,
    force: Flag = False,
    json: Flag = False,
    quiet: Flag = False,
) -> int:
    """Show what changed between two states of a painting, as before and after cleaning.

    BEFORE and AFTER are results of impasto fit or impasto job run (.npz, .zarr or their folders),
    or folders of photographs, which are fitted with default options. AFTER is registered on BEFORE.
    Prints how much normals, colours and gloss differ, how much of that is significant, and where.

    Parameters
    ----------
    out
        A folder for comparison.png, the maps (comparison.npz, or a .zarr where BEFORE is one) and
        report.json.
    align
        found: AFTER may be shifted, cropped, scaled or rotated; same: its pixels are those of
        BEFORE.
    exposure
        measured: colours as the white boards have them; matched: one gain per band takes off what
        most of the painting has in common.
    illuminant
        Light of the colour differences: D65, A, 3000K ...; without --camera D65.
    camera
        File of the camera, or srgb, for colours from spectra; given twice: before and after.
        Default: the spectra of both results, if both have them.
    alpha
        Probability that a quantity of an unchanged pixel is marked.
    exposure_sigma
        Relative standard deviation of the exposure between the two sessions.
    cells
        Cells of the grid along the longer side, for the table of areas.
    regions
        A picture as large as BEFORE in which every region has its own grey or colour: the table
        is by region; black belongs to none.
    height
        Compare heights, too, in memory.
    force
        Write into a folder that has other files.
    json
        Print the report as JSON for programs.
    quiet
        No progress, only errors.
    """
    import impasto
    from impasto.cli.folder import result_folder

    stages = Stages(quiet=quiet)
    with ExitStack() as held:
        # Refused before photographs are fitted, which may take long.
        folder = None
        if out is not None:
            folder = held.enter_context(result_folder(out, inputs=(before, after), force=force))
        with stages.stage("read") as stage:
            paintings = [_painting(path, stages) for path in (before, after)]
            spectra = tuple(map(_spectra, (before, after)))
            options: dict[str, Any] = {
                "align": align,
                "exposure": exposure,
                "illuminant": illuminant,
                "camera": _cameras(camera),
                "reflectance": None if camera or None in spectra else spectra,
                "alpha": alpha,
                "exposure_sigma": exposure_sigma,
                "cells": cells,
                "regions": None if regions is None else _regions(regions),
                "height": height,
            }
            stage.note = f"{before} and {after}"
        target = None
        if folder is not None and not height and _is_store(before):
            target = folder / STORE
        with stages.stage("compare", "registering") as stage:
            found = impasto.compare(
                paintings[0], paintings[1], target, progress=stage.advance, **options
            )
            stage.note = f"{found.shape[1]} x {found.shape[0]} pixels"
        if folder is not None:
            with stages.stage("write", str(out)):
                if target is None:
                    found.save(folder / SINGLE)
                _write(found, folder, [before, after], options, stages)
    if json:
        console.print_json(found.to_dict())
    else:
        console.stdout().out(str(found))
    if out is not None:
        stages.advise(f"Look at {shlex.quote(str(out / PICTURE))}")
    return Exit.OK


def _write(
    found: Comparison, folder: Path, inputs: list[Path], options: dict[str, Any], stages: Stages
) -> None:
    """The picture and the report."""
    from impasto.cli.folder import REPORT
    from impasto.io import write_png8
    from impasto.report import report, write_report

    write_png8(folder / PICTURE, np.moveaxis(found.picture(), -1, 0))
    left = ("regions", "reflectance")
    recorded = {name: value for name, value in options.items() if name not in left}
    recorded["camera"] = [None if one is None else list(one.bands) for one in recorded["camera"]]
    content = report(
        "compare",
        inputs=[path for path in inputs if path.is_file()],
        options=recorded | {"before": inputs[0], "after": inputs[1]},
        results=found.to_dict(),
        timings=stages.timings,
        folder=folder,
    )
    write_report(folder / REPORT, content)


def _is_store(path: Path) -> bool:
    """Whether a result is that of a job, not photographs."""
    from impasto.io.results import result_file

    return result_file(path).suffix.lower() == ".zarr"


def _painting(path: Path, stages: Stages) -> Any:
    """The path of a result, or photographs, fitted."""
    import impasto
    from impasto.io.results import STORES, result_file

    target = result_file(path)
    if target.suffix.lower() == ".zarr" or (target.suffix.lower() in STORES and target.is_file()):
        return path
    if path.is_dir() or path.suffix.lower() in {".lp", ".toml"}:
        if path.is_dir() and not any(path.iterdir()):
            raise ArgumentError(f"{path} is empty: expected a result or photographs")
        stages.say(
            f"  {'':14}[dim]{escape(str(path))}: photographs, fitted with default options[/]"
        )
        try:
            stack = impasto.read_stack(path)
        except ArgumentError as error:
            # Its advice is in options that this command does not have.
            raise ArgumentError(
                f"{path}: cannot be read without more words ({error}); fit it by impasto fit, "
                "which takes them, and compare the results"
            ) from error
        return impasto.fit_sbrdf(stack)
    what = "does not exist" if not path.exists() else "is no result and no folder of photographs"
    raise ArgumentError(
        f"{path} {what}: expected the --out folder of impasto fit, its .npz, the .zarr of impasto "
        "job run, or a folder of photographs"
    )


def _spectra(path: Path) -> Any:
    """The spectra of a result folder; None: it has none."""
    import impasto
    from impasto.cli.maps import SPECTRA

    file = path / SPECTRA
    return impasto.Reflectance.load(file) if file.is_file() else None


def _cameras(names: tuple[str, ...]) -> tuple[Any, Any]:
    from impasto.cli.fit import camera_of

    if len(names) > 2:
        raise ArgumentError(f"camera: expected one file, or two, found {len(names)}")
    found = [camera_of(name, None) for name in names]
    if not found:
        return None, None
    return found[0], found[-1]


def _regions(path: Path) -> NDArray[np.int64]:
    from impasto.io import read_labels

    return read_labels(path)
