"""Photographs of one painting, each rectified to the frontal view and written as a stack."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto.align.card import Card, black_of, strength
from impasto.align.depth_picture import depth_picture
from impasto.align.depth_search import FoundDepth, find_depth
from impasto.align.detection import FoundMarks, find_marks
from impasto.align.features import Reference
from impasto.align.fixed_camera import common_marks, move_of
from impasto.align.frontal import frontal_view
from impasto.align.layout import Layout
from impasto.align.output import write_photograph, write_stack_lights
from impasto.align.photographs import LINEAR, lights_of, photographs_of
from impasto.align.picture import Overview, align_picture, overview, shown_photographs
from impasto.align.pose import camera_poses
from impasto.align.refinement import LARGEST, Shift, shift_between
from impasto.align.relighting import predictable, relit_shifts
from impasto.align.report import Aligned, AlignedPhotograph, report_of
from impasto.calibrate.tones import light_from
from impasto.depth_mesh import DepthMesh, Parallax
from impasto.errors import ArgumentError
from impasto.frontal_view import FrontalView
from impasto.io.depth_mesh import as_written, write_depth
from impasto.io.folders import new_folder
from impasto.io.images.write import write_json, write_png8
from impasto.io.lights import LightFile
from impasto.io.session.frames import FrameSource
from impasto.io.session.linear_codes import Photograph, read_photograph
from impasto.lens import Lens
from impasto.rectification import Grid, middle_of, rectified

Floats = NDArray[np.float64]
Progress = Callable[[int, int], None]

WINDOWS_BYTES = 1 << 26
"""Memory of the parts of all photographs that are compared with predictions, which makes six more
arrays of this size."""
SHARE = 1000
"""Parts of a step that progress is told in."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is kept of a photograph between its readings.

    Attributes
    ----------
    view
        How it shows the painting.
    size
        Columns and rows.
    outlines
        ``(4, 2)`` pixels of each marker.
    move
        Of a fixed camera, columns and rows against the other photographs; None for none.
    """

    view: FrontalView
    size: tuple[int, int]
    outlines: Mapping[str, Floats]
    move: tuple[float, float] | None


def align(
    folder: str | Path,
    out: str | Path,
    layout: Layout | Reference,
    *,
    lens: Lens | None = None,
    pixel_mm: float | None = None,
    depth: DepthMesh | bool = False,
    mesh_mm: float | None = None,
    refine: bool = False,
    fixed_camera: bool = False,
    lights: str | Path | None = None,
    card: Card | None = None,
    dark: FrameSource | None = None,
    encoding: str | None = None,
    saturation: float | None = None,
    progress: Progress | None = None,
) -> Aligned:
    """Rectify the photographs of a folder to the frontal view of the painting.

    Lens, perspective, depth and shift are one resampling. Photographs are read twice, and again for
    depth and shifts, one at a time: memory holds one of them and its result, and of the others
    their marks. The folder appears whole or not at all.

    Parameters
    ----------
    folder
        The photographs, with their light file if there is one.
    out
        The folder to write: a 16-bit linear TIFF per photograph (32-bit of floats), the lights, and
        ``report/`` with ``alignment.json``, ``alignment.png`` and, where a photograph does not show
        all of the painting, ``mask.png``; with depth also ``depth.csv`` and ``depth.png``.
    layout
        The marks (:func:`layout_from_markers`, :func:`read_points`), or the picture of another
        session (:class:`Reference`).
    lens
        From :func:`impasto.calibrate.read_lens`; default: no distortion.
    pixel_mm
        Width of a pixel of the result; default: that of the finest pixel of any photograph, or that
        of the reference.
    depth
        True: the heights of the relief are estimated from the parallax between views; a mesh
        (:func:`read_depth`): it is used as it is. Needs a lens. Default: the painting is flat.
    mesh_mm
        Largest distance between the nodes of the estimated mesh; default: 12 pixels, or what makes
        6000 nodes.
    refine
        Estimate and take out shifts between photographs. With 8 lamps or more, whose directions are
        known, each is compared with what photometric stereo predicts of it; otherwise with the
        reference picture, the photograph whose lamp stands most frontal, or the first.
    fixed_camera
        One view for all photographs, from the median of the marks over them; some marks may be
        missing in some photographs. A photograph that moved against the others is named in
        :attr:`Aligned.moved`.
    lights
        The light file; default: the only one in the folder.
    card
        A white card in all photographs, from which the strength of the lamp is measured in each; it
        replaces strengths of the light file. ``light_intensities.txt`` holds them.
    dark
        Dark frames or a black level in codes, as for :func:`impasto.read_stack`; subtracted from
        the light of the card. Aligned photographs keep their black level.
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
        Marks that determine no perspective, or contradict each other; views or a painting that tell
        no depth.
    CorruptInputError
        A damaged photograph.
    MissingExtraError
        Depth is to be estimated, and SciPy is not installed.
    """
    folder, out = Path(folder), Path(out)
    if out.exists():
        raise ArgumentError(f"out: {out} already exists; choose another name")
    if pixel_mm is not None:
        length_mm(pixel_mm, "pixel_mm")
    paths = photographs_of(folder)
    file = lights_of(folder, None if lights is None else Path(lights), [p.name for p in paths])

    if card is not None and file is None:
        raise ArgumentError("card: needs a light file, which says where the lamps are")
    if depth is not False and lens is None:
        raise ArgumentError("depth: needs the lens, without which no camera has a place")
    estimated = depth is True
    steps = 2 + refine + estimated

    def step_done(step: int, done: int, count: int) -> None:
        if progress is not None:
            progress(step * SHARE + round(SHARE * done / count), steps * SHARE)

    def read(number: int) -> Photograph:
        return read_photograph(paths[number], encoding, saturation)

    black = black_of(dark, paths[0], encoding)
    count = len(paths)
    seen = _views(paths, read, layout, lens, fixed_camera, lambda done: step_done(0, done, count))
    views = [one.view for one in seen]
    cameras = camera_poses(views)
    grid = _grid(layout, views, pixel_mm)
    found: FoundDepth | None = None
    mesh = None
    if isinstance(depth, DepthMesh):
        mesh = _fitting(depth, grid)
    elif estimated and cameras is not None:
        found = find_depth(
            read, views, cameras, grid, spacing_mm=mesh_mm,
            advance=lambda done, every: step_done(1, done, every),
        )  # fmt: skip
        mesh = as_written(found.mesh)
    parallaxes: list[Parallax | None] = [None] * count
    if mesh is not None and cameras is not None:
        parallaxes = [Parallax(mesh, one.place_mm) for one in cameras]
    shifts: list[Shift | None] = [None] * count
    if refine:
        shifts = _shifts(
            read, views, parallaxes, grid, layout, file,
            lambda done: step_done(steps - 2, done, count),
        )  # fmt: skip
    out.parent.mkdir(parents=True, exist_ok=True)
    covered = np.ones((grid.rows, grid.columns), dtype=bool)
    done: list[AlignedPhotograph] = []
    strengths: list[Floats] = []
    names = [f"{path.stem}.tif" for path in paths]
    shown = shown_photographs(views)
    overviews: dict[int, Overview] = {}
    with new_folder(out) as made:
        (made / "report").mkdir()
        for number, (path, one) in enumerate(zip(paths, seen, strict=True)):
            photograph = read(number)
            if card is not None and file is not None:
                near = file.positions is not None
                lamps = file.directions if file.positions is None else file.positions
                strengths.append(
                    strength(photograph, one.view, card, lamps[number], near, black, path.name)
                )
            share = write_photograph(
                made / names[number], photograph, one.view, grid, shifts[number],
                parallaxes[number], covered,
            )  # fmt: skip
            if number in shown:
                reduced = overview(light_from(photograph.planes, LINEAR))
                overviews[number] = Overview(path.name, reduced, one.size, one.outlines)
            camera = None if cameras is None else cameras[number]
            done.append(
                AlignedPhotograph(
                    path.name, names[number], one.view, camera, shifts[number], share, one.move
                )
            )
            step_done(steps - 1, number + 1, count)
        if not covered.all():
            write_png8(made / "report" / "mask.png", 255 * covered.astype(np.uint8))
        if mesh is not None:
            write_depth(made / "report" / "depth.csv", mesh)
            write_png8(made / "report" / "depth.png", depth_picture(mesh, found, cameras))
        if file is not None and strengths:
            file = replace(file, intensities=np.stack(strengths))
        written = write_stack_lights(made, file, names, cameras, grid)
        result = Aligned(grid, lens, tuple(done), float(covered.mean()), written, mesh, found)
        write_json(made / "report" / "alignment.json", report_of(result))
        write_png8(made / "report" / "alignment.png", align_picture(overviews, result))
    return result


def _fitting(mesh: DepthMesh, grid: Grid) -> DepthMesh:
    """Refuse a mesh of another painting."""
    apart = np.abs(np.subtract(mesh.size_mm, grid.size_mm)).max()
    if apart > 1e-3 * max(grid.size_mm):
        sizes = [f"{width:g} x {height:g} mm" for width, height in (mesh.size_mm, grid.size_mm)]
        raise ArgumentError(
            f"depth: the mesh is of a painting of {sizes[0]}, this one has {sizes[1]}"
        )
    return mesh


def _views(
    paths: list[Path],
    read: Callable[[int], Photograph],
    layout: Layout | Reference,
    lens: Lens | None,
    fixed_camera: bool,
    advance: Callable[[int], None],
) -> list[_Seen]:
    """The marks of every photograph, and the plane that they determine."""
    if fixed_camera and isinstance(layout, Reference):
        raise ArgumentError("fixed_camera: there are no marks to share with a reference picture")
    found: list[FoundMarks | FrontalView] = []
    sizes: list[tuple[int, int]] = []
    for number, path in enumerate(paths):
        light = light_from(read(number).planes, LINEAR)
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
        advance(number + 1)
    moves: list[tuple[float, float] | None] = [None] * len(paths)
    if isinstance(layout, Layout):
        marks = [one for one in found if isinstance(one, FoundMarks)]
        common = common_marks(marks, layout) if fixed_camera else None
        if common is not None:
            moves = [move_of(own, common) for own in marks]
        views = [
            _view_of(common or own, layout, lens, "all photographs" if common else path.name)
            for own, path in zip(marks, paths, strict=True)
        ]
        outlines = [own.outlines for own in marks]
    else:
        views = [one for one in found if isinstance(one, FrontalView)]
        outlines = [{} for _ in views]
    return [_Seen(*one) for one in zip(views, sizes, outlines, moves, strict=True)]


def _view_of(marks: FoundMarks, layout: Layout, lens: Lens | None, name: str) -> FrontalView:
    return frontal_view(
        layout.mm(marks.names), marks.pixels, marks.names, layout.size_mm, lens, name
    )


def _grid(layout: Layout | Reference, views: list[FrontalView], pixel_mm: float | None) -> Grid:
    size = layout.grid.size_mm if isinstance(layout, Reference) else layout.size_mm
    if pixel_mm is None:
        finest = min(view.pixel_mm() for view in views)
        # Three digits are written in reports, and read again.
        rounded = float(f"{finest:.3g}")
        pixel_mm = layout.grid.pixel_mm if isinstance(layout, Reference) else rounded
    return Grid(size, pixel_mm)


def _shifts(
    read: Callable[[int], Photograph],
    views: list[FrontalView],
    parallaxes: list[Parallax | None],
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
        side = int(min(LARGEST, np.sqrt(WINDOWS_BYTES / (4 * len(views)))))
    window = middle_of(grid, side)

    def light(number: int) -> NDArray[np.float32]:
        part = rectified(
            read(number).planes, views[number], window,
            parallax=parallaxes[number], interpolation="cubic",
        )  # fmt: skip
        return light_from(part.planes, LINEAR)

    if relit and file is not None:
        pictures = []
        for number in range(len(views)):
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
    for number in range(len(views)):
        found.append(None if number == chosen else shift_between(against, light(number)))
        advance(number + 1)
    return found
