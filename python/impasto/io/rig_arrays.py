"""A rig as plain arrays, for the files of stacks and results."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import numbers
from impasto.errors import ArgumentError
from impasto.lights import DistantLight, Light, PointLight
from impasto.refinement import RigRefinement
from impasto.rig import Rig, Views, viewpoints


def arrays_of_rig(rig: Rig) -> dict[str, NDArray[Any]]:
    """``lights`` (positions in mm where ``near``), ``pitch_mm`` if known, and so on."""
    arrays: dict[str, NDArray[Any]] = {
        "lights": rig.vectors,
        "near": rig.near,
        "falloff": rig.falloff,
        "intensities": rig.intensities,
        "views": rig.views,
    }
    if rig.radii.any():
        arrays["radii"] = rig.radii
    if rig.near_views.any():
        arrays["view_positions"] = rig.view_positions
    if rig.pitch_mm is not None:
        arrays["pitch_mm"] = np.array(rig.pitch_mm)
    if rig.origin != (0.0, 0.0):
        arrays["origin"] = np.array(rig.origin)
    if rig.refinement is not None:
        arrays["refinement"] = np.array(rig.refinement.to_json())
    return arrays


def rig_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> Rig:
    """The rig of the arrays of :func:`arrays_of_rig`; all but ``lights`` may be missing.

    Raises
    ------
    ArgumentError
        An array of another shape, named.
    """
    vectors = numbers(arrays["lights"], "lights", "numbers")
    count = len(vectors)
    near = arrays.get("near", np.zeros(count, bool))
    falloff = arrays.get("falloff", np.ones(count, bool))
    strength = arrays.get("intensities", np.ones(count)).tolist()
    radii = arrays.get("radii", np.zeros(count)).tolist()
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ArgumentError(f"lights: expected (obs, 3), found shape {vectors.shape}")
    named = (("near", near), ("falloff", falloff), ("intensities", strength), ("radii", radii))
    for name, array in named:
        if np.shape(array) != (count,):
            raise ArgumentError(f"{name}: expected shape ({count},), found {np.shape(array)}")
    lights: list[Light] = [
        PointLight((x, y, z), strength[i], bool(falloff[i]), radii[i])
        if near[i]
        else DistantLight((x, y, z), strength[i], radii[i])
        for i, (x, y, z) in enumerate(vectors.tolist())
    ]
    pitch = float(arrays["pitch_mm"]) if "pitch_mm" in arrays else None
    origin = arrays.get("origin", np.zeros(2))
    directions = arrays.get("views")
    views: Views | None = directions
    if directions is not None and "view_positions" in arrays:
        views = viewpoints(directions, arrays["view_positions"])
    refinement = None
    if "refinement" in arrays:
        refinement = RigRefinement.from_json(str(arrays["refinement"]))
    return Rig(
        lights,
        views=views,
        pitch_mm=pitch,
        origin=(origin[0], origin[1]),
        refinement=refinement,
    )
