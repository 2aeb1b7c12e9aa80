"""Strengths of lobes that clipped photographs alone show: a gilded icon (hard case 4)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import impasto

MOST = 64.0
"""Light of a lobe's peak, in units of the most that any photograph of the pixel shows."""


def test_hard_case_4_no_peak_is_far_above_all_samples(data: Path) -> None:
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp")
    found = impasto.fit_sbrdf(stack, pooling="pixel", refine=False)
    fresnel = ((1.45 - 1.0) / (1.45 + 1.0)) ** 2
    peak = fresnel * np.nan_to_num(found.specular).max(axis=(0, 1))
    light = np.array([stack.linear(photograph) for photograph in range(72)])
    largest = np.minimum(light, stack.ceiling[:, None, None]).max(axis=(0, 1))
    # The peak is a product of four roundings in single precision.
    assert (peak / largest).max() < MOST * (1.0 + 1e-6)
    assert (peak / largest).max() > 0.9 * MOST, "the limit is reached"
    # Light from the front: 4 / ln 2 F beta gamma^2 is the integral of a narrow lobe over the
    # hemisphere, as facets turn by half the angle of the light.
    strength = np.nanmax(found.specular, axis=1)
    share = 4.0 / np.log(2.0) * fresnel * strength * found.gamma.astype(np.float64) ** 2
    assert np.nanmax(share) < 1.0
