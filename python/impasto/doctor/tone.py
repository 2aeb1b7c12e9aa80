"""Whether the files were decoded with the right tone curve."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.wording import factor
from impasto.doctor.diagnosis import Finding
from impasto.doctor.sampled_tiles import linear
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.session.tone import CANDIDATES, ToneEstimate, estimate_tone, few
from impasto.stack import Stack

_PIXELS = 8000
_WORSE = 1.1
"""A curve is wrong if the best one predicts better by this factor, significantly."""


def tone(stack: Stack) -> list[Finding]:
    """Compare the stack's tone curve with an estimate from its photographs."""
    curve = stack.encoding.curve
    estimate = _estimate(stack)
    name = stack.encoding.name
    numbers: dict[str, Any] = {"curve": name}
    if estimate is None:
        return [
            Finding(
                "encoding",
                "ok",
                f"cannot check the tone curve {name!r}: six photographs with usable samples are "
                "needed",
                numbers=numbers,
            )
        ]
    errors = dict(estimate.errors)
    times = errors[curve] / max(errors[estimate.best], 1e-12)
    numbers |= {
        "best": _name(estimate.best),
        "plausible": [_name(one) for one in estimate.plausible],
        "coloured": estimate.coloured,
        "errors": {_name(one): round(error, 6) for one, error in estimate.errors},
    }
    if curve not in estimate.plausible and times > _WORSE:
        better = estimate.curve
        others = [repr(_name(one)) for one in estimate.plausible if one != estimate.best]
        also = f" ({', '.join(others)} nearly so)" if others else ""
        return [
            Finding(
                "encoding",
                "warning",
                f"the tone curve {name!r} seems to be wrong: "
                f"{estimate.best!r} predicts held-out photographs {factor(times)} times "
                f"better{also}",
                f'give encoding="{better}" (command line: --encoding {better})',
                numbers=numbers,
            )
        ]
    if len(estimate.plausible) == len(errors):
        message = f"cannot check the tone curve {name!r}: no other fits worse"
    elif curve not in estimate.plausible:
        message = f"the tone curve {name!r} fits nearly as well as {_name(estimate.best)!r}"
    else:
        next_best = next(one for one, _ in estimate.errors if one not in estimate.plausible)
        ratio = errors[next_best] / max(errors[curve], 1e-12)
        others = [repr(_name(one)) for one in estimate.plausible if one != curve]
        also = f", as would {', '.join(others)}" if others else ""
        message = (
            f"the tone curve {name!r} fits{also}; {_name(next_best)!r} would predict held-out "
            f"photographs {ratio:.2f} times worse"
        )
    return [Finding("encoding", "ok", message, numbers=numbers)]


def _name(curve: str) -> str:
    return Encoding(curve).name


def _estimate(stack: Stack) -> ToneEstimate | None:
    """The curve estimated from the codes; decoded files are encoded again."""
    photographs = few(len(stack.rig))
    codes = _codes(stack, photographs)
    if codes is None:
        return None
    curve = stack.encoding.curve
    try:
        return estimate_tone(
            codes,
            stack.rig.directions[photographs],
            white=stack.encoding.white,
            intensities=stack.rig.intensities[photographs],
            candidates=CANDIDATES if curve in CANDIDATES else (*CANDIDATES, curve),
        )
    except ArgumentError:
        return None


def _codes(stack: Stack, photographs: NDArray[np.int64]) -> NDArray[np.float32] | None:
    """``(obs, band, 1, n)`` coded values of some pixels, full scale at the encoding's white."""
    height, width = stack.shape[2:]
    inside = np.arange(height * width) if stack.mask is None else np.flatnonzero(stack.mask.ravel())
    if len(inside) == 0:
        return None
    picked = np.random.default_rng(0).choice(inside, min(_PIXELS, len(inside)), replace=False)
    rows, columns = np.divmod(np.sort(picked), width)
    light = np.stack(
        [linear(stack, stack.samples[i][:, rows, columns]) for i in photographs.tolist()]
    )
    usable = np.isfinite(light)
    if not usable.any():
        return None
    full = np.full(len(stack.bands), np.nan)
    if stack.saturation is not None:
        full = (stack.saturation - stack.black) * stack.scale
    full = np.where(np.isfinite(full), full, float(light[usable].max()))
    if not (full > 0).all():
        return None
    encoding = Encoding(stack.encoding.curve, stack.encoding.white)
    for photograph, known in zip(light, usable, strict=True):
        # Missing samples count as clipped: neither says anything about the curve.
        photograph[:] = encoding.encode(np.where(known, photograph / full[:, None], 1.0))
    return light[:, :, None]
