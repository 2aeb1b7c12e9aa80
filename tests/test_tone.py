"""`estimate_tone`: the tone curve that photographs tell by themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impasto import ArgumentError, read_stack, simulate
from impasto.io import estimate_tone

RIGS = ("tominaga-rgb-camera", "tominaga-six-band-adaptation")


def photographs(rig: str, varnish: str | None, curve: str) -> tuple[np.ndarray, np.ndarray]:
    """Eight-bit codes and light directions of a simulated painting."""
    painting = simulate.painting(5, (72, 72), varnish=varnish)
    stack = simulate.capture(painting, rig, encoding=curve, bits=8).stack
    if curve == "linear":
        return stack.samples - stack.black[0].astype(np.uint8), stack.rig.directions
    return np.rint(stack.encode(stack.samples)).astype(np.uint8), stack.rig.directions


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("varnish", [None, "matte", "satin", "gloss"])
@pytest.mark.parametrize("curve", ["linear", "1.8", "srgb"])
def test_the_curve_is_found_under_any_varnish(rig: str, varnish: str | None, curve: str) -> None:
    codes, lights = photographs(rig, varnish, curve)
    estimate = estimate_tone(codes, lights, white=255.0)
    assert estimate.coloured
    assert curve in estimate.plausible
    assert ("linear" in estimate.plausible) == (curve == "linear")
    assert estimate.curve == curve or {estimate.curve, curve} <= set(estimate.plausible)
    if curve != "1.8":
        assert estimate.curve == curve


def test_srgb_and_gamma_are_told_apart_only_with_enough_lights() -> None:
    """The two differ in the shadows only: where that is too little, sRGB is the usual one."""
    codes, lights = photographs(RIGS[1], "satin", "2.2")
    estimate = estimate_tone(codes, lights, white=255.0)
    assert (estimate.curve, estimate.decided) == ("2.2", True)
    codes, lights = photographs(RIGS[0], None, "2.2")
    estimate = estimate_tone(codes, lights, white=255.0)
    assert (estimate.curve, estimate.decided) == ("srgb", False)
    assert "give encoding=" in str(estimate)


def test_grey_and_glossy_photographs_cannot_be_called_linear() -> None:
    """Without colour gloss cannot be taken out, and it makes coded photographs look linear."""
    for curve in ("srgb", "linear"):
        codes, lights = photographs(RIGS[0], "satin", curve)
        estimate = estimate_tone(codes[:, 1:2], lights, white=255.0)
        assert not estimate.coloured
        assert curve in estimate.plausible
        assert not estimate.decided


def test_the_same_photographs_give_the_same_answer_in_any_scale() -> None:
    codes, lights = photographs(RIGS[1], "satin", "srgb")
    first = estimate_tone(codes, lights, white=255.0)
    again = estimate_tone(codes / np.float32(255.0), lights, white=1.0)
    assert first.plausible == again.plausible
    strong = np.where(np.arange(16) % 2, 2.0, 1.0)
    told = estimate_tone(codes, lights, white=255.0, intensities=np.ones(16))
    assert told.errors == first.errors
    wrong = estimate_tone(codes, lights, white=255.0, intensities=strong)
    assert wrong.errors[0][1] > 3 * first.errors[0][1]


def test_what_cannot_be_used_is_refused() -> None:
    codes, lights = photographs(RIGS[0], "satin", "srgb")
    with pytest.raises(ArgumentError, match="at least 6 photographs, found 5"):
        estimate_tone(codes[:5], lights[:5], white=255.0)
    with pytest.raises(ArgumentError, match="mask"):
        estimate_tone(codes, lights, white=255.0, mask=np.zeros((72, 72), bool))


def test_icon_is_not_linear(data: Path) -> None:
    """Its JPEG files say nothing; gilding is left out by taking colour from unclipped pixels."""
    stack = read_stack(data / "icon_rti" / "dirs.lp", encoding="auto")
    assert stack.encoding.curve == "srgb"
    estimate = next(note for note in stack.notes if note.kind == "encoding")
    assert "linear" not in estimate.plausible


@pytest.mark.parametrize("code", [0, 128, 255])
def test_photographs_without_content_tell_nothing(code: int) -> None:
    _, lights = photographs(RIGS[0], None, "srgb")
    codes = np.full((len(lights), 3, 40, 40), code, dtype=np.uint8)
    estimate = estimate_tone(codes, lights, white=255.0)
    assert not estimate.decided
    assert "do not distinguish" in str(estimate)
