"""The figure of a matching experiment: choices, mean and interval, and where models lie."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from impasto.matching.models import ModelMatch
from impasto.pictures import BACKGROUND, FAINT, INK, Picture
from impasto.pictures.diagrams import AMBER, BLUE, GREEN, GROUND, LINE, RED
from impasto.pictures.sheet import draw_text

WIDTH, LEFT, RIGHT = 1100, 190, 50
ROW = 30
MOST_ROWS = 60
"""Observers that have a row of their own."""
COLOURS = (AMBER, RED, GREEN)
"""Of the models."""


def matching_picture(
    choices: Sequence[tuple[str, str, float]],
    observers: Mapping[str, float],
    mean: float,
    interval: tuple[float, float],
    models: Sequence[ModelMatch],
    title: str,
) -> Picture:
    """``(y, x, 3)`` uint8: one row per observer with a dot per choice and a bar at the mean.

    Choices of the same degree stand above each other. The band is the interval of the mean over
    all, and every model has a line at the degree whose colours are nearest to its own.
    """
    import cv2

    names = sorted(observers, key=lambda name: (observers[name], name))[:MOST_ROWS]
    top, foot = 108, 74 + 24 * len(models)
    base = top + ROW * len(names)
    picture = np.empty((base + foot, WIDTH, 3), np.uint8)
    picture[:] = BACKGROUND
    picture[top:base, LEFT : WIDTH - RIGHT] = GROUND

    def column(d: float) -> int:
        return round(LEFT + d * (WIDTH - RIGHT - LEFT))

    draw_text(picture, f"Degree of adaptation, {title}", (40, 50), 26, weight=500)
    if math.isfinite(interval[0]):
        low, high = (column(min(max(d, 0.0), 1.0)) for d in interval)
        band = picture[top:base, low : high + 1].astype(np.float64)
        picture[top:base, low : high + 1] = np.rint(0.72 * band + 0.28 * np.array(BLUE))
        words = f"mean {mean:.2f}, 95 % interval {interval[0]:.2f} to {interval[1]:.2f}"
    else:
        words = f"mean {mean:.2f}"
    draw_text(picture, f"{words}; observers: {len(observers)}, choices: {len(choices)}", (40, 78),
              15, FAINT)  # fmt: skip
    for tenth in range(11):
        at = column(tenth / 10)
        picture[top:base, at] = LINE
        draw_text(picture, f"{tenth / 10:g}", (at - 8, base + 22), 13, FAINT)
    draw_text(picture, "0: as a camera sees it", (LEFT, base + 44), 13, FAINT)
    draw_text(picture, "1: complete adaptation", (WIDTH - RIGHT, base + 44), 13, FAINT, right=True)
    cv2.line(picture, (column(mean), top), (column(mean), base - 1), BLUE, 2, cv2.LINE_AA)
    for model, colour in zip(models, COLOURS, strict=False):
        at = column(model.degree)
        for start in range(top, base, 12):
            cv2.line(picture, (at, start), (at, min(start + 6, base - 1)), colour, 2)
    for row, name in enumerate(names):
        middle = top + ROW * row + ROW // 2
        draw_text(picture, name, (LEFT - 14, middle + 5), 14, INK, right=True, room=LEFT - 54)
        seen: dict[float, int] = {}
        for who, _, degree in choices:
            if who == name:
                above = seen[degree] = seen.get(degree, -1) + 1
                spot = (column(degree) + 9 * above, middle)
                cv2.circle(picture, spot, 4, INK, -1, cv2.LINE_AA)
        at = column(observers[name])
        cv2.line(picture, (at, middle - 11), (at, middle + 11), BLUE, 2, cv2.LINE_AA)
    for number, (model, colour) in enumerate(zip(models, COLOURS, strict=False)):
        line = base + 74 + 24 * number
        picture[line - 11 : line - 1, 40:50] = colour
        draw_text(
            picture,
            f"{model.name}: nearest d {model.degree:.2f}, {model.delta_e:.1f} dE00 from it; "
            f"{model.chosen_delta_e:.1f} dE00 from the observers' mean",
            (60, line), 14, FAINT, room=WIDTH - 100,
        )  # fmt: skip
    return picture
