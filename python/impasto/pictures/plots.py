"""Diagrams of fitted lobes; they need matplotlib (``pip install impasto[plot]``)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.extras import need
from impasto._internal.windows import place
from impasto.errors import ArgumentError
from impasto.lights import PointLight
from impasto.pictures.panels import BACKGROUND, FAINT, INK
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status
from impasto.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Angles = NDArray[np.float64]

LOBES = ("#e8a15a", "#7fb4d6", "#a6c48a")
"""The sharpest lobe first."""
SAMPLES = "#d65a6e"
WITHIN = 6.0
"""Degrees: largest distance of a photograph from the plane and from the light of a panel."""
PANELS = 3


def lobe_plot(sbrdf: Any, y: int, x: int, stack: Stack | None = None) -> Figure:
    """Draw a pixel's lobes: see :meth:`impasto.Sbrdf.lobe_plot`."""
    need("matplotlib", "plot", "lobe_plot")
    from matplotlib.figure import Figure

    y, x = place(y, x, sbrdf.shape)
    status = Status(int(sbrdf.status[y, x]))
    if not status < Status.DARK:
        raise ArgumentError(f"y, x: pixel ({y}, {x}) has no lobes, its status is {status.name}")
    if stack is not None and stack.shape[2:] != sbrdf.shape:
        raise ArgumentError(f"stack: expected {sbrdf.shape} pixels, found {stack.shape[2:]}")
    rig = sbrdf.rig if stack is None else stack.rig
    normal = sbrdf.normal[:, y, x].astype(np.float64)
    light, view, beside = _angles(normal, _towards(rig, sbrdf.shape, y, x), rig.views)
    surface = sbrdf[y : y + 1, x : x + 1].surface()
    samples = np.full(len(rig), np.nan)
    if stack is not None:
        samples = _reflectances(stack, y, x, light, surface.ambient)
    incidences = _incidences(light, beside)
    shown = [number for number, lobe in enumerate(surface.lobes) if np.any(lobe.strength)]
    upright = np.array([0.0, 0.0, 1.0], np.float32)[:, None, None]
    chosen = tuple(surface.lobes[number] for number in shown)
    surface = replace(surface, normal=upright, lobes=chosen, ambient=None)
    words = [sbrdf.lobe_words(number, y, x) for number in shown]
    slices = [_slice(surface, incidence) for incidence in incidences]
    figure = Figure(figsize=(4.2 * len(incidences), 3.2), facecolor=_colour(BACKGROUND))
    for panel, (incidence, (angle, total, lobes)) in enumerate(
        zip(incidences, slices, strict=True)
    ):
        axes = figure.add_subplot(1, len(incidences), panel + 1, projection="polar")
        # Each panel has its own scale: under grazing light a highlight is a hundred times brighter.
        top = 1.08 * float(total.max()) or 1.0
        _dress(axes, incidence, top)
        axes.fill(np.radians(angle), lobes[0], color=_colour(FAINT), alpha=0.25, lw=0)
        axes.plot(np.radians(angle), lobes[0], color=_colour(FAINT), lw=0.8, label="diffuse")
        for number, lobe in enumerate(lobes[1:]):
            label = f"lobe {number + 1}: {words[number]}"
            axes.plot(np.radians(angle), lobe, color=LOBES[number], lw=1.4, label=label)
        axes.plot(np.radians(angle), total, color=_colour(INK), lw=1.6, label="all")
        near = (np.abs(light - incidence) < WITHIN) & (beside < WITHIN) & np.isfinite(samples)
        if near.any():
            axes.plot(
                np.radians(view[near]), np.minimum(samples[near], top), ".", ms=5,
                color=SAMPLES, label="photographs",
            )  # fmt: skip
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=len(labels), frameon=False,
        labelcolor=_colour(INK), fontsize=8,
    )  # fmt: skip
    title = f"Reflectance of pixel ({y}, {x})"
    figure.suptitle(title, x=0.02, y=0.96, ha="left", color=_colour(INK), fontsize=11)
    figure.subplots_adjust(left=0.02, right=0.98, top=1.0, bottom=0.0, wspace=0.06)
    return figure


def _towards(rig: Rig, shape: tuple[int, int], y: int, x: int) -> Angles:
    """``(obs, 3)`` unit vectors to the lights from a pixel."""
    rig = rig.here
    pitch = rig.pitch_mm or 0.0
    place = ((x - (shape[1] - 1) / 2) * pitch, ((shape[0] - 1) / 2 - y) * pitch, 0.0)
    vectors = [
        np.subtract(light.position, place) if isinstance(light, PointLight) else light.direction
        for light in rig.lights
    ]
    lights = np.asarray(vectors, dtype=np.float64)
    return np.asarray(lights / np.linalg.norm(lights, axis=1, keepdims=True))


def _angles(normal: Angles, lights: Angles, views: Angles) -> tuple[Angles, Angles, Angles]:
    """Degrees of lights from the normal, and of views in the plane of incidence and out of it.

    In the plane, the side of the mirror direction is positive.
    """
    cosine = np.clip(lights @ normal, -1.0, 1.0)
    across = cosine[:, None] * normal - lights
    length = np.linalg.norm(across, axis=1)
    # A light along the normal has no plane of incidence: use that of the view.
    alone = views - (views @ normal)[:, None] * normal
    across = np.where(length[:, None] > 1e-6, across, alone)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    sideways = np.einsum("ij,ij->i", np.cross(across, normal), views)
    in_plane = np.arctan2(np.einsum("ij,ij->i", across, views), views @ normal)
    beside = np.abs(np.arcsin(np.clip(sideways, -1.0, 1.0)))
    return np.degrees(np.arccos(cosine)), np.degrees(in_plane), np.degrees(beside)


def _incidences(light: Angles, beside: Angles) -> list[float]:
    """Degrees, increasing: the incidences with the most photographs in the plane."""
    counts = {
        angle: int(((np.abs(light - angle) < WITHIN) & (beside < WITHIN)).sum())
        for angle in range(0, 81, 5)
    }
    chosen: list[int] = []
    for angle in sorted(counts, key=lambda angle: (-counts[angle], angle)):
        apart = all(abs(angle - other) > 2 * WITHIN for other in chosen)
        if counts[angle] and apart and len(chosen) < PANELS:
            chosen.append(angle)
    return [float(angle) for angle in sorted(chosen)] or [45.0]


def _slice(surface: Surface, incidence: float) -> tuple[Angles, Angles, list[Angles]]:
    """View angles in degrees, reflectance there, and its terms: diffuse, then each lobe."""
    angle = np.linspace(-89.5, 89.5, 359)
    a, b = np.radians(incidence), np.radians(angle)
    light = (-np.sin(a), 0.0, np.cos(a))
    views = np.stack([np.sin(b), np.zeros_like(b), np.cos(b)], axis=1)
    rig = Rig(np.broadcast_to(light, views.shape), views=views)

    def shown(part: Surface) -> Angles:
        radiance = part.predict(rig, threads=1)
        return np.asarray(radiance[:, :, 0, 0].mean(axis=1, dtype=np.float64) / np.cos(a))

    black = np.zeros_like(surface.diffuse)
    parts = [shown(replace(surface, lobes=()))]
    parts += [shown(replace(surface, diffuse=black, lobes=(lobe,))) for lobe in surface.lobes]
    return angle, np.sum(parts, axis=0), parts


def _reflectances(stack: Stack, y: int, x: int, light: Angles, ambient: Any) -> Angles:
    """``(obs,)`` mean of the bands over ``(N.L)``; NaN where clipped or lit from behind.

    ``ambient (band, 1, 1)`` is light that does not depend on the lamp's direction, or None.
    """
    stored = stack.samples[:, :, y, x].astype(np.float64)
    linear = (stored - stack.black) * stack.scale / stack.rig.here.intensities[:, None]
    if ambient is not None:
        linear = linear - ambient[:, 0, 0]
    if stack.saturation is not None:
        linear[stored >= stack.saturation] = np.nan
    cosine = np.cos(np.radians(light))
    return np.where(cosine > 0.05, linear.mean(axis=1) / np.maximum(cosine, 0.05), np.nan)


def _dress(axes: Axes, incidence: float, top: float) -> None:
    polar: Any = axes
    polar.set_facecolor(_colour(BACKGROUND))
    polar.set_theta_zero_location("N")
    polar.set_theta_direction(-1)
    polar.set_thetalim(-np.pi / 2, np.pi / 2)
    polar.set_ylim(0.0, top)
    polar.set_thetagrids(range(-90, 91, 30))
    # With more circles, their labels below the disc would overlap.
    polar.set_rticks(_circles(top))
    polar.tick_params(colors=_colour(FAINT), labelsize=7)
    polar.grid(color=_colour(FAINT), alpha=0.25, lw=0.6)
    polar.spines[:].set_visible(False)
    for angle, style, label in ((-incidence, "-", "light"), (incidence, ":", "its mirror")):
        line = 2 * [np.radians(angle)]
        polar.plot(line, [0.0, top], style, color="#f2d57e", lw=1.0, label=label)
    # Below the disc: a title would stand above the hidden half, far from the plot.
    polar.text(
        np.pi, 0.27 * top, f"light at {incidence:.0f}°",
        color=_colour(INK), fontsize=9, ha="center", clip_on=False,
    )  # fmt: skip


def _circles(top: float) -> list[float]:
    """Round reflectances up to ``top``: 0 and three to five more."""
    decade = 10.0 ** np.floor(np.log10(top / 3.0))
    steps = (each * decade for each in (1.0, 2.0, 2.5, 5.0) if 3.0 * each * decade <= top)
    # The logarithm of a round number may be rounded up.
    step = max(steps, default=decade)
    return [number * step for number in range(int(top / step) + 1)]


def _colour(rgb: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)
