"""A white board under each lamp: strengths of the lamps, evenness, and the noise of the camera.

The light of a lamp in the middle of the painting is W / (R cos(theta_w)), with W the board's linear
light above black, R its reflectance and theta_w the angle of incidence: eq. 3 of the RGB-camera
paper [@tominaga-rgb-camera]. Near lamps whose positions are known also lose their fall-off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.calibrate.board_frames import BoardFrames, read_board
from impasto.calibrate.photon_transfer import PhotonTransfer, photon_transfer
from impasto.calibrate.smooth_field import Floats, SmoothField, smooth_field
from impasto.errors import ArgumentError
from impasto.io.files import atomic_bytes
from impasto.io.images.write import write_json
from impasto.io.notes import few

SEEN = 5.0
"""Robust standard deviations from which a block is no noise ..."""
LEAST = 0.01
"""... and its relative difference, at least."""
UNSURE = 0.05
"""Standard deviation of a strength above which it is no board that was photographed: that of a
simulated board is 0.0001, that of the painting in its place 0.18."""
UNLIT = 0.1
"""Share of the median strength below which a lamp did not light."""


@dataclass(frozen=True, eq=False)
class Board:
    """What photographs of a white board tell.

    Parameters
    ----------
    names
        Of the photographs, one for each lamp.
    strengths
        ``(obs, band)``: what a perfect white in the middle of the painting, facing the lamp, reads;
        full scale is 1.
    sigma
        ``(obs, band)`` relative standard deviations of the strengths.
    repeatability
        Relative standard deviation of a lamp's strength between two photographs of the same; None
        without a second photograph.
    light
        ``(obs, rows, columns)``: the board's light, mean of the bands, of blocks of the picture.
    evenness
        ``(obs,)``: darkest over brightest part of the smooth light.
    residual
        ``(obs, rows, columns)``: logarithm of measured over smooth light, mean of the bands.
    noise
        Of each band; empty without pairs of photographs.
    findings
        What is wrong with the board, one sentence each.
    """

    names: tuple[str, ...]
    strengths: Floats
    sigma: Floats
    repeatability: float | None
    light: Floats
    evenness: Floats
    residual: Floats
    noise: tuple[PhotonTransfer, ...]
    findings: tuple[str, ...]

    def save(self, path: str | Path) -> None:
        """Write strengths as a text file (replaced atomically): one row for each lamp.

        :func:`impasto.read_stack` takes it as ``intensities``, and by itself where it is named
        ``light_intensities.txt`` and lies beside the light file. A ``.json`` of the same name has
        errors, evenness and noise.
        """
        path = Path(path)
        rows = (" ".join(f"{value:.7g}" for value in row) for row in self.strengths.tolist())
        content = {
            "kind": "impasto board",
            "version": 1,
            "photographs": list(self.names),
            "strengths": self.strengths.tolist(),
            "relative_sigma": self.sigma.tolist(),
            "repeatability": self.repeatability,
            "evenness": self.evenness.tolist(),
            "noise": [
                {"full_well": list(one.full_well), "read": list(one.read)} for one in self.noise
            ],
            "findings": list(self.findings),
        }
        write_json(path.with_suffix(".json"), content)
        atomic_bytes(path, ("\n".join(rows) + "\n").encode("ascii"))


def board_strengths(
    folder: str | Path,
    lights: str | Path,
    *,
    dark: Any = None,
    again: str | Path | None = None,
    reflectance: ArrayLike = 1.0,
    encoding: str | None = None,
    saturation: float | None = None,
    pitch_mm: float | None = None,
) -> Board:
    """Strengths of lamps from photographs of a white board in the plane of the painting.

    Parameters
    ----------
    folder
        A photograph of the board for each lamp, with the names of the lights' photographs, or as
        many in the same order.
    lights
        The light file.
    dark
        Dark frame, folder or list of dark frames, or a black level in codes.
    again
        A second folder like the first, photographed in the same way: it tells the noise of the
        camera and how well the lamps repeat.
    reflectance
        Of the board, one number or one per band.
    encoding
        Tone curve of the files; default: 8-bit files by their profile, else sRGB, others linear.
    saturation
        Code from which samples are clipped; default: the largest.
    pitch_mm
        Width of a pixel in mm, for lamps with positions; default: that of the light file.

    Raises
    ------
    ArgumentError
        No board for a lamp, an overexposed or dark one, a lamp that did not light, or other sizes.
    GeometryError
        A lamp behind the board, or positions without ``pitch_mm``.
    CorruptInputError
        A damaged photograph or light file.
    """
    options: dict[str, Any] = {
        "dark": dark, "reflectance": reflectance, "encoding": encoding, "saturation": saturation,
        "pitch_mm": pitch_mm,
    }  # fmt: skip
    first = read_board(Path(folder), Path(lights), **options, pairs=again)
    found = _board(first)
    if again is None:
        return found
    second = _board(read_board(Path(again), Path(lights), **options))
    # A difference of two has twice the variance of one.
    ratio = np.log(second.strengths / found.strengths).mean(axis=1)
    repeats = float(np.sqrt(np.mean(ratio**2) / 2.0))
    strengths = np.sqrt(found.strengths * second.strengths)
    sigma = np.sqrt(0.5 * (found.sigma**2 + second.sigma**2) / 2.0 + repeats**2 / 2.0)
    noise, findings = _noise(first)
    return replace(
        found, strengths=strengths, sigma=sigma, repeatability=repeats, noise=noise,
        findings=(*found.findings, *findings),
    )  # fmt: skip


def _board(frames: BoardFrames) -> Board:
    fields = [[smooth_field(plane, frames.size) for plane in planes] for planes in frames.white]
    strengths = np.array([[one.middle for one in row] for row in fields])
    sigma = np.array([[one.sigma for one in row] for row in fields])
    levels = strengths.mean(axis=1)
    weak = np.flatnonzero(levels < UNLIT * np.median(levels))
    if len(weak):
        named = few([frames.names[i] for i in weak])
        share = levels[weak[0]] / np.median(levels)
        raise ArgumentError(
            f"board: {named} has {100 * share:.1f} % of the usual light; did the lamp not light? "
            "Photograph the board under it again"
        )
    rough = int(np.argmax(sigma.max(axis=1)))
    if sigma[rough].max() > UNSURE:
        raise ArgumentError(
            f"board: {frames.names[rough]} is uneven as no white board is: its strength would be "
            f"uncertain by {100 * sigma[rough].max():.0f} %; is it a photograph of the painting?"
        )
    residual = np.array([np.mean([one.residual for one in row], axis=0) for row in fields])
    light = np.array([np.mean(planes, axis=0) for planes in frames.light])
    even = np.array([_evenness(row, geometry) for row, geometry in zip(
        fields, frames.geometry, strict=True
    )])  # fmt: skip
    scale = float(np.median([one.scale for row in fields for one in row]))
    return Board(
        frames.names, strengths, sigma, None, light, even, residual, (),
        tuple(_findings(frames, residual, scale)),
    )  # fmt: skip


def _evenness(fields: list[SmoothField], geometry: Floats) -> float:
    """Of the light as the camera sees it, with cosine and fall-off."""
    seen = np.mean([one.field for one in fields], axis=0) * geometry
    return float(seen.min() / seen.max())


def _findings(frames: BoardFrames, residual: Floats, scale: float) -> list[str]:
    """Spots of the board, which all lamps show, and shadows and reflections of single lamps."""
    limit = max(SEEN * scale, LEAST)
    common = np.median(residual, axis=0)
    found = []
    if len(residual) > 2 and np.abs(common).max() > limit:
        where, share = _worst(frames, common)
        found.append(
            f"all photographs: the board is {_than(share)} {where} than around it (a spot, a "
            "scratch, a border?); keep this part out of the picture or use another board"
        )
    own = residual - (common if len(residual) > 2 else 0.0)
    for name, plane in zip(frames.names, own, strict=True):
        if np.abs(plane).max() <= limit:
            continue
        where, share = _worst(frames, plane)
        blocks = int((np.abs(plane) > limit).sum())
        part = 100.0 * blocks / plane.size
        what = "a shadow of something" if share < 0 else "a reflection, or gloss of the board"
        found.append(
            f"{name}: {_than(share)} {where} than around it, on {part:.1f} % of the picture "
            f"({what}?); photograph it again"
        )
    return found


def _worst(frames: BoardFrames, plane: Floats) -> tuple[str, float]:
    row, column = np.unravel_index(int(np.abs(plane).argmax()), plane.shape)
    height, width = frames.size
    x = round((int(column) + 0.5) * width / plane.shape[1])
    y = round((int(row) + 0.5) * height / plane.shape[0])
    return f"at column {x}, row {y}", float(np.expm1(plane[row, column]))


def _than(share: float) -> str:
    return f"{abs(100.0 * share):.1f} % {'darker' if share < 0 else 'brighter'}"


def _noise(frames: BoardFrames) -> tuple[tuple[PhotonTransfer, ...], list[str]]:
    found: list[PhotonTransfer] = []
    signal, variance = frames.pairs
    for band in range(signal.shape[0]):
        try:
            found.append(photon_transfer(signal[band].ravel(), variance[band].ravel()))
        except ArgumentError as error:
            return (), [str(error)]
    return tuple(found), []


def mean_strengths(board: Board) -> NDArray[np.float64]:
    """``(obs,)``: strengths relative to their mean, each the mean of its bands' ratios."""
    relative = board.strengths / board.strengths.mean(axis=0)
    return np.asarray(relative.mean(axis=1))
