"""Whether a photograph that has just been downloaded is kept: the checks of one file, in order."""

from __future__ import annotations

from pathlib import Path

from impasto.capture.devices import Frame
from impasto.capture.examine import Known
from impasto.capture.frames import Picture, read_picture
from impasto.capture.misfires import (
    Misfire,
    blurred,
    clipped,
    dark_reference,
    drifted,
    duplicate_frame,
    light_in_the_dark,
    moved,
    no_light,
    sharpness,
    wrong_exposure,
    wrong_kind,
)
from impasto.capture.shots import Shot
from impasto.errors import CorruptInputError

LEAST_COSINE = 0.05
"""A lamp in the plane of the painting still lights slopes."""


class MisfireError(Exception):
    """A photograph that is not to be kept; never leaves the run."""

    def __init__(self, misfire: Misfire) -> None:
        super().__init__(misfire.why)
        self.misfire = misfire


def refuse(misfire: Misfire | None) -> None:
    """Raise what a check found."""
    if misfire is not None:
        raise MisfireError(misfire)


def accepted(shot: Shot, frame: Frame, path: Path, known: Known, seen: dict[str, str]) -> Picture:
    """The photograph, if it is right as far as it shows by itself.

    Parameters
    ----------
    shot, frame
        What was ordered, and what came.
    path
        The file, under its temporary name.
    known
        What is known of the capture so far.
    seen
        Shots by the hashes of all photographs so far; this one is added.

    Raises
    ------
    MisfireError
        It is not.
    """
    try:
        picture = read_picture(path)
    except CorruptInputError as error:
        raise MisfireError(
            Misfire("corrupt", f"the file {error.problem}", "see to cable and memory card")
        ) from error
    if known.first is not None:
        refuse(wrong_kind(picture, known.first))
    misfire = duplicate_frame(picture.sha256, seen)
    seen[picture.sha256] = shot.name
    refuse(misfire)
    stated = picture.exif.exposure_s if frame.exposure_s is None else frame.exposure_s
    refuse(wrong_exposure(shot.exposure_s, stated))
    if shot.kind == "dark":
        refuse(light_in_the_dark(picture.level, known.darks))
        return picture
    # Of a bracket, only the shortest exposure has to be whole.
    if shot.bracket is None or shot == known.plan.photographs()[shot.bracket][0]:
        refuse(clipped(picture.clipped))
    if known.base is None and shot.kind == "reference":
        refuse(dark_reference(picture.level - known.dark))
    if known.base is None or shot.kind == "board":
        return picture
    base = known.base + known.dark
    refuse(no_light(picture.level, known.dark, base, _share(shot, known)))
    if shot.kind == "reference":
        first = known.patch_of(shot)
        if known.place is not None and first is not None:
            evidence = known.place.evidence(picture)
            refuse(moved(first, evidence.patch))
            refuse(blurred(evidence.sharpness, sharpness(first)))
        if (own := known.base_of(shot)) is not None:
            refuse(drifted(picture.level - known.dark, own))
    return picture


def _share(shot: Shot, known: Known) -> float:
    """Light that a flat painting shows, relative to the reference shot."""
    first = known.plan.of("reference")[0]
    own, reference = (
        max(light[2], LEAST_COSINE)
        for light in (known.plan.light_of(shot), known.plan.light_of(first))
        if light is not None
    )
    share = own / reference * shot.exposure_s / first.exposure_s
    # A long exposure of a bracket clips: no photograph shows more than full scale.
    return min(share, 1.0 / known.base) if known.base else share
