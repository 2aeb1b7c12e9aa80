"""Lobes need photographs that show them: strengths of others would be extrapolated (hard case 4).

Photographs of a gilded icon, whose highlights are clipped.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import impasto


def test_no_lobe_of_a_pixel_reflects_more_light_than_arrives(data: Path) -> None:
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp")
    found = impasto.fit_sbrdf(stack, pooling="pixel", refine=False)
    # Light from the front, 4 / ln 2 F beta gamma^2 of narrow lobes: their integral over the
    # hemisphere, with facets turned by half the angle of the light. The picture's unit of light is
    # not known, but that no paint is white in it.
    fresnel = ((1.45 - 1.0) / (1.45 + 1.0)) ** 2
    strength = np.nanmax(found.specular, axis=1)
    share = 4.0 / np.log(2.0) * fresnel * strength * found.gamma.astype(np.float64) ** 2
    assert np.isfinite(share).mean() > 0.3
    assert np.nanmax(share) < 1.0


def test_lamps_far_from_every_highlight_give_the_painting_no_lobe(data: Path) -> None:
    """Their samples are the tail of a lobe of any strength."""
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp").take([0, 1, 2, 3])
    found = impasto.fit_sbrdf(stack, pooling="painting", refine=False)
    assert found.verdict == "no-highlight"
    assert found.beta == 0.0
    assert "under way" not in str(found)
