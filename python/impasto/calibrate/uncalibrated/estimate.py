"""Lamps from photographs of a painting alone: uncalibrated photometric stereo of a panel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import numbers, one_of
from impasto.calibrate.uncalibrated.equal_strengths import (
    LEAST,
    EqualStrengths,
    equal_strengths,
    same_lamps,
)
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
"""Largest spread of strengths: lamps that differ by 2 % are 1.6 degrees off, which the errors say;
rough gloss, for which the model is wrong, looks like 3 % (docs/calibrate.md)."""
FOUND = 0.65
"""Least share of the lamps that follow the model: on a glossy relief with 10 of 16 directions were
7 degrees off, with 33 of 48 3 (docs/calibrate.md)."""
FOLLOW = 0.8
"""Least share of the photographs without many highlights that do."""
UNLIT = 0.005
"""Share of the median light below which a lamp does not light a painting: 0.3 degrees of grazing
light."""
PIXELS_LEAST = 500
"""Pixels of a patch: the fewest that any photographs can show and that are enough for factors."""
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
        Fewer than eight photographs, one that no lamp lights, strengths of another number or not
        positive, a side that the photographs contradict.
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
        strong = _checked(numbers(strengths, "strengths", "one for each lamp"), count)
    _check_lit(patches, strong)
    _check_copies(patches)
    fields = fall_off(patches)
    # Of size 1 whatever the unit: products of numbers near the ends of floats are no numbers.
    unit_of_light = float(np.nanmedian(patches.light))
    light = patches.light / unit_of_light / fields.field / strong[:, None, None, None]
    sample = Sample.of(light, seed)
    if sample.values.shape[1] < PIXELS_LEAST:
        raise ArgumentError(
            f"photographs: only {sample.values.shape[1]} of their pixels show something under "
            f"most lamps; at least {PIXELS_LEAST} are needed"
        )
    factors = factorise(sample.values, seed)
    groups = same_lamps(factors.lamps, factors.clean)
    _check_different(groups, count)
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
    sigma = fit.errors(directions, known, groups, seed)
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


def _checked(strengths: NDArray[np.generic], count: int) -> Array:
    """``(lamp,)`` strengths of mean 1."""
    strong = strengths.astype(np.float64)
    flat = strong.ndim in (1, 2) and len(strong) == count and strong.size > 0
    if not flat or not (np.isfinite(strong) & (strong > 0.0)).all():
        raise ArgumentError(
            f"strengths: expected {count} positive numbers, one for each photograph, or as many "
            f"rows of them, one for each band, found shape {strong.shape}"
        )
    strong = strong / strong.max()
    strong = strong.reshape(count, -1).mean(axis=1)
    return np.asarray(strong / np.median(strong))


def _check_lit(patches: Patches, strong: Array) -> None:
    level = np.nanmedian(patches.light.reshape(len(strong), -1), axis=1) / strong
    dark = np.flatnonzero(level <= UNLIT * np.median(level))
    if len(dark):
        raise ArgumentError(
            f"photographs: {patches.names[dark[0]]} is almost black beside the others: its lamp "
            "did not light, or stands behind the painting; leave it out"
        )


def _check_copies(patches: Patches) -> None:
    seen: dict[bytes, str] = {}
    for light, name in zip(patches.light, patches.names, strict=True):
        first = seen.setdefault(light.tobytes(), name)
        if first != name:
            raise ArgumentError(
                f"photographs: {name} is a copy of {first}: leave one of them out, and count the "
                "lamps again"
            )


def _check_different(groups: NDArray[np.intp], count: int) -> None:
    different = len(np.unique(groups))
    if different < LEAST:
        raise GeometryError(
            f"lights: the {count} photographs show only {different} different lamps, the same one "
            f"under several names; at least {LEAST} are needed, in different places; or {NO_BALL}"
        )


def _check_model(form: EqualStrengths | None, clean: NDArray[np.bool_]) -> None:
    count = len(clean)
    found = 0 if form is None else int((form.weights > 0.0).sum())
    if form is None or found < FOUND * count or found < FOLLOW * clean.sum():
        which = f"only {found} of {count}" if found else "hardly any"
        raise GeometryError(
            f"lights: {which} photographs look like those of a matte relief under equally strong "
            f"lamps: gloss or gold hides the shading, there is no relief, "
            f"or strengths differ; {NO_BALL}"
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
