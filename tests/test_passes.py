"""Where the passes of lobes per pixel go, as benchmarks count them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from impasto.effort import PRESETS
from impasto.fit import lobes


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    painting = simulate.painting(0, (32, 32), varnish="patches")
    return simulate.capture(painting, simulate.rig("tominaga-rgb-camera"), "rgb").stack


def counted(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch, **options: Any
) -> dict[str, tuple[int, int, float]]:
    """Lanes, passes and seconds by purpose."""
    found: dict[str, tuple[int, int, float]] = {}
    core = lobes._core.fit_lobes

    def counting(*arguments: Any) -> Any:
        answer = core(*arguments)
        found.update({name: (lanes, useful, seconds) for name, lanes, useful, seconds in answer[1]})
        return answer

    with monkeypatch.context() as patch:
        patch.setattr(lobes._core, "fit_lobes", counting)
        impasto.fit_sbrdf(stack, pooling="pixel", refine=False, **options)
    return found


def test_weights_take_a_pass_per_round_and_one_at_the_end(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = stack.shape[2] * stack.shape[3]
    found = counted(stack, monkeypatch)
    assert found["weights and colours"][1] == (PRESETS["standard"].rounds + 1) * pixels
    assert found["errors of normals"][1] == pixels


def test_passes_do_not_depend_on_threads_and_fill_their_lanes(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = (counted(stack, monkeypatch, threads=threads) for threads in (1, 2))
    for purpose, (lanes, useful, seconds) in one.items():
        # Threads share the pixels, so that lanes end at other times.
        assert two[purpose][1] == useful, purpose
        assert 0 < useful <= lanes, purpose
        assert np.isfinite(seconds), purpose
        assert seconds > 0.0, purpose


def test_a_draft_takes_fewer_passes(stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch) -> None:
    standard, draft = (counted(stack, monkeypatch, effort=e) for e in ("standard", "draft"))
    assert draft["all bands"][1] < standard["all bands"][1]
