"""The files of a result: maps for programs, maps for viewing, and reading them back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.result import PerPixelSbrdf
from impasto.fit.segments import SegmentSbrdf
from impasto.io import write_exr, write_png8, write_png16, write_tiff16
from impasto.io.results import RESULT, result_file

SPECTRA = "reflectance.npz"


def write_maps(folder: Path, sbrdf: Any, reflectance: Any = None) -> None:
    """Write every map as 32-bit OpenEXR, and those that fit as 16-bit PNG or TIFF.

    ============================  =============================================================
    ``normal.exr``                X, Y, Z; NaN where unknown, as in all ``.exr``
    ``normal.png``                16 bits, (n + 1) / 2; black where unknown
    ``diffuse.exr``               linear, white board 1.0; R, G, B or the names of the bands
    ``diffuse.png``, ``.tif``     16 bits: sRGB for one or three bands, else linear TIFF
    ``lobes.exr``                 with lobes per pixel: ``1.R`` and so on, the strength of lobe 1,
                                  ``1.gamma`` and ``1.sigma`` in degrees, ``ambient.R``, ``lobes``;
                                  of Lafortune ``1.cxy``, ``1.cz`` and ``1.exponent``, and the
                                  errors ``1.specular_sigma``, ``1.direction_sigma`` (degrees)
                                  and ``1.exponent_sigma``
    ``gloss.exr``                 with lobes per segment: ``beta``, and ``gamma`` in degrees
    ``quality.exr``               status, residual, sigma (degrees), misfit of the gloss,
                                  condition, samples used and rejected, by reason
    ``status.png``                8 bits: the codes of :class:`impasto.Status`
    ``sbrdf.npz``                 all of it, for ``impasto render`` and :func:`impasto.load_sbrdf`
    ``reflectance.npz``           spectra, if the camera is known
    ``colour.png``                16 bits, sRGB: the diffuse colour under D65, from the spectra
    ============================  =============================================================
    """
    write_exr(folder / "normal.exr", dict(zip("XYZ", sbrdf.normal, strict=True)))
    write_png16(folder / "normal.png", (sbrdf.normal.astype(np.float32) + 1.0) / 2.0)
    write_exr(folder / "diffuse.exr", _channels(sbrdf))
    if len(sbrdf.diffuse) in {1, 3}:
        write_png16(folder / "diffuse.png", _coded(sbrdf.diffuse))
    else:
        write_tiff16(folder / "diffuse.tif", sbrdf.diffuse, attributes={"bands": sbrdf.bands})
    if isinstance(sbrdf, PerPixelSbrdf):
        write_exr(folder / "lobes.exr", _lobes(sbrdf))
    if isinstance(sbrdf, SegmentSbrdf):
        write_exr(folder / "gloss.exr", _segments(sbrdf))
    write_exr(folder / "quality.exr", _quality(sbrdf))
    write_png8(folder / "status.png", np.asarray(sbrdf.status, dtype=np.uint8))
    sbrdf.save(folder / RESULT)
    if reflectance is not None:
        from impasto.colour import display_from_coefficients, icc_profile
        from impasto.render import display_from_bands

        reflectance.save(folder / SPECTRA)
        fold = display_from_coefficients(reflectance.basis, reflectance.wavelengths, "D65")
        colour = display_from_bands(reflectance.coefficients, fold, bits=16)
        write_png16(
            folder / "colour.png", np.moveaxis(colour, -1, 0), icc=icc_profile(fold.display)
        )


def name_of(result: Path) -> str:
    """What a result is called: its folder, or its file without what says that it is one."""
    path = result.resolve()
    path = path.parent if path.name == RESULT else path
    return path.name.removesuffix(".zarr").removesuffix(".npz").removesuffix(".impasto")


def load_result(folder: Path) -> tuple[Any, Any]:
    """The fit in a result folder and its reflectance, or None if the camera was unknown.

    Raises
    ------
    ArgumentError
        There is no result.
    CorruptInputError
        The result is damaged, or of two runs.
    """
    import impasto
    from impasto.cli.folder import check_listed

    path = result_file(folder)
    if not path.is_dir() and (not path.is_file() or path.suffix.lower() != ".npz"):
        what = "does not exist" if not folder.exists() else f"has no {RESULT}"
        raise ArgumentError(
            f"{folder} {'is no result' if path.is_file() else what}: expected the --out folder of "
            f"impasto fit or demo, its {RESULT}, or the .zarr of impasto job run"
        )
    spectra = _spectra_of(path)
    if not path.is_dir():
        check_listed([path] if spectra is None else [path, spectra])
    reflectance = None if spectra is None else impasto.Reflectance.load(spectra)
    return impasto.load_sbrdf(path), reflectance


def result_files(folder: Path) -> list[Path]:
    """The files that :func:`load_result` reads."""
    path = result_file(folder)
    if path.is_dir():
        return sorted(file for file in path.rglob("*") if file.is_file())
    spectra = _spectra_of(path)
    return [path] if spectra is None else [path, spectra]


def _spectra_of(path: Path) -> Path | None:
    """The spectra beside the fit of a result folder; a store has none."""
    spectra = path.with_name(SPECTRA)
    return spectra if path.is_file() and spectra.is_file() else None


def _channels(sbrdf: Any) -> dict[str, NDArray[np.float32]]:
    return dict(zip(_band_names(sbrdf), sbrdf.diffuse, strict=True))


def _band_names(sbrdf: Any) -> tuple[str, ...]:
    if len(sbrdf.diffuse) in {1, 3}:
        return ("Y",) if len(sbrdf.diffuse) == 1 else ("R", "G", "B")
    return tuple(sbrdf.bands)


def _lobes(sbrdf: PerPixelSbrdf) -> dict[str, NDArray[Any]]:
    names = _band_names(sbrdf)
    channels: dict[str, NDArray[Any]] = {"lobes": sbrdf.lobes}
    for number, strengths in enumerate(sbrdf.specular, start=1):
        shape = {name: getattr(sbrdf, name)[number - 1] for name in sbrdf.SHAPE}
        if isinstance(sbrdf, LobeSbrdf):
            shape["gamma"] = np.degrees(shape["gamma"])
            shape["sigma"] = shape["gamma"] * sbrdf.gamma_sigma[number - 1]
        if isinstance(sbrdf, LafortuneSbrdf):
            shape["specular_sigma"] = sbrdf.specular_sigma[number - 1]
            shape["direction_sigma"] = np.degrees(sbrdf.direction_sigma[number - 1])
            shape["exponent_sigma"] = sbrdf.exponent_sigma[number - 1]
        shape |= dict(zip(names, strengths, strict=True))
        channels |= {f"{number}.{name}": plane for name, plane in shape.items()}
    if isinstance(sbrdf, LobeSbrdf):
        ambient = zip(names, sbrdf.ambient, strict=True)
        channels |= {f"ambient.{name}": plane for name, plane in ambient}
    return channels


def _segments(sbrdf: SegmentSbrdf) -> dict[str, NDArray[Any]]:
    return {"beta": sbrdf.beta, "gamma": np.degrees(sbrdf.gamma)}


def _coded(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    coded = Encoding("srgb").encode(np.nan_to_num(linear, nan=0.0))
    return np.asarray(coded, dtype=np.float32)


def _quality(sbrdf: Any) -> dict[str, NDArray[Any]]:
    stereo = sbrdf.normals
    reasons = ("saturated", "invalid", "shadow", "highlight")
    return {
        "status": sbrdf.status,
        "residual": sbrdf.residual,
        "sigma": np.degrees(sbrdf.sigma),
        **({} if isinstance(sbrdf, PerPixelSbrdf) else {"misfit": sbrdf.misfit}),
        "condition": stereo.condition,
        "used": stereo.used,
        **{f"rejected.{name}": p for name, p in zip(reasons, stereo.rejected, strict=True)},
    }
