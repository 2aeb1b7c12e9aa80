"""A folder with photographs of mirror balls, alone or beside the painting."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impasto.calibrate.beside import Box, balls_beside, size_of
from impasto.calibrate.circles import read_circles
from impasto.calibrate.highlight import luma
from impasto.calibrate.lights import BallPhotographs
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text
from impasto.io.images import list_images, read_image

_BALL = re.compile(r"ball|probe|sphere|chrome", re.I)
_REFERENCE = re.compile(r"^ref", re.I)


@dataclass(frozen=True, eq=False)
class BallFolder:
    """What :func:`read_balls` found.

    Parameters
    ----------
    balls
        The photographs of each ball.
    objects
        The folder of the object's photographs; None if there is none.
    names
        The object's photographs, in the order of the lamps.
    frame
        Rows and columns of the photographs of which the balls are crops; None where not known.
    notes
        In words, each ball that a border of the photographs cuts off and that is left out.
    """

    balls: tuple[BallPhotographs, ...]
    objects: Path | None
    names: tuple[str, ...]
    frame: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()


def ball_folders(folder: Path) -> list[Path]:
    """The subfolders with photographs of a mirror ball, by their names."""
    inner = sorted(path for path in folder.iterdir() if path.is_dir())
    return [path for path in inner if _BALL.search(path.name) and list_images(path)]


def read_balls(
    folder: str | Path, *, circles: str | None = None, boxes: Sequence[Box] | None = None
) -> BallFolder:
    """Read the photographs of the balls in a folder.

    A folder of photographs shows the balls beside the object; they are found, or lie in
    ``boxes``. In a folder of folders, those whose names contain ball, probe, sphere or chrome hold
    one ball each; the only other one with photographs holds those of the object, in the same order
    of lamps. Photographs whose names begin with ``ref`` show the edge of a ball.
    ``ManualData/probes_bbox.txt`` of Xiong's data set [@xiong2014psbox] gives the places of the
    balls in one frame.

    Parameters
    ----------
    folder
        The folder of these folders.
    circles
        Name of a text file in the folder of each ball: x, y and radius of its outline in pixels,
        counted from 1, y up from the lower border (``circle_data.txt`` of that data set). Where
        balls lie beside the object, a file in the folder of the photographs, one ball a line.
        Default: outlines are found.
    boxes
        Top, left, height and width in pixels around each ball in the photographs of a folder.
        Default: balls are found.

    Raises
    ------
    ArgumentError
        No ball, no folder of a ball, several folders of objects, or other numbers of photographs.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder")
    inner = sorted(path for path in folder.iterdir() if path.is_dir())
    homes = ball_folders(folder)
    others = [path for path in inner if path not in homes and list_images(path)]
    photographs = [path for path in list_images(folder) if not _REFERENCE.match(path.name)]
    if photographs and not homes:
        outlines = None
        if circles is not None:
            if boxes is not None:
                raise ArgumentError("circles: they say where the balls are; leave --ball out")
            outlines = read_circles(folder / circles, size_of(photographs[0])[0])
        references = [path for path in list_images(folder) if _REFERENCE.match(path.name)]
        found, frame, notes = balls_beside(photographs, references, boxes, outlines)
        return BallFolder(found, folder, tuple(path.name for path in photographs), frame, notes)
    if boxes is not None:
        raise ArgumentError(
            f"boxes: {folder} holds folders of balls; boxes (--ball) are places in photographs "
            "that show balls beside the object"
        )
    if not homes:
        raise ArgumentError(
            f"path: {folder} has no folder of a ball: name the folder of each ball so that its "
            "name contains ball, probe, sphere or chrome, or give a folder of photographs that "
            "show the ball beside the object"
        )
    if len(others) > 1:
        raise ArgumentError(
            f"path: {folder} has several folders of objects "
            f"({', '.join(path.name for path in others)}); keep one"
        )
    corners = _corners(folder, len(homes))
    balls = tuple(_ball(home, circles, corners) for home in homes)
    corrected = []
    for number, ball in enumerate(balls):
        corner = None if corners is None else corners[number]
        if corner is not None:
            # From y up to rows down; the height of the whole frame moves all balls alike.
            corner = (corner[0] - 1.0, -corner[1])
        corrected.append(
            BallPhotographs(
                ball.pictures, ball.name, corner, ball.references, ball.outline, ball.full,
                ball.names,
            )
        )  # fmt: skip
    names: tuple[str, ...] = balls[0].names
    if others:
        names = tuple(p.name for p in list_images(others[0]) if not _REFERENCE.match(p.name))
        if len(names) != len(balls[0].pictures):
            raise ArgumentError(
                f"{others[0]}: {len(names)} photographs, but {len(balls[0].pictures)} of "
                f"{balls[0].name}: one for each lamp is needed, in the same order"
            )
    return BallFolder(tuple(corrected), others[0] if others else None, names)


def _ball(home: Path, circles: str | None, corners: object) -> BallPhotographs:
    files = list_images(home)
    lamps = [path for path in files if not _REFERENCE.match(path.name)]
    references = [path for path in files if _REFERENCE.match(path.name)]
    if not lamps:
        raise ArgumentError(f"{home}: no photograph of the ball under a lamp")
    codes = read_image(lamps[0])
    full = float(np.iinfo(codes.dtype).max) if codes.dtype.kind == "u" else None
    pictures = [luma(codes)]
    for path in lamps[1:] + references:
        picture = luma(read_image(path))
        if picture.shape != pictures[0].shape:
            raise ArgumentError(
                f"{path}: {picture.shape[1]} x {picture.shape[0]} pixels, but {lamps[0].name} has "
                f"{pictures[0].shape[1]} x {pictures[0].shape[0]}; crop all of a ball alike"
            )
        pictures.append(picture)
    whole = np.array(pictures)
    outline = None
    if circles is not None:
        given = read_circles(home / circles, whole.shape[1])
        if len(given) > 1:
            raise CorruptInputError(
                home / circles, f"has {len(given)} outlines; a folder of a ball shows one"
            )
        outline = given[0]
    return BallPhotographs(
        whole[: len(lamps)], home.name, None, whole[len(lamps) :], outline, full,
        tuple(path.name for path in lamps),
    )  # fmt: skip


def _corners(folder: Path, count: int) -> list[tuple[float, float]] | None:
    """Least x and largest y of each crop, y up, where the data set says."""
    path = folder / "ManualData" / "probes_bbox.txt"
    if not path.is_file():
        return None
    try:
        rows = [[float(word) for word in line.split()] for line in read_text(path).splitlines()]
        rows = [row for row in rows if row]
        if len(rows) != count or any(len(row) != 4 for row in rows):
            raise ValueError
    except ValueError:
        raise CorruptInputError(
            path, f"expected x_min x_max y_min y_max for each of {count} balls"
        ) from None
    return [(row[0], row[3]) for row in rows]
