"""What a scene calls for: effects are simulated where they can be seen, and nowhere else."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, thread_count
from impasto._internal.checks import one_of
from impasto.bands import Camera
from impasto.colour import delta_e, lab_from_xyz
from impasto.effects import Decision, Decisions, PlannedEffect, checked_tolerance
from impasto.fit.reflectance import Reflectance
from impasto.illumination import MIXING_GRID
from impasto.image import Image, Output, columns_to_display, tone_table
from impasto.level import Level
from impasto.lighting import Prepared, prepare
from impasto.picture import Backend, Fidelity, picture
from impasto.scene import Scene
from impasto.surface import Relightable

_OF_DISPLAY = ("clipping", "gamut clipping")
"""Effects that are part of the tone curve."""

_REPEATS = 3
"""A time is the shortest of so many."""


@dataclass(frozen=True, slots=True)
class Verification:
    """A planned picture against the one with every effect.

    Attributes
    ----------
    equal
        Whether all bits of light and coverage are equal.
    delta_e
        Largest CIEDE2000 difference of a pixel.
    codes
        Largest difference of an 8-bit display code.
    planned, forced
        Seconds that each picture took.
    """

    equal: bool
    delta_e: float
    codes: int
    planned: float
    forced: float


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Decisions):
    """What is simulated of a scene, made by :func:`plan`.

    The maps of the surface must not be changed as long as the plan is used: it rests on their
    statistics.

    Attributes
    ----------
    effects
        One :class:`PlannedEffect` per effect.
    tolerance
        As given.
    error
        The largest sum of what a tile does without, in ``unit``.
    unit
        ``"dE00"``, ``"codes"`` or ``""``.
    tiles
        Number of tiles.
    from_picture
        Whether the exposure follows from the picture, so that nothing is left out by a bound.
    """

    _scene: Scene
    _prepared: Prepared
    _native: _core.Plan
    _extra: Callable[[], NDArray[np.float32] | None]
    _again: Callable[[Scene, Plan | None], Plan]
    _statistics: _core.SurfaceStatistics

    def render(
        self,
        *,
        output: Output = "display",
        backend: Backend = "cpu",
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> Image:
        """The picture as planned; parameters as in :func:`impasto.render`."""
        one_of(output, get_args(Output), "output")
        one_of(backend, get_args(Backend), "backend")

        def again() -> NDArray[np.float32]:
            return self.render(output="light", threads=threads).xyz

        return picture(
            self._prepared,
            self._native,
            self._scene,
            self._extra(),
            again=again if output == "display" else None,
            backend=backend,
            threads=threads,
            progress=progress,
        )

    def forced(self) -> Plan:
        """The plan that simulates every effect that is there, everywhere."""
        core = _core.Plan.forced(self._prepared.surface, self._prepared.arguments)
        effects = (*_effects(core), *_folded(self._scene, self._prepared))
        return replace(self, effects=effects, tolerance=0, error=0.0, unit="", _native=core)

    def with_scene(self, scene: Scene) -> Plan:
        """A plan for another scene with the same surface.

        Statistics are used again where the scene leaves the maps as they are: a varnish adds a
        lobe, shadows may rotate a panel that leans.
        """
        return self._again(scene, self)

    def verify(self, *, threads: int | None = None) -> Verification:
        """Render both as planned and forced, and compare all pixels: their light and codes."""
        planned, seconds, _ = _timed(lambda: self.render(output="light", threads=threads), 1)
        whole = self.forced()
        forced, all_seconds, _ = _timed(lambda: whole.render(output="light", threads=threads), 1)
        white = np.linalg.solve(planned.exposure * self._scene.display.linear_from_xyz, np.ones(3))
        shown = planned.coverage > 0.0
        equal = all(
            one.tobytes() == other.tobytes()
            for one, other in ((planned.xyz, forced.xyz), (planned.coverage, forced.coverage))
        )
        differs = shown & (planned.xyz != forced.xyz).any(axis=0)
        colours = [lab_from_xyz(image.xyz[:, differs], white) for image in (planned, forced)]
        painted = self.render(threads=threads).display
        codes = np.abs(painted.astype(np.int16) - forced.display)
        return Verification(
            equal=equal,
            delta_e=float(delta_e(*colours).max(initial=0.0)),
            codes=int(codes.max(initial=0)),
            planned=seconds,
            forced=all_seconds,
        )

    def measured(self, *, threads: int | None = None) -> Plan:
        """The plan with the seconds that every effect saves, from pictures without each effect.

        Times are the shortest of three, after a picture that is not counted. A difference of two of
        them counts as 0 where it does not exceed the spread of either three, longest less shortest:
        it may be noise. So on a busy machine a small saving is 0, too.
        """
        forced = self.forced()
        forced.render(threads=threads)
        _, everything, scatter = _timed(lambda: forced.render(threads=threads), _REPEATS)
        effects = []
        for effect in self.effects:
            saves, core, share = None, None, 1.0 - effect.tiles / self.tiles
            if effect.name in _OF_DISPLAY:
                # They take no time; what they save is light on tiles that are clipped whole.
                if effect.name == _OF_DISPLAY[0] and self._native.clipped_whole:
                    core, share = forced._native.clipped_as(self._native), 1.0
            elif effect.decision in {"no-op", "bounded"} or 0 < effect.tiles < self.tiles:
                core = forced._native.without(effect.name)
            if core is not None:
                bare = replace(forced, _native=core)
                _, rest, other = _timed(lambda bare=bare: bare.render(threads=threads), _REPEATS)  # type: ignore[misc]
                gained = everything - rest
                saves = gained * share if gained > max(scatter, other) else 0.0
            effects.append(replace(effect, saves=saves))
        return replace(self, effects=tuple(effects))


def plan(
    surface: Relightable,
    scene: Scene,
    *,
    tolerance: str | float = 0,
    reflectance: Reflectance | None = None,
    camera: Camera | None = None,
    height: ArrayLike | None = None,
    pitch_mm: float | None = None,
    index: float | None = None,
    fidelity: Fidelity = "photographs",
    level: bool | Level | None = None,
    reduce: int = 1,
    threads: int | None = None,
) -> Plan:
    """Decide what a scene calls for, effect by effect and tile by tile.

    Parameters
    ----------
    surface, scene, reflectance, camera, height, pitch_mm, index, fidelity, level, reduce, threads
        As in :func:`impasto.render`.
    tolerance
        0: no bit may change. ``"code:1"``: so many 8-bit codes of the display, before rounding;
        ``"dE:0.5"``: so much CIEDE2000, relative to the display's white. The bounds of all that a
        pixel does without are summed and stay below it.

    Returns
    -------
    Plan
        With ``explain()``, ``render()``, ``forced()``, ``verify()`` and ``to_json()``.

    Raises
    ------
    ArgumentError
        A tolerance that is none of these; everything that :func:`impasto.render` refuses.
    """
    one_of(fidelity, get_args(Fidelity), "fidelity")

    def again(other: Scene, earlier: Plan | None) -> Plan:
        prepared = prepare(
            surface,
            other,
            reflectance=reflectance,
            camera=camera,
            height=height,
            pitch_mm=pitch_mm,
            index=index,
            level=level,
            reduce=reduce,
            threads=threads,
        )
        # What a fit keeps of its photographs takes longer than a plan: it is made for a picture.
        kept = shows_photographs(surface, prepared, fidelity)

        @cache
        def extra() -> NDArray[np.float32] | None:
            return surface.unmodelled(prepared.rig) if kept else None

        workers = thread_count(threads)
        if earlier is not None and _describes(earlier, prepared):
            statistics = earlier._statistics
        else:
            statistics = _core.SurfaceStatistics(prepared.surface, prepared.relief, workers)
        core, decisions = decided(
            prepared, other, statistics, tolerance=tolerance, more_light=kept, workers=workers
        )
        return Plan(
            **{one.name: getattr(decisions, one.name) for one in fields(Decisions)},
            _scene=other,
            _prepared=prepared,
            _native=core,
            _extra=extra,
            _again=again,
            _statistics=statistics,
        )

    return again(scene, None)


def decided(
    prepared: Prepared,
    scene: Scene,
    statistics: _core.SurfaceStatistics,
    *,
    tolerance: str | float,
    more_light: bool,
    workers: int,
    shape: tuple[int, int] | None = None,
) -> tuple[_core.Plan, Decisions]:
    """What a scene calls for, from the statistics of a surface.

    Parameters
    ----------
    prepared
        The surface and the scene; a part of the surface does, if ``shape`` is that of the whole.
    more_light
        Whether the picture shows what photographs show besides the model.
    """
    limit = _limit(tolerance, scene, prepared)
    core = _core.Plan(
        prepared.surface,
        statistics,
        prepared.arguments,
        tolerance=limit,
        display=_display(scene, prepared),
        more_light=more_light,
        threads=workers,
        shape=shape,
    )
    decisions = Decisions(
        effects=(*_effects(core), *_folded(scene, prepared)),
        tolerance=tolerance,
        error=core.error,
        unit="" if limit is None else "codes" if len(limit) == 3 else "dE00",
        tiles=core.tiles,
        from_picture=prepared.from_picture,
    )
    return core, decisions


def shows_photographs(surface: Relightable, prepared: Prepared, fidelity: Fidelity) -> bool:
    """Whether a picture adds what a fit keeps of its photographs besides the model."""
    kept = fidelity == "photographs" and prepared.as_photographed
    return kept and type(surface).unmodelled is not Relightable.unmodelled


def _describes(earlier: Plan, prepared: Prepared) -> bool:
    """Whether the statistics of an earlier plan are those of these maps."""
    one, other = earlier._prepared.surface, prepared.surface
    if prepared.relief is not None and not earlier._statistics.tiles[1]:
        return False
    if len(one.lobes) != len(other.lobes) or (one.ambient is None) != (other.ambient is None):
        return False
    pairs: list[tuple[Any, Any]] = [
        (one.normal, other.normal),
        (one.diffuse, other.diffuse),
        (one.ambient, other.ambient),
    ]
    for lobe, same in zip(one.lobes, other.lobes, strict=True):
        pairs += zip((lobe.strength, *lobe.shape), (same.strength, *same.shape), strict=True)
    return all(_same(*pair) for pair in pairs)


def _same(one: Any, other: Any) -> bool:
    """Whether two numbers are equal, or two maps the same memory."""
    if isinstance(one, np.ndarray) != isinstance(other, np.ndarray):
        return False
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        # Both are alive: equal addresses are the same values.
        place = ("data", "shape", "strides")
        return [one.__array_interface__[key] for key in place] == [
            other.__array_interface__[key] for key in place
        ]
    return bool(one == other)


def _limit(tolerance: str | float, scene: Scene, prepared: Prepared) -> Any:
    """A tolerance as the core takes it; None for none."""
    kind, limit = checked_tolerance(tolerance)
    # An exposure that follows from the picture is not known before it.
    if limit == 0.0 or prepared.from_picture:
        return None
    matrix = prepared.exposure * scene.display.linear_from_xyz
    if kind == "dE":
        return limit, np.linalg.solve(matrix, np.ones(3)).tolist()
    codes = 255.0 * tone_table(scene.display).astype(np.float64)
    light = np.linspace(0.0, 1.0, codes.shape[1]) ** 2
    # Within its first cell the table is steep, and rises by its first entry.
    slope = (np.diff(codes, axis=1) / np.diff(light))[:, 1:].max(axis=1)
    first = float(codes[:, 1].max())
    return max(limit - first, 0.0), matrix.tolist(), slope.tolist()


def _display(scene: Scene, prepared: Prepared) -> list[list[float]] | None:
    """Columns from XYZ to linear display light, where they are known before the picture."""
    if prepared.from_picture:
        return None
    columns: list[list[float]] = columns_to_display(scene.display, prepared.exposure).tolist()
    return columns


def _effects(core: _core.Plan) -> tuple[PlannedEffect, ...]:
    return tuple(
        PlannedEffect(row["effect"], row["decision"], row["tiles"], row["reason"], row["error"])
        for row in core.rows
    )


def _folded(scene: Scene, prepared: Prepared) -> tuple[PlannedEffect, ...]:
    """What is part of the colour matrices, and costs nothing."""
    count, coefficients, _ = prepared.arguments.diffuse.shape
    matrices = f"{count} matri{'x' if count == 1 else 'ces'} 3 x {coefficients}"
    spectra: Decision = "absent" if prepared.in_bands else "folded"
    reason = "colours of the bands" if prepared.in_bands else matrices
    if scene.adaptation is None:
        adaptation: tuple[Decision, str] = "absent", "the light is shown as it is"
    else:
        adaptation = "folded", f"d = {scene.adaptation:g}, in {matrices}"
    return (
        _small(prepared.reduce),
        PlannedEffect("spectra", spectra, 0, reason, 0.0),
        PlannedEffect("chromatic adaptation", *adaptation[:1], 0, adaptation[1], 0.0),
        _film(scene, matrices),
    )


def _small(reduce: int) -> PlannedEffect:
    """Normals within a pixel, which are part of its lobes."""
    if reduce == 1:
        return PlannedEffect("minification", "absent", 0, "a pixel for each of the surface", 0.0)
    reason = f"{reduce} x {reduce} normals widen the lobes of a pixel"
    return PlannedEffect("minification", "folded", 0, reason, 0.0)


def _film(scene: Scene, matrices: str) -> PlannedEffect:
    """What a varnish absorbs; its gloss is a lobe."""
    coat = scene.varnish
    if coat is None:
        return PlannedEffect("varnish", "absent", 0, "no coat", 0.0)
    share = 100.0 * float(coat.transmittance([450.0])[0])
    if (coat.transmittance(MIXING_GRID) == 1.0).all():
        return PlannedEffect("varnish", "no-op", 0, "a clear film", 0.0)
    what = "divided by" if coat.removed else "times"
    reason = f"{what} {share:.3g} % at 450 nm in front, in {matrices}"
    return PlannedEffect("varnish", "folded", 0, reason, 0.0)


def _timed(work: Callable[[], Image], repeats: int) -> tuple[Image, float, float]:
    """What the last of some repeats gives, the shortest time, and the longest less the shortest."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        image = work()
        seconds.append(time.perf_counter() - start)
    return image, min(seconds), max(seconds) - min(seconds)
