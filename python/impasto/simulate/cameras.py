"""The cameras of the papers."""

from __future__ import annotations

from typing import Any

import numpy as np

from impasto._internal.checks import one_of
from impasto.bands import Camera
from impasto.colour._science import science
from impasto.simulate.pigments import WAVELENGTHS

LAMP_KELVIN = 3000.0
"""The halogen lamp of both rigs (a flood lamp, a slide projector)."""

CAMERAS = {
    "rgb": "rgb",
    "six-band": "six-band",
    "tominaga-rgb-camera": "rgb",
    "tominaga-six-band-adaptation": "six-band",
    "snel-lafortune": "rgb",
}
"""The cameras by their own names and by those of their rigs."""

CAMERA_OPTIONS: dict[str, dict[str, Any]] = {
    "snel-lafortune": {"sensitivity": (2.0 / 3.0, 1.0, 1.0 / 3.0), "exposure": 1.0}
}
"""Options of a capture that belong to the camera of a rig. "Green elements are almost three times
more sensitive than blue", red ones "about twice" (section 4); an exposure at which green clips
where a white board would."""


def camera(name: str = "rgb") -> Camera:
    """A camera under a 3000 K halogen lamp.

    ``"rgb"`` (or ``"tominaga-rgb-camera"``, ``"snel-lafortune"``): the measured Nikon D5100 of
    colour-science.

    ``"six-band"`` (or ``"tominaga-six-band-adaptation"``): a monochrome CCD behind six filters.
    The paper's curves were never published: Gaussians at 425, 475 ... 675 nm, 50 nm wide at half
    maximum, times the quantum efficiency of a CCD.
    """
    one_of(name, CAMERAS, "name")
    if CAMERAS[name] == "rgb":
        curves = science().MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
        rows = np.array([np.interp(WAVELENGTHS, curves.wavelengths, c) for c in curves.values.T])
        bands: tuple[str, ...] = ("red", "green", "blue")
    else:
        centres = np.arange(425.0, 676.0, 50.0)
        rows = np.exp(-4.0 * np.log(2.0) * ((WAVELENGTHS - centres[:, None]) / 50.0) ** 2)
        efficiency = (0.35, 0.50, 0.60, 0.62, 0.60, 0.55, 0.45)
        rows *= np.interp(WAVELENGTHS, np.arange(400.0, 701.0, 50.0), efficiency)
        bands = tuple(f"{centre:.0f} nm" for centre in centres)
    return Camera(WAVELENGTHS.copy(), rows, LAMP_KELVIN, bands)
