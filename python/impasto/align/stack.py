"""Photographs of one painting, each rectified to the frontal view and written as a stack."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto.align.detection import FoundMarks, find_marks
from impasto.align.features import Reference
from impasto.align.frontal import FrontalView, frontal_view
from impasto.align.layout import Layout
from impasto.align.photographs import (
    LINEAR,
    Photograph,
    lights_of,
    photographs_of,
    read_photograph,
)
from impasto.align.picture import Overview, align_picture, overview
from impasto.align.pose import Pose, poses
from impasto.align.rectification import Grid, Rectified, middle_of, rectified, rectified_rows
from impasto.align.refinement import LARGEST, Shift, shift_between
from impasto.align.relighting import predictable, relit_shifts
from impasto.align.report import Aligned, AlignedPhotograph, report_of
from impasto.calibrate.lens import Lens
from impasto.calibrate.tones import light_from
from impasto.errors import ArgumentError
from impasto.io.folders import new_folder
from impasto.io.images.write import write_json, write_png8, write_tiff16, write_tiff32
from impasto.io.lights import LightFile
from impasto.io.lights.write import write_lights

Floats = NDArray[np.float64]
Progress = Callable[[int, int], None]

SAME_VIEW = np.radians(0.5)
"""Views that differ by less are one: the camera stood still."""
FRONTAL = np.radians(1.0)
"""A common view nearer to the front than this is frontal; a light file without views says so."""
WINDOWS_BYTES = 1 << 26
"""Memory of the parts of all photographs that are compared with predictions, which makes six more
arrays of this size."""
SHARE = 1000
"""Parts of a step that progress is told in."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is kept of a photograph between its two readings."""

    view: FrontalView
    overview: Overview


def align(
    folder: str | Path,
    out: str | Path,
    layout: Layout | Reference,
    *,
    lens: Lens | None = None,
    pixel_mm: float | None = None,
    refine: bool = False,
    fixed_camera: bool = False,
    lights: str | Path | None = None,
    encoding: str | None = None,
    saturation: float | None = None,
    progress: Progress | None = None,
) -> Aligned:
    """Rectify the photographs of a folder to the frontal view of the painting.

    Lens, perspective and shift are one resampling. Photographs are read two or three times, one at
    a time: memory holds one of them. The folder appears whole or not at all.

    Parameters
    ----------
    folder
        The photographs, with their light file if there is one.
    out
        The folder to write: a 16-bit linear TIFF per photograph (32-bit of floats), the lights, and
        ``report/`` with ``alignment.json``, ``alignment.png`` and, where a photograph does not show
        all of the painting, ``mask.png``.
    layout
        The marks (:func:`layout_from_markers`, :func:`read_points`), or the picture of another
        session (:class:`Reference`).
    lens
        From :func:`impasto.calibrate.read_lens`; default: no distortion.
    pixel_mm
        Width of a pixel of the result; default: that of the finest pixel of any photograph, or that
        of the reference.
    refine
        Estimate and take out shifts between photographs. With 8 lamps or more, whose directions are
        known, each is compared with what photometric stereo predicts of it; otherwise with the
        reference picture, the photograph whose lamp stands most frontal, or the first.
    fixed_camera
        One view for all photographs, from the median of the marks over them; some marks may be
        missing in some photographs.
    lights
        The light file; default: the only one in the folder.
    encoding
        As for :func:`impasto.read_stack`; default: 8-bit files by their profile, else sRGB.
    saturation
        The code from which samples are clipped; default: the largest.
    progress
        Called with parts done and all.

    Raises
    ------
    ArgumentError
        A photograph whose marks are missing or doubled, with the marks; a folder that exists.
    GeometryError
        Marks that determine no perspective, or contradict each other.
    CorruptInputError
        A damaged photograph.
    """
    folder, out = Path(folder), Path(out)
    if out.exists():
        raise ArgumentError(f"out: {out} already exists; choose another name")
    if pixel_mm is not None:
        length_mm(pixel_mm, "pixel_mm")
    paths = photographs_of(folder)
    file = lights_of(folder, None if lights is None else Path(lights), [p.name for p in paths])

    steps = 3 if refine else 2

    def step_done(step: int, done: int) -> None:
        if progress is not None:
            progress(step * SHARE + round(SHARE * done / len(paths)), steps * SHARE)

    def read(path: Path) -> Photograph:
        return read_photograph(path, encoding, saturation)

    seen = _views(paths, read, layout, lens, fixed_camera, lambda done: step_done(0, done))
    views = [one.view for one in seen]
    cameras = poses(views)
    grid = _grid(layout, views, pixel_mm)
    shifts: list[Shift | None] = [None] * len(paths)
    if refine:
        shifts = _shifts(paths, read, views, grid, layout, file, lambda done: step_done(1, done))
    out.parent.mkdir(parents=True, exist_ok=True)
    covered = np.ones((grid.rows, grid.columns), dtype=bool)
    done: list[AlignedPhotograph] = []
    names = [f"{path.stem}.tif" for path in paths]
    with new_folder(out) as made:
        (made / "report").mkdir()
        for number, (path, view) in enumerate(zip(paths, views, strict=True)):
            share = _write(made / names[number], read(path), view, grid, shifts[number], covered)
            camera = None if cameras is None else cameras[number]
            done.append(
                AlignedPhotograph(path.name, names[number], view, camera, shifts[number], share)
            )
            step_done(steps - 1, number + 1)
        if not covered.all():
            write_png8(made / "report" / "mask.png", 255 * covered.astype(np.uint8))
        written = _write_lights(made, file, names, cameras)
        result = Aligned(grid, lens, tuple(done), float(covered.mean()), written)
        write_json(made / "report" / "alignment.json", report_of(result))
        write_png8(
            made / "report" / "alignment.png", align_picture([one.overview for one in seen], result)
        )
    return result


def _views(
    paths: list[Path],
    read: Callable[[Path], Photograph],
    layout: Layout | Reference,
    lens: Lens | None,
    fixed_camera: bool,
    advance: Callable[[int], None],
) -> list[_Seen]:
    """The marks of every photograph, and the plane that they determine."""
    if fixed_camera and isinstance(layout, Reference):
        raise ArgumentError("fixed_camera: there are no marks to share with a reference picture")
    found: list[FoundMarks | FrontalView] = []
    pictures: list[NDArray[np.uint8]] = []
    sizes: list[tuple[int, int]] = []
    for number, path in enumerate(paths, 1):
        light = light_from(read(path).planes, LINEAR)
        size = light.shape[1], light.shape[0]
        if lens is not None and size != lens.size:
            raise ArgumentError(
                f"{path.name}: {size[0]} x {size[1]} pixels, but the lens was calibrated with "
                f"{lens.size[0]} x {lens.size[1]}; use photographs as the camera writes them"
            )
        if fixed_camera and sizes and size != sizes[0]:
            raise ArgumentError(
                f"{path.name}: {size[0]} x {size[1]} pixels, but {paths[0].name} has "
                f"{sizes[0][0]} x {sizes[0][1]}; a fixed camera takes photographs of one size"
            )
        sizes.append(size)
        if isinstance(layout, Reference):
            found.append(layout.view(light, lens, path.name))
        else:
            found.append(find_marks(light, layout, path.name, partial=fixed_camera))
        pictures.append(overview(light))
        advance(number)
    if isinstance(layout, Layout):
        marks = [one for one in found if isinstance(one, FoundMarks)]
        common = _common(marks, layout) if fixed_camera else None
        views = [
            _view_of(common or own, layout, lens, "all photographs" if common else path.name)
            for own, path in zip(marks, paths, strict=True)
        ]
        outlines = [own.outlines for own in marks]
    else:
        views = [one for one in found if isinstance(one, FrontalView)]
        outlines = [{} for _ in views]
    shown = [
        Overview(path.name, picture, size, quads)
        for path, picture, size, quads in zip(paths, pictures, sizes, outlines, strict=True)
    ]
    return [_Seen(*pair) for pair in zip(views, shown, strict=True)]


def _view_of(marks: FoundMarks, layout: Layout, lens: Lens | None, name: str) -> FrontalView:
    return frontal_view(
        layout.mm(marks.names), marks.pixels, marks.names, layout.size_mm, lens, name
    )


def _common(marks: list[FoundMarks], layout: Layout) -> FoundMarks:
    """Medians of the marks over all photographs."""
    places: dict[str, list[Floats]] = {}
    for one in marks:
        for name, pixel in zip(one.names, one.pixels, strict=True):
            places.setdefault(name, []).append(pixel)
    missing = [name for name in layout.places if name not in places] if not layout.points else []
    if missing:
        raise ArgumentError(f"markers: {', '.join(missing)} not found in any photograph")
    names = tuple(places)
    pixels = np.array([np.median(places[name], axis=0) for name in names])
    return FoundMarks(names, pixels.reshape(-1, 2), {})


def _grid(layout: Layout | Reference, views: list[FrontalView], pixel_mm: float | None) -> Grid:
    size = layout.grid.size_mm if isinstance(layout, Reference) else layout.size_mm
    if pixel_mm is None:
        finest = min(view.pixel_mm() for view in views)
        # Three digits are written in reports, and read again.
        rounded = float(f"{finest:.3g}")
        pixel_mm = layout.grid.pixel_mm if isinstance(layout, Reference) else rounded
    return Grid(size, pixel_mm)


def _shifts(
    paths: list[Path],
    read: Callable[[Path], Photograph],
    views: list[FrontalView],
    grid: Grid,
    layout: Layout | Reference,
    file: LightFile | None,
    advance: Callable[[int], None],
) -> list[Shift | None]:
    """Shifts between photographs; None for the one that others are compared with."""
    relit = file is not None and not isinstance(layout, Reference)
    relit = relit and file is not None and predictable(file.directions)
    side = LARGEST
    if relit:
        side = int(min(LARGEST, np.sqrt(WINDOWS_BYTES / (4 * len(paths)))))
    window = middle_of(grid, side)

    def light(number: int) -> NDArray[np.float32]:
        part = rectified(read(paths[number]).planes, views[number], window, interpolation="cubic")
        return light_from(part.planes, LINEAR)

    if relit and file is not None:
        pictures = []
        for number in range(len(paths)):
            pictures.append(light(number))
            advance(number + 1)
        return list(relit_shifts(pictures, file.directions))
    if isinstance(layout, Reference):
        if layout.grid != grid:
            raise ArgumentError(
                "refine: needs the pixels of the reference; leave out the pixel width"
            )
        top, left = (grid.rows - window.rows) // 2, (grid.columns - window.columns) // 2
        shown = layout.light[top : top + window.rows, left : left + window.columns]
        chosen, against = -1, np.ascontiguousarray(shown)
    else:
        # The lamp that casts the shortest shadows.
        chosen = 0 if file is None else int(file.directions[:, 2].argmax())
        against = light(chosen)
    found: list[Shift | None] = []
    for number in range(len(paths)):
        found.append(None if number == chosen else shift_between(against, light(number)))
        advance(number + 1)
    return found


def _write(
    path: Path,
    photograph: Photograph,
    view: FrontalView,
    grid: Grid,
    shift: Shift | None,
    covered: NDArray[np.bool_],
) -> float:
    """Write one aligned photograph; returns the share of the painting that it shows."""
    moved = (0.0, 0.0) if shift is None else (shift.x, shift.y)
    planes = np.empty((len(photograph.planes), grid.rows, grid.columns), photograph.planes.dtype)
    top, shown = 0, 0
    part: Rectified
    for part in rectified_rows(photograph.planes, view, grid, shift=moved, full=photograph.full):
        rows = slice(top, top + part.planes.shape[1])
        planes[:, rows] = part.planes
        covered[rows] &= part.seen
        shown += int(part.seen.sum())
        top = rows.stop
    attributes: dict[str, Any] = {"pixel_mm": grid.pixel_mm}
    write = write_tiff16 if planes.dtype == np.uint16 else write_tiff32
    write(path, planes, attributes=attributes)
    return shown / (grid.rows * grid.columns)


def _write_lights(
    folder: Path, file: LightFile | None, names: list[str], cameras: list[Pose] | None
) -> str:
    """Write the lights with the views that the lens shows; returns the name, empty for none."""
    if file is None:
        return ""
    own = replace(file, names=tuple(names))
    if own.views is None:
        own = replace(own, views=_eyes(cameras))
    name = "lights.lp" if own.views is None else "lights.csv"
    write_lights(folder / name, own)
    if file.intensities is not None:
        rows = np.atleast_2d(file.intensities.T).T.tolist()
        text = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
        (folder / "light_intensities.txt").write_text(text, encoding="utf-8")
    return name


def _eyes(cameras: list[Pose] | None) -> Floats | None:
    """``(n, 3)`` directions to the camera; None for one frontal camera, or without a lens."""
    if cameras is None:
        return None
    eyes = np.array([one.view for one in cameras])
    common = eyes.mean(axis=0) / np.linalg.norm(eyes.mean(axis=0))
    # The chord of a small angle is the angle.
    if np.linalg.norm(eyes - common, axis=1).max() < SAME_VIEW:
        if np.hypot(common[0], common[1]) < FRONTAL:
            return None
        return np.tile(common, (len(eyes), 1))
    return eyes
