"""What commands that render share: lamps from options, and what a result allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from cyclopts import CycloptsError

from impasto._internal.checks import suggestion
from impasto.cli.console import Stages
from impasto.cli.options import Angles, Lamp, Position
from impasto.errors import ArgumentError

_LARGEST = 90.0
"""Degrees that a lamp may be across."""

ABOVE = Lamp(Angles(90.0, 45.0))
"""The lamp of a picture without others."""


def lamps(
    light: Sequence[Lamp] | None,
    point: Sequence[Position] | None,
    illuminant: str,
    *,
    dark: bool = False,
    size: float | None = None,
) -> tuple[list[Any], list[Any]]:
    """Lights and their illuminants, ``illuminant`` where a lamp has none of its own.

    Without any the light comes from above, unless the painting may be ``dark``. Distant lamps are
    ``size`` degrees across.
    """
    import impasto

    distant = light or (() if point or dark else (ABOVE,))
    near = point or ()
    across = 0.0 if size is None else size
    if not 0.0 <= across <= _LARGEST:
        raise ArgumentError(f"--lamp-size: expected 0 to {_LARGEST:g} degrees, found {across:g}")
    radius = math.radians(0.5 * across)
    lights: list[Any] = [
        impasto.DistantLight(lamp.angles.direction, radius=radius) for lamp in distant
    ]
    lights += [impasto.PointLight(position) for position in near]
    own = [illuminant if lamp.illuminant is None else lamp.illuminant for lamp in distant]
    return lights, own + [illuminant] * len(near)


def room_of(environment: str | None, rotation: float | None) -> Any:
    """The environment of a name or a file, turned by so many degrees; None for none."""
    import impasto
    from impasto.environment import SUFFIXES
    from impasto.rooms import ROOMS

    if environment is None:
        if rotation is not None:
            raise CycloptsError(msg="--environment-rotation turns a room: it needs --environment")
        return None
    degrees = 0.0 if rotation is None else rotation
    if not math.isfinite(degrees):
        raise ArgumentError(f"--environment-rotation: expected degrees, found {degrees:g}")
    radians = math.radians(degrees)
    if environment in ROOMS:
        return impasto.Environment.named(environment, rotation=radians)
    if Path(environment).suffix.lower() not in SUFFIXES:
        near = suggestion(environment.strip().lower(), list(ROOMS))
        raise ArgumentError(
            f"--environment: expected {', '.join(ROOMS)}, or a file {', '.join(SUFFIXES[:-1])} or "
            f"{SUFFIXES[-1]}, found {environment!r}{near}"
        )
    return impasto.Environment.read(environment, rotation=radians)


VarnishName = Literal["clear", "yellowed", "brown"]

_YELLOWNESS: dict[VarnishName, float] = {"clear": 0.0, "yellowed": 10.0, "brown": 30.0}
"""Absorption at 450 nm in 1/mm, in a film of 50 micrometres."""


def coat(varnish: VarnishName | None, removed: VarnishName | None) -> Any:
    """A coat over the painting, or the one that is taken off it; None for neither."""
    import impasto

    if varnish is not None and removed is not None:
        raise CycloptsError(
            msg="--varnish adds a coat and --remove-varnish takes one off: give one of them"
        )
    if removed == "clear":
        raise CycloptsError(
            msg="--remove-varnish: a clear film changes no colour; expected yellowed or brown"
        )
    name = varnish or removed
    if name is None:
        return None
    return impasto.Varnish(yellowness=_YELLOWNESS[name], removed=removed is not None)


def tolerance_of(text: str | None) -> str | int | None:
    """A tolerance as :func:`impasto.plan` takes it: 0 however it is written."""
    from impasto.effects import checked_tolerance

    if text is None:
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    allowed = 0 if number == 0.0 else text
    checked_tolerance(allowed)
    return allowed


def check_spectra(result: Path, reflectance: Any, scene: Any) -> None:
    """Refuse what needs spectra where a result has none: other illuminants, a varnish."""
    if reflectance is None and scene.varnish is not None:
        raise ArgumentError(
            f"--{'remove-' if scene.varnish.removed else ''}varnish: what a film absorbs needs "
            f"spectra, and {result} has none; fit again with --camera"
        )
    other = scene.adaptation is not None or any(one != "D65" for one in scene.illuminants)
    if reflectance is None and other:
        raise ArgumentError(
            f"--illuminant: {result} has no spectra, so only its colours as photographed are "
            "known; fit again with --camera to render another light"
        )


def say_false_colours(stages: Stages, result: Any, reflectance: Any) -> None:
    """That three of the bands stand in for red, green and blue, where they do."""
    import impasto

    stored = isinstance(result, impasto.StoredSbrdf)  # has no plane of its own in memory
    count = len(result.bands if stored else result.diffuse)
    if reflectance is None and count not in {1, 3}:
        stages.say(
            f"  {'':14}[yellow]false colours: three of {count} bands stand in for red, green and "
            "blue; a fit with --camera has true ones[/]"
        )


def panel_of_heights(stages: Stages, sbrdf: Any, *, wanted: bool) -> Any:
    """The plane about which heights are, as :func:`panel`."""
    return panel(
        stages, sbrdf, wanted=wanted, what="heights are about", without="they have its lean"
    )


def panel(
    stages: Stages,
    sbrdf: Any,
    *,
    wanted: bool,
    what: str = "the lights shine on",
    without: str = "as it stood",
) -> Any:
    """The plane of a panel that leans, if its rotation is wanted; otherwise False.

    ``what`` its plane is for is said, and what there is ``without``.
    """
    import impasto

    if not wanted:
        return False
    stored = isinstance(sbrdf, impasto.StoredSbrdf)
    found = sbrdf.find_level() if stored else impasto.find_level(sbrdf.normal)
    plane = found if found.leans else False
    words = f"; {what} its own plane (--no-level: {without})" if plane else ""
    stages.say(f"  {'':14}[dim]{found}{words}[/]")
    return plane
