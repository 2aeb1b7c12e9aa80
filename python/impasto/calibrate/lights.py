"""Light directions, and positions where they can be told, from photographs of mirror balls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import one_of, positive
from impasto.calibrate.adjustment import LEVEL, Adjustment, adjust
from impasto.calibrate.geometry import Array, BallCamera, tangents
from impasto.calibrate.highlight import Highlight, Rule, find_highlight, median_highlight
from impasto.calibrate.outline import Outline, check_inside, find_outline
from impasto.calibrate.painting_frame import PaintingFrame
from impasto.errors import ArgumentError, GeometryError

ENOUGH = 0.75
"""Support of an outline with which no other picture of the ball is tried."""


@dataclass(frozen=True, eq=False)
class BallPhotographs:
    """One ball under every lamp.

    Parameters
    ----------
    pictures
        ``(lamp, y, x)``: brightness (:func:`impasto.calibrate.luma`).
    name
        Of the ball, for messages.
    corner
        (x, y) of the first pixel in the whole frame, where the pictures are crops of it; None:
        not known.
    references
        ``(n, y, x)``: other pictures of the ball in the same place, in which its edge is seen.
    outline
        The outline in pixels of ``pictures``; None: found.
    full
        Brightness of a clipped pixel, where known.
    names
        Of the photographs, for messages.
    """

    pictures: Array
    name: str
    corner: tuple[float, float] | None = None
    references: Array | None = None
    outline: Outline | None = None
    full: float | None = None
    names: tuple[str, ...] = ()

    def where(self, lamp: int) -> str:
        """What a photograph is called."""
        name = self.names[lamp] if self.names else f"photograph {lamp + 1}"
        return f"{self.name}/{name}"


@dataclass(frozen=True, eq=False)
class BallLights:
    """Lamps as mirror balls show them.

    Parameters
    ----------
    directions
        ``(lamp, 3)`` unit vectors to the lamps, as if all were distant: x right, y up, z towards
        the camera; :meth:`from_middle` gives those of near lamps.
    sigma
        ``(lamp,)`` standard deviation in radians, along the worse axis.
    single
        ``(ball, lamp, 3)`` directions by each ball alone.
    outlines, highlights
        Of each ball, and of each ball and lamp, in pixels of its photographs.
    near
        ``(lamp,)`` whether the balls can tell that a lamp is near (:attr:`Adjustment.near`).
    distant_fit
        The adjustment with all lamps distant.
    near_fit
        That with free distances; None where the places of the balls in one frame are not known, or
        there is one ball.
    """

    directions: Array
    sigma: Array
    single: Array
    outlines: tuple[Outline, ...]
    highlights: tuple[tuple[Highlight, ...], ...]
    near: NDArray[np.bool_]
    distant_fit: Adjustment
    near_fit: Adjustment | None

    @property
    def verdict(self) -> str:
        """What the balls tell of the distances of the lamps, in words."""
        if self.near_fit is None:
            if len(self.outlines) > 1:
                return "distant: the places of the balls in one frame are not known"
            return "distant: one ball cannot tell distances"
        count = int(self.near.sum())
        test = f"Student's t test of the inverse distance, one-sided at {LEVEL:g}"
        largest = float(np.nanmax(self.near_fit.t))
        if count == 0:
            return (
                f"distant: no lamp is nearer than the errors allow ({test}; t up to {largest:.1f})"
            )
        return f"{count} of {len(self.near)} lamps are near ({test})"

    def in_frame(self, frame: PaintingFrame) -> BallLights:
        """The same with directions in the frame of the painting."""
        return replace(self, directions=frame.directions(self.directions))

    def from_middle(self, camera: BallCamera) -> BallLights:
        """The same with directions from the middle of the photograph, on the plane of the balls.

        Near lamps shine on the painting from elsewhere than on the balls beside it.

        Parameters
        ----------
        camera
            With which the lamps were found, its principal point in the middle of the photograph.
        """
        near = self.near_fit
        if near is None:
            return self
        offset = near.origin - (0.0, 0.0, _plane(near, camera))
        towards = near.direction + near.inverse_distance[:, None] * offset
        length = np.linalg.norm(towards, axis=1, keepdims=True)
        towards = towards / length
        axes = (*tangents(near.direction), np.broadcast_to(offset, towards.shape))
        across = np.stack(tangents(towards), axis=1) @ np.stack(axes, axis=2) / length[..., None]
        spread = across @ near.covariance @ np.swapaxes(across, 1, 2)
        sigma = np.sqrt(np.linalg.eigvalsh(spread)[:, -1])
        return replace(
            self,
            directions=np.where(self.near[:, None], towards, self.directions),
            sigma=np.where(self.near, sigma, self.sigma),
        )


def lights_from_balls(
    balls: Sequence[BallPhotographs],
    camera: BallCamera | None = None,
    *,
    rule: Rule = "centroid",
) -> BallLights:
    """Directions of lamps from photographs of one mirror ball or more.

    The outline of each ball is found, then its highlight under each lamp, and all of them are
    adjusted together; see ``impasto.calibrate.adjustment`` for formulas and the test.

    Parameters
    ----------
    balls
        One or more, photographed under the same lamps in the same order.
    camera
        Default: orthographic.
    rule
        How the place of a highlight is found: ``"centroid"``, or ``"median"`` as published with
        Xiong's data [@xiong2014psbox].

    Raises
    ------
    ArgumentError
        No ball, one cut off by a border, no highlight, two highlights, one at the rim, NaN, other
        numbers of photographs, another order of lamps: the message names ball and photograph.
    """
    one_of(rule, ("centroid", "median"), "rule")
    if not balls:
        raise ArgumentError("balls: expected photographs of one ball or more, found none")
    counts = {ball.name: len(ball.pictures) for ball in balls}
    if len(set(counts.values())) > 1 or not all(counts.values()):
        raise ArgumentError(
            f"balls: expected as many photographs of every ball, found {counts}: one for each lamp"
        )
    camera = BallCamera() if camera is None else camera
    if camera.perspective and any(ball.corner is None for ball in balls):
        raise ArgumentError("corner: a perspective camera needs the place of the ball in its frame")
    outlines, highlights = [], []
    for ball in balls:
        own = _camera_of(ball, camera)
        outline = outline_of(ball, own)
        outlines.append(outline)
        still = ball.pictures.min(axis=0) if len(ball.pictures) > 3 else None
        highlights.append(
            tuple(
                median_highlight(picture, ball.where(lamp))
                if rule == "median"
                else find_highlight(
                    picture, outline.numbers, own, ball.where(lamp), still=still, full=ball.full
                )
                for lamp, picture in enumerate(ball.pictures)
            )
        )
    corners = np.array([ball.corner or (0.0, 0.0) for ball in balls])
    numbers = np.array([outline.numbers for outline in outlines])
    numbers[:, :2] += corners
    covariance = np.array([outline.covariance for outline in outlines])
    pixels = np.array([[(one.x, one.y) for one in row] for row in highlights])
    pixels = pixels + corners[:, None]
    sigma = np.array([[one.sigma for one in row] for row in highlights])
    _, single = camera.reflected(np.broadcast_to(numbers[:, None], (*pixels.shape[:2], 3)), pixels)
    if not np.isfinite(single).all():
        which, lamp = (int(at[0]) for at in np.nonzero(~np.isfinite(single).all(axis=2)))
        raise GeometryError(
            f"{balls[which].where(lamp)}: the highlight lies outside the outline of the ball; "
            "correct the outline"
        )
    _check_order(single, [ball.name for ball in balls])
    table = (camera, numbers, covariance, pixels, sigma)
    distant = adjust(*table, distant=True)
    placed = len(balls) > 1 and all(ball.corner is not None for ball in balls)
    near = adjust(*table, distant=False) if placed else None
    worst = np.sqrt(np.linalg.eigvalsh(distant.covariance[:, :2, :2])[:, -1])
    known = np.zeros(pixels.shape[1], dtype=bool) if near is None else near.near
    return BallLights(
        distant.direction, worst, single, tuple(outlines), tuple(highlights), known, distant, near
    )


def _plane(fit: Adjustment, camera: BallCamera) -> float:
    """Z of the plane on which the balls lie, in the camera frame."""
    middle, radius = camera.balls(fit.outlines)
    return float((middle[:, 2] - radius).mean())


@dataclass(frozen=True, eq=False)
class LampPositions:
    """Where near lamps stand, as :func:`lamp_positions` finds it.

    Parameters
    ----------
    mm
        ``(lamp, 3)`` x right, y up, z towards the camera, from the middle of the photograph on the
        plane on which the balls lie; with a frame in that of the painting.
    sigma
        ``(lamp,)`` standard deviation in mm along the worst axis.
    pitch_mm
        Width of a pixel of the photograph on that plane.
    """

    mm: Array
    sigma: Array
    pitch_mm: float


def lamp_positions(
    found: BallLights,
    diameter_mm: float,
    camera: BallCamera | None = None,
    frame: PaintingFrame | None = None,
) -> LampPositions:
    """The positions of lamps in mm, from balls of a known size that lie on the painting's plane.

    Parameters
    ----------
    found
        What :func:`lights_from_balls` returned.
    diameter_mm
        Of every ball.
    camera
        The same as there, with its principal point in the middle of the photograph.
    frame
        How a near camera looks at the painting, from whose middle the positions then are.

    Raises
    ------
    ArgumentError
        A frame, but a camera that is far away.
    GeometryError
        The balls cannot tell that every lamp is near.
    """
    diameter = positive(diameter_mm, "diameter_mm", "the diameter of the balls in mm")
    near = found.near_fit
    if near is None or not found.near.all():
        numbers = ", ".join(str(lamp + 1) for lamp in np.flatnonzero(~found.near))
        which = "" if near is None else f"; lamps without a distance: {numbers}"
        raise GeometryError(
            f"lights: positions are not known ({found.verdict}){which}; use the directions"
        )
    camera = BallCamera() if camera is None else camera
    if frame is not None and not camera.perspective:
        raise ArgumentError("frame: it needs a near camera, BallCamera(focal_px=...)")
    _, radius = camera.balls(near.outlines)
    plane = _plane(near, camera)
    unit = diameter / (2.0 * float(radius.mean()))
    far = 1.0 / near.inverse_distance
    place = near.origin + near.direction * far[:, None]
    right, up = tangents(near.direction)
    slopes = np.stack(
        [right * far[:, None], up * far[:, None], -near.direction * np.square(far)[:, None]], axis=2
    )
    spread = np.einsum("lij,ljk,lmk->lim", slopes, near.covariance, slopes)
    worst = np.sqrt(np.linalg.eigvalsh(spread)[:, -1])
    pitch = unit if camera.focal_px is None else -plane * unit / camera.focal_px
    if frame is None:
        return LampPositions(unit * (place - (0.0, 0.0, plane)), unit * worst, pitch)
    return LampPositions(frame.places(unit * place), unit * worst, pitch)


def _camera_of(ball: BallPhotographs, camera: BallCamera) -> BallCamera:
    """The camera in pixels of a ball's own pictures."""
    x, y = ball.corner or (0.0, 0.0)
    return BallCamera(camera.focal_px, (camera.centre[0] - x, camera.centre[1] - y))


def outline_of(ball: BallPhotographs, camera: BallCamera) -> Outline:
    """The given outline, or that of the picture in which most of it is seen."""
    for lamp, picture in enumerate(ball.pictures):
        if not np.isfinite(picture).all():
            raise ArgumentError(
                f"{ball.where(lamp)}: {int((~np.isfinite(picture)).sum())} pixels are NaN or "
                "infinite; write the file again"
            )
    if ball.outline is not None:
        check_inside(ball.outline, ball.pictures.shape[1:], camera, ball.name)
        return ball.outline
    pictures = [] if ball.references is None else list(ball.references)
    pictures += [ball.pictures.max(axis=0), ball.pictures.mean(axis=0)]
    found: list[Outline] = []
    problem: ArgumentError | None = None
    for picture in pictures:
        try:
            found.append(find_outline(picture, camera, ball.name))
        except ArgumentError as error:
            problem = error if problem is None else problem
            continue
        if found[-1].support >= ENOUGH:
            break
    if not found:
        assert problem is not None
        raise problem
    return max(found, key=lambda outline: outline.support)


def _check_order(single: Array, names: Sequence[str]) -> None:
    """Refuse balls whose directions agree only in reverse order, or mirrored."""
    if single.shape[1] < 3:
        return
    first = single[0]
    for name, own in zip(names[1:], single[1:], strict=True):
        apart = float(np.square(first - own).sum())
        others = {
            "in the reverse order of lamps": own[::-1],
            "mirrored left to right": own * (-1.0, 1.0, 1.0),
            "upside down": own * (1.0, -1.0, 1.0),
        }
        for words, changed in others.items():
            if float(np.square(first - changed).sum()) < 0.04 * apart:
                raise ArgumentError(
                    f"{name}: its photographs seem to be {words}, compared with {names[0]}; "
                    "name or turn them as those of the other ball"
                )
