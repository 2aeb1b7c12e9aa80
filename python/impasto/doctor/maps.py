"""Whether the maps of a result are what a fit leaves: tile by tile, in the memory of one.

The border between two tiles is tested by ranks. A tile knows nothing of the one beside it, so a
fault of one shows where they meet. Of the three steps between the means of four times four pixels
in a row across the border, the middle one is the largest in a third of all places if nothing
happens there; more where JPEG blocks meet, as they do at most borders. So the share is compared
with that on two lines beside the border, some blocks away, by a test of two proportions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import squares
from impasto._internal.wording import counted
from impasto.doctor.diagnosis import Diagnosis, Finding, Severity
from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.status import Status

Floats = NDArray[np.float64]

SIDE = 512
"""Rows and columns of the parts of a result that is in memory."""
LENGTH = 2.0**-9
"""More than half precision changes of a length: three roundings of at most 2^-11."""
FEW = 0.01
"""A share of the pixels below which nothing is said of them."""
POOR = 0.1
"""A share of pixels, or of residuals of the light, above which a fit is worth another look."""
SAMPLED = 200_000
"""Pixels whose residuals are compared, on an even grid."""
SEAM = 0.15
"""A share so much larger than beside the border is a seam; without one it is the same."""
SIGMAS = 5.0
"""By so many standard errors: a painting of a gigapixel has thousands of borders."""
MEANS = 4
"""Pixels of a mean: noise and canvas are larger than many a seam."""
BLOCKS = 16
"""Rows and columns of blocks of JPEG files, or a multiple: how far away the other lines are."""
FEWEST = 8
"""Places at a border that are known, below which it is not judged."""
NAMES = ("status", "normal", "diffuse", "residual")


class Maps(Protocol):
    """What is examined: a result in memory or in a store."""

    @property
    def rig(self) -> Rig:
        """Who lit and who looked."""

    @property
    def bands(self) -> tuple[str, ...]:
        """One name per band."""


def examine_result(result: Maps) -> Diagnosis:
    """Check the maps of a result; every finding says what to do.

    A result in a store (:func:`impasto.open_sbrdf`) is read tile by tile and may have any size.

    Parameters
    ----------
    result
        A result of :func:`impasto.fit_sbrdf`, in memory or in a store.

    Returns
    -------
    Diagnosis
        Its ``.worst`` is ``"error"`` if the maps cannot be what a fit left.

    Raises
    ------
    ArgumentError
        No such result.
    CorruptInputError
        A chunk of a store is missing or damaged.
    """
    read, size, tile = _access(result)
    step = max(1, int(np.sqrt(size[0] * size[1] / SAMPLED)))
    tally = _Tally()
    for rows, columns in squares(size, tile or SIDE):
        status, normal, diffuse, residual = (read(name, rows, columns) for name in NAMES)
        tally.add(status, normal, diffuse, residual, step)
    found = [
        _statuses(tally),
        _gaps(tally),
        *_normals(tally),
        _colours(tally),
        _residuals(tally),
    ]
    if tile is not None and max(size) > tile > 2 * BLOCKS:
        found.append(_seams(read, size, tile))
    shape = (len(result.rig), len(result.bands), *size)
    return Diagnosis(tuple(found), (), shape, of_result=True)


Read = Callable[[str, slice, slice], NDArray[Any]]
"""A window of a map, by its name."""


def _access(result: Any) -> tuple[Read, tuple[int, int], int | None]:
    """How maps are read, rows and columns, and those of a tile where there are tiles."""
    if hasattr(result, "map") and hasattr(result, "tile"):
        return result.map, result.shape, result.tile
    if not all(hasattr(result, name) for name in NAMES):
        raise ArgumentError(f"result: expected a result of fit_sbrdf, found {result!r:.60}")

    def read(name: str, rows: slice, columns: slice) -> NDArray[Any]:
        return np.asarray(getattr(result, name)[..., rows, columns])

    return read, result.status.shape, None


@dataclass
class _Tally:
    """Counts over all tiles."""

    statuses: NDArray[np.int64] = field(default_factory=lambda: np.zeros(256, np.int64))
    gaps: int = 0
    guesses: int = 0
    infinite: int = 0
    lengths: int = 0
    normals: int = 0
    facing_away: int = 0
    negative: int = 0
    bright: int = 0
    residuals: list[Floats] = field(default_factory=list)

    def add(
        self,
        status: NDArray[np.uint8],
        normal: NDArray[np.float32],
        diffuse: NDArray[np.float32],
        residual: NDArray[np.float32],
        step: int,
    ) -> None:
        """A tile; of every ``step``-th row and column the residual is kept."""
        self.statuses += np.bincount(status.ravel(), minlength=256)
        estimated = status < Status.DARK
        coloured = estimated | (status == Status.DARK)
        for maps, known in ((normal, estimated), (diffuse, coloured)):
            self.infinite += int(np.isinf(maps).any(axis=0).sum())
            missing = np.isnan(maps)
            self.gaps += int((missing.any(axis=0) & known).sum())
            self.guesses += int((~missing.all(axis=0) & ~known).sum())
        there = estimated & np.isfinite(normal).all(axis=0)
        vectors = normal[:, there].astype(np.float64)
        self.normals += vectors.shape[1]
        self.lengths += int((np.abs(np.square(vectors).sum(axis=0) - 1.0) > 2.0 * LENGTH).sum())
        self.facing_away += int((vectors[2] <= 0.0).sum())
        self.negative += int((diffuse[:, there] < 0.0).any(axis=0).sum())
        self.bright += int((diffuse[:, there] > 1.0).any(axis=0).sum())
        few = (slice(None, None, step), slice(None, None, step))
        light = diffuse[(slice(None), *few)].astype(np.float64).mean(axis=0)
        relative = residual[few] / np.where(light > 0.0, light, np.nan)
        self.residuals.append(relative[np.isfinite(relative)])

    def share(self, count: int) -> float:
        """Of the pixels that have a normal."""
        return count / max(self.normals, 1)


def _statuses(tally: _Tally) -> Finding:
    counts = {
        status.name: int(tally.statuses[status]) for status in Status if tally.statuses[status]
    }
    total = int(tally.statuses.sum())
    inside = total - counts.get("MASKED", 0)
    estimated = sum(count for name, count in counts.items() if Status[name].estimated)
    words = ", ".join(
        f"{100.0 * count / total:.1f} % {name.lower().replace('_', ' ')}"
        for name, count in sorted(counts.items(), key=lambda one: -one[1])
    )
    severity: Severity = "ok"
    advice = ""
    if not estimated:
        severity, advice = "error", "examine the photographs: impasto doctor STACK"
    elif "NOT_COMPUTED" in counts:
        severity, advice = "warning", "finish the job: impasto job resume"
    elif estimated < (1.0 - POOR) * inside or counts.get("ILL_CONDITIONED", 0) > POOR * inside:
        severity = "warning"
        advice = "look at status.png; examine the photographs: impasto doctor STACK"
    if other := total - sum(counts.values()):
        severity, advice = "error", "the file is damaged: restore it, or fit again"
        words += f", {100.0 * other / total:.1f} % of unknown status"
    return Finding("statuses", severity, words, advice, numbers=counts)


def _gaps(tally: _Tally) -> Finding:
    numbers = {"gaps": tally.gaps, "guesses": tally.guesses, "infinite": tally.infinite}
    if any(numbers.values()):
        return Finding(
            "gaps",
            "error",
            f"{tally.gaps} pixels lack a normal or a colour that their status says they have, "
            f"{tally.guesses} have one that it says they lack, {tally.infinite} are infinite",
            "maps and status are not of one fit: restore the file, or fit again",
            numbers=numbers,
        )
    return Finding("gaps", "ok", "numbers are missing exactly where the status says so")


def _normals(tally: _Tally) -> Iterator[Finding]:
    numbers = {"lengths": tally.lengths, "facing_away": tally.facing_away}
    if tally.lengths:
        yield Finding(
            "unit-normals",
            "error",
            f"{tally.lengths} normals have another length than 1",
            "the map was changed after the fit: restore it, or fit again",
            numbers=numbers,
        )
    else:
        yield Finding("unit-normals", "ok", "all normals have length 1", numbers=numbers)
    share = tally.share(tally.facing_away)
    yield Finding(
        "facing",
        "warning" if share > FEW else "ok",
        f"{100.0 * share:.2g} % of the normals face away from the camera",
        "the light directions may be mirrored, or most photographs in shadow there: impasto doctor "
        "STACK"
        if share > FEW
        else "",
        numbers=numbers,
    )


def _colours(tally: _Tally) -> Finding:
    bright, negative = tally.share(tally.bright), tally.share(tally.negative)
    wrong = max(bright, negative) > FEW
    return Finding(
        "colours",
        "warning" if wrong else "ok",
        f"{100.0 * bright:.2g} % of the pixels are brighter than the white board, "
        f"{100.0 * negative:.2g} % negative in a band",
        "metal may be; paint is not: check the white board and the intensities" if wrong else "",
        numbers={"brighter_than_white": bright, "negative": negative},
    )


def _residuals(tally: _Tally) -> Finding:
    relative = np.concatenate(tally.residuals)
    if not len(relative):
        return Finding("residuals", "ok", "no pixel has a residual")
    middle, most = (float(np.quantile(relative, rank)) for rank in (0.5, 0.95))
    poor = middle > POOR
    return Finding(
        "residuals",
        "warning" if poor else "ok",
        f"residuals of {100.0 * middle:.2g} % of the diffuse colour in the median, "
        f"{100.0 * most:.2g} % in the worst twentieth",
        "the model does not describe the photographs: impasto doctor STACK, or another model"
        if poor
        else "",
        numbers={"median": middle, "quantile_95": most},
    )


def _seams(read: Read, size: tuple[int, int], tile: int) -> Finding:
    """The borders between every two tiles."""
    borders = 0
    worst: tuple[float, str] = (-1.0, "")
    seams: dict[str, float] = {}
    for axis, name in enumerate(("row", "column")):
        for line in range(tile, size[axis], tile):
            for start in range(0, size[1 - axis], tile):
                along = slice(start, min(start + tile, size[1 - axis]))
                excess = _excess(read, size, axis, line, along)
                if excess is None:
                    continue
                borders += 1
                where = f"{name} {line} from {start}"
                worst = max(worst, (excess[0], where))
                if excess[0] > max(SEAM, SIGMAS * excess[1]):
                    seams[where] = round(excess[0], 3)
    if not borders:
        return Finding("seams", "ok", "too little is known beside the borders of tiles")
    numbers = {"borders": borders, "seams": seams}
    most = f"in {100.0 * worst[0]:.0f} % more of all places than beside it, at {worst[1]}"
    if not seams:
        return Finding(
            "seams",
            "ok",
            f"no seam at {counted(borders, 'border')} of tiles: the step across is a large one at "
            f"most {most}",
            numbers=numbers,
        )
    return Finding(
        "seams",
        "error",
        f"{len(seams)} of {counted(borders, 'border')} of tiles show: the step across is a large "
        f"one {most}",
        "tiles are of different fits or exchanged: impasto job verify, impasto job rerun; if rerun "
        "makes the same bytes, the painting has a straight edge there",
        numbers=numbers,
    )


def _excess(
    read: Read, size: tuple[int, int], axis: int, line: int, along: slice
) -> tuple[float, float] | None:
    """By how much larger the share at a border is than beside it, and the standard error.

    None where too little is known, or the painting ends a few pixels beyond the border.
    """
    if line > size[axis] - 2 * MEANS:
        return None
    here = _steps_across(read, size, axis, line, along)
    beside = np.zeros_like(here)
    for other in (line - BLOCKS, line + BLOCKS):
        beside += _steps_across(read, size, axis, other, along)
    known = (here[1] >= FEWEST) & (beside[1] >= FEWEST)
    if not known.any():
        return None
    here, beside = here[:, known], beside[:, known]
    share, other_share = here[0] / here[1], beside[0] / beside[1]
    both = (here[0] + beside[0]) / (here[1] + beside[1])
    error = np.sqrt(both * (1.0 - both) * (1.0 / here[1] + 1.0 / beside[1]))
    # The planes of one place are not independent: that which shows most of a seam counts.
    plane = int(np.argmax(share - other_share))
    return float((share - other_share)[plane]), float(error[plane])


def _steps_across(
    read: Read, size: tuple[int, int], axis: int, line: int, along: slice
) -> NDArray[np.int64]:
    """In how many places the step across a line is the largest of three, and of how many.

    ``(2, plane)``; only places count that are known.
    """
    reach = 2 * MEANS
    if not reach <= line <= size[axis] - reach:
        return np.zeros((2, 1), np.int64)
    across = slice(line - reach, line + reach)
    rows, columns = (across, along) if axis == 0 else (along, across)
    planes = np.concatenate(
        [read("normal", rows, columns)[:2], read("diffuse", rows, columns)]
    ).astype(np.float64)
    planes = np.moveaxis(planes, 1 + axis, -1)
    count, length = planes.shape[0], planes.shape[1] // MEANS
    means = planes[:, : length * MEANS].reshape(count, length, MEANS, 4, MEANS).mean(axis=(2, 4))
    before, step, after = np.moveaxis(np.abs(np.diff(means, axis=2)), 2, 0)
    known = np.isfinite(means).all(axis=2)
    largest = (step > before) & (step > after) & known
    return np.stack([largest.sum(axis=1), known.sum(axis=1)]).astype(np.int64)
