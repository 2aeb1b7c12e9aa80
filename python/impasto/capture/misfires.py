"""Misfires that one photograph shows by itself, or against a reference photograph.

Each check is a function that returns what is wrong, or None. Thresholds lie midway between what a
misfire does at least and what a right photograph shows at most, or are derived beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impasto.align.refinement import FARTHEST, LEAST_SCORE, gradient_picture, middle, shift_between
from impasto.capture.devices import Pose
from impasto.capture.frames import Image, Picture

LEAST_LIGHT = 0.1
"""Share of the expected light from which a lamp counts as on. Lamps of one rig differ by a factor
of two and shadows of relief take a half at most, which leaves a quarter; the light of a room that
a capture can bear is a few hundredths."""
LEAST_REFERENCE = 0.01
"""Share of full scale: shot noise of 300 electrons, of 30 000, is 6 % of the light of a pixel."""
MOST_CLIPPED = 0.5
"""Share of clipped pixels from which most of a photograph says nothing: medians over it fail. A
gilded icon under lamps in the mirror direction has 45 %."""
EQUAL_EXPOSURE = 0.02
"""Relative difference of exposure times that counts as none: cameras round 1/127 s to 1/125 s."""
LEAST_SHIFT = 0.5
"""Pixels, half of the smallest shift that is searched for, of two pictures in the same light."""
LEAST_SHIFT_OF_ANOTHER_LAMP = 1.5
"""Pixels. Relief that is lit from another side seems to move by up to one pixel where there are few
windows to compare."""
LEAST_SHARPNESS = 0.5
"""Relative to a picture in the same light. A blur of one pixel (standard deviation) leaves a
quarter and less of the variance."""
WARM = 0.003
"""Relative difference of three consecutive reference frames of a lamp that is warm."""
LARGEST_DRIFT = 0.015
"""Relative: five times what a warm lamp varies by, a third of the 5 % that falsify a reflectance.
"""
SAME_POSE = float(np.radians(0.1))
"""Radians: what normals of good photographs are off by."""
CLOCK_JUMP_S = 3.0
"""EXIF counts whole seconds, and a download takes about one more or less than the last."""
NEEDED = 80
"""Pixels along the shorter side from which shifts can be estimated: 4 x 4 windows of 31 pixels."""


@dataclass(frozen=True)
class Misfire:
    """What is wrong with a photograph.

    Parameters
    ----------
    code
        A stable word for programs: the name of the check, with hyphens.
    why
        One sentence for people.
    advice
        What to do.
    """

    code: str
    why: str
    advice: str


def no_light(level: float, dark: float, reference: float, share: float) -> Misfire | None:
    """Less than a tenth of the light that a flat painting would show.

    Parameters
    ----------
    level, dark, reference
        Mean light of the photograph, of dark frames, and of the reference shot.
    share
        Cosine of the lamp's angle over that of the reference lamp, and ratio of their exposures.
    """
    expected = (reference - dark) * share
    if level - dark >= LEAST_LIGHT * expected:
        return None
    percent = 100.0 * max(level - dark, 0.0) / max(expected, 1e-12)
    return Misfire(
        "no-light",
        f"no light: {percent:.0f} % of what this lamp should give",
        "see whether the lamp is on when it should be, and whether something stands before it",
    )


def dark_reference(above: float) -> Misfire | None:
    """A reference shot with less than 1 % of full scale, which all others are compared with.

    Parameters
    ----------
    above
        Its mean light above the dark frames.
    """
    if above >= LEAST_REFERENCE:
        return None
    return Misfire(
        "no-light",
        f"the reference shot is dark: {100.0 * max(above, 0.0):.1f} % of full scale",
        "see whether its lamp is on and the lens is open; if so, take a longer exposure",
    )


def light_in_the_dark(level: float, darks: Sequence[float]) -> Misfire | None:
    """A dark frame that is brighter than 2 % of full scale, and than twice the other dark frames.

    The black level of cameras is 0.1 to 1.6 % of full scale.
    """
    if level <= max(0.02, 2.0 * float(np.median(darks)) if darks else 0.0):
        return None
    return Misfire(
        "light-in-the-dark",
        f"a dark frame with light: {100.0 * level:.1f} % of full scale",
        "switch off all lamps and the light of the room, or cover the lens",
    )


def clipped(share: float) -> Misfire | None:
    """More than half of the pixels are clipped."""
    if share <= MOST_CLIPPED:
        return None
    return Misfire(
        "clipped",
        f"{100.0 * share:.0f} % of the pixels are overexposed",
        "take a shorter exposure for all shots",
    )


def wrong_exposure(ordered_s: float, found_s: float | None) -> Misfire | None:
    """An exposure time that differs by more than 2 %."""
    if found_s is None or abs(found_s / ordered_s - 1.0) <= EQUAL_EXPOSURE:
        return None
    return Misfire(
        "wrong-exposure",
        f"the camera says {1000.0 * found_s:.4g} ms, the plan {1000.0 * ordered_s:.4g} ms",
        "set the camera to manual exposure (M), and choose a time that it has",
    )


def wrong_pose(ordered: Pose, found: Pose) -> Misfire | None:
    """A pose that is read back and differs by more than 0.1 degrees in any angle."""
    off: dict[str, float] = {}
    for name, angle in ordered.angles.items():
        off[f"joint {name}"] = abs(found.angles.get(name, np.inf) - angle)
    for name in ("view", "light"):
        one, other = getattr(ordered, name), getattr(found, name)
        if one is not None and other is not None:
            off[name] = float(np.linalg.norm(np.subtract(one, other)))
    worst = max(off, key=lambda name: off[name], default="")
    if not worst or off[worst] <= SAME_POSE:
        return None
    if not np.isfinite(off[worst]):
        why = f"the stage does not say where its {worst} is"
    else:
        why = f"the stage is off by {np.degrees(off[worst]):.2g} degrees ({worst})"
    return Misfire("wrong-pose", why, "see whether something blocks the stage, and home it again")


def duplicate_frame(sha256: str, known: Mapping[str, str]) -> Misfire | None:
    """The file of another shot once more: two photographs differ by their noise.

    Parameters
    ----------
    sha256
        Of the file.
    known
        Names of shots by the hashes of their files.
    """
    if (other := known.get(sha256)) is None:
        return None
    return Misfire(
        "duplicate",
        f"the same file as that of {other}: the camera has sent an old photograph",
        "switch the camera off and on",
    )


def sharpness(light: Image) -> float:
    """Variance of the Laplacian [@pechpacheco2000diatom] of the logarithm of the light."""
    import cv2

    inner = middle(light)
    level = max(float(np.median(inner)), 1e-6)
    tone = np.log(np.maximum(inner, 0.0) / level + 0.1).astype(np.float32)
    return float(np.asarray(cv2.Laplacian(tone, cv2.CV_32F)).var(dtype=np.float64))


def blurred(found: float, reference: float) -> Misfire | None:
    """Less than half of the sharpness of a picture in the same light (:func:`sharpness`)."""
    if found >= LEAST_SHARPNESS * reference:
        return None
    return Misfire(
        "blurred",
        f"blurred: {100.0 * found / reference:.0f} % of the sharpness that this light should give",
        "see that nothing shook, and that the focus is fixed (manual focus)",
    )


def moved(reference: Image, light: Image, least: float = LEAST_SHIFT) -> Misfire | None:
    """The picture lies ``least`` pixels or more from the reference.

    By Lucas and Kanade's method as :mod:`impasto.align` uses it; pictures that are too small or
    have nothing in common are not judged.
    """
    if min(light.shape) < NEEDED or light.shape != reference.shape:
        return None
    found = shift_between(reference, light)
    x, y = found.x, found.y
    if found.refused:
        # Far from the reference the flow is lost; phase correlation still finds a clear shift.
        x, y = found.phase_x, found.phase_y
        if not _agrees(reference, light, x, y):
            return None
    if np.hypot(x, y) < least:
        return None
    ways = [
        f"{abs(x):.1f} px to the {'right' if x > 0 else 'left'}" if abs(x) >= 0.05 else "",
        f"{abs(y):.1f} px {'down' if y > 0 else 'up'}" if abs(y) >= 0.05 else "",
    ]
    return Misfire(
        "moved",
        f"the picture has moved {' and '.join(filter(None, ways))} against the others",
        "see that camera and painting stand firm; if one has moved for good, begin a new capture",
    )


def surely_still(reference: Image, light: Image) -> bool:
    """Whether two pictures in the same light are too alike for a shift of half a pixel.

    A small shift d changes a picture by d times its slope. Where the difference, after a gain, is
    less than half of that of the least shift across the weakest slopes, the flow need not be found.
    """
    one, other = reference.astype(np.float64), light.astype(np.float64)
    gain = float((one * other).sum()) / max(float((one * one).sum()), 1e-12)
    down, across = np.gradient(gain * one)
    mixed = float((down * across).mean())
    tensor = [[float((across**2).mean()), mixed], [mixed, float((down**2).mean())]]
    weakest = max(float(np.linalg.eigvalsh(tensor)[0]), 0.0)
    change = float(np.square(other - gain * one).mean())
    return change < (0.5 * LEAST_SHIFT) ** 2 * weakest


def _agrees(reference: Image, light: Image, x: float, y: float) -> bool:
    """Whether the pictures are alike after a shift of whole pixels, and unlike without."""
    first, second = (gradient_picture(middle(one)) for one in (reference, light))
    right, down = round(x), round(y)
    limit = 4 * round(FARTHEST)
    if not 0 < max(abs(right), abs(down)) <= limit:
        return False
    edge = limit + 1
    if min(first.shape) < 4 * edge:
        return False
    inner = np.s_[edge:-edge, edge:-edge]
    back = np.roll(second, (-down, -right), (0, 1))
    here, there = (
        float(np.corrcoef(first[inner].ravel(), one[inner].ravel())[0, 1]) for one in (second, back)
    )
    return there >= LEAST_SCORE and there > here


def drifted(level: float, reference: float) -> Misfire | None:
    """A reference shot whose light has changed by more than 1.5 %.

    Parameters
    ----------
    level, reference
        Mean light above the dark frames, of this reference shot and of the first one.
    """
    change = level / reference - 1.0
    if abs(change) <= LARGEST_DRIFT:
        return None
    return Misfire(
        "lamp-drift",
        f"the reference lamp is {100.0 * abs(change):.1f} % "
        f"{'brighter' if change > 0 else 'darker'} than at the beginning",
        "let the lamps warm up, and see to a stable power supply",
    )


def warmed_up(levels: Sequence[float]) -> bool:
    """Whether the last three reference frames differ by less than 0.3 %."""
    last = np.asarray(levels[-3:])
    return len(last) == 3 and float(np.ptp(last)) < WARM * float(last.mean())


def clock_jump(before_s: float, after_s: float) -> str | None:
    """What a change of the camera's clock against this computer's is called; None: no change.

    Parameters
    ----------
    before_s, after_s
        Clock of the camera minus that of the computer, for two photographs in sequence.
    """
    change = after_s - before_s
    if abs(change) <= CLOCK_JUMP_S:
        return None
    return (
        f"the clock of the camera has jumped {abs(change):.0f} s "
        f"{'forward' if change > 0 else 'back'}; shots keep their order, which is that of the "
        "journal"
    )


def wrong_kind(picture: Picture, first: Picture) -> Misfire | None:
    """Another size, format or type than the first photograph of the capture."""
    if picture.kind == first.kind:
        return None
    one, other = (f"{k[1]} x {k[2]} {k[0]} of {k[3]} x {k[4]}" for k in (picture.kind, first.kind))
    return Misfire(
        "wrong-kind",
        f"a picture of another kind, {one}, where the first one is {other}",
        "set size and format of the camera's files as at the beginning",
    )
