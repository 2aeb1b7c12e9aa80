"""Misfires to inject into a simulated rig, drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from impasto._internal.checks import number
from impasto.errors import ArgumentError

Fault = Literal[
    "timeout", "setting", "exposure", "duplicate", "missing", "corrupt", "disconnect", "no-ack",
    "late-ack", "wrong-ack", "wrong-lamp", "dark", "double", "clipped", "blurred", "moved", "drift",
]  # fmt: skip
"""``timeout``, ``missing``, ``disconnect``: no photograph, an empty one, a camera that is gone
until it is reconnected. ``setting``: another exposure is read back. ``exposure``: another one is
taken, and stated. ``duplicate``: the file of the photograph before. ``corrupt``: half of the file.
``no-ack``, ``late-ack``, ``wrong-ack``: no acknowledgement, that of the order before, or of another
lamp. ``wrong-lamp``: another lamp glows, and the ordered one is acknowledged. ``dark``,
``double``: no lamp, or two. ``clipped``: twenty times the light. ``blurred``: by 1.5 pixels.
``moved``: by one pixel. ``drift``: all lamps lose 5 % for a while."""
DRIFT_TRIGGERS = 25
"""Photographs for which a drift lasts."""


@dataclass(frozen=True)
class Faults:
    """Which order of a simulated rig goes wrong, and how.

    Parameters
    ----------
    at
        Faults by the number of the photograph that is ordered, from 1 on, retries included.
    forever
        Faults that are there from this number on.
    """

    at: Mapping[int, Fault] = field(default_factory=dict)
    forever: Mapping[int, Fault] = field(default_factory=dict)

    def of(self, order: int) -> Fault | None:
        """What goes wrong with a photograph."""
        for first, fault in self.forever.items():
            if order >= first:
                return fault
        return self.at.get(order)


def random_faults(count: int, share: float, seed: int) -> Faults:
    """Faults of all kinds, evenly, at random places.

    Parameters
    ----------
    count
        Photographs among which they are.
    share
        Of the photographs that go wrong, from 0 to 1.
    seed
        Of the places and the order of kinds.
    """
    rng = np.random.default_rng(seed)
    share = number(share, "faults", "a share from 0 to 1")
    if not 0.0 <= share <= 1.0:
        raise ArgumentError(f"faults: expected a share from 0 to 1, found {share!r}")
    places = rng.choice(count, round(share * count), replace=False) + 1
    kinds = rng.permutation(np.array(get_args(Fault)))
    return Faults({int(at): kinds[n % len(kinds)].item() for n, at in enumerate(places)})
