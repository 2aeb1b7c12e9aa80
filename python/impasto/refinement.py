"""What the photographs of a stack said about their rig."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Any

from impasto._internal.damage import DAMAGE
from impasto.errors import ArgumentError


@dataclass(frozen=True, slots=True)
class Estimate:
    """One estimated property of a rig.

    Attributes
    ----------
    found
        The value that predicts photographs held out best.
    accepted
        Whether the refined rig has it; if not, it keeps what was given.
    reason
        Why, in a few words.
    """

    found: float
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True)
class RigRefinement:
    """What :func:`impasto.refine_rig` found, accepted and could not determine.

    Attributes
    ----------
    camera, lamps
        Distance of the camera and of the lamps from the middle of the painting, in halves of the
        longer side of the picture; infinite where the best is far away.
    strengths
        The largest strength divided by the smallest, once estimated.
    half_mm
        Half of the longer side in mm, or in pixels if the width of a pixel is not known.
    gain, scatter
        Gain on photographs held out, dB per photograph: mean and its standard error, each
        photograph with a strength of its own.
    open
        What the photographs do not determine: held as given.
    in_mm
        Whether lengths of the rig are in mm; False: in pixels, as nobody has said how wide one is.
    """

    camera: Estimate
    lamps: Estimate
    strengths: Estimate
    half_mm: float
    gain: float
    scatter: float
    open: tuple[str, ...]
    in_mm: bool = True

    @property
    def accepted(self) -> bool:
        """Whether anything differs from the rig that was given."""
        return self.camera.accepted or self.lamps.accepted or self.strengths.accepted

    def __str__(self) -> str:
        lamps = f"{_distance('lamps', self.lamps)}; {self._strengths()}"
        left = ", ".join(self.open) if self.open else "nothing"
        gain = f"{self.gain:+.2f} ± {self.scatter:.2f} dB on photographs held out"
        return f"{_distance('camera', self.camera)}\n{lamps}\n{gain}; held as given: {left}"

    def _strengths(self) -> str:
        one = self.strengths
        if one.accepted:
            return f"strengths differ by a factor of {one.found:.2f} ({one.reason})"
        return f"strengths as given ({one.reason})"

    def to_json(self) -> str:
        """The fields as JSON, for files."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> RigRefinement:
        """The inverse of :meth:`to_json`.

        Raises
        ------
        ArgumentError
            Another text.
        """
        try:
            fields: dict[str, Any] = json.loads(text)
            for name in ("camera", "lamps", "strengths"):
                fields[name] = Estimate(**fields[name])
            return cls(**(fields | {"open": tuple(fields["open"])}))
        except DAMAGE as error:
            raise ArgumentError(
                f"refinement: no saved refinement of a rig ({type(error).__name__}: {error})"
            ) from error


def _distance(what: str, one: Estimate) -> str:
    far = "far away" if math.isinf(one.found) else f"{one.found:.2f} half-sides away"
    if one.accepted:
        return f"{what}: {far} ({one.reason})"
    return f"{what}: as given ({one.reason})"
