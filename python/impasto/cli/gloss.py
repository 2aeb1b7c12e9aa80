"""Which model of the gloss `fit` fits, and to what: options that only go together in some ways."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import CycloptsError, Group, Parameter

from impasto.errors import ArgumentError
from impasto.fit.sbrdf import Model, Pooling

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from impasto.stack import Stack

GROUP = Group("Gloss", sort_key=2)


@Parameter(name="*", group=GROUP)
@dataclass(frozen=True, kw_only=True)
class Gloss:
    """Options of :func:`impasto.fit_sbrdf`, as words of a command line."""

    model: Model = "torrance-sparrow"
    """The first two papers' lobe, or up to three of the third paper's for every pixel, which asks
    for hundreds of photographs."""

    pooling: Pooling | None = None
    """One gloss for the painting; one for every segment; or lobes of its own for every pixel:
    gilding, metal leaf, varnish that differs from place to place. The latter needs many lights and
    no --camera. Default: the painting; Lafortune lobes are always every pixel's own."""

    segments: Annotated[Path | None, Parameter(metavar="PICTURE")] = None
    """With --pooling segment: a picture as large as the photographs (PNG or TIFF) in which every
    segment has a grey or a colour of its own; black: of none."""

    lobes: int | None = None
    """With --pooling pixel or --model lafortune: lobes per pixel at most, 1 to 3; default: 2, of
    Lafortune's 3."""

    ambient: Annotated[bool | None, Parameter(negative="--no-ambient")] = None
    """With --pooling pixel: allow for light that comes from everywhere; default: yes."""

    @property
    def of_pixels(self) -> bool:
        """Whether every pixel has lobes of its own."""
        return self.pooling == "pixel" or self.model == "lafortune"

    @property
    def word(self) -> str:
        """The option that makes it other than the usual."""
        lafortune = self.model == "lafortune"
        return "--model lafortune" if lafortune else f"--pooling {self.pooling}"

    @property
    def asked(self) -> dict[str, Any]:
        """What was asked for, for the report."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def check(self, *, system: str, camera: str | None, steps: dict[str, Any]) -> None:
        """Refuse what does not go together; ``steps`` are options of the pooled fit."""
        if self.model == "lafortune" and self.pooling not in {None, "pixel"}:
            raise CycloptsError(
                msg=f"--model lafortune fits every pixel by itself: it goes without --pooling "
                f"{self.pooling}"
            )
        if self.pooling == "segment" and self.segments is None:
            raise CycloptsError(
                msg="--pooling segment needs --segments, a picture in which every segment has a "
                "grey or a colour of its own"
            )
        if self.segments is not None and self.pooling != "segment":
            raise CycloptsError(msg="--segments goes with --pooling segment")
        if self.lobes is not None and not self.of_pixels:
            raise CycloptsError(msg="--lobes goes with --pooling pixel or --model lafortune")
        if self.ambient is not None and (self.pooling != "pixel" or self.model == "lafortune"):
            raise CycloptsError(msg="--ambient goes with --pooling pixel")
        if system != "impasto" and (self.of_pixels or self.pooling == "segment"):
            raise CycloptsError(
                msg=f"{self.word} goes without --system: the papers have one gloss per painting"
            )
        if camera is not None and self.of_pixels:
            raise CycloptsError(
                msg=f"{self.word} goes without --camera: spectra tell nothing of lobes with colours"
            )
        idle = {"extraction", "joint"} if self.of_pixels else set()
        idle |= {"index"} if self.model == "lafortune" else set()
        for name in sorted(idle):
            if steps[name] is not None:
                raise CycloptsError(msg=f"{self.word} has no --{name}")

    def options(self, stack: Stack, region: tuple[int, int, int, int] | None) -> dict[str, Any]:
        """Arguments of :func:`impasto.fit_sbrdf`; none for the usual gloss."""
        if not self.of_pixels and self.pooling != "segment":
            return {}
        found: dict[str, Any] = {"model": self.model}
        if self.of_pixels:
            found |= {"pooling": "pixel"} | ({} if self.lobes is None else {"lobes": self.lobes})
            found |= {} if self.ambient is None else {"ambient": self.ambient}
        if self.segments is not None:
            labels = _labels(self.segments, stack.shape[2:], region)
            found |= {"pooling": "segment", "segments": labels}
        return found


def _labels(
    path: Path, size: tuple[int, int], region: tuple[int, int, int, int] | None
) -> NDArray[Any]:
    """The parts that a picture tells apart, in the pixels of the photographs."""
    from impasto.io import read_labels

    labels = read_labels(path)
    rows, columns = labels.shape
    if region is not None:
        top, left, height, width = region
        labels = labels[top : top + height, left : left + width]
    if labels.shape != size:
        where = "" if region is None else " before --region is cut out of both"
        raise ArgumentError(
            f"--segments: {path} has {columns} x {rows} pixels, the photographs "
            f"{size[1]} x {size[0]}; it must be as large as they are{where}"
        )
    return labels
