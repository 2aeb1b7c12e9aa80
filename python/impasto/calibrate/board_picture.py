"""A picture of a white board: its light under each lamp, strengths, what is not smooth, noise."""

from __future__ import annotations

import numpy as np

from impasto.calibrate.board import Board, mean_strengths
from impasto.calibrate.photon_transfer import PhotonTransfer
from impasto.pictures import Panel, Picture, Series, contact_sheet, diagram_panel, ramp_panel
from impasto.pictures.diagrams import AMBER, BLUE, GREEN, RED

MOST = 24
"""Lamps that are shown; of more, every n-th."""
INTERVAL = 1.96
"""Standard deviations of a 95 % interval."""
_WIDTH = 300


def board_picture(board: Board) -> Picture:
    """``(y, x, 3)``: light of the board on one scale, strengths with 95 % intervals, deviations."""
    step = -(-len(board.names) // MOST)
    shown = range(0, len(board.names), step)
    # Strong at the top, so that the sheet begins with what the lamps differ in.
    size = (round(_WIDTH * 0.75), _WIDTH)
    panels = [_strengths(board, size), _deviations(board)]
    if board.noise:
        panels.append(_noise(board.noise, size))
    top = float(board.light.max())
    panels += [
        ramp_panel(board.light[i], board.names[i], unit=_even(board, i), low=0.0, high=top)
        for i in shown
    ]
    return contact_sheet(
        [_sized(panel, size) for panel in panels],
        title="White board",
        subtitle=f"{len(board.names)} lamps; light in shares of full scale; "
        + (f"{len(board.findings)} findings" if board.findings else "nothing found"),
        width=_WIDTH,
    )


def _even(board: Board, index: int) -> str:
    return f"darkest / brightest {board.evenness[index]:.2f}"


def _sized(panel: Panel, size: tuple[int, int]) -> Panel:
    """Blocks as squares that can be seen."""
    import cv2

    picture = panel.picture
    if picture.shape[:2] != size:
        factor = min(size[0] / picture.shape[0], size[1] / picture.shape[1])
        picture = np.asarray(
            cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
        )
    return Panel(panel.title, picture, panel.note, panel.bar, panel.classes, panel.axis)


def _strengths(board: Board, size: tuple[int, int]) -> Panel:
    value = mean_strengths(board)
    reach = INTERVAL * board.sigma.mean(axis=1) * value
    numbers = np.arange(1, len(value) + 1)
    lines = [
        Series("", [(x, v - r), (x, v + r)], AMBER)
        for x, v, r in zip(numbers.tolist(), value.tolist(), reach.tolist(), strict=True)
    ]
    dots = Series("", np.stack([numbers, value], axis=1), AMBER, dots=True)
    low, high = float((value - reach).min()), float((value + reach).max())
    margin = max(0.1 * (high - low), 1e-3)
    return diagram_panel(
        [*lines, dots], "Strength / mean", x=(0.0, len(value) + 1.0),
        y=(low - margin, high + margin), axis=("first", "last"),
        note=f"95 % within {100 * INTERVAL * float(board.sigma.max()):.2g} %", size=size,
    )  # fmt: skip


def _deviations(board: Board) -> Panel:
    """Of all lamps that which deviates most, with its sign."""
    most = np.abs(board.residual).argmax(axis=0)
    worst = np.take_along_axis(board.residual, most[None], axis=0)[0]
    percent = 100.0 * np.expm1(worst)
    reach = max(float(np.abs(percent).max()), 0.5)
    return ramp_panel(percent, "Largest deviation", unit="% from smooth", low=-reach, high=reach)


def _noise(noise: tuple[PhotonTransfer, ...], size: tuple[int, int]) -> Panel:
    colours = [RED, GREEN, BLUE] if len(noise) == 3 else [AMBER, GREEN, BLUE, RED] * len(noise)
    series = []
    top = max(float(one.signal.max()) for one in noise)
    high = max(100.0 * float(np.sqrt(one.variance.max())) for one in noise)
    for one, colour in zip(noise, colours, strict=False):
        some = np.linspace(0, len(one.signal) - 1, min(200, len(one.signal))).astype(int)
        points = np.stack([one.signal[some], 100.0 * np.sqrt(one.variance[some])], axis=1)
        dim = (colour[0] // 2, colour[1] // 2, colour[2] // 2)
        series.append(Series("", points, dim, dots=True))
        line = np.linspace(0.0, top, 65)
        series.append(Series("", np.stack([line, 100.0 * one.deviation(line)], axis=1), colour))
    wells = [one.full_well[0] for one in noise]
    reads = [one.read[0] for one in noise]
    return diagram_panel(
        series, "Noise, %", x=(0.0, top), y=(0.0, 1.1 * high), axis=("0", f"{top:.2g} of full"),
        note=f"{np.mean(wells):.0f} e full, {np.mean(reads):.1f} e read", size=size,
    )  # fmt: skip
