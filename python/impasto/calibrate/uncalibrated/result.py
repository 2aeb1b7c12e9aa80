"""What photographs of a painting alone tell of lamps, and what was taken for granted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.uncalibrated.patches import Array
from impasto.io.images.write import write_json

Side = Literal["left", "right", "top", "bottom"]


@dataclass(frozen=True, eq=False)
class PanelLights:
    """Lamps as photographs of a painting alone show them.

    Parameters
    ----------
    directions
        ``(lamp, 3)`` unit vectors: x right, y up, z towards the camera; NaN for lamps that are not
        known, since highlights cover their photographs.
    sigma
        ``(lamp,)`` standard deviation in radians along the worse axis, of what the photographs
        tell; not of what is taken for granted (:attr:`assumptions`).
    names
        Of the photographs.
    unevenness
        Standard deviation of the strengths that lamps seem to have.
    curl, mirrored_curl
        Of the relief, and of its mirror image.
    side
        Rise of the light towards the lamps by the inverse square law, in its standard deviations.
    given
        The side that the caller gave, or None.
    """

    directions: Array
    sigma: Array
    names: tuple[str, ...]
    unevenness: float
    curl: float
    mirrored_curl: float
    side: float
    given: Side | None

    @property
    def known(self) -> NDArray[np.bool_]:
        """``(lamp,)`` whether a direction is known."""
        return np.isfinite(self.directions[:, 0])

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What photographs of a painting alone do not tell, and what was taken for it."""
        side = (
            f"the first lamp stands {_WHERE[self.given]}, as given"
            if self.given is not None
            else "hills are told from hollows by the fall-off of the light, "
            f"{self.side:.0f} standard deviations from none"
        )
        return (
            "all lamps are equally strong on the painting, or as strong as given",
            "values are proportional to the light of one lamp: a wrong --encoding, black level or "
            "light of the room turns lamps",
            "the painting as a whole faces the camera: a tilt of it would turn all lamps",
            side,
        )

    def save_report(self, path: str | Path) -> None:
        """Write directions, errors and what was taken for granted as JSON (replaced atomically)."""
        write_json(
            Path(path),
            {
                "kind": "impasto lights from a painting",
                "version": 1,
                "lights": [
                    {
                        "photograph": name,
                        "direction": direction if known else None,
                        "sigma_degrees": sigma if known else None,
                    }
                    for name, direction, sigma, known in zip(
                        self.names,
                        self.directions.tolist(),
                        np.degrees(self.sigma).tolist(),
                        self.known.tolist(),
                        strict=True,
                    )
                ],
                "taken_for_granted": list(self.assumptions),
                "unevenness": self.unevenness,
                "curl": self.curl,
                "mirrored_curl": self.mirrored_curl,
                "side": self.side,
            },
        )


_WHERE = {"left": "on the left", "right": "on the right", "top": "above", "bottom": "below"}
