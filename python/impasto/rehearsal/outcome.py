"""What came of a rehearsed session, against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto import simulate
from impasto.colour import delta_e, lab_from_xyz, white_point
from impasto.pictures import Panel, colour_panel, contact_sheet, normal_panel, ramp_panel
from impasto.pictures.panels import Picture
from impasto.rehearsal.course import ILLUMINANT, LIGHT
from impasto.rehearsal.photographs import EXPOSURE
from impasto.simulate.score import normal_error

Linear: TypeAlias = NDArray[np.float32]
BORDER = 4
"""Pixels at the edge of the painting that are not compared: frontal photographs are interpolated
there from the table, too."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """A result beside the truth.

    Attributes
    ----------
    score
        Of the maps.
    lamps_degrees
        ``(lamp,)``: errors of the directions of the lamps from the middle of the painting.
    relit, truth
        The picture in the light that no photograph had, by the result and by the truth.
    normal_degrees
        ``(y, x)``; NaN where nothing is known, and at the border.
    delta_e
        ``(y, x)``: CIEDE2000 between the pictures; NaN likewise.
    """

    score: simulate.Score
    lamps_degrees: NDArray[np.float64]
    relit: impasto.Image
    truth: impasto.Image
    normal_degrees: NDArray[np.float32]
    delta_e: NDArray[np.float32]

    def numbers(self) -> dict[str, float]:
        """In degrees and CIEDE2000; beta and gamma as relative errors."""
        angles, colours = (
            values[np.isfinite(values)] for values in (self.normal_degrees, self.delta_e)
        )
        return {
            "lamps_mean_degrees": float(self.lamps_degrees.mean()),
            "lamps_worst_degrees": float(self.lamps_degrees.max()),
            "normal_mean_degrees": float(angles.mean()),
            "normal_p95_degrees": float(np.percentile(angles, 95)),
            "beta_relative": self.score.beta,
            "gamma_relative": self.score.gamma,
            "diffuse_delta_e_mean": self.score.colour_mean[ILLUMINANT],
            "diffuse_delta_e_p95": self.score.colour_p95[ILLUMINANT],
            "relit_delta_e_mean": float(colours.mean()),
            "relit_delta_e_p95": float(np.percentile(colours, 95)),
        }

    def picture(self, photograph: Linear, frontal: Linear, normal: Linear) -> Picture:
        """A sheet: from a photograph of the session to the picture in another light.

        Parameters
        ----------
        photograph, frontal
            ``(3, y, x)`` linear light, as the camera saw it and aligned.
        normal
            ``(3, y, x)`` as found.
        """
        note = f"{ILLUMINANT}, azimuth {LIGHT[0]}, elevation {LIGHT[1]} degrees"
        panels = (
            colour_panel(photograph, "A photograph", note="with marks and balls", white=EXPOSURE),
            colour_panel(frontal, "Frontal", note="lens and perspective taken out", white=EXPOSURE),
            normal_panel(normal),
            Panel("In another light", self.relit.display, note),
            Panel("The truth", self.truth.display, note),
            ramp_panel(self.delta_e, "Difference", unit="CIEDE2000", low=0.0, high=5.0),
        )
        return contact_sheet(panels, title="A rehearsed session", columns=3)


def outcome(
    truth: simulate.Truth, sbrdf: impasto.Sbrdf, reflectance: Any, lamps: NDArray[np.float64]
) -> Outcome:
    """Compare the result of a session with the truth.

    Parameters
    ----------
    truth
        Of the session.
    sbrdf, reflectance
        What was found.
    lamps
        ``(lamp, 3)`` positions of the lamps as found, or directions.
    """
    azimuth, elevation = np.radians(LIGHT)
    across = np.cos(elevation)
    towards = (across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation))
    scene = impasto.Scene([impasto.DistantLight(towards)], illuminant=ILLUMINANT)
    relit = impasto.render(sbrdf, scene, reflectance=reflectance, level=False)
    shown = impasto.render(truth.painting, scene)
    found = lamps / np.linalg.norm(lamps, axis=1, keepdims=True)
    white = white_point(ILLUMINANT)
    colours = delta_e(*(lab_from_xyz(image.xyz, white) for image in (relit, shown)))
    angles = normal_error(sbrdf.normal, truth.normal)
    for values in (colours, angles):
        inside = values[BORDER:-BORDER, BORDER:-BORDER].copy()
        values[:] = np.nan
        values[BORDER:-BORDER, BORDER:-BORDER] = inside
    return Outcome(
        simulate.score(truth, sbrdf, reflectance),
        normal_error(found.T, truth.rig.directions.T).astype(np.float64),
        relit,
        shown,
        angles,
        np.asarray(colours, np.float32),
    )
