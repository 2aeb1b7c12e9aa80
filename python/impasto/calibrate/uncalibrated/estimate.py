"""Lamps from photographs of a painting alone: uncalibrated photometric stereo of a panel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import numbers, one_of
from impasto.calibrate.uncalibrated.equal_strengths import LEAST, EqualStrengths, equal_strengths
from impasto.calibrate.uncalibrated.factorisation import factorise
from impasto.calibrate.uncalibrated.fall_off import fall_off, inverse_square_share
from impasto.calibrate.uncalibrated.panel import PanelFrame, mirrored, panel_frame
from impasto.calibrate.uncalibrated.patches import Array, Patches
from impasto.calibrate.uncalibrated.resampling import Fit, Sample, mapped, unit
from impasto.calibrate.uncalibrated.result import PanelLights, Side
from impasto.errors import ArgumentError, GeometryError

_SIDES: dict[str, tuple[float, float]] = {
    "left": (-1.0, 0.0), "right": (1.0, 0.0), "top": (0.0, 1.0), "bottom": (0.0, -1.0),
}  # fmt: skip

UNEVEN = 0.025
"""Largest spread of strengths: matte paintings under equal lamps stay below 0.01, glossy ones for
which the model is wrong are above 0.1 (docs/calibrate.md)."""
FOUND = 0.65
"""Least share of the lamps that follow the model: on a glossy relief with 10 of 16 directions were
7 degrees off, with 33 of 48 3 (docs/calibrate.md)."""
FOLLOW = 0.8
"""Least share of the photographs without many highlights that do."""
WORST = 6.0
"""Median error in degrees from which directions are worth nothing."""
CLEAR = 0.7
"""Largest share of the curl of one hand over that of the other for which relief tells the hand."""
SURE = 5.0
"""Standard deviations of the fall-off at which it tells a side, where lamps are ten or more."""
NO_BALL = "photograph a mirror ball beside the painting instead (impasto calibrate lights)"


def lights_from_panel(
    patches: Patches,
    *,
    strengths: ArrayLike | None = None,
    first_from: Side | None = None,
    seed: int = 0,
) -> PanelLights:
    """Directions of lamps from photographs of a painting without balls.

    Photographs are factored into lamps and surface [@hayakawa1994photometric], up to a linear map;
    equal strengths of the lamps leave a rotation; the painting as a whole faces the camera, and
    slopes without curl [@yuille1999determining] leave half a turn, hills for hollows
    [@belhumeur1999basrelief], which the fall-off of near lamps tells, or the caller. Errors are by
    the bootstrap [@efron1979bootstrap] over patches and the jackknife over lamps.

    Parameters
    ----------
    patches
        :func:`impasto.calibrate.read_patches`: of eight photographs or more.
    strengths
        ``(lamp,)`` or ``(lamp, band)`` of the lamps on the painting, as a white board shows them
        (:func:`impasto.calibrate.board_strengths`); default: all are equal.
    first_from
        From which side the first lamp that is known shines; default: the fall-off tells.
    seed
        Of random samples.

    Raises
    ------
    ArgumentError
        Fewer than eight photographs, strengths of another number or not positive.
    GeometryError
        The photographs do not follow the model, or do not tell: the message says in what.
    """
    if first_from is not None:
        one_of(first_from, tuple(_SIDES), "first_from")
    count = len(patches.light)
    if count < LEAST:
        raise ArgumentError(
            f"photographs: {count} are too few to find lamps from them alone; at least {LEAST} "
            f"are needed, under different lamps; or {NO_BALL}"
        )
    strong = np.ones(count)
    if strengths is not None:
        strong = numbers(strengths, "strengths", "one for each lamp").astype(np.float64)
        if strong.ndim == 2:
            strong = strong.mean(axis=1)
        if strong.shape != (count,) or not (strong > 0.0).all():
            raise ArgumentError(
                f"strengths: expected {count} positive numbers, one for each photograph, found "
                f"shape {strong.shape}"
            )
    fields = fall_off(patches)
    light = patches.light / fields.field / strong[:, None, None, None]
    sample = Sample.of(light, seed)
    factors = factorise(sample.values, seed)
    form = equal_strengths(factors.lamps, factors.clean, seed)
    _check_model(form, factors.clean)
    assert form is not None
    known = form.weights > 0.0
    fit = Fit.of(sample, factors, form)
    lamps = factors.lamps @ form.matrix
    surface = mapped(fit.surface(factors.lamps), form.matrix)
    counts = np.ones(light.shape[1])
    frame = panel_frame(lamps, surface, counts)
    mirror = frame.curl > CLEAR * frame.mirrored_curl
    choices = [frame]
    if mirror:
        choices.append(mirrored(frame, surface, counts))
    directions, side = _facing(choices, lamps, fields.slope, known)
    directions = _on_side(directions, side, known, first_from, mirror)
    sigma = fit.errors(directions, known, seed)
    typical = float(np.degrees(np.median(sigma[known])))
    if not typical <= WORST:
        raise GeometryError(
            f"lights: the relief is too flat, or the photographs too noisy, to tell lamps: errors "
            f"of {typical:.0f} degrees; {NO_BALL}"
        )
    directions[~known], sigma[~known] = np.nan, np.nan
    return PanelLights(
        directions, sigma, patches.names, form.spread, frame.curl, frame.mirrored_curl,
        abs(side), first_from,
    )  # fmt: skip


def _check_model(form: EqualStrengths | None, clean: NDArray[np.bool_]) -> None:
    count = len(clean)
    found = 0 if form is None else int((form.weights > 0.0).sum())
    if form is None or found < FOUND * count or found < FOLLOW * clean.sum():
        which = f"only {found} of {count}" if found else "hardly any"
        raise GeometryError(
            f"lights: {which} photographs look like those of a matte relief under equally strong "
            f"lamps: gloss or gold hides the shading, or strengths differ; {NO_BALL}"
        )
    if form.spread > UNEVEN:
        raise GeometryError(
            f"lights: the lamps would differ in strength by {100 * form.spread:.0f} % (standard "
            f"deviation; {100 * UNEVEN:.0f} % is the most for alike lamps): gloss or gold hides "
            f"the shading, or strengths do differ and must be given (--strengths); {NO_BALL}"
        )


def _facing(
    choices: list[PanelFrame], lamps: Array, slope: Array, known: NDArray[np.bool_]
) -> tuple[Array, float]:
    """The hand and side that the fall-off tells, and by how many of its standard deviations."""
    best, found = -1.0, np.empty(0)
    for frame in choices:
        directions = unit(lamps @ frame.matrix)
        t = inverse_square_share(directions[known], slope[known])
        if abs(t) > best:
            best = abs(t)
            found = directions * (-1.0 if t < 0.0 else 1.0, -1.0 if t < 0.0 else 1.0, 1.0)
    return found, best


def _on_side(
    directions: Array,
    side: float,
    known: NDArray[np.bool_],
    first_from: Side | None,
    hand_open: bool,
) -> Array:
    """The directions on the side that the fall-off tells, or the caller."""
    sure = side >= SURE
    if hand_open and not sure:
        raise GeometryError(
            "lights: neither the relief nor the fall-off of the light tells right from left; "
            f"{NO_BALL}"
        )
    first = int(np.flatnonzero(known)[0])
    if first_from is None:
        if not sure:
            raise GeometryError(
                "lights: hills cannot be told from hollows, since the light falls off too little "
                f"over the painting; say from which side photograph {first + 1} is lit "
                "(--first-from left)"
            )
        return directions
    along = float(directions[first, :2] @ _SIDES[first_from])
    if abs(along) < 0.5 * float(np.linalg.norm(directions[first, :2])):
        raise ArgumentError(
            f"first_from: the first lamp stands neither on the {first_from} nor opposite: its "
            f"direction is ({directions[first, 0]:.2f}, {directions[first, 1]:.2f}) or the "
            "reverse; name the nearer side"
        )
    if along < 0.0 and sure and not hand_open:
        raise ArgumentError(
            f"first_from: the light falls off as if the first lamp stood opposite of {first_from}; "
            "look at the first photograph again, or leave this argument out"
        )
    return directions if along > 0.0 else directions * (-1.0, -1.0, 1.0)
