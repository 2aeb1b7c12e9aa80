"""What came of a rehearsed session with moving views [@snel], against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto.colour import as_display, delta_e, lab_from_xyz, white_point
from impasto.depth_mesh import seen_at
from impasto.frontal_view import FrontalView
from impasto.io.session.alignment import Alignment, read_alignment
from impasto.lens import Lens, read_lens
from impasto.pictures import Panel, colour_panel, contact_sheet, normal_panel, ramp_panel
from impasto.pictures.panels import Picture
from impasto.rehearsal.moving_views import MovingSession
from impasto.rehearsal.studio import Floats, StudioCamera
from impasto.simulate.score import normal_error

Plane = NDArray[np.float32]

PAIRS = (
    ((60.0, 50.0), (240.0, 60.0)),
    ((100.0, 60.0), (275.0, 45.0)),
    ((20.0, 40.0), (120.0, 70.0)),
    ((310.0, 70.0), (90.0, 90.0)),
)
"""Azimuth and elevation in degrees of a distant light and of an eye, the first two near the mirror
direction: no photograph of the rig has them."""
BORDER = 4
"""Pixels at the edge of the painting that are not compared: frontal photographs are interpolated
there from the sheet, too."""
REPORT = Path("painting") / "aligned" / "report" / "alignment.json"
LENS = Path("painting") / "lens.json"


@dataclass(frozen=True, eq=False)
class MovingOutcome:
    """A result beside the truth.

    Attributes
    ----------
    off_px
        ``(photograph, y, x)``: how far from its place a point of the surface is in the aligned
        photograph, in pixels of it.
    flat_px
        The same, had the painting been taken for flat.
    depth_mm
        ``(y, x)``: height of the mesh less that of the surface; NaN at the border, as all maps.
    normal_degrees
        ``(y, x)``.
    delta_e
        ``(pair, y, x)``: CIEDE2000 of pictures at :data:`PAIRS`.
    relit, truth
        The picture of the first pair.
    lobes
        Mean number of lobes by the kind of varnish, found and true.
    """

    off_px: Floats
    flat_px: Floats
    depth_mm: Floats
    normal_degrees: Plane
    delta_e: Plane
    relit: impasto.Image
    truth: impasto.Image
    lobes: dict[str, tuple[float, float]]

    def numbers(self) -> dict[str, float]:
        """In pixels, mm, degrees and CIEDE2000."""
        angles, depth = (one[np.isfinite(one)] for one in (self.normal_degrees, self.depth_mm))
        near, far = (one[np.isfinite(one)] for one in (self.delta_e[:2], self.delta_e[2:]))
        return {
            "flat_rms_px": _rms(self.flat_px),
            "aligned_rms_px": _rms(self.off_px),
            "aligned_p95_px": float(np.percentile(self.off_px, 95)),
            "depth_rms_mm": _rms(depth),
            "depth_worst_mm": float(np.abs(depth).max()),
            "normal_mean_degrees": float(angles.mean()),
            "normal_p95_degrees": float(np.percentile(angles, 95)),
            "mirror_delta_e_mean": float(near.mean()),
            "mirror_delta_e_p95": float(np.percentile(near, 95)),
            "other_delta_e_mean": float(far.mean()),
            "other_delta_e_p95": float(np.percentile(far, 95)),
        } | {
            f"lobes_{kind}{word}": value
            for kind, pair in self.lobes.items()
            for word, value in zip(("", "_true"), pair, strict=True)
        }

    def picture(self, photograph: Plane, frontal: Plane, normal: Plane) -> Picture:
        """A sheet: from the flattest photograph to the picture at an unseen pair.

        Parameters
        ----------
        photograph, frontal
            ``(3, y, x)`` linear light, as the camera saw it and aligned.
        normal
            ``(3, y, x)`` as found.
        """
        (turn, up), (side, high) = PAIRS[0]
        note = f"light {turn:g}, {up:g}, eye {side:g}, {high:g} degrees"
        panels = (
            colour_panel(photograph, "The flattest photograph", note="between its markers"),
            colour_panel(frontal, "Frontal", note="lens, perspective, relief taken out"),
            ramp_panel(self.depth_mm, "Depth, error", unit="mm", low=-0.1, high=0.1),
            normal_panel(normal),
            ramp_panel(self.normal_degrees, "Normals, error", unit="degrees", low=0.0, high=5.0),
            Panel("At an unseen pair", self.relit.display, note),
            Panel("The truth", self.truth.display, note),
            ramp_panel(self.delta_e[0], "Difference", unit="CIEDE2000", low=0.0, high=10.0),
        )
        return contact_sheet(panels, title="A rehearsed session with moving views", columns=3)


def moving_outcome(session: MovingSession, sbrdf: impasto.LafortuneSbrdf) -> MovingOutcome:
    """Compare the result of a session with the truth.

    Parameters
    ----------
    session
        What was photographed; its alignment is read from its folder.
    sbrdf
        What was found, on the pixels of the painting.
    """
    painting = session.painting
    alignment = read_alignment(session.folder / REPORT)
    lens = read_lens(session.folder / LENS)
    places = _places(session)
    heights = painting.height.astype(np.float64)
    assert alignment.depth is not None
    mesh = alignment.depth.at(places)
    off, flat = (
        np.stack([
            _off(camera, alignment, name.casefold(), lens, places, heights, taken)
            for name, camera in zip(session.names, session.cameras, strict=True)
        ])
        for taken in (mesh, np.zeros_like(mesh))
    )  # fmt: skip
    true = impasto.Surface.lafortune(painting.normal, session.diffuse, **vars(session.lobes))
    rig = [impasto.DistantLight(towards(*light)) for light, _ in PAIRS]
    eyes = [towards(*eye) for _, eye in PAIRS]
    # Bands as linear sRGB, as pictures without spectra show them.
    xyz_from_bands = as_display("srgb").xyz_from_linear
    white = white_point("D65")
    lab = [
        [
            lab_from_xyz(np.tensordot(xyz_from_bands, planes, 1), white)
            for planes in one.predict(rig, eyes)
        ]
        for one in (sbrdf.surface(), true)
    ]
    differences = [
        _inside(np.asarray(delta_e(first, second), np.float64))
        for first, second in zip(*lab, strict=True)
    ]
    scene = impasto.Scene(rig[:1], view=eyes[0])
    relit, shown = (impasto.render(one, scene, level=False) for one in (sbrdf, true))
    there = (session.lobes.specular > 0.0).any(axis=1).sum(axis=0)
    counts = {
        kind: (float(sbrdf.lobes[mask].mean()), float(there[mask].mean()))
        for kind, mask in painting.masks.items()
        if mask.any()
    }
    angles = normal_error(sbrdf.normal, painting.normal).astype(np.float64)
    return MovingOutcome(
        np.stack([one[BORDER:-BORDER, BORDER:-BORDER] for one in off]),
        np.stack([one[BORDER:-BORDER, BORDER:-BORDER] for one in flat]),
        _inside(mesh - heights),
        _inside(angles).astype(np.float32),
        np.stack(differences).astype(np.float32),
        relit,
        shown,
        counts,
    )


def towards(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """The unit direction of angles in degrees."""
    turn, up = np.radians((azimuth, elevation))
    x, y, z = np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)
    return (float(x), float(y), float(z))


def _places(session: MovingSession) -> Floats:
    """``(y, x, 2)``: mm of the painting's pixels."""
    rows, columns = session.painting.size
    pitch = session.painting.pitch_mm
    x, y = (np.arange(columns) - (columns - 1) / 2) * pitch, np.arange(rows) - (rows - 1) / 2
    return np.stack(np.meshgrid(x, -y * pitch), axis=-1)


def _off(
    camera: StudioCamera,
    alignment: Alignment,
    name: str,
    lens: Lens,
    places: Floats,
    heights: Floats,
    taken: Floats,
) -> Floats:
    """``(y, x)``: pixels of the aligned photograph between where a point is and where it belongs.

    The point is where the true camera sees it, behind the lens and the homography that were found;
    it belongs where the camera that was found sees it at the height that was ``taken`` out.
    """
    found = alignment.cameras[name]
    assert found is not None
    nothing = np.empty((0, 2))
    view = FrontalView(alignment.homographies[name], lens, (), nothing, nothing)
    surface = np.concatenate([places, heights[..., None]], axis=-1).reshape(-1, 3)
    shown = view.mm(camera.pixels(surface)).reshape(places.shape)
    belongs = seen_at(places, taken, found.place_mm)
    return np.asarray(np.linalg.norm(shown - belongs, axis=-1) / alignment.grid.pixel_mm)


def _inside(values: Floats) -> Floats:
    """A map whose border is NaN."""
    kept = np.full(values.shape, np.nan)
    part = (slice(BORDER, -BORDER),) * 2
    kept[part] = values[part]
    return kept


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.square(values).mean()))
