"""What crosses the border to the numerics, and the circumstances of a call.

Everything here is checked and C-contiguous, so that the border only has to borrow it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.checks import is_whole
from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.stack import Stack, checked_stack
from impasto.waiting import floats

if TYPE_CHECKING:
    from impasto.fit.normals import Normals

ProgressCallback: TypeAlias = Callable[[int, int], object]
"""Called with (tiles done, tiles in all), at most about twenty times a second."""

MOST_THREADS = 64


@dataclass(frozen=True, slots=True)
class RigArguments:
    """A :class:`~impasto.Rig` as plain arrays."""

    lights: NDArray[np.float64]
    point: NDArray[np.bool_]
    falloff: NDArray[np.bool_]
    views: NDArray[np.float64]
    pitch_mm: float

    @classmethod
    def of(cls, rig: Rig) -> RigArguments:
        """Directions of distant lights, positions of near ones."""
        return cls(
            lights=rig.vectors,
            point=rig.near,
            falloff=rig.falloff,
            views=np.ascontiguousarray(rig.views, dtype=np.float64),
            pitch_mm=1.0 if rig.pitch_mm is None else float(rig.pitch_mm),
        )


@dataclass(frozen=True, slots=True)
class StackArguments:
    """A :class:`~impasto.Stack` as plain arrays; samples are divided by their light's intensity."""

    samples: NDArray[Any]
    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    saturation: NDArray[np.float32]
    mask: NDArray[np.bool_] | None
    rig: RigArguments

    @classmethod
    def of(cls, stack: Stack) -> StackArguments:
        """The samples stay where they are; the rest is a few numbers per observation."""
        checked_stack(stack)
        rig = stack.rig.here
        observations, bands = stack.shape[:2]
        gain = stack.scale[None, :] / rig.intensities[:, None]
        saturation = np.full(bands, np.inf) if stack.saturation is None else stack.saturation
        return cls(
            samples=stack.samples,
            gain=gain.astype(np.float32),
            offset=(-stack.black[None, :] * gain).astype(np.float32),
            saturation=np.ascontiguousarray(
                np.broadcast_to(saturation, (observations, bands)), dtype=np.float32
            ),
            mask=stack.mask,
            rig=RigArguments.of(rig),
        )


@dataclass(frozen=True, slots=True)
class StartArguments:
    """What photometric stereo found, as plain arrays: where a fit of the gloss begins."""

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    status: NDArray[np.uint8]

    @classmethod
    def of(cls, stereo: Normals) -> StartArguments:
        """The maps, copied only where they are not contiguous."""
        return cls(
            normal=floats(stereo.normal),
            diffuse=floats(stereo.albedo),
            status=np.ascontiguousarray(stereo.status, dtype=np.uint8),
        )


def thread_count(threads: int | None) -> int:
    """How many threads a call may use.

    The argument, else ``IMPASTO_NUM_THREADS``, else ``RAYON_NUM_THREADS``, else every core that
    this process is allowed to run on. Results do not depend on it: a request for more than
    :data:`MOST_THREADS` on a smaller machine, which would only stand in its own way, gets those.
    """
    if threads is not None:
        if not (is_whole(threads) and threads >= 1):
            raise ArgumentError(f"threads: expected a positive number or None, found {threads!r}")
        return min(int(threads), max(MOST_THREADS, os.cpu_count() or 1))
    for variable in ("IMPASTO_NUM_THREADS", "RAYON_NUM_THREADS"):
        text = os.environ.get(variable, "")
        if text:
            if not text.isdecimal() or int(text) < 1:
                raise ArgumentError(f"{variable}: expected a positive number, found {text!r}")
            return min(int(text), max(MOST_THREADS, os.cpu_count() or 1))
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def reporting(
    progress: bool | ProgressCallback, description: str
) -> Iterator[ProgressCallback | None]:
    """The callback that ``progress=`` asks for: none, a bar on stderr, or the caller's own.

    A bar is gone when the block ends, however it ends.
    """
    if progress is False or progress is None:
        yield None
    elif callable(progress):
        yield progress
    elif progress is True:
        from impasto.fit.progress import bar

        with bar(description) as update:
            yield update
    else:
        raise ArgumentError(
            f"progress: expected True, False or a callable (done, total), found {progress!r}"
        )
