"""Photographs of a painting in; a relightable, colour-true surface out.

The way through: :func:`read_stack` (or :class:`Stack`, from arrays), :func:`fit_sbrdf`,
:func:`fit_reflectance`, :class:`Scene`, :func:`render`. ``dir(impasto)`` lists what is public; the
modules in it have more: ``io`` (files), ``colour``, ``systems`` (the procedures of the papers),
``simulate`` (paintings of known truth), ``doctor`` (checks before a fit), ``calibrate``, ``align``,
``capture``, ``session``, ``jobs`` (fits of any size), ``export`` and ``gpu``.
"""

import importlib as _importlib
import os as _os
import sys as _sys
import types as _types
import typing as _typing
import warnings as _warnings

from impasto._internal import starting as _starting  # noqa: F401  # isort: skip
from impasto import _core, colour, systems
from impasto._internal import viewing as _viewing
from impasto.bands import Camera
from impasto.comparison import Comparison, compare, load_comparison
from impasto.effects import Decisions, PlannedEffect
from impasto.effort import Effort
from impasto.encoding import Encoding
from impasto.environment import Environment
from impasto.errors import (
    ArgumentError,
    ClusterError,
    CorruptInputError,
    GeometryError,
    GpuUnavailableError,
    ImpastoError,
    ImpastoWarning,
    InternalError,
    MissingExtraError,
    ResumeMismatchError,
)
from impasto.fit.gloss import Gloss
from impasto.fit.highlight import HighlightFit, fit_highlight
from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.lazy import LazyStack
from impasto.fit.learning import LearnedModel, learn_sbrdf, load_learned
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.normals import LearnedNormals, Normals, fit_normals, learn_normals
from impasto.fit.partial_normals import PartialNormals
from impasto.fit.pixel import Pixel
from impasto.fit.pooled import PooledSbrdf
from impasto.fit.reflectance import Reflectance, fit_reflectance, white_corrected
from impasto.fit.result import Sbrdf
from impasto.fit.rig_refinement import refine_rig
from impasto.fit.sbrdf import fit_sbrdf, load_sbrdf
from impasto.fit.segments import Segment, SegmentSbrdf
from impasto.fit.stored import StoredSbrdf, open_sbrdf
from impasto.fit.strengths import Strengths, fit_strengths
from impasto.height import cast_shadows, integrate_normals, sky_visibility
from impasto.highlights import leave_out_highlights, reconstruct_highlights
from impasto.image import Image
from impasto.io import read_spectra, read_stack
from impasto.jobs.ingest import ingest
from impasto.jobs.job import run
from impasto.level import Level, find_level
from impasto.lights import DistantLight, PointLight
from impasto.merge import Merged, MergeReport, merge
from impasto.plan import Plan, Verification, plan
from impasto.refinement import RigRefinement
from impasto.render import display_from_bands, render
from impasto.rig import PointView, Rig
from impasto.scene import Scene
from impasto.stack import Stack
from impasto.status import Status
from impasto.study.suggestion import Suggestion, suggest_effort
from impasto.surface import Relightable, Surface
from impasto.training import Training
from impasto.varnish import Varnish

__all__ = [
    "ArgumentError",
    "Camera",
    "ClusterError",
    "Comparison",
    "CorruptInputError",
    "Decisions",
    "DistantLight",
    "Effort",
    "Encoding",
    "Environment",
    "GeometryError",
    "Gloss",
    "GpuUnavailableError",
    "HighlightFit",
    "Image",
    "ImpastoError",
    "ImpastoWarning",
    "InternalError",
    "LafortuneSbrdf",
    "LazyStack",
    "LearnedModel",
    "LearnedNormals",
    "Level",
    "LobeSbrdf",
    "MergeReport",
    "Merged",
    "MissingExtraError",
    "Normals",
    "PartialNormals",
    "Pixel",
    "Plan",
    "PlannedEffect",
    "PointLight",
    "PointView",
    "PooledSbrdf",
    "Reflectance",
    "Relightable",
    "ResumeMismatchError",
    "Rig",
    "RigRefinement",
    "Sbrdf",
    "Scene",
    "Segment",
    "SegmentSbrdf",
    "Stack",
    "Status",
    "StoredSbrdf",
    "Strengths",
    "Suggestion",
    "Surface",
    "Training",
    "Varnish",
    "Verification",
    "cast_shadows",
    "colour",
    "compare",
    "display_from_bands",
    "find_level",
    "fit_highlight",
    "fit_normals",
    "fit_reflectance",
    "fit_sbrdf",
    "fit_strengths",
    "ingest",
    "integrate_normals",
    "learn_normals",
    "learn_sbrdf",
    "leave_out_highlights",
    "load_comparison",
    "load_learned",
    "load_sbrdf",
    "merge",
    "open_sbrdf",
    "plan",
    "read_spectra",
    "read_stack",
    "reconstruct_highlights",
    "refine_rig",
    "render",
    "run",
    "sky_visibility",
    "suggest_effort",
    "systems",
    "white_corrected",
]

_LAZY = (
    "align", "calibrate", "capture", "doctor", "export", "figures", "gpu", "matching", "overview",
    "pictures", "report", "session", "simulate", "study", "training", "viewer",
)  # fmt: skip
"""Modules that are imported on first use."""

if not _typing.TYPE_CHECKING:  # type checkers still report unknown names

    def __getattr__(name: str) -> _types.ModuleType:
        """``impasto.doctor`` and other modules that are imported on first use."""
        if name in _LAZY:
            return _importlib.import_module(f"{__name__}.{name}")
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}",
            name=name,
            obj=_sys.modules[__name__],  # Python suggests the nearest name of what dir() lists
        )


def __dir__() -> list[str]:
    """What is public, whatever else has been imported: for completion, and for ``help``."""
    special = [name for name in globals() if name.startswith("__")]
    return sorted({*__all__, *_LAZY, "io", "jobs", *special})


def _show(result: _typing.Any, options: dict[str, _typing.Any]) -> _typing.Any:
    """The viewer, loaded when it is asked for: it imports results, and no result imports it."""
    from impasto.viewer.widget import view

    return view(result, **options)


_viewing.shown_by(_show)

__version__ = _core.build_info()["version"]

_level = _os.environ.get("IMPASTO_SIMD", "")
if _level not in {"", _core.build_info()["simd"]}:
    _warnings.warn(
        f"IMPASTO_SIMD={_level!r} is not known, or this machine has it not; "
        f"{_core.build_info()['simd']} is used (known are baseline, avx2 and avx512)",
        ImpastoWarning,
        stacklevel=2,
    )

if _core.build_info()["debug"]:
    _warnings.warn(
        "impasto was built without optimisation and is slow; build it with `make build`",
        RuntimeWarning,
        stacklevel=2,
    )
