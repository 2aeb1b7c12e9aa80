"""What a saved fit must hold before it is believed: every array's type, size and range."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.checks import refractive_index
from impasto.fit.normals import Normals
from impasto.io.results import SavedMaps, rig_from_arrays

VERDICTS = ("fitted", "mixed", "no-highlight", "at-bound")


def sbrdf_fields(maps: SavedMaps) -> dict[str, Any]:
    """The arguments of :class:`~impasto.Sbrdf`, or a refusal that names file and array."""
    names = maps.array("bands", np.str_, (None,))
    bands = tuple(str(name) for name in names)
    height, width = maps.array("status", np.uint8, (None, None)).shape
    verdict = str(maps.array("verdict", np.str_, ()))
    maps.demand("verdict", verdict in VERDICTS, f"is {verdict!r}, none of {', '.join(VERDICTS)}")
    beta, gamma = _scalar(maps, "beta"), _scalar(maps, "gamma")
    maps.demand("beta", 0.0 <= beta < np.inf, f"is {beta:g}, not a finite strength from 0 on")
    maps.demand("gamma", 0.0 < gamma <= 2.0, f"is {gamma:g} rad, not within 0 to 2")
    return {
        "normal": maps.array("normal", np.float32, (3, height, width)),
        "diffuse": maps.array("diffuse", np.float32, (len(bands), height, width)),
        "beta": beta,
        "gamma": gamma,
        "index": refractive_index(_scalar(maps, "index")),
        "covariance": maps.array("covariance", np.float64, (2, 2)),
        "verdict": verdict,
        "curve": maps.array("curve", np.float64, (None, 3)),
        "path": maps.array("path", np.float64, (None, 2)),
        "describes": _scalar(maps, "describes"),
        "converged": bool(maps.array("converged", np.bool_, ())),
        **{
            name: maps.array(name, np.float32, (height, width))
            for name in ("misfit", "residual", "sigma")
        },
        "status": maps.array("status", np.uint8, (height, width)),
        "normals": saved_normals(maps, len(bands), height, width),
        "rig": rig_from_arrays(maps),
        "bands": bands,
    }


def saved_normals(maps: SavedMaps, bands: int, height: int, width: int) -> Normals:
    """The photometric stereo that a fit began with."""
    planes = {"normal": (3,), "albedo": (bands,), "rejected": (4,)}
    types: dict[str, type[np.generic]] = {
        "used": np.uint16,
        "rejected": np.uint16,
        "status": np.uint8,
    }
    stereo: dict[str, NDArray[Any]] = {
        field.name: maps.array(
            f"normals.{field.name}",
            types.get(field.name, np.float32),
            (*planes.get(field.name, ()), height, width),
        )
        for field in fields(Normals)
        if field.name != "method"
    }
    return Normals(method=str(maps.array("normals.method", np.str_, ())), **stereo)


def _scalar(maps: SavedMaps, name: str) -> float:
    return float(maps.array(name, np.float64, ()))
