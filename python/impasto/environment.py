"""Environments: light from all directions, as high dynamic range maps."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import thread_count
from impasto._internal.checks import MOST, number, numbers, one_of, positive
from impasto._internal.damage import DAMAGE
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.rooms import ROOMS

Scheme = Literal["vector", "scalar"]

SUFFIXES = (".exr", ".hdr", ".pic")
"""Files of environments: OpenEXR, and Radiance under two names."""
WIDTH, FACE = 512, 128
"""Columns of a map, and of a cube's face, beyond which maps are averaged down."""
COARSEST_WIDTH, COARSEST_FACE = 128, 32
"""Columns of a map, and of a cube's face, below which the wall cuts off parts of texels that count:
texels then are divided into equal ones, until there are twice as many. Constant radiance shows a
facet at up to 64 degrees to within 1 % of the truth then (maps of 1 x 1 to 127 x 127 texels, cubes
of 1 to 31, also turned)."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Y of linear sRGB."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Environment:
    """Distant light from all directions in front of a painting.

    Radiance is relative: a constant radiance of 1 / pi shows a white board that faces the viewer
    as white, as a :class:`~impasto.DistantLight` of intensity 1 straight in front of it does. What
    lies behind the plane of the painting gives no light. A map with more than 512 columns (faces
    of more than 128) is averaged down to these by solid angle; the texels of a small one are
    patches of even light.

    Parameters
    ----------
    radiance
        ``(3, y, x)`` linear RGB (sRGB primaries) over longitude and latitude, in any size: the
        middle is in front of the painting, the upper edge up, and columns run as somebody sees
        them who stands at the painting and looks into the room. Or the faces
        ``(6, 3, n, n)`` of a cube map, +x, -x, +y, -y, +z, -z as in OpenGL; +z is in front.
    rotation
        Radians by which the room is turned about the painting's vertical, or a rotation matrix
        ``(3, 3)``: positive angles move what is in front of the painting to its right.
    intensity
        Factor on the radiance.
    scheme
        ``"vector"``: Lafortune lobes by prefiltered maps of vectors, exact but for interpolation;
        ``"scalar"``: by those of the third paper, for comparison.
    name
        For reports.

    Raises
    ------
    ArgumentError
        Another shape; radiance that is negative, NaN or above 1e30; no rotation.

    Examples
    --------
    >>> import impasto
    >>> room = impasto.Environment.named("gallery")
    >>> scene = impasto.Scene(environment=room)
    """

    radiance: NDArray[np.float32]
    rotation: NDArray[np.float64]
    intensity: float
    scheme: Scheme
    name: str
    _built: dict[bool, Any] = field(init=False)

    def __init__(
        self,
        radiance: ArrayLike,
        *,
        rotation: float | ArrayLike = 0.0,
        intensity: float = 1.0,
        scheme: Scheme = "vector",
        name: str = "array",
    ) -> None:
        one_of(scheme, ("vector", "scalar"), "scheme")
        light = _checked(radiance, name)
        factor = positive(intensity, "intensity", "a positive factor")
        if not float(light.max()) * factor <= MOST:
            raise ArgumentError(
                f"intensity: {factor:g} times the largest radiance of {name}, {light.max():g}, is "
                f"above {MOST:g}"
            )
        self.__setstate__(
            {
                "radiance": light,
                "rotation": _rotation(rotation),
                "intensity": factor,
                "scheme": scheme,
                "name": name,
            }
        )

    def __getstate__(self) -> dict[str, Any]:
        """All but the tables, which a copy builds again."""
        return {name: value for name, value in vars(self).items() if name != "_built"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        set_ = object.__setattr__
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            set_(self, name, value)
        set_(self, "_built", {})

    @classmethod
    def read(cls, path: str | Path, *, rotation: float | ArrayLike = 0.0, **options: Any) -> Any:
        """An environment from a file.

        Parameters
        ----------
        path
            OpenEXR (``.exr``) or Radiance (``.hdr``): twice as wide as high is a map over
            longitude and latitude; six times as high as wide, or as wide as high, a column or a row
            of the faces of a cube.
        rotation, **options
            As in the class.

        Raises
        ------
        ArgumentError
            Another suffix, not found, or other proportions.
        CorruptInputError
            Truncated or damaged.
        """
        try:
            path = Path(path)
        except TypeError as error:
            raise ArgumentError(f"path: expected the name of a file, found {path!r}") from error
        picture = _picture(path)
        channels, height, width = picture.shape
        if channels != 3:
            raise ArgumentError(f"{path}: expected red, green and blue, found {channels} channels")
        if height == 6 * width:
            picture = np.moveaxis(picture.reshape(3, 6, width, width), 1, 0)
        elif width == 6 * height:
            faces = picture.reshape(3, height, 6, height)
            picture = np.moveaxis(faces, 2, 0)
        elif width != 2 * height:
            raise ArgumentError(
                f"{path}: expected a picture twice as wide as high, or six faces of a cube in a "
                f"row or a column, found {width} x {height} pixels"
            )
        # Compression rounds black to a little less, and colours may lie outside sRGB.
        if picture.max(initial=0.0) > 0.0:
            picture = np.maximum(picture, np.float32(0.0))
        return cls(picture, rotation=rotation, **{"name": path.name, **options})

    @classmethod
    def named(cls, name: str, *, rotation: float | ArrayLike = 0.0, **options: Any) -> Any:
        """An environment that impasto contains.

        Parameters
        ----------
        name
            ``"gallery"``: a room with a luminous ceiling, a window on the left and two track
            spots; ``"skylight"``: a hall under a roof of glass; ``"window"``: a dark room with one
            tall window on the left; ``"overcast"``: the sky of CIE's standard over open ground;
            ``"candles"``: a dark room with seven flames. A white board that faces the viewer has
            Y = 1.
        rotation, **options
            As in the class.
        """
        one_of(name, tuple(ROOMS), "name")
        return cls(ROOMS[name](), rotation=rotation, **{"name": name, **options})

    def rotated(self, rotation: float | ArrayLike) -> Environment:
        """The same room, turned further."""
        return Environment(
            self.radiance,
            rotation=_rotation(rotation) @ self.rotation,
            intensity=self.intensity,
            scheme=self.scheme,
            name=self.name,
        )

    def irradiance(self, normal: ArrayLike = (0.0, 0.0, 1.0)) -> NDArray[np.float64]:
        """``(3,)`` irradiance of a facet in linear RGB; 1 shows a white board as white."""
        vector = numbers(normal, "normal", "(x, y, z)")
        if vector.shape != (3,):
            raise ArgumentError(f"normal: expected (x, y, z), found shape {vector.shape}")
        if not np.isfinite(vector).all():
            raise ArgumentError(f"normal: expected finite numbers, found {vector.tolist()}")
        # Of any length that a number has: squares of 1e-300 would be 0.
        vector = vector / (np.abs(vector).max() or 1.0)
        found = self.prefiltered(lobes=False).irradiance(tuple(vector.tolist()))
        return self.intensity * np.array(found)

    def prefiltered(self, *, lobes: bool, threads: int | None = None) -> Any:
        """What the renderer looks up, built once; maps for Lafortune lobes are kept on disk.

        The folder is ``impasto/environments`` in ``XDG_CACHE_HOME`` (``~/.cache``); the environment
        variable ``IMPASTO_CACHE`` names another one, or is ``off``.
        """
        workers = thread_count(threads)
        if False not in self._built:
            scalar = self.scheme == "scalar"
            self._built[False] = _core.Environment(
                divided(self.radiance), self.rotation, scalar, workers
            )
        if lobes and True not in self._built:
            plain = self._built[False]
            kept = _kept(self._key(), lambda: plain.with_lobes(None, workers).lobes())
            try:
                self._built[True] = plain.with_lobes(kept, workers)
            except ImpastoError:  # damaged in a way that reading did not show
                self._built[True] = plain.with_lobes(None, workers)
        return self._built[lobes]

    def _key(self) -> str:
        texels = divided(self.radiance)
        digest = hashlib.sha256(f"{_core.Environment.VERSION} {texels.shape}".encode())
        digest.update(texels.tobytes())
        digest.update(self.rotation.tobytes())
        return digest.hexdigest()

    def __repr__(self) -> str:
        *_, height, width = self.radiance.shape
        cube = "cube of " * (self.radiance.ndim == 4)
        white = float(LUMINANCE @ self.irradiance())
        scalar = ", scalar lobes" * (self.scheme == "scalar")
        return (
            f"<Environment {self.name!r}, {cube}{width} x {height} pixels, a white board has Y = "
            f"{white:.3g}{scalar}>"
        )


def _picture(path: Path) -> NDArray[np.float32]:
    """``(band, y, x)`` of a file."""
    suffix = path.suffix.lower()
    if suffix == ".exr":
        from impasto.io.images.read import read_image

        return np.asarray(read_image(path), dtype=np.float32)
    if suffix not in SUFFIXES:
        raise ArgumentError(f"environment: expected .exr or .hdr, found {path}")
    import cv2

    with closing(RegularFile(path)) as file:
        data = file.content()
    if not data.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise CorruptInputError(path, "is not a Radiance picture")
    try:
        flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError(f"{path}: {error}") from error
        raise CorruptInputError(
            path, "cannot be decoded: it is damaged, or claims too many pixels"
        ) from error
    if decoded is None:
        raise CorruptInputError(path, "cannot be decoded: it is damaged; copy it again")
    return np.asarray(np.moveaxis(decoded[..., ::-1], -1, 0), dtype=np.float32)


def _checked(radiance: ArrayLike, name: str) -> NDArray[np.float32]:
    """Radiance that the numerics take: a size they want, every number finite and not negative."""
    values = numbers(radiance, "radiance", "linear RGB (3, y, x) or (6, 3, n, n)")
    cube = values.ndim == 4 and values.shape[:2] == (6, 3) and values.shape[2] == values.shape[3]
    if not (cube or (values.ndim == 3 and values.shape[0] == 3)) or 0 in values.shape:
        raise ArgumentError(
            f"radiance: expected (3, y, x) or cube faces (6, 3, n, n), found shape {values.shape}"
        )
    fine = (values >= 0.0) & (values <= MOST)
    if not fine.all():
        worst = tuple(int(i) for i in np.argwhere(~fine)[0])
        raise ArgumentError(
            f"radiance: expected numbers from 0 to {MOST:g}; {name} has {values[worst]:g} at "
            f"{worst}"
        )
    if cube and values.shape[-1] > FACE:
        values = _averaged(_averaged(values, FACE, -1), FACE, -2)
    elif not cube and values.shape[-1] > WIDTH:
        rows = values.shape[-2]
        edges = np.sin(np.linspace(0.5 * np.pi, -0.5 * np.pi, rows + 1))
        area = (edges[:-1] - edges[1:])[:, None]
        fewer = min(rows, WIDTH // 2)
        values = _averaged(values * area, fewer, -2) / _averaged(area, fewer, -2)
        values = _averaged(values, WIDTH, -1)
    # A sum of products may be a rounding below 0.
    return np.array(np.maximum(values, 0.0), dtype=np.float32, order="C")


def divided(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """A map whose texels are small enough for the wall: those of a coarse one in equal parts."""
    height, width = radiance.shape[-2:]
    if radiance.ndim == 4:
        # An even number of parts: the wall of an unturned room is their border.
        parts = 2 * -(-COARSEST_FACE // width) if width < COARSEST_FACE else 1
        down = across = parts
    else:
        down = -(-COARSEST_WIDTH // height) if height < COARSEST_WIDTH // 2 else 1
        across = -(-2 * COARSEST_WIDTH // width) if width < COARSEST_WIDTH else 1
    if down == across == 1:
        return radiance
    return np.ascontiguousarray(radiance.repeat(down, axis=-2).repeat(across, axis=-1))


def _averaged(values: NDArray[Any], count: int, axis: int) -> NDArray[Any]:
    """Means over ``count`` equal parts of an axis; a value is cut where a part ends."""
    along = np.moveaxis(values, axis, 0)
    size = len(along)
    sums = np.concatenate([np.zeros_like(along[:1]), np.cumsum(along, axis=0)])
    edges = np.linspace(0.0, size, count + 1)
    whole = np.minimum(edges.astype(int), size - 1)
    part = (edges - whole).reshape(-1, *(1,) * (along.ndim - 1))
    at = sums[whole] + part * along[whole]
    return np.moveaxis(np.diff(at, axis=0) * (count / size), 0, axis)


def _rotation(rotation: float | ArrayLike) -> NDArray[np.float64]:
    if np.ndim(rotation) == 0:
        angle = number(rotation, "rotation", "an angle in radians or a matrix (3, 3)")
        if not np.isfinite(angle):
            raise ArgumentError(f"rotation: expected a finite angle, found {angle}")
        sine, cosine = np.sin(angle), np.cos(angle)
        return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    matrix = numbers(rotation, "rotation", "an angle in radians or a matrix (3, 3)")
    if matrix.shape != (3, 3) or not (
        np.allclose(matrix @ matrix.T, np.eye(3), rtol=0, atol=1e-6) and np.linalg.det(matrix) > 0
    ):
        raise ArgumentError("rotation: expected an angle in radians or a rotation matrix (3, 3)")
    return np.ascontiguousarray(matrix)


def _folder() -> Path | None:
    """Where prefiltered maps are kept; None for nowhere."""
    named = os.environ.get("IMPASTO_CACHE", "")
    if named.casefold() in {"off", "0", "no"}:
        return None
    if named:
        return Path(named)
    home = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(home) if home and Path(home).is_absolute() else Path.home() / ".cache"
    return root / "impasto" / "environments"


def _kept(key: str, build: Callable[[], NDArray[np.float32]]) -> NDArray[np.float32]:
    """Numbers from the cache, or built now and kept; a cache that fails is as good as none."""
    from impasto.io.files import atomic_path

    folder = _folder()
    if folder is None:
        return build()
    path = folder / f"{key}.npz"
    try:
        # A damaged file has another checksum.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return np.ascontiguousarray(file["lobes"], dtype=np.float32)
    except (*DAMAGE, OSError):
        pass
    found = build()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.savez(file, lobes=found)
    except OSError:
        pass
    return found
