"""Which tone curve the photographs of a session have: given, stated by the files, or assumed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.io.images import ImageHeader
from impasto.io.images.profile import OTHER
from impasto.io.notes import Notebook
from impasto.io.session.tone import ToneEstimate, estimate_tone, sure_tone
from impasto.io.tone_curve import named_curve

ASSUMED = "assumed"

_JPEG = {".jpg", ".jpeg", ".jpe"}


@dataclass(frozen=True, eq=False)
class Photographs:
    """What a tone curve is estimated from.

    Attributes
    ----------
    codes
        ``(obs, band, y, x)`` as stored in the files.
    full
        Code of full scale.
    directions, strengths
        ``(obs, 3)`` and ``(obs, 1)`` or ``(obs, band)`` of the lights.
    saturation
        ``(band,)`` code from which a sample is clipped, or None.
    mask
        ``(y, x)``, or None.
    """

    codes: NDArray[Any]
    full: float
    directions: NDArray[np.float64]
    strengths: NDArray[np.float64]
    saturation: NDArray[np.float64] | None
    mask: NDArray[np.bool_] | None

    def estimate(self) -> ToneEstimate:
        """The curve that predicts held-out photographs best."""
        return estimate_tone(
            self.codes,
            self.directions,
            white=self.full,
            saturation=self.saturation,
            mask=self.mask,
            intensities=self.strengths,
        )

    def sure(self) -> ToneEstimate | None:
        """The estimate, if it is beyond doubt that the photographs are not sRGB."""
        return sure_tone(
            self.codes,
            self.directions,
            white=self.full,
            saturation=self.saturation,
            mask=self.mask,
            intensities=self.strengths,
        )


def choose_curve(
    encoding: Encoding | str | None,
    photographs: Photographs,
    header: ImageHeader,
    first: Path,
    notebook: Notebook,
) -> Encoding:
    """The tone curve of a session; a note of kind ``"encoding"`` says what was not given.

    Parameters
    ----------
    encoding
        As :func:`impasto.read_stack` takes it; None: what the files state, or hold as a rule.
    photographs
        All of them.
    header
        Of the first file; its profile is that of all files.
    first
        The first file.
    notebook
        Takes the notes.
    """
    full = photographs.full
    if isinstance(encoding, Encoding):
        return encoding
    if encoding is None:
        return Encoding(_usual(photographs, header, first.parent, notebook), full)
    if str(encoding).lower() == "auto":
        return Encoding(_taken(photographs.estimate(), first.parent, notebook), full)
    given = Encoding(named_curve(encoding), full)
    if given.curve == "linear" and first.suffix.lower() in _JPEG:
        message = "JPEGs, read as linear light; most are sRGB (encoding=)"
        notebook.warn("encoding", first.parent, message)
    return given


def _usual(photographs: Photographs, header: ImageHeader, folder: Path, notebook: Notebook) -> str:
    """The profile of 8-bit files, else sRGB; all others are linear, whatever their profile."""
    if photographs.full != 255.0:
        message = "files with more than 8 bits, read as linear light"
        if header.curve in {"", "linear"}:
            notebook.say("encoding", folder, message, ASSUMED)
        else:
            curve = "" if header.curve == OTHER else f", {header.curve}"
            advice = "give encoding= if their codes follow it"
            message += f", but their profile has another curve{curve}; {advice}"
            notebook.warn("encoding", folder, message, ASSUMED)
        return "linear"
    if header.curve == OTHER:
        notebook.warn(
            "encoding",
            folder,
            "8-bit files with a profile of an unusual tone curve, read as srgb; export them as "
            "sRGB, or give encoding=",
            ASSUMED,
        )
        return "srgb"
    if header.curve:
        message = f"8-bit files, read as {header.curve}, as their profile states"
        notebook.say("encoding", folder, message, "profile")
        return header.curve
    estimate = photographs.sure()
    if estimate is not None:
        return _taken(estimate, folder, notebook)
    notebook.say("encoding", folder, "8-bit files without a profile, read as srgb", ASSUMED)
    return "srgb"


def _taken(estimate: ToneEstimate, folder: Path, notebook: Notebook) -> str:
    notebook.take(replace(estimate, where=str(folder)))
    return estimate.curve
