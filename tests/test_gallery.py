"""The pictures of the gallery page, small: each shows what it is there to show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gallery import icon, painting
from gallery.measured import Measured
from impasto.pictures import Panel

SIZE, PITCH_MM = (96, 128), 0.2
DARK, BRIGHT = 40, 250
"""Codes between which rounding and clipping change linear light by less than 3 %."""


@pytest.fixture(scope="module")
def varnished() -> Measured:
    return painting.measured(SIZE, PITCH_MM)


@pytest.fixture(scope="module")
def bare() -> Measured:
    return painting.measured(SIZE, PITCH_MM, varnish=None)


def linear(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Linear light of 8-bit sRGB, IEC 61966-2-1."""
    code = picture / 255.0
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def are_pictures(panels: list[Panel]) -> None:
    """Each has something on it, and no two are the same."""
    for index, panel in enumerate(panels):
        assert panel.picture.dtype == np.uint8
        assert panel.picture.std() > 10.0, panel.title
        for other in panels[:index]:
            same = panel.picture.shape == other.picture.shape
            assert not (same and np.array_equal(panel.picture, other.picture)), panel.title


def test_no_picture_of_the_painting_is_empty_or_there_twice(varnished: Measured) -> None:
    panels = painting.in_the_gallery(varnished) + painting.in_raking_light(varnished)
    panels += painting.by_candlelight(varnished) + painting.figures_8_and_9(varnished)
    are_pictures(panels)
    are_pictures(painting.details(varnished))


def test_a_slanted_view_is_narrower_by_the_cosine(varnished: Measured) -> None:
    straight, slanted = painting.figures_8_and_9(varnished)[:2]
    x, _, z = painting.RIGHT
    rows, columns = straight.picture.shape[:2]
    # What the relief moves out of the painting's plane makes the picture wider by a few pixels.
    assert slanted.picture.shape[0] == pytest.approx(rows, abs=4)
    assert slanted.picture.shape[1] == pytest.approx(columns * z / np.hypot(x, z), abs=6)


def test_raking_light_shades_and_casts_shadows(bare: Measured) -> None:
    """Without gloss the ratio to light from above is that of the cosines, or a shadow."""
    panels = painting.in_raking_light(bare)
    above, raking = (linear(panel.picture).sum(axis=-1) for panel in panels)
    seen = [((p.picture > DARK) & (p.picture < BRIGHT)).all(axis=-1) for p in panels]
    normal = bare.sbrdf.normal.astype(np.float64)
    cosines = [
        np.tensordot(np.array(light.direction) / np.linalg.norm(light.direction), normal, axes=1)
        for light in (painting.ABOVE, painting.RAKING)
    ]
    lit = seen[0] & seen[1] & (cosines[1] > 0.1)
    assert lit.sum() > 500
    shading = np.log(raking[lit] / above[lit]) - np.log(cosines[1][lit] / cosines[0][lit])
    # Light from above has an exposure near 1, at which white does not clip. Codes add 3 % each.
    np.testing.assert_allclose(np.median(shading), np.log(2.4), atol=0.06)
    assert np.percentile(np.abs(shading - np.median(shading)), 90) < 0.06
    # Facets that face the lamp and are black lie in the shadow of others; without shadows none.
    unshadowed = 2.4 * above * np.maximum(cosines[1], 0.0) / cosines[0]
    assert ((raking < 0.1 * unshadowed) & (unshadowed > 0.05)).mean() > 0.003


def test_adaptation_takes_the_colour_of_the_flame_away(varnished: Measured) -> None:
    """The share of blue rises with d: at d = 1 it is nearer to daylight's than to that at d = 0."""
    shares = [linear(p.picture).mean(axis=(0, 1)) for p in painting.by_candlelight(varnished)]
    shares = [share / share.sum() for share in shares]
    daylight = linear(painting.in_raking_light(varnished)[0].picture).mean(axis=(0, 1))
    daylight /= daylight.sum()
    blue = [share[2] for share in shares]
    assert blue[0] < blue[1] < blue[2]
    distances = [float(np.abs(share - daylight).sum()) for share in shares]
    assert distances[2] < distances[1] < distances[0]
    assert distances[2] < 0.25 * distances[0]


def test_a_yellowed_coat_takes_blue_and_its_removal_gives_it_back(
    bare: Measured, varnished: Measured
) -> None:
    panels = painting.varnished(bare)
    are_pictures(panels)
    as_it_is, _, old = (linear(panel.picture).mean(axis=(0, 1)) for panel in panels[:3])
    assert old[2] / as_it_is[2] < 0.8 * old[0] / as_it_is[0]
    aged = painting.measured(SIZE, PITCH_MM, yellowing=painting.AGED)
    removed = painting.without_varnish(aged, varnished)
    are_pictures(removed)
    left, middle = (float(panel.note.split()[1]) for panel in removed[:2])
    assert middle < 0.5 * left


@pytest.mark.slow
def test_the_icon_is_shown_in_light_that_its_fit_has_not_seen(data: Path) -> None:
    """A part of it: each rendering is nearer to its own photograph than to the others shown."""
    stack = icon.upright(data / "icon_rti")[158:190, 68:100]
    # With its rig refined, as in the documentation, the fit would take most of a minute.
    found = icon.measured(stack, refine=False)
    held = {stack.names[index] for index in icon.SHOWN}
    used = stack.take([index for index in range(72) if index % icon.HELD_OUT])
    assert held.isdisjoint(used.names)
    assert len(found.measured.sbrdf.rig) == len(used.names) == 60
    panels = icon.beside_photographs(found)
    photographs, renderings = panels[:4], panels[4:]
    for index, rendering in enumerate(renderings):
        likeness = [icon.psnr(rendering.picture, one.picture) for one in photographs]
        assert int(np.argmax(likeness)) == index
    for shown in (icon.in_the_gallery, icon.by_candlelight, icon.with_varnish):
        are_pictures(shown(found))


def test_without_photographs_the_icon_is_left_out_and_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import pictures

    monkeypatch.setenv("IMPASTO_DATA", str(tmp_path))
    pictures.gallery_of_the_icon()
    assert str(tmp_path) in capsys.readouterr().err
