"""The maps of a comparison over one window of the painting before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, widened, within
from impasto.colour import delta_e, lab_from_xyz
from impasto.comparison.colours import Colours
from impasto.comparison.entries import RATIOS, Changed, Compared
from impasto.comparison.quantities import Quantities, has_places, quantities_of, resampled
from impasto.comparison.registration import Alignment
from impasto.comparison.significance import criticals, squares
from impasto.merge.frames import Frame
from impasto.merge.resampling import REACH, Samples

Planes = NDArray[np.float64]

DIVISION = 2.0
"""Where the number of lobes differs, light is divided otherwise between lobes and diffuse part: so
many times larger are errors there, measured on paintings that had not changed."""
STEPS = 3
"""Of a window: the quantities before, those after, the differences. The first two take most of the
time."""


@dataclass(frozen=True, eq=False)
class Tile:
    """What a window has.

    Attributes
    ----------
    maps
        ``(y, x)`` by name, as in :class:`ComparisonMaps`.
    detectable
        ``(y, x)`` by quantity: the smallest difference that would be significant, in its unit.
    tested
        ``(y, x)`` by quantity.
    overview
        Planes for :class:`OverviewSums`.
    normals
        ``(3, y, x)`` before and after, for heights.
    """

    maps: dict[str, NDArray[Any]]
    detectable: dict[str, Planes]
    tested: dict[str, NDArray[np.bool_]]
    overview: dict[str, NDArray[Any]]
    normals: tuple[Planes, Planes]


@dataclass(frozen=True, eq=False)
class Comparer:
    """Compares windows.

    Attributes
    ----------
    before, after
        The paintings.
    alignment
        What is done to the one after.
    colours
        How bands become colours.
    alpha
        The probability of a mark where nothing changed.
    exposure_sigma
        Relative standard deviation of a band's exposure between the two.
    """

    before: Frame
    after: Frame
    alignment: Alignment
    colours: Colours
    alpha: float
    exposure_sigma: float

    def tile(self, part: Window, step: Callable[[int], object]) -> Tile:
        """Maps, statuses and marks of a window; they do not depend on which windows are made.

        ``step`` is called after each of the :data:`STEPS` but the last, with how many there were.
        """
        # One pixel more for the slopes that an error of the registration is multiplied by.
        wide = widened(part, self.before.shape, 1)
        inner = within(part, wide)
        one = quantities_of(self.before.window(*wide))
        step(1)
        other, covered = self._after(wide)
        step(2)
        status = _status(one, other, covered)
        fine = status < Compared.OUTSIDE
        angle = _angles(one.normal, other.normal)
        error = self._normal_error(one, other)
        freedom = _freedom(one, other)
        first, second = (
            np.where(fine, np.nan, np.nan)[None] if matrix is None else _xyz(matrix, own.diffuse)
            for matrix, own in zip(self.colours.matrices or (None, None), (one, other), strict=True)
        )
        colour = np.full(fine.shape, np.nan)
        tests: dict[str, tuple[Planes, Planes]] = {
            "normal": (angle**2 / error, criticals(self.alpha, 2, freedom))
        }
        if self.colours.matrices is not None:
            labs = [lab_from_xyz(np.where(fine, xyz, 0.0), self.colours.white)
                    for xyz in (first, second)]  # fmt: skip
            colour = delta_e(*labs)
            square, rank = self._colour_square(one, other, first, second)
            tests["colour"] = square, criticals(self.alpha, rank, freedom)
        ratio, width = _ratio(other.beta, one.beta), _ratio(other.gamma, one.gamma)
        both = has_places(self.before.kind) and has_places(self.after.kind)
        if both:
            square, critical = self._gloss_square(one, other, freedom)
            tests["gloss"] = square, critical
        changed = np.zeros(fine.shape, np.uint8)
        tested = {}
        for name, (square, critical) in tests.items():
            tested[name] = (fine & np.isfinite(square))[inner]
            changed |= np.where(
                fine & (square > critical), np.uint8(Changed[name.upper()]), 0
            ).astype(np.uint8)
        status[fine & ~np.isfinite(tests["normal"][0])] = Compared.NO_ERROR
        maps = {
            "angle": angle, "delta_e": colour, "beta_ratio": ratio, "gamma_ratio": width,
        }  # fmt: skip
        maps = {name: np.where(fine, plane, np.nan)[inner].astype(np.float32)
                for name, plane in maps.items()}  # fmt: skip
        maps |= {"changed": changed[inner], "status": status[inner]}
        sizes = {"normal": np.degrees(angle), "colour": colour}
        detectable = {
            name: _detectable(sizes[name], *tests[name])[inner] for name in sizes if name in tests
        }
        if both:
            relative = self._beta_error(one, other) / np.maximum(one.beta, 1e-12)
            critical = np.sqrt(criticals(self.alpha / 2, 1, freedom))
            detectable["gloss"] = np.where(one.beta > 0, 1.0 + critical * relative, np.nan)[inner]
        return Tile(
            maps,
            detectable,
            tested,
            self._overview(part, inner, one, other, maps),
            (one.normal[:, inner[0], inner[1]], other.normal[:, inner[0], inner[1]]),
        )

    def _after(self, part: Window) -> tuple[Quantities, NDArray[np.bool_]]:
        """Quantities after at pixels before, and which of these it covers."""
        place = self.alignment.placement
        rows, columns = part
        size = rows.stop - rows.start, columns.stop - columns.start
        x, y = (
            one.ravel().astype(np.float64)
            for one in np.meshgrid(
                np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
            )
        )
        column, row = (x, y) if place is None else place.back(x, y)
        height, width = self.after.shape
        covered = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
        column, row = np.clip(column, 0, width - 1), np.clip(row, 0, height - 1)
        window = (
            slice(max(int(row.min()) - REACH, 0), min(int(row.max()) + REACH + 2, height)),
            slice(max(int(column.min()) - REACH, 0), min(int(column.max()) + REACH + 2, width)),
        )
        own = quantities_of(self.after.window(*window))
        shape = own.known.shape
        samples = Samples.at(column - window[1].start, row - window[0].start, shape)
        flat = resampled(own, samples, self.alignment)
        found = Quantities(
            **{name: plane.reshape(*plane.shape[:-1], *size) for name, plane in vars(flat).items()}
        )
        return found, covered.reshape(size)

    def _normal_error(self, one: Quantities, other: Quantities) -> Planes:
        """Variance of a normal along an axis: both errors, and that of the registration."""
        error = one.sigma**2 + other.sigma**2
        for slope in _slopes(one.normal):
            moved = self.alignment.report.sigma * np.nan_to_num(slope)
            error = error + np.sum(moved**2, axis=0)
        return np.asarray(error)

    def _colour_square(
        self, one: Quantities, other: Quantities, first: Planes, second: Planes
    ) -> tuple[Planes, int]:
        """T squared of the difference in XYZ, in as many dimensions as there are."""
        assert self.colours.matrices is not None
        rank = min(3, len(one.diffuse), len(other.diffuse))
        rows = slice(0, 3) if rank == 3 else slice(1, 2)
        size = 3 if rank == 3 else 1
        covariance = np.zeros((*one.known.shape, size, size))
        for own, matrix in zip((one, other), self.colours.matrices, strict=True):
            used = matrix[rows]
            noise = own.noise * _division(one, other)
            covariance += noise[..., None, None] ** 2 * (used @ used.T)
        # The exposure of either is off by a part of the colour itself, band by band.
        used = self.colours.matrices[0][rows]
        gains = np.moveaxis(one.diffuse, 0, -1)[..., None, :] * used * self.exposure_sigma
        covariance += gains @ np.swapaxes(gains, -1, -2)
        for slope in _slopes(first[rows]):
            across = np.moveaxis(np.nan_to_num(slope), 0, -1) * self.alignment.report.sigma
            covariance += across[..., :, None] * across[..., None, :]
        difference = np.moveaxis((second - first)[rows], 0, -1).reshape(-1, size)
        found = squares(difference, covariance.reshape(-1, size, size))
        return found.reshape(one.known.shape), rank

    def _beta_error(self, one: Quantities, other: Quantities) -> Planes:
        """Of the difference of beta: both errors, and that of the exposure."""
        exposure = self.exposure_sigma * one.beta
        return np.asarray(np.hypot(np.hypot(one.beta_sigma, other.beta_sigma), exposure))

    def _gloss_square(
        self, one: Quantities, other: Quantities, freedom: NDArray[np.int64]
    ) -> tuple[Planes, Planes]:
        """The larger T squared of beta and gamma, each at half of alpha (Bonferroni)."""
        error = self._beta_error(one, other) * _division(one, other)
        with np.errstate(invalid="ignore", divide="ignore"):
            strength = ((other.beta - one.beta) / error) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            width = np.log(other.gamma / one.gamma) ** 2
        width = width / (one.gamma_sigma**2 + other.gamma_sigma**2)
        # The strongest of one lobe and that of two need not be the same coat.
        width = np.where(one.lobes == other.lobes, width, np.nan)
        return np.fmax(strength, width), criticals(self.alpha / 2, 1, freedom)

    def _overview(
        self,
        part: Window,
        inner: Window,
        one: Quantities,
        other: Quantities,
        maps: dict[str, NDArray[Any]],
    ) -> dict[str, NDArray[Any]]:
        fine = maps["status"] < Compared.OUTSIDE
        ratio = maps["beta_ratio"]
        marks = [np.where(fine, (maps["changed"] & flag) > 0, np.nan) for flag in Changed]
        pictures = (
            self.colours.shown(side, own.diffuse)[(..., *inner)]
            for side, own in enumerate((one, other))
        )
        before, after = pictures
        seen = (maps["status"] != Compared.OUTSIDE)[None]
        return {
            "before": before,
            "after": np.where(seen, after, np.nan),
            "angle": maps["angle"][None],
            "delta_e": maps["delta_e"][None],
            "log_beta_ratio": np.log(np.clip(ratio, *RATIOS))[None],
            "changed": np.stack(marks),
            "compared": fine[None].astype(np.float64),
        }


def _status(one: Quantities, other: Quantities, covered: NDArray[np.bool_]) -> NDArray[np.uint8]:
    status = np.full(covered.shape, Compared.TESTED, np.uint8)
    status[~one.known & other.known] = Compared.UNKNOWN_BEFORE
    status[one.known & ~other.known] = Compared.UNKNOWN_AFTER
    status[~one.known & ~other.known] = Compared.UNKNOWN_BOTH
    status[~covered] = Compared.OUTSIDE
    return status


def _division(one: Quantities, other: Quantities) -> Planes:
    return np.where(one.lobes == other.lobes, 1.0, DIVISION)


def _angles(first: Planes, second: Planes) -> Planes:
    across = np.linalg.norm(np.cross(first, second, axis=0), axis=0)
    return np.asarray(np.arctan2(across, np.sum(first * second, axis=0)))


def _freedom(one: Quantities, other: Quantities) -> NDArray[np.int64]:
    return np.nan_to_num(one.freedom + other.freedom, nan=1.0).astype(np.int64)


def _xyz(matrix: Planes, diffuse: Planes) -> Planes:
    return np.asarray(np.tensordot(matrix, diffuse, axes=1))


def _ratio(second: Planes, first: Planes) -> Planes:
    """After divided by before; NaN where there is neither."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(second / first)


def _detectable(size: Planes, square: Planes, critical: Planes) -> Planes:
    """A difference in the direction of the one that was found, as large as is just significant."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(size * np.sqrt(critical / square))


def _slopes(planes: Planes) -> list[Planes]:
    """Along rows and columns, by a pixel; none of a window that is too small for them."""
    if min(planes.shape[1:]) < 2:
        return []
    return [np.asarray(np.gradient(planes, axis=axis)) for axis in (1, 2)]
