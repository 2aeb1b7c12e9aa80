"""A flat painting in Mitsuba 3, and the papers' two reflection models as BSDFs of Mitsuba.

Mitsuba (Jakob et al. 2022) does all the rest: rectangle, frames of its ``normalmap``, cameras,
lamps, fall-off, ``direct`` integrator, film, and Fresnel's reflectance. The BSDFs are written from
the papers' equations:

    Torrance-Sparrow, RGB-camera paper eq. 9 = six-band paper eq. 1:
        Y = (N.L) S E + beta D F G / (N.V) E,      D = exp(-ln 2 phi^2 / gamma^2)
    Lafortune et al. 1997 eq. 6 with Cx = Cy:
        Y = (N.L) (S + sum of A (Cxy (lx vx + ly vy) + Cz lz vz)^n) E

Mitsuba's ``eval`` is Y / E / pi: a white board has the reflectance 1, and so reads 1 in an
irradiance of pi. Samples lie in the centres of pixels, one per pixel: nothing is random.

``use("llvm_ad_rgb")`` comes before anything else. Written for Mitsuba 3.9.1, which needs libLLVM 19
or newer (Debian: libllvm19, libllvm22; the same bits with both); with 15 and 16 it ends the process
(``Cannot select: fmaximum``), 14 it does not load. ``DRJIT_LIBLLVM_PATH`` names the library.
Mitsuba 3.5.2 renders with 14, 15, 16 and 19, but its ``normalmap`` lacks two options used here.
"""

from __future__ import annotations

import math

import numpy as np

INDEX = 1.45


def use(variant):
    """Choose how Mitsuba computes, and make the two BSDFs for it."""
    global mi, dr, TorranceSparrow, Lafortune
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    TorranceSparrow, Lafortune = _bsdfs()
    return mi


def _bsdfs():
    class Maps(mi.BSDF):
        """What both have: maps ``(y, x, channel)`` of parameters, read at the nearest pixel."""

        def __init__(self, props, maps):
            mi.BSDF.__init__(self, props)
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags]
            self.m_flags = flags
            self.maps = mi.Texture2f(mi.TensorXf(upwards(maps)), filter_mode=dr.FilterMode.Nearest)

        def sample(self, ctx, si, sample1, sample2, active):
            raise NotImplementedError("lamps are sampled, not the BSDF")

        def pdf(self, ctx, si, wo, active):
            return mi.Float(0.0)

        def eval(self, ctx, si, wo, active):
            active &= (si.wi.z > 0.0) & (wo.z > 0.0)
            value = self.papers(self.maps.eval(si.uv), si.wi, wo)
            return dr.select(active, value / dr.pi, 0.0)

        def eval_pdf(self, ctx, si, wo, active):
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self):
            return type(self).__name__

    class TorranceSparrow(Maps):
        """Channels: S of three bands, then beta and gamma of each coat."""

        def papers(self, maps, view, light):
            half = dr.normalize(view + light)
            # The arc cosine of N.H would be noise in single precision.
            phi = dr.atan2(dr.sqrt(half.x * half.x + half.y * half.y), half.z)
            v_h = dr.dot(view, half)
            fresnel = mi.fresnel(v_h, INDEX)[0]
            masked, shadowed = (2.0 * half.z * c / v_h for c in (view.z, light.z))
            attenuation = dr.minimum(1.0, dr.minimum(masked, shadowed))
            total = light.z * mi.Color3f(*maps[:3])
            for beta, gamma in zip(maps[3::2], maps[4::2], strict=True):
                facets = dr.exp(-math.log(2.0) * dr.square(phi / gamma))
                total += beta * facets * fresnel * attenuation / view.z
            return total

    class Lafortune(Maps):
        """Channels: S of three bands, then A of three bands, Cxy, Cz and n of each lobe."""

        def papers(self, maps, view, light):
            total = mi.Color3f(*maps[:3])
            flat = light.x * view.x + light.y * view.y
            for lobe in zip(*(maps[i::6] for i in range(3, 9)), strict=True):
                *strength, cxy, cz, n = lobe
                base = cxy * flat + cz * light.z * view.z
                power = dr.exp(n * dr.log(dr.maximum(base, 1e-30)))
                total += mi.Color3f(*strength) * dr.select(base > 0.0, power, 0.0)
            return total * light.z

    return TorranceSparrow, Lafortune


def upwards(maps):
    """Maps ``(y, x, channel)`` with rows that run up, as v does on a rectangle."""
    return np.ascontiguousarray(maps[::-1], dtype=np.float32)


def bitmap(array):
    """A texture of a map ``(channel, y, x)``, as it is, one texel per pixel."""
    pixels = upwards(np.moveaxis(array, 0, -1))
    raw = {"raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), **raw}


def with_normals(bsdf, normal):
    """A BSDF about the normals ``(3, y, x)`` of Mitsuba's ``normalmap``."""
    # What it adds to normals for looks is left out.
    plain = {"flip_invalid_normals": False, "use_shadowing_function": False}
    encoded = 0.5 + 0.5 * np.asarray(normal, np.float64)
    return {"type": "normalmap", "normalmap": bitmap(encoded), "bsdf": bsdf, **plain}


def diffuse(reflectance):
    """Mitsuba's own Lambertian reflection."""
    return {"type": "diffuse", "reflectance": bitmap(reflectance)}


def torrance_sparrow(reflectance, beta, gamma):
    """Maps ``(3, y, x)``, and ``(coat, y, x)`` twice."""
    pairs = [plane for pair in zip(beta, gamma, strict=True) for plane in pair]
    maps = np.stack([*reflectance, *pairs], axis=-1)
    return TorranceSparrow(mi.Properties(), maps)


def lafortune(reflectance, specular, cxy, cz, exponent):
    """Maps ``(3, y, x)``, ``(lobe, 3, y, x)``, and ``(lobe, y, x)`` three times."""
    lobes = [
        plane
        for strength, *shape in zip(specular, cxy, cz, exponent, strict=True)
        for plane in (*strength, *shape)
    ]
    return Lafortune(mi.Properties(), np.stack([*reflectance, *lobes], axis=-1))


def distant(direction, intensity=1.0):
    """A distant lamp; ``direction`` points to it."""
    light = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    irradiance = {"type": "rgb", "value": float(np.pi * intensity)}
    return {"type": "directional", "direction": (-light).tolist(), "irradiance": irradiance}


def near(position, intensity=1.0):
    """A point lamp whose irradiance in the painting's middle is ``intensity``."""
    radiant = np.pi * intensity * float(np.sum(np.square(position)))
    return {
        "type": "point",
        "position": list(position),
        "intensity": {"type": "rgb", "value": radiant},
    }


def camera(shape, pitch_mm, view=(0.0, 0.0, 1.0), near_eye=False):
    """A camera whose pixels are those of the painting.

    ``view`` is a direction, seen along parallel rays, or with ``near_eye`` a position in mm: a
    camera that looks straight at the painting's plane, its film shifted.
    """
    rows, columns = shape
    width = columns * pitch_mm
    film = {
        "type": "hdrfilm", "width": columns, "height": rows, "rfilter": {"type": "box"},
        "pixel_format": "rgb", "component_format": "float32",
    }  # fmt: skip
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    placed = np.diag([-1.0, 1.0, -1.0, 1.0])  # x to the left, y up, z ahead
    view = np.asarray(view, np.float64)
    if near_eye:
        placed[:3, 3] = view
        half = 0.5 * width / view[2]
        lens = {
            "type": "perspective", "fov_axis": "x", "fov": float(np.degrees(2.0 * np.arctan(half))),
            "principal_point_offset_x": float(-view[0] / width),
            "principal_point_offset_y": float(view[1] / (rows * pitch_mm)),
        }  # fmt: skip
    else:
        towards = view / np.linalg.norm(view)
        placed[:3, :2] *= 0.5 * width
        placed[:3, 2] = -towards
        placed[:3, 3] = towards * width / towards[2]
        lens = {"type": "orthographic"}
    pose = mi.ScalarTransform4f(placed)
    return {**lens, "to_world": pose, "film": film, "sampler": sampler}


def scene(bsdf, shape, pitch_mm, lamps, **view):
    """A painting as a rectangle in z = 0 under lamps."""
    rows, columns = shape
    size = np.diag([0.5 * columns * pitch_mm, 0.5 * rows * pitch_mm, 1.0, 1.0])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
            "sensor": camera(shape, pitch_mm, **view),
            "painting": {"type": "rectangle", "to_world": mi.ScalarTransform4f(size), "bsdf": bsdf},
            **{f"lamp{i}": lamp for i, lamp in enumerate(lamps)},
        }
    )


def seen(made):
    """``(y, x, 3)`` mm: the places that the pixels' rays hit."""
    sensor = made.sensors()[0]
    columns, rows = sensor.film().size()
    x, y = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    film = mi.Point2f(x.ravel().astype(np.float32), y.ravel().astype(np.float32))
    rays, _ = sensor.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
    return np.array(made.ray_intersect(rays).p).T.reshape(rows, columns, 3)


def picture(made):
    """Linear light ``(3, y, x)``."""
    return np.moveaxis(np.array(mi.render(made, spp=1)), -1, 0)


def integrated(made, towards, solid, part):
    """Linear light ``(3, y, x)`` that pixels reflect of a room, its only light.

    Directions ``(3, m)`` with solid angles ``(m,)``; so many rows of pixels at a time.
    """
    sensor = made.sensors()[0]
    columns, rows = sensor.film().size()
    sky = made.environment()
    context = mi.BSDFContext()
    shown = np.zeros((3, rows, columns))
    for first in range(0, rows, part):
        few = min(part, rows - first)
        y, x = np.mgrid[first : first + few, :columns]
        pixels, directions = few * columns, towards.shape[1]
        film = np.stack([(x.ravel() + 0.5) / columns, (y.ravel() + 0.5) / rows])
        repeated = np.repeat(film, directions, axis=1).astype(np.float32)
        rays, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(repeated), mi.Point2f(0.5))
        hit = made.ray_intersect(rays)
        out = mi.Vector3f(np.tile(towards, (1, pixels)).astype(np.float32))
        beyond = dr.zeros(mi.SurfaceInteraction3f, pixels * directions)
        beyond.wi = -out
        weight = mi.Float(np.tile(solid, pixels).astype(np.float32))
        reflected = hit.bsdf().eval(context, hit, hit.to_local(out)) * sky.eval(beyond) * weight
        values = np.array(reflected, np.float64).reshape(3, pixels, directions)
        shown[:, first : first + few] = np.pi * values.sum(axis=2).reshape(3, few, columns)
    return shown
