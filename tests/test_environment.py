"""Environment light: against brute force in float64, closed forms, and as files and scenes.

The oracle is ``oracles/environment.py``. Goals for a map of 128 x 64 texels, where a value is above
1e-3 of the largest: 99 % of the pixels within 0.5 % for lobes and 0.05 % for irradiance.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Environment, Scene, Surface
from impasto.colour.primaries import primary_spectra, primary_transmittances
from impasto.surface import Lobe
from oracles import environment as oracle

PIXELS = 600
XYZ_FROM_RGB = impasto.colour.Display.named("srgb").xyz_from_linear


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps are kept for all tests of a run, away from the user's own."""
    monkeypatch.setenv("IMPASTO_CACHE", str(tmp_path_factory.getbasetemp() / "environments"))


def sky(kind: str) -> np.ndarray:
    """Radiance ``(3, 64, 128)``: rooms, and the sun in a dim sky."""
    gallery = np.asarray(Environment.named("gallery").radiance)
    small = gallery.reshape(3, 64, 4, 128, 4).mean(axis=(2, 4))
    if kind == "gallery":
        return small
    rng = np.random.default_rng(5)
    if kind == "noise":
        return rng.uniform(0.0, 1.0, (3, 64, 128))
    cloudy = 0.2 + 0.8 * np.linspace(1.0, 0.0, 64)[None, :, None] * np.ones((3, 1, 128))
    # Half of the light from one texel.
    cloudy[:, 18, 74] = 1500.0
    return cloudy


def normals(slope: float = 0.15, count: int = PIXELS) -> np.ndarray:
    """``(p, 3)`` unit normals with slopes of this deviation, as the maps will hold them."""
    rng = np.random.default_rng(1)
    found = np.concatenate([rng.normal(0.0, slope, (2, count)), np.ones((1, count))])
    return (found / np.linalg.norm(found, axis=0)).T.astype(np.float32).astype(np.float64)


def shown(surface: Surface, room: Environment, view: Any = (0.0, 0.0, 1.0), **options: Any) -> Any:
    """Linear RGB ``(p, 3)`` that a one-row painting shows."""
    # In front, so that the picture has the painting's own pixels; a view from the side is put
    # into the normals and the room by whoever asks.
    image = impasto.render(surface, Scene(environment=room, view=view, **options), threads=1)
    return np.linalg.solve(XYZ_FROM_RGB, image.xyz.reshape(3, -1)).T


def painting(facets: np.ndarray, lobes: tuple[Lobe, ...] = (), **options: Any) -> Surface:
    """Matte black but for its lobes."""
    diffuse = np.zeros((3, 1, len(facets)), np.float32)
    return Surface(facets.T[:, None].astype(np.float32), diffuse, lobes, **options)


def seen_from(view: Any) -> np.ndarray:
    """The rotation that brings a view to the front."""
    z = np.asarray(view, np.float64) / np.linalg.norm(view)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def errors(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Relative errors where the light is above 1e-3 of the largest."""
    bright = expected > 1e-3 * expected.max()
    return np.asarray(np.abs(found - expected)[bright] / expected[bright])


@pytest.mark.parametrize("kind", ["gallery", "sun", "noise"])
def test_irradiance_is_that_of_all_texels(kind: str) -> None:
    room, facets = Environment(sky(kind)), normals(0.3)
    board = Surface(facets.T[:, None], np.ones((3, 1, PIXELS), np.float32))
    found = shown(board, room)
    expected = oracle.irradiance(facets, oracle.texels(sky(kind)))
    assert np.percentile(errors(found, expected), 99) < 5e-4
    front = oracle.irradiance(np.array([[0.0, 0.0, 1.0]]), oracle.texels(sky(kind)))[0]
    np.testing.assert_allclose(room.irradiance(), front, rtol=5e-4)


def test_light_under_a_varnish_crosses_it_twice() -> None:
    facets = normals(0.3)
    board = Surface(facets.T[:, None], np.ones((3, 1, PIXELS), np.float32), coated=True)
    found = shown(board, Environment(sky("sun")))
    expected = oracle.irradiance(facets, oracle.texels(sky("sun")), coated=True)
    assert np.percentile(errors(found, expected), 99) < 5e-4


@pytest.mark.parametrize("kind", ["gallery", "sun"])
@pytest.mark.parametrize("degrees", [0, 30, 60])
def test_lafortune_lobes_are_those_of_all_texels(kind: str, degrees: int) -> None:
    """Exponents from 5 on; a pixel's view from the side is a point view far away."""
    tilt, facets = np.radians(degrees), normals()
    view = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    rng = np.random.default_rng(2)
    exponent = np.exp(rng.uniform(np.log(5.0), np.log(200.0), PIXELS)).astype(np.float32)
    turn = rng.normal(0.0, 0.03, PIXELS)
    cxy, cz = (np.sin(turn) - np.cos(turn), np.sin(turn) + np.cos(turn))
    shape = tuple(p.astype(np.float32)[None] for p in (cxy, cz, exponent))
    surface = painting(facets, (Lobe(1.0, shape),), model="lafortune", pitch_mm=1e-9)
    eye = impasto.PointView(tuple(1e3 * view))
    room = Environment(sky(kind))
    found = shown(surface, room, eye)
    maps = [p[0].astype(np.float64) for p in shape]
    expected = oracle.lafortune(facets, view, *maps, oracle.texels(sky(kind)))
    assert np.percentile(errors(found, expected), 99) < 5e-3
    # The third paper's scheme takes the cosine out of the integral.
    scalar = shown(surface, Environment(sky(kind), scheme="scalar"), eye)
    assert np.median(errors(scalar, expected)) > 10 * np.median(errors(found, expected))


@pytest.mark.parametrize("kind", ["gallery", "sun"])
@pytest.mark.parametrize("gamma", [0.05, 0.15, 0.35])
def test_torrance_sparrow_lobes_are_those_of_all_texels(kind: str, gamma: float) -> None:
    facets = normals()
    found = shown(painting(facets, (Lobe(1.0, (gamma,)),)), Environment(sky(kind)))
    expected = oracle.torrance_sparrow(facets, (0, 0, 1), gamma, oracle.texels(sky(kind)))
    assert np.percentile(errors(found, expected), 99) < 5e-3


def test_a_width_per_pixel_is_read_between_tables() -> None:
    facets = normals()
    gamma = np.exp(np.random.default_rng(4).uniform(np.log(0.04), np.log(0.4), PIXELS))
    gamma = gamma.astype(np.float32)
    found = shown(painting(facets, (Lobe(1.0, (gamma[None],)),)), Environment(sky("gallery")))
    sphere = oracle.texels(sky("gallery"))
    expected = oracle.torrance_sparrow(facets, (0, 0, 1), gamma.astype(np.float64), sphere)
    assert np.percentile(errors(found, expected), 99) < 5e-3


def test_a_distant_view_from_the_side_is_that_of_a_turned_room() -> None:
    """One even facet keeps its light when the picture is foreshortened."""
    view = np.array([0.5, -0.3, 0.8]) / np.linalg.norm([0.5, -0.3, 0.8])
    facet = np.array([0.1, 0.05, 0.99]) / np.linalg.norm([0.1, 0.05, 0.99])
    even = np.repeat(facet[:, None], 400, axis=1).reshape(3, 20, 20).astype(np.float32)
    surface = Surface(even, np.zeros((3, 20, 20), np.float32), (Lobe(1.0, (0.2,)),))
    scene = Scene(environment=Environment(sky("sun")), view=view)
    image = impasto.render(surface, scene, threads=1)
    middle = image.xyz[:, image.xyz.shape[1] // 2, image.xyz.shape[2] // 2]
    found = np.linalg.solve(XYZ_FROM_RGB, middle)
    expected = oracle.torrance_sparrow(facet[None], view, 0.2, oracle.texels(sky("sun")))[0]
    np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_an_even_room_of_radiance_one_over_pi_shows_white_as_white() -> None:
    room = Environment(np.full((3, 64, 128), 1.0 / np.pi))
    facets = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    board = Surface(facets.T[:, None].astype(np.float32), np.ones((3, 1, 2), np.float32))
    image = impasto.render(board, Scene(environment=room), threads=1)
    # Clipped by the wall, a tilted facet sees (1 + cos) / 2; midpoints of texels of 0.049 rad are
    # off by 0.049^2 / 24, twice.
    np.testing.assert_allclose(image.xyz[1, 0], [1.0, 0.9], rtol=4e-4)
    # The largest exposure that clips no channel.
    assert image.exposure == pytest.approx(1.0, rel=4e-4)


def test_no_surface_reflects_more_than_it_gets() -> None:
    """A white furnace: white paint and varnish that follow the papers' strengths."""
    facets, room = normals(0.3), Environment(np.full((3, 64, 128), 1.0 / np.pi))
    tall = shown(painting(facets, (Lobe(1.0, (0.3,)),)), room)
    # beta F G D integrated over the room, F at most 0.04 to 60 degrees: gamma^2 of it.
    assert (tall > 0.0).all()
    assert (tall < 0.04 * 4.0 * 0.3**2 / np.log(2.0) / 0.7).all()
    mirror = (np.float32(-1.0), np.float32(1.0), np.float32(50.0))
    phong = shown(painting(facets, (Lobe(51.0 / 2.0, mirror),), model="lafortune"), room)
    # (n + 1) / 2 pi of the cosine lobe over radiance 1 / pi, the norm of the lobe being 2: 1.
    assert (phong < 1.0).all()
    assert phong.max() > 0.9


@pytest.mark.parametrize(("columns", "least"), [(512, 0.999), (128, 0.975), (32, 0.975)])
def test_narrow_lobes_lose_little_of_their_light(columns: int, least: float) -> None:
    """In an even room a lobe as strong as a smooth interface reflects what Fresnel's formula says.

    Texels of 512 columns hold the narrowest lobe; those of 128, and of faces of 32, are the
    coarsest that are not divided.
    """
    shape = (6, 3, columns, columns) if columns == 32 else (3, columns // 2, columns)
    room = Environment(np.full(shape, 1.0 / np.pi))
    widths = np.array([0.02, 0.01, 0.005, 0.002, 0.0005])
    level = np.zeros((3, 1, widths.size))
    level[2] = 1.0
    strengths = np.log(2.0) / (4.0 * widths**2)
    black = np.zeros((3, 1, widths.size))
    at_normal = ((1.54 - 1.0) / (1.54 + 1.0)) ** 2

    def reflected(strength: Any, width: Any, surface: slice) -> Any:
        lobes = Surface.torrance_sparrow(
            level[..., surface], black[..., surface], strength, width, index=1.54
        )
        scene = Scene(environment=room, exposure=1.0)
        return impasto.render(lobes, scene, threads=1).xyz[1, 0] / at_normal

    apart = [
        reflected(float(strength), float(width), slice(0, 1))[0]
        for strength, width in zip(strengths, widths, strict=True)
    ]
    together = reflected(strengths[None], widths[None], slice(None))
    # 1 but for gamma^2, at most 4e-4, since the lobe is not all about the normal: 1e-3 above.
    for found in (apart, together):
        assert np.min(found) > least
        assert np.max(found) < 1.001


def test_lamps_and_rooms_add_up_and_colours_are_their_own() -> None:
    facets = normals()
    rng = np.random.default_rng(7)
    diffuse = rng.uniform(0.1, 0.9, (3, 1, PIXELS)).astype(np.float32)
    surface = Surface.torrance_sparrow(facets.T[:, None], diffuse, 0.7, 0.2)
    room = Environment(sky("gallery"), intensity=0.4)
    lamp = impasto.DistantLight((0.3, 0.4, 0.8), 0.6)
    both = impasto.render(surface, Scene([lamp], environment=room), threads=1)
    alone = impasto.render(surface, Scene([lamp]), threads=1)
    lit = impasto.render(surface, Scene(environment=room), threads=1)
    np.testing.assert_allclose(both.xyz, alone.xyz + lit.xyz, rtol=2e-6)
    spheres = oracle.texels(sky("gallery"))
    expected = diffuse[:, 0].T * oracle.irradiance(facets, spheres)
    expected = expected + 0.7 * oracle.torrance_sparrow(facets, (0, 0, 1), 0.2, spheres)
    found = np.linalg.solve(XYZ_FROM_RGB, lit.xyz[:, 0]).T
    np.testing.assert_allclose(found, 0.4 * expected, rtol=5e-3)


def test_spectra_of_the_channels_sum_to_the_illuminant() -> None:
    grid = np.arange(380.0, 781.0, 5.0)
    assert np.allclose(primary_transmittances(grid).sum(axis=0), 1.0)
    assert (primary_transmittances(grid) >= 0.0).all()
    spectra = primary_spectra("A", grid)
    np.testing.assert_allclose(spectra.sum(axis=0), impasto.colour.spectrum("A", grid))
    # Mallett and Yuksel's curves give sRGB's primaries under D65 to their 5 nm tables' digits.
    total = primary_spectra("D65", grid)
    xyz = impasto.colour.xyz_from_spectrum(grid, np.ones(grid.size)) @ total.T
    primaries = xyz / xyz[1].sum()
    np.testing.assert_allclose(primaries, XYZ_FROM_RGB, atol=2e-3)


@pytest.mark.parametrize("illuminant", ["D65", "A"])
def test_a_grey_room_has_the_colour_of_the_illuminant(illuminant: str) -> None:
    """With spectra, an even white room and one lamp of the same irradiance agree."""
    rng = np.random.default_rng(0)
    grid = np.arange(400.0, 701.0, 10.0)
    basis = np.exp(-0.5 * ((grid - np.linspace(410, 690, 6)[:, None]) / 35) ** 2)
    coefficients = rng.uniform(0.0, 0.5, (6, 2, 3)).astype(np.float32)

    class Spectra:
        basis: Any
        coefficients: Any
        wavelengths = grid

    spectra = Spectra()
    spectra.basis, spectra.coefficients = basis, coefficients
    up = np.zeros((3, 2, 3), np.float32)
    up[2] = 1.0
    surface = Surface(up, coefficients)
    room = Environment(np.full((3, 64, 128), 1.0 / np.pi))
    options: Any = {"reflectance": spectra, "threads": 1}
    for d in (None, 0.56):
        scene: Any = {"illuminant": illuminant, "adaptation": d, "exposure": 1.0}
        around = impasto.render(surface, Scene(environment=room, **scene), **options)
        lamp = impasto.render(surface, Scene([(0, 0, 1)], **scene), **options)
        # The room's own irradiance is exact to 2e-4; its sources are sampled at 1 nm.
        np.testing.assert_allclose(around.xyz, lamp.xyz, rtol=1e-3)


def test_files_come_back(tmp_path: Path) -> None:
    import cv2

    radiance = np.random.default_rng(3).uniform(0.0, 50.0, (3, 16, 32)).astype(np.float32)
    impasto.io.write_exr(tmp_path / "room.exr", dict(zip("RGB", radiance, strict=True)))
    found = Environment.read(tmp_path / "room.exr", rotation=0.3)
    np.testing.assert_array_equal(found.radiance, radiance)
    assert found.rotation[0, 2] == pytest.approx(np.sin(0.3))
    bgr = np.ascontiguousarray(np.moveaxis(radiance[::-1], 0, -1))
    assert cv2.imwrite(str(tmp_path / "room.hdr"), bgr)
    packed = Environment.read(tmp_path / "room.hdr").radiance
    # Eight bits below the largest channel of a pixel.
    assert (np.abs(packed - radiance) <= radiance.max(axis=0) / 128.0).all()
    cube = np.random.default_rng(3).uniform(0.0, 1.0, (6, 3, 8, 8)).astype(np.float32)
    column = np.moveaxis(cube, 1, 0).reshape(3, 48, 8)
    impasto.io.write_exr(tmp_path / "cube.exr", dict(zip("RGB", column, strict=True)))
    np.testing.assert_array_equal(Environment.read(tmp_path / "cube.exr").radiance, cube)
    (tmp_path / "broken.hdr").write_bytes((tmp_path / "room.hdr").read_bytes()[:60])
    with pytest.raises(impasto.CorruptInputError, match=r"broken\.hdr"):
        Environment.read(tmp_path / "broken.hdr")
    for name, match in (("room.png", "exr or"), ("gone.hdr", "cannot be read")):
        with pytest.raises(impasto.ArgumentError, match=match):
            Environment.read(tmp_path / name)
    (tmp_path / "huge.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n" + bytes(99)
    )
    with pytest.raises(impasto.CorruptInputError, match=r"huge\.hdr: cannot be decoded") as refused:
        Environment.read(tmp_path / "huge.hdr")
    assert "Assertion" not in str(refused.value)
    assert "\n" not in str(refused.value)
    impasto.io.write_exr(tmp_path / "below.exr", dict.fromkeys("RGB", np.full((8, 16), -1.0, "f4")))
    with pytest.raises(impasto.ArgumentError, match=r"below\.exr has -1 at"):
        Environment.read(tmp_path / "below.exr")
    impasto.io.write_exr(tmp_path / "odd.exr", dict(zip("RGB", radiance[:, :, :30], strict=True)))
    with pytest.raises(impasto.ArgumentError, match="twice as wide"):
        Environment.read(tmp_path / "odd.exr")


def test_a_cube_lights_as_a_sphere_does() -> None:
    """A smooth function on both; a cube of 32 has texels of 0.06 rad."""

    def smooth(x: Any, y: Any, z: Any) -> Any:
        return np.stack([2.0 + x + 0 * y, 2.0 + y + z, 2.0 - x * y], axis=0)

    rows, columns = np.meshgrid(np.arange(128), np.arange(256), indexing="ij")
    latitude = 0.5 * np.pi - (rows + 0.5) * np.pi / 128
    longitude = (columns + 0.5) * 2 * np.pi / 256 - np.pi
    flat = np.cos(latitude)
    sphere = smooth(-flat * np.sin(longitude), np.sin(latitude), flat * np.cos(longitude))
    s, t = np.meshgrid((np.arange(32) + 0.5) / 16 - 1, (np.arange(32) + 0.5) / 16 - 1)
    one = np.ones_like(s)
    # OpenGL's table; x of the cube is the painting's -x.
    sides = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    faces = []
    for x, y, z in sides:
        length = np.sqrt(x * x + y * y + z * z)
        faces.append(smooth(-x / length, y / length, z / length))
    for normal in ((0, 0, 1), (0.5, 0.2, 0.8), (-0.3, -0.6, 0.7)):
        found = Environment(np.stack(faces)).irradiance(normal)
        np.testing.assert_allclose(found, Environment(sphere).irradiance(normal), rtol=2e-3)


def test_a_large_map_is_averaged_down() -> None:
    fine = np.random.default_rng(1).uniform(0.0, 1.0, (3, 600, 1200))
    room = Environment(fine)
    assert room.radiance.shape == (3, 256, 512)
    # Texels of 0.3 degrees, averaged over 0.7: their light keeps its place to 3e-3 rad.
    expected = oracle.irradiance(np.array([[0.3, 0.0, 0.954]]), oracle.texels(fine))[0]
    np.testing.assert_allclose(room.irradiance((0.3, 0.0, 0.954)), expected, rtol=2e-3)


def test_a_turn_moves_the_light_to_the_right() -> None:
    dark = np.zeros((3, 64, 128))
    dark[:, 30, 63] = 1.0
    ahead = Environment(dark)
    turned = ahead.rotated(np.radians(40))
    right, left = turned.irradiance((0.6, 0, 0.8)), turned.irradiance((-0.6, 0, 0.8))
    assert (right > left).all()
    np.testing.assert_allclose(
        ahead.rotated(0.5).rotated(-0.5).irradiance(), ahead.irradiance(), rtol=1e-6
    )


def test_kept_maps_are_used_and_rebuilt(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("IMPASTO_CACHE", str(tmp_path))
    dark = np.zeros((3, 8, 16))
    dark[:, 3, 8] = 1.0

    def lobes() -> Any:
        return Environment(dark).prefiltered(lobes=True, threads=1).lobes()

    first = lobes()
    (kept,) = tmp_path.glob("*.npz")
    np.testing.assert_array_equal(lobes(), first)
    # What lies there is what is used: maps of twice the light, which nobody would build.
    with np.load(kept) as file:
        twice = 2.0 * file["lobes"]
    built = kept.read_bytes()
    np.savez(kept, lobes=twice)
    np.testing.assert_array_equal(lobes(), 2.0 * first)
    kept.write_bytes(built)
    whole = kept.read_bytes()
    for broken in (b"", whole[: len(whole) // 2], whole[:5000] + b"\xff" * 64 + whole[5064:]):
        kept.write_bytes(broken)
        np.testing.assert_array_equal(lobes(), first)
        assert kept.read_bytes() == whole
    np.savez(kept, lobes=np.zeros(7, np.float32))
    np.testing.assert_array_equal(lobes(), first)
    monkeypatch.setenv("IMPASTO_CACHE", "off")
    kept.unlink()
    np.testing.assert_array_equal(lobes(), first)
    assert list(tmp_path.iterdir()) == []


def test_wrong_environments_are_refused() -> None:
    for bad, match in (
        (np.ones((4, 8, 16)), "shape"),
        (np.ones((6, 3, 8, 9)), "shape"),
        (np.full((3, 8, 16), np.nan), "nan"),
        (np.full((3, 8, 16), -1.0), "-1"),
        (np.full((3, 8, 16), np.inf), "inf"),
        (np.full((3, 8, 16), 1e300), r"numbers from 0 to 1e\+30; array has 1e\+300"),
    ):
        with pytest.raises(impasto.ArgumentError, match=match):
            Environment(bad)
    with pytest.raises(impasto.ArgumentError, match="rotation"):
        Environment(np.ones((3, 8, 16)), rotation=np.ones((3, 3)))
    with pytest.raises(
        impasto.ArgumentError, match=r"intensity: 1e\+10 times the largest radiance"
    ):
        Environment(np.full((3, 8, 16), 1e25), intensity=1e10)
    with pytest.raises(
        impasto.ArgumentError, match=r"normal: expected finite numbers, found \[nan"
    ):
        Environment.named("gallery").irradiance((np.nan, 0.0, 1.0))
    for no_path in (3, None):
        with pytest.raises(impasto.ArgumentError, match="path: expected the name of a file"):
            Environment.read(no_path)  # type: ignore[arg-type]
    for no_lights in (None, 3, np.array(3.0), (light for light in [(0, 0, 1)])):
        with pytest.raises(impasto.ArgumentError, match="lights: expected"):
            Scene(no_lights, environment=Environment.named("gallery"))  # type: ignore[arg-type]
    with pytest.raises(impasto.ArgumentError, match="gallery"):
        Environment.named("galery")
    with pytest.raises(impasto.GeometryError):
        Scene([])
    with pytest.raises(impasto.ArgumentError, match="Environment"):
        Scene(environment="gallery")  # type: ignore[arg-type]
    with pytest.raises(impasto.ArgumentError, match="one for the environment"):
        Scene([(0, 0, 1)], environment=Environment.named("gallery"), illuminant=["A"])


def test_a_room_does_not_move_the_eye_that_lamps_are_seen_by() -> None:
    """A near eye sees a lamp's highlight where it did; the room, as from its own direction."""
    eye = impasto.PointView((20.0, -10.0, 60.0))
    varnish = painting(normals(count=9), (Lobe(1.0, (0.2,)),), pitch_mm=4.0)
    lamp, room = impasto.DistantLight((0.1, 0.1, 0.9)), Environment.named("gallery")
    alone, both = (
        impasto.render(varnish, Scene([lamp], environment=around, view=eye, exposure=1.0)).xyz
        for around in (None, room)
    )
    only = impasto.render(varnish, Scene(environment=room, view=eye, exposure=1.0)).xyz
    # Three roundings of light of up to 10.
    np.testing.assert_allclose(both, alone + only, atol=3e-6)
    assert only.max() > 0.01


def test_a_part_has_the_pixels_of_the_whole() -> None:
    rng = np.random.default_rng(9)
    facets = normals(0.2, 40 * 30).T.reshape(3, 30, 40)
    gamma = rng.uniform(0.05, 0.4, (30, 40)).astype(np.float32)
    diffuse = rng.uniform(0.0, 1.0, (3, 30, 40))
    scene = Scene(environment=Environment.named("gallery"))
    whole = impasto.render(Surface.torrance_sparrow(facets, diffuse, 0.5, gamma), scene, threads=2)
    part = impasto.render(
        Surface.torrance_sparrow(
            facets[:, 7:19, 3:17], diffuse[:, 7:19, 3:17], 0.5, gamma[7:19, 3:17]
        ),
        scene,
        threads=1,
    )
    np.testing.assert_array_equal(part.xyz, whole.xyz[:, 7:19, 3:17])


COARSE = [(1, 1), (1, 100), (3, 2), (5, 10), (9, 9), (31, 63), (64, 127), (200, 1)]


@pytest.mark.parametrize(
    "shape", [*((3, *size) for size in COARSE), *((6, 3, n, n) for n in range(1, 32, 5))]
)
@pytest.mark.parametrize("rotation", [0.0, 0.3])
def test_a_coarse_map_is_of_patches_of_even_light(shape: tuple[int, ...], rotation: float) -> None:
    room = Environment(np.full(shape, 1.0 / np.pi), rotation=rotation)
    assert room.radiance.shape == shape
    for x, y, z in ((0, 0, 1), (0.6, 0, 0.8), (0, -0.6, 0.8), (-0.9, 0, 0.436)):
        expected = 0.5 * (1.0 + z / np.sqrt(x * x + y * y + z * z))
        # Midpoints of texels of 0.025 rad, those that the wall cuts being whole or away.
        np.testing.assert_allclose(room.irradiance((x, y, z)), expected, rtol=0.01)


def test_two_halves_are_two_patches() -> None:
    """Light from the left half of a map alone, the painting's right: in closed form."""
    halves = np.zeros((3, 1, 2))
    halves[:, :, 0] = 1.0 / np.pi
    room = Environment(halves)
    np.testing.assert_allclose(room.irradiance(), 0.5, rtol=1e-3)
    # To a facet at 45 degrees the quarter reaches from -45 to 45 degrees: the sine of it.
    np.testing.assert_allclose(room.irradiance((1.0, 0.0, 1.0)), np.sqrt(0.5), rtol=1e-3)


def test_an_environment_is_copied_and_kept_and_stays_as_it_is() -> None:
    import copy
    import pickle

    room = Environment(sky("sun"), rotation=0.3, intensity=2.0, scheme="scalar", name="sun")
    expected = room.prefiltered(lobes=True).lobes()
    for twin in (copy.copy(room), copy.deepcopy(room), pickle.loads(pickle.dumps(room))):
        np.testing.assert_array_equal(twin.radiance, room.radiance)
        assert (twin.intensity, twin.scheme, twin.name) == (2.0, "scalar", "sun")
        np.testing.assert_array_equal(twin.irradiance(), room.irradiance())
        np.testing.assert_array_equal(twin.prefiltered(lobes=True).lobes(), expected)
        with pytest.raises(ValueError, match="read-only"):
            twin.radiance[0, 0, 0] = 1.0
    for name in ("rotation", "intensity", "radiance", "scheme"):
        with pytest.raises(AttributeError, match=name):
            setattr(room, name, 0.5)
    turn = np.eye(3)
    Environment(sky("sun"), rotation=turn)
    turn[0, 0] = 2.0  # what was given stays the caller's


def test_a_black_room_says_so() -> None:
    board = Surface(normals(count=4).T[:, None], np.ones((3, 1, 4), np.float32))
    behind = np.zeros((3, 8, 16))
    behind[:, :, :2] = 1.0
    for radiance in (np.zeros((3, 8, 16)), behind):
        room = Environment(radiance)
        with pytest.raises(
            impasto.ArgumentError, match="'array' is black in front of the painting"
        ):
            impasto.render(board, Scene(environment=room))
        assert not impasto.render(board, Scene(environment=room, exposure=1.0)).xyz.any()
    lit = impasto.render(board, Scene([(0, 0, 1)], environment=Environment(behind)))
    assert (lit.xyz > 0.0).all()


def test_a_scene_of_one_illuminant_can_be_brought_into_a_room() -> None:
    room = Environment.named("gallery")
    lamps = Scene([(0, 0, 1), (0, 1, 1)], illuminant="A")
    assert lamps.changed(environment=room).illuminants == ("A", "A", "A")
    assert lamps.changed(lights=[], environment=room).illuminants == ("A",)
    assert lamps.changed(environment=room).changed(environment=None).illuminants == ("A", "A")
    mixed = Scene([(0, 0, 1), (0, 1, 1)], illuminant=["A", 3000.0])
    with pytest.raises(impasto.ArgumentError, match="one for the environment"):
        mixed.changed(environment=room)
    spectrum = (np.array([400.0, 700.0]), np.array([1.0, 2.0]))
    kept = Scene([(0, 0, 1)], illuminant=spectrum).changed(environment=room).illuminants
    assert kept == (spectrum, spectrum)


def test_what_faces_away_is_not_lit_as_what_faces_the_eye() -> None:
    """A normal straight away from the eye is none of the middle of the table of irradiance."""
    room = impasto.Environment(np.full((3, 4, 8), 2.0), name="even")
    scene = impasto.Scene(environment=room, exposure=1.0)
    tilted = np.array([0.0, 1e-7, 1e-4, 3e-4, 1e-2])
    normal = np.stack([tilted, np.zeros(5), -np.sqrt(1.0 - tilted**2)])[:, None, :]
    surface = impasto.Surface(normal.astype(np.float32), np.full((3, 1, 5), 0.5))
    away = impasto.render(surface, scene, output="light").xyz[1, 0]
    front = impasto.Surface(np.array([0.0, 0.0, 1.0])[:, None, None], np.full((3, 1, 1), 0.5))
    facing = impasto.render(front, scene, output="light").xyz[1, 0, 0]
    # The table ends a degree below the horizon, which sees half of the room.
    assert (away <= 0.51 * facing).all()
    # Neighbours of the direction away are like it.
    assert np.ptp(away) <= 0.02 * facing
