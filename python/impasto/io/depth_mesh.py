"""Depth meshes as CSV files that people can edit: one node a line."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.depth_mesh import DepthMesh, nodes_mm
from impasto.errors import CorruptInputError
from impasto.io.files import atomic_bytes, read_text

Floats = NDArray[np.float64]

COLUMNS = ("x_mm", "y_mm", "depth_mm", "sigma_mm")
DIGITS = 4
"""Decimals of mm in a file."""
PLACES = 1e-3
"""Mm by which nodes may lie beside an even grid."""


def as_written(mesh: DepthMesh) -> DepthMesh:
    """The mesh that a file says: what is made with it can be made again from the file."""
    return replace(
        mesh,
        depth_mm=np.round(mesh.depth_mm, DIGITS),
        sigma_mm=np.round(mesh.sigma_mm, DIGITS),
    )


def write_depth(path: str | Path, mesh: DepthMesh) -> None:
    """Write a mesh as a table: place, height and standard deviation of each node.

    Rows of nodes follow each other from the top, nodes of a row from the left. A standard deviation
    that is not known is left empty. The file is replaced atomically.
    """
    atomic_bytes(path, depth_text(mesh).encode("utf-8"))


def depth_text(mesh: DepthMesh) -> str:
    """What :func:`write_depth` writes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    x, y = mesh.nodes_mm
    for row, up in enumerate(y.tolist()):
        for column, right in enumerate(x.tolist()):
            sigma = float(mesh.sigma_mm[row, column])
            said = f"{sigma:.{DIGITS}f}" if np.isfinite(sigma) else ""
            height = f"{mesh.depth_mm[row, column]:.{DIGITS}f}"
            writer.writerow([f"{right:.{DIGITS}f}", f"{up:.{DIGITS}f}", height, said])
    return text.getvalue()


def read_depth(path: str | Path) -> DepthMesh:
    """Read a mesh that :func:`write_depth` wrote, and that may have been edited since.

    Lines may come in any order; nodes must lie on an even grid about the middle of the painting.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        Other columns, a line without numbers, or nodes that are missing, doubled or off the grid,
        with the line.
    """
    path = Path(path)
    lines = list(csv.reader(io.StringIO(read_text(path))))
    if not lines or tuple(cell.strip() for cell in lines[0]) != COLUMNS:
        raise CorruptInputError(path, f"line 1: expected the columns {','.join(COLUMNS)}")
    found: list[tuple[float, float, float, float]] = []
    numbers: list[int] = []
    for number, cells in enumerate(lines[1:], 2):
        if any(cell.strip() for cell in cells):
            found.append(_node(path, number, cells))
            numbers.append(number)
    if not found:
        raise CorruptInputError(path, "holds no nodes")
    table = np.array(found)
    width, height = (2.0 * float(np.abs(table[:, axis]).max()) for axis in (0, 1))
    columns, rows = (len(np.unique(np.round(table[:, axis], 3))) for axis in (0, 1))
    if min(rows, columns) < 2:
        raise CorruptInputError(path, "expected 2 x 2 nodes or more")
    x, y = nodes_mm((width, height), (rows, columns))
    place = np.stack(
        [np.abs(table[:, :1] - x).argmin(axis=1), np.abs(table[:, 1:2] - y).argmin(axis=1)], axis=1
    )
    off = np.abs(table[:, :2] - np.stack([x[place[:, 0]], y[place[:, 1]]], axis=1)).max(axis=1)
    if (off > PLACES).any():
        line = numbers[int(off.argmax())]
        raise CorruptInputError(
            path, f"line {line}: the node lies beside an even grid of {columns} x {rows} nodes "
            "about the middle of the painting"
        )  # fmt: skip
    flat = place[:, 1] * columns + place[:, 0]
    count = np.bincount(flat, minlength=rows * columns)
    if (count > 1).any():
        twice = [n for n, node in zip(numbers, flat.tolist(), strict=True) if count[node] > 1]
        raise CorruptInputError(path, f"lines {twice[0]} and {twice[1]} are the same node")
    if (count == 0).any():
        row, column = divmod(int(count.argmin()), columns)
        raise CorruptInputError(path, f"the node at x {x[column]:g}, y {y[row]:g} mm is missing")
    depth, sigma = np.empty(rows * columns), np.empty(rows * columns)
    depth[flat], sigma[flat] = table[:, 2], table[:, 3]
    shape = rows, columns
    return DepthMesh((width, height), depth.reshape(shape), sigma.reshape(shape))


def _node(path: Path, number: int, cells: list[str]) -> tuple[float, float, float, float]:
    said = [cell.strip() for cell in cells]
    if len(said) == len(COLUMNS) - 1 or (len(said) == len(COLUMNS) and not said[-1]):
        said = [*said[:3], "nan"]
    try:
        x, y, depth, sigma = (float(cell) for cell in said)
        if not np.isfinite((x, y, depth)).all():
            raise ValueError
    except ValueError:
        raise CorruptInputError(
            path, f"line {number}: expected three or four numbers, found {','.join(cells)}"
        ) from None
    return x, y, depth, sigma
