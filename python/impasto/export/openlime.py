"""A folder for OpenLIME: its BRDF layer, an RTI layer, and a multispectral layer of spectra.

``layers.json`` holds the options of each layer as its constructor takes them. The BRDF layer lights
``kd``, ``ks``, ``normals`` and ``gloss`` with Ward's lobe [@ward1992measuring], from the front.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.colour import display_from_coefficients
from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, Shown, measure, written
from impasto.export.rti import relightable
from impasto.export.shading import Angles, ward
from impasto.export.source import Direction, Map, Source
from impasto.export.textures import (
    Textures,
    coded_linear,
    coded_normals,
    coded_srgb,
    decoded_normals,
    decoded_srgb,
    textures,
)
from impasto.io.images.read import read_image
from impasto.io.images.write import write_jpeg, write_json, write_png8
from impasto.io.json_file import read_json
from impasto.io.rti import write_relight

ALPHA = (0.01, 0.5)
"""The layer's limits of the width: ``alphaLimits``."""
AMBIENT = 0.02
"""What the layer takes for an ambient light of 0."""
MOST_BANDS = 33
INDEX = "layers.json"
CHANNELS = ("kd", "ks", "normals", "gloss")
LOST = (
    "every view but the front: OpenLIME's BRDF layer has no other",
    "Fresnel's reflectance: highlights do not grow towards grazing light",
    "all but one lobe of a pixel, and its shape",
    "ambient light, which stands in the diffuse colour, the same for all lights",
    "shadows and what photographs show besides the model",
    "highlights broader than a width of 0.5",
)
ILLUMINANTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("D65", {}),
    ("Illuminant A", {"illuminant": "A"}),
    ("Illuminant A, adapted d = 0.56", {"illuminant": "A", "d": 0.56}),
)


def export_openlime(source: Source, out: Path) -> LossReport:
    """Write the folder.

    The loss is that of the BRDF layer, relative to how bright it shows a white board: it divides
    the diffuse colour by pi and has no exposure, so that colours are stored as bright as they fit
    (``brightness`` in ``layers.json``: the share of impasto's light that the layer shows).
    """
    maps = textures(source, "ward")
    brightness = brightness_of(maps.diffuse)
    with export_folder(out) as folder:
        for name, planes in codes_of(maps, brightness).items():
            write_png8(folder / f"{name}.png", planes)
        layers: dict[str, Any] = {"brdf": brdf_options("image", ".png")}
        write_relight(_made(folder / "rti"), relightable(source, "hsh", file=False))
        layers["rti"] = {"type": "rti", "url": "rti/info.json", "layout": "image"}
        kept = ["normals, diffuse colour and one lobe per pixel (Ward), 8 bits each"]
        kept.append("nine hemispherical harmonics, as an RTI layer")
        lost = list(LOST)
        if source.spectra is not None:
            layers["multispectral"] = _multispectral(source, _made(folder / "spectra"))
            kept.append("reflectance per wavelength, with weights for illuminants and adaptation")
        else:
            lost.append("spectra: the painting has none")
        write_json(folder / INDEX, {"layers": layers, "brightness": brightness})
        files = [path for path in folder.rglob("*") if path.is_file()]
        colours = measure(source, shown_by(folder), oblique=False)
        report = LossReport(
            "OpenLIME", tuple(kept), tuple(lost), files=written(files, folder), **colours
        )
        content = {"layers": layers, "brightness": brightness, "impasto": report.to_dict()}
        write_json(folder / INDEX, content)
        report.save(folder / REPORT)
    return report


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def brightness_of(diffuse: Map) -> float:
    """The share of the light at which 99.9 % of the colours fit, of pi at most."""
    bright = float(np.percentile(diffuse, 99.9))
    return min(np.pi, 1.0 / bright if bright > 0.0 else np.pi) / np.pi


def codes_of(maps: Textures, brightness: float) -> dict[str, NDArray[np.uint8]]:
    """The channels of the BRDF layer, ``(plane, y, x)``."""
    factor = np.float32(brightness * np.pi)
    alpha = np.clip(maps.lobe.alpha, *ALPHA)
    least, greatest = (1.0 - limit**0.25 for limit in reversed(ALPHA))
    gloss = (1.0 - np.power(alpha, 0.25) - least) / (greatest - least)
    # A highlight of Ward's lobe is ks / (4 pi alpha^2) where a white board is 1 / pi.
    peak = maps.lobe.peak * np.float32(maps.lobe.head_on)
    specular = factor * 4.0 * np.square(alpha) * peak
    return {
        "kd": coded_srgb(factor * maps.diffuse),
        "ks": coded_srgb(specular),
        "normals": coded_normals(maps.normal),
        "gloss": coded_linear(gloss)[None],
    }


def brdf_options(layout: str, suffix: str) -> dict[str, Any]:
    """The options of the BRDF layer, whose channels have names that end so."""
    return {
        "type": "brdf",
        "layout": layout,
        "channels": {name: f"{name}{suffix}" for name in CHANNELS},
        # Both must be said: the layer has no default for them.
        "colorspaces": {"kd": "srgb", "ks": "srgb"},
        "alphaLimits": list(ALPHA),
        "kAmbient": AMBIENT,
    }


def _multispectral(source: Source, folder: Path) -> dict[str, Any]:
    """Reflectance at wavelengths, three per picture, and the weights of red, green and blue."""
    spectra = source.spectra
    step = -(-len(spectra.wavelengths) // MOST_BANDS)
    at = np.arange(0, len(spectra.wavelengths), step)
    basis = np.asarray(spectra.basis)[:, at]
    flat = np.float32(basis.T) @ np.asarray(spectra.coefficients).reshape(len(basis), -1)
    bands = np.nan_to_num(flat.reshape(len(at), *source.shape))
    padded = np.zeros((-(-len(bands) // 3) * 3, *source.shape), np.float32)
    padded[: len(bands)] = bands
    for number in range(len(padded) // 3):
        picture = coded_linear(padded[3 * number : 3 * number + 3])
        write_jpeg(folder / f"band_{number:02d}.jpg", picture, quality=98)
    rows, columns = source.shape
    wavelengths = [float(one) for one in np.asarray(spectra.wavelengths)[at]]
    info: dict[str, Any] = {
        "width": columns,
        "height": rows,
        "format": "jpg",
        "type": "multispectral",
        "nplanes": len(bands),
        "basename": "band",
        "wavelength": wavelengths,
    }
    if source.pitch_mm is not None:
        info["pixelSizeInMM"] = source.pitch_mm
    write_json(folder / "info.json", info)
    write_json(folder / "presets.json", _presets(wavelengths))
    return {
        "type": "multispectral",
        "url": "spectra/info.json",
        "layout": "image",
        "defaultMode": "rgb",
        "presets": "spectra/presets.json",
    }


def _presets(wavelengths: list[float]) -> dict[str, dict[str, list[float]]]:
    """Linear display light of a unit of reflectance at each wavelength."""
    found = {}
    for name, options in ILLUMINANTS:
        illuminant = options.get("illuminant", "D65")
        adapted = {"d": options["d"]} if "d" in options else {}
        every = np.eye(len(wavelengths))
        fold = display_from_coefficients(every, wavelengths, illuminant, **adapted)
        channels = zip(("red", "green", "blue"), fold.diffuse, strict=True)
        found[name] = {channel: [float(one) for one in row] for channel, row in channels}
    return found


def shown_by(folder: Path) -> Shown:
    """What OpenLIME shows of a folder's BRDF layer, relative to its brightness."""
    content = read_json(folder / INDEX)
    options, brightness = content["layers"]["brdf"], float(content["brightness"])
    maps = {name: read_image(folder / file) for name, file in options["channels"].items()}
    return shown_of(maps, options, brightness)


def shown_of(maps: Mapping[str, NDArray[Any]], options: dict[str, Any], brightness: float) -> Shown:
    """The same of the codes of the channels ``(plane, y, x)``, with the options of the layer."""
    kd, ks, normals, gloss = (maps[name].reshape(len(maps[name]), -1) for name in CHANNELS)
    limits = options["alphaLimits"]
    least, greatest = (1.0 - limit**0.25 for limit in reversed(limits))

    def shown(light: Direction, view: Direction | None, at: NDArray[np.intp]) -> Map:
        share = gloss[0, at].astype(np.float32) / np.float32(255.0)
        alpha = np.power(1.0 - share * (greatest - least) - least, 4.0)
        angles = Angles.of(decoded_normals(normals[:, at]), light, None)
        ambient = options["kAmbient"]
        light_ = ward(decoded_srgb(kd[:, at]), decoded_srgb(ks[:, at]), alpha, angles, ambient)
        return np.asarray(light_ / np.float32(brightness * np.pi), dtype=np.float32)

    return shown
