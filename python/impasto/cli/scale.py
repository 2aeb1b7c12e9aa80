"""Which part of a result a command shows, and at what scale."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from cyclopts import CycloptsError

from impasto.cli.maps import load_result
from impasto.errors import ArgumentError
from impasto.io.results import result_file

if TYPE_CHECKING:
    from impasto.fit.stored import StoredSbrdf
    from impasto.image import Image

WHOLE = 2**24
"""Most pixels of a store that are loaded at once: some 2 GB of maps."""
FINER = 2
"""An overview is rendered with at least so many times its columns, where that can be loaded."""
Region: TypeAlias = tuple[int, int, int, int]


@dataclass(frozen=True)
class Shown:
    """What is to be rendered.

    Attributes
    ----------
    surface
        What :func:`impasto.render` takes; a :class:`impasto.StoredSbrdf` where it is too large.
    reflectance
        Its spectra, if there are any.
    reduce
        How many pixels of it, along a side, are one of the picture.
    factor
        How many pixels of the painting, along a side, are one of ``surface``.
    window
        The detail of ``surface`` that is meant, where that is a :class:`impasto.StoredSbrdf`.
    panel
        What knows the normals of the whole painting.
    detail
        Whether it is a part of the painting.
    columns
        How many the picture has in the end, seen from the front; None: as many as it is rendered
        with.
    """

    surface: Any
    reflectance: Any
    reduce: int = 1
    factor: int = 1
    window: tuple[slice, slice] | None = None
    panel: Any = None
    detail: bool = False
    columns: int | None = None

    def resampled(self, image: Image) -> Image:
        """The picture with its columns: as a mean of light over areas."""
        if self.columns is None:
            return image
        return image.resampled(self.columns / (self.surface.shape[1] // self.reduce))

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the picture, seen from the front."""
        rows, columns = (one // self.reduce for one in self.surface.shape)
        if self.columns is None:
            return rows, columns
        return max(1, round(self.columns / columns * rows)), self.columns

    @property
    def in_parts(self) -> bool:
        """Whether it is rendered part by part."""
        return self.window is not None


def shown(result: Path, region: Region | None, width: int | None, reduce: int) -> Shown:
    """What is shown of a result: of a store, as little as possible is loaded.

    Raises
    ------
    ArgumentError
        There is no result, or the region is not within the painting.
    """
    if sum((region is not None, width is not None, reduce != 1)) > 1:
        raise CycloptsError(
            msg="--region is a detail, --width and --reduce are smaller scales: give one of them"
        )
    if width is not None and width < 1:
        raise ArgumentError(f"--width: expected a number of pixels from 1 on, found {width}")
    path = result_file(result)
    if path.suffix.lower() == ".zarr" and path.is_dir():
        return _of_store(path, region, width, reduce)
    sbrdf, reflectance = load_result(result)
    if region is not None:
        rows, columns = _window(region, sbrdf.shape)
        if reflectance is not None:
            reflectance = reflectance[rows, columns]
        part = sbrdf[rows, columns]
        return Shown(part, reflectance, panel=sbrdf, detail=True)
    if width is not None and width < sbrdf.shape[1]:
        reduce = _times(sbrdf.shape[1], width)
        return Shown(sbrdf, reflectance, reduce, panel=sbrdf, columns=width)
    return Shown(sbrdf, reflectance, reduce, panel=sbrdf)


def scale_of(result: Path, width: int) -> Shown:
    """The scale of a store that has exactly so many columns, in memory.

    Raises
    ------
    ArgumentError
        No such scale, or one that is too large to be loaded.
    """
    import impasto

    path = result_file(result)
    if not (path.suffix.lower() == ".zarr" and path.is_dir()):
        raise ArgumentError(
            f"--width: {result} has no smaller scale, as the .zarr of impasto job run has; give "
            "--region for a detail"
        )
    stored = impasto.open_sbrdf(path)
    sizes = {1: stored.shape} | {factor: stored.level_shape(factor) for factor in stored.factors}
    for factor, (rows, columns) in sizes.items():
        if columns == width and rows * columns <= WHOLE:
            level = impasto.load_sbrdf(path) if factor == 1 else stored.level(factor)
            return Shown(level, None, factor=factor, panel=level)
    widths = ", ".join(str(across) for down, across in sizes.values() if down * across <= WHOLE)
    raise ArgumentError(
        f"--width: expected the columns of a scale that {result} holds and that can be loaded "
        f"({widths or 'none'}), found {width}"
    )


def loaded(result: Path, width: int | None) -> Shown:
    """The whole painting in memory, at a scale for so many columns.

    Raises
    ------
    ArgumentError
        A store that is too large for that.
    """
    part = shown(result, None, width, 1)
    if part.in_parts:
        rows, columns = part.surface.shape
        raise ArgumentError(
            f"--width: {result} is too large to be loaded ({columns} x {rows} pixels); give the "
            "columns of a smaller picture, such as --width 1920"
        )
    return part


def _of_store(path: Path, region: Region | None, width: int | None, reduce: int) -> Shown:
    import impasto

    stored = impasto.open_sbrdf(path)
    rows, columns = stored.shape
    if width is not None and width < columns:
        factor = _factor(stored, width)
        if factor == 1 and rows * columns > WHOLE:
            raise ArgumentError(
                f"--width: {path} is too large to be loaded ({columns} x {rows} pixels) and holds "
                "no smaller scale, as those that impasto job run makes do; give --region for a "
                "detail"
            )
        level = stored.level(factor) if factor > 1 else impasto.load_sbrdf(path)
        across = level.shape[1]
        return Shown(
            level, None, _times(across, width), factor, panel=level, columns=min(width, across)
        )
    window = slice(0, rows), slice(0, columns)
    if region is not None:
        window = _window(region, stored.shape)
    pixels = (window[0].stop - window[0].start) * (window[1].stop - window[1].start)
    if pixels <= WHOLE:
        part = impasto.load_sbrdf(path) if region is None else stored[window]
        whole = stored if region is not None else part
        return Shown(part, None, reduce, panel=whole, detail=region is not None)
    if reduce != 1:
        factors = ", ".join(map(str, stored.factors)) or "no smaller scale"
        raise ArgumentError(
            f"--reduce: {path} is too large to be loaded ({columns} x {rows} pixels); give --width "
            f"for one of the scales that it holds (1/{factors})"
        )
    return Shown(stored, None, window=window, panel=stored, detail=region is not None)


def check_parts(part: Shown, out: Path, scene: Any) -> None:
    """Refuse what a picture that is rendered part by part cannot be.

    Raises
    ------
    ArgumentError
        Another format than TIFF, or effects that need the whole painting.
    """
    from impasto.fit.stored.picture import check_local

    assert part.window is not None
    rows, columns = (one.stop - one.start for one in part.window)
    size, smaller = f"{columns} x {rows} pixels", "give --width for an overview or --region"
    if out.suffix.lower() not in {".tif", ".tiff"}:
        raise ArgumentError(
            f"--out: a picture of {size} is written part by part, as .tif, found {out.name}; name "
            f"it so, or {smaller} for a detail"
        )
    check_local(scene)


def render_parts(part: Shown, scene: Any, out: Path, **options: Any) -> Any:
    """Write a picture part by part, in bands that can be shown."""
    return part.surface.render(scene, out, **_part_of(part), **options)


def plan_parts(part: Shown, scene: Any, **options: Any) -> Any:
    """What such a picture calls for."""
    return part.surface.plan(scene, **_part_of(part), **options)


def _part_of(part: Shown) -> dict[str, Any]:
    """The bands and the detail that are shown; None for all."""
    count = len(part.surface.bands)
    bands = None if count in {1, 3} else [count - 1, count // 2, 0]
    return {"region": part.window if part.detail else None, "bands": bands}


def _factor(stored: StoredSbrdf, width: int) -> int:
    """The smallest scale that shows a width well, of those that can be loaded."""
    rows, columns = stored.shape
    factors = (1, *stored.factors)
    loaded = [one for one in factors if (rows // one) * (columns // one) <= WHOLE] or factors[-1:]
    for most in (FINER * width, width):
        fine = [factor for factor in loaded if columns // factor >= most]
        if fine:
            return fine[-1]
    return loaded[0]


def _times(columns: int, width: int) -> int:
    return max(1, columns // (FINER * width))


def _window(region: Region, shape: tuple[int, int]) -> tuple[slice, slice]:
    top, left, height, width = region
    rows, columns = shape
    inside = 0 <= top < top + height <= rows and 0 <= left < left + width <= columns
    if not (inside and height > 0 and width > 0):
        raise ArgumentError(
            "--region: expected TOP LEFT HEIGHT WIDTH within a painting of "
            f"{rows} rows and {columns} columns, found {' '.join(map(str, region))}"
        )
    return slice(top, top + height), slice(left, left + width)
