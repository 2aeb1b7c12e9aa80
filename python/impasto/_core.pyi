"""The numerics of impasto: what the Rust extension offers to the package, and to nobody else.

Arrays are C-contiguous; shapes and units stand in the public functions that call these.
"""

from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self, TypedDict, final, type_check_only

import numpy as np
from numpy.typing import NDArray

from impasto._internal.border import RigArguments, StackArguments
from impasto._internal.calls import ProgressCallback
from impasto.fit.highlight import HighlightFit
from impasto.fit.learned import LearnedLobe, PooledMaps
from impasto.fit.lobes import LearnedLobes, LobeMaps, LobeOptions
from impasto.fit.normals import Normals
from impasto.fit.partial_normals import PartialNormals
from impasto.fit.reflectance import Reflectance
from impasto.fit.start import StartArguments
from impasto.lighting import SceneArguments
from impasto.surface import Surface

@type_check_only
class BuildInfo(TypedDict):
    version: str
    sources: str
    debug: bool
    simd: str

STATUS: list[tuple[str, int]]
CONDITION_LIMIT: float
RANK_LIMIT: float
HALO: int
TYPICAL_PIXELS: int

def build_info() -> BuildInfo: ...

# Reflection models (crates/impasto-py/src/sbrdf.rs)

def predict(
    surface: Surface,
    rig: RigArguments,
    intensities: NDArray[np.float64],
    out: NDArray[np.float32],
    threads: int,
    progress: ProgressCallback | None,
) -> None: ...
def add_residual_scores(
    stack: StackArguments,
    first: int,
    shown: NDArray[np.float32],
    intensities: NDArray[np.float64],
    top: float,
    curve: NDArray[np.float32],
    basis: NDArray[np.float64],
    scores: NDArray[np.float32],
    threads: int,
) -> None: ...
def rig_equations(
    surface: Surface,
    profile: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
    rig: RigArguments,
    intensities: NDArray[np.float64],
    moved: Sequence[RigArguments],
    step: float,
    strengths: bool,
    sample_errors: NDArray[np.float64],
    slopes: NDArray[np.float64],
    held: NDArray[np.bool_],
    threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

@type_check_only
class LafortuneMaps(TypedDict):
    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    specular: NDArray[np.float32]
    cxy: NDArray[np.float32]
    cz: NDArray[np.float32]
    exponent: NDArray[np.float32]
    specular_sigma: NDArray[np.float32]
    direction_sigma: NDArray[np.float32]
    exponent_sigma: NDArray[np.float32]
    lobes: NDArray[np.uint8]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    status: NDArray[np.uint8]

def fit_lafortune(
    stack: StackArguments,
    start: StartArguments,
    maps: LafortuneMaps,
    lobes: int,
    rounds: int,
    threads: int,
    progress: ProgressCallback | None,
) -> None: ...
def views_differ(rig: RigArguments) -> bool: ...

@type_check_only
class LearnedNumbers(TypedDict):
    beta: float
    gamma: float
    log_sharpness: float
    index: float
    refined: bool
    coated: bool
    brightness: float
    noise: list[float]
    noise_floor: float
    covariance: list[list[float]]
    verdict: str
    describes: float
    converged: bool
    curve: list[list[float]]
    path: list[list[float]]

def learn_pooled(
    stack: StackArguments,
    start: StartArguments,
    maps: PooledMaps | None,
    extraction: str,
    peak: bool,
    joint: bool,
    coated: bool,
    index: float,
    pixels: int,
    threads: int,
    progress: ProgressCallback | None,
) -> LearnedNumbers: ...
def apply_pooled(
    learned: LearnedLobe,
    stack: StackArguments,
    start: StartArguments,
    maps: PooledMaps,
    threads: int,
    progress: ProgressCallback | None,
) -> None: ...

# Lobes of every pixel (crates/impasto-py/src/lobes.rs)

@type_check_only
class PriorNumbers(TypedDict):
    counts: NDArray[np.uint32]
    shapes: NDArray[np.float32]
    variances: NDArray[np.float32]

@type_check_only
class Learned(TypedDict):
    start: Literal["multistart", "neighbours", "neighbours-only"]
    bounded: bool
    pixels: int
    prior: PriorNumbers | None

def fit_lobes(
    stack: StackArguments,
    start: StartArguments,
    options: LobeOptions,
    maps: LobeMaps,
    threads: int,
    progress: ProgressCallback | None,
) -> tuple[Learned, list[tuple[str, int, int, float]]]: ...
def learn_lobes(
    stack: StackArguments,
    start: StartArguments,
    options: LobeOptions,
    extent: tuple[int, int],
    middle: tuple[float, float],
    threads: int,
    progress: ProgressCallback | None,
) -> Learned: ...
def apply_lobes(
    learned: LearnedLobes,
    stack: StackArguments,
    start: StartArguments,
    origin: tuple[int, int],
    size: tuple[int, int],
    maps: LobeMaps,
    threads: int,
    progress: ProgressCallback | None,
) -> None: ...

# One lobe per pixel (crates/impasto-py/src/highlight.rs)

def fit_highlight(
    samples: NDArray[np.float32],
    phi: NDArray[np.float32],
    maps: HighlightFit,
    threads: int,
    progress: ProgressCallback | None,
) -> None: ...

# Photometric stereo (crates/impasto-py/src/stereo.rs)

def fit_normals(
    stack: StackArguments,
    maps: Normals | PartialNormals,
    method: str,
    low: float,
    high: float,
    w1: float,
    w2: float,
    steps: int | None,
    selection: int | None,
    learned: tuple[float, float],
    threads: int,
    progress: ProgressCallback | None,
) -> None: ...
def learn_normals(
    stack: StackArguments, steps: int, selection: int | None, threads: int
) -> tuple[float, float]: ...

# Spectral reflectance

@type_check_only
class SpectralDiagnostics(TypedDict):
    condition: float
    effective_rank: float
    noise_gain: float
    training_rmse: float
    truncation: float
    ridge: float
    gamma: float

@final
class SpectralEstimator:
    @property
    def basis(self) -> NDArray[np.float64]: ...
    @property
    def diagnostics(self) -> SpectralDiagnostics: ...
    def evaluate(self, responses: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def apply(
        self,
        responses: NDArray[np.float32],
        status: NDArray[np.uint8] | None,
        maps: Reflectance,
        threads: int,
        progress: ProgressCallback | None,
    ) -> None: ...

def spectral_estimator(
    kind: str,
    response: NDArray[np.float64],
    training: NDArray[np.float64],
    noise: float,
    rank: int | None,
    seed: int,
) -> SpectralEstimator: ...

# Environment light (crates/impasto-py/src/environment.rs)

@final
class Environment:
    VERSION: int
    def __new__(
        cls,
        radiance: NDArray[np.float32],
        rotation: NDArray[np.float64],
        scalar: bool,
        threads: int,
    ) -> Environment: ...
    def with_lobes(self, kept: NDArray[np.float32] | None, threads: int) -> Environment: ...
    def lobes(self) -> NDArray[np.float32] | None: ...
    def irradiance(self, normal: tuple[float, float, float]) -> list[float]: ...

# Light between the cells of a relief (crates/impasto-py/src/radiosity.rs)

def form_factors(
    height: NDArray[np.float32], normal: NDArray[np.float32], threads: int = 1
) -> tuple[NDArray[np.uint64], NDArray[np.uint32], NDArray[np.float64]]: ...
def gather(
    first: NDArray[np.uint64],
    cell: NDArray[np.uint32],
    share: NDArray[np.float64],
    sent: NDArray[np.float32],
    threads: int = 1,
) -> NDArray[np.float64]: ...

# From maps to light (crates/impasto-py/src/relight.rs)

@final
class ToneCurve:
    def __new__(cls, codes: NDArray[np.float32]) -> Self: ...

def cast_shadows(
    height: NDArray[np.float32],
    pitch_mm: float,
    light: tuple[float, float, float],
    point: bool = False,
    threads: int = 1,
) -> NDArray[np.float32]: ...
def soft_shadows(
    height: NDArray[np.float32],
    pitch_mm: float,
    light: tuple[float, float, float],
    radius: float,
    point: bool = False,
    threads: int = 1,
) -> NDArray[np.float32]: ...
def sky_visibility(
    height: NDArray[np.float32],
    pitch_mm: float,
    azimuths: int,
    albedo: float,
    threads: int,
) -> NDArray[np.float32]: ...
def reduced_surface(
    surface: Surface, height: NDArray[np.float32] | None, factor: int, threads: int
) -> tuple[
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32] | None,
    list[tuple[NDArray[np.float32], list[NDArray[np.float32]]]],
    NDArray[np.float32] | None,
]: ...
def display_from_bands(
    planes: NDArray[np.float32],
    matrix: NDArray[np.float64],
    curve: ToneCurve,
    bits: int,
    threads: int,
) -> tuple[Any, list[int], list[int]]: ...
def integrate_normals(
    normal: NDArray[np.float32],
    pitch_mm: float,
    threads: int,
    progress: ProgressCallback | None,
) -> NDArray[np.float32]: ...
def linear_from_bands(
    planes: NDArray[np.float32], matrix: NDArray[np.float64], threads: int
) -> NDArray[np.float32]: ...
def paint(
    surface: Surface,
    height: NDArray[np.float32] | None,
    scene: SceneArguments,
    plan: Plan,
    matrix: NDArray[np.float64],
    curve: ToneCurve,
    codes: NDArray[np.uint8],
    coverage: NDArray[np.float32],
    threads: int,
    progress: ProgressCallback | None,
) -> tuple[list[int], list[int]]: ...
def render(
    surface: Surface,
    height: NDArray[np.float32] | None,
    scene: SceneArguments,
    plan: Plan,
    threads: int,
    progress: ProgressCallback | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...

# What a scene calls for (crates/impasto-py/src/plan.rs)

@type_check_only
class PlanRow(TypedDict):
    effect: str
    decision: Literal["absent", "no-op", "bounded", "on"]
    tiles: int
    error: float
    reason: str

@final
class SurfaceStatistics:
    SIDE: ClassVar[int]
    def __new__(
        cls, surface: Surface, height: NDArray[np.float32] | None = None, threads: int = 1
    ) -> Self: ...
    @property
    def tiles(self) -> tuple[int, bool]: ...
    def table(self) -> NDArray[np.float64]: ...
    @staticmethod
    def from_table(
        table: NDArray[np.float64], surface: Surface, shape: tuple[int, int], tile: int
    ) -> SurfaceStatistics: ...

@final
class Plan:
    def __new__(
        cls,
        surface: Surface,
        statistics: SurfaceStatistics,
        scene: SceneArguments,
        *,
        tolerance: tuple[float, list[float]] | tuple[float, list[list[float]], list[float]] | None,
        display: list[list[float]] | None = None,
        more_light: bool,
        threads: int,
        shape: tuple[int, int] | None = None,
    ) -> Self: ...
    @staticmethod
    def forced(surface: Surface, scene: SceneArguments) -> Plan: ...
    def without(self, effect: str) -> Plan: ...
    def clipped_as(self, other: Plan) -> Plan: ...
    @property
    def clipped_whole(self) -> int: ...
    @property
    def rows(self) -> list[PlanRow]: ...
    @property
    def error(self) -> float: ...
    @property
    def tiles(self) -> int: ...
    @property
    def projected(self) -> bool: ...

# Pictures by a graphics card (crates/impasto-py/src/gpu.rs); absent without the feature `gpu`

@type_check_only
class GpuAdapter(TypedDict):
    name: str
    kind: Literal["discrete", "integrated", "virtual", "other", "cpu"]
    backend: str
    driver: str

def gpu_adapters() -> list[GpuAdapter]: ...
def gpu_render(
    surface: Surface,
    height: NDArray[np.float32] | None,
    scene: SceneArguments,
    plan: Plan,
    threads: int,
    progress: ProgressCallback | None,
    adapter: str,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...

@final
class GpuRenderer:
    def __new__(
        cls,
        surface: Surface,
        height: NDArray[np.float32] | None,
        pitch_mm: float,
        adapter: str,
    ) -> GpuRenderer: ...
    @property
    def adapter(self) -> GpuAdapter: ...
    def light(
        self, scene: SceneArguments, threads: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
    def codes(
        self,
        scene: SceneArguments,
        matrix: NDArray[np.float64],
        curve: ToneCurve,
        threads: int,
    ) -> NDArray[np.uint8]: ...
