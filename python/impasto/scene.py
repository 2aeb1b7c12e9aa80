"""Scenes: lamps, environment, illuminant, eye and display."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Literal, get_args

from numpy.typing import ArrayLike

from impasto._internal.checks import instance, number, numbers, positive, truth
from impasto.colour import Display
from impasto.colour.adaptation import Mode
from impasto.colour.illuminants import checked_illuminant
from impasto.environment import Environment
from impasto.errors import ArgumentError, GeometryError
from impasto.lights import DistantLight, Light
from impasto.rig import FRONTAL, PointView, Rig
from impasto.varnish import Varnish

COUNT = "illuminant: expected one per light"
"""How the message begins that illuminants are more or fewer than lights."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Scene:
    """Lights, illuminant, view and display of a rendering.

    Parameters
    ----------
    lights
        :class:`~impasto.DistantLight` and :class:`~impasto.PointLight`, or ``(light, 3)``
        directions. All stand in front of the painting (z > 0). There may be none in an environment.
    environment
        Light from all directions besides; its white is the illuminant.
    illuminant
        Light of lamps: a name (``"A"``, ``"D65"``), kelvin, or ``(wavelengths, values)``; a list
        holds one per light, and one more for an environment.
    view
        Direction to the eye, parallel rays. Off the normal, the picture is the painting
        foreshortened along its tilt, the painting's up staying up. Or a
        :class:`~impasto.PointView`: the painting's own pixels, each lit as seen from there, or with
        ``perspective`` the painting as it looks from there.
        Default: in front; where the photographs of a result have one :class:`~impasto.PointView`,
        given or refined, from there. Torrance-Sparrow lobes see an environment as from the middle
        of the painting, wherever the eye is.
    adaptation
        Degree d of chromatic adaptation from the illuminant to ``reference`` (eq. 7 to 12 of the
        six-band paper): 0 to 1; None shows the light as it is.
    adaptation_mode
        ``"planck"`` as in the paper, or ``"anchored"``; see :func:`impasto.colour.adaptation`.
    reference
        The light of complete adaptation.
    display
        ``"srgb"``, ``"display-p3"`` or a :class:`impasto.colour.Display`.
    exposure
        Factor on all light before the display: a white board in full light has Y = ``exposure``.
        None: the largest at which a white board facing all lights together clips no channel.
        ``"maximum"``: the largest Y of the picture becomes that of the display's white, ``Y_W =
        Y_max`` of the six-band paper; one bright highlight then darkens the whole picture. The
        picture reports the factor.
    shadows
        Include cast shadows of the relief: hard ones of lamps without a size, soft ones of lamps
        with a ``radius``. Of an environment each pixel then has the share that it sees of an even
        sky, and light that the relief gives back once.
    perspective
        Whether the picture from a :class:`~impasto.PointView` is in perspective, its up that of the
        painting, its middle at the painting's scale; a picture from a direction is refused.
        Default: the painting's own pixels.
    parallax
        Whether a picture from the side or in perspective shows each place of the relief where its
        height puts it, near relief before far relief. Default: with ``shadows``.
    varnish
        A coat of :class:`~impasto.Varnish` over the painting; default: the painting as it is.
    background
        Linear display light (three numbers from 0 to 1) where nothing of the painting is known or
        seen.

    Raises
    ------
    GeometryError
        A light or an eye behind the painting, no light at all.
    ArgumentError
        Any other value that cannot be used.

    Examples
    --------
    The pictures of the papers:

    >>> from impasto import DistantLight
    >>> scene = Scene([DistantLight((0, 0.71, 0.71))])
    >>> lamp = Scene([DistantLight((0, 0.71, 0.71))], illuminant="A", adaptation=0.56)
    """

    lights: tuple[Light, ...]
    environment: Environment | None
    illuminants: tuple[Any, ...]
    """One per light, and the environment's."""
    view: tuple[float, float, float] | PointView | None
    adaptation: float | None
    adaptation_mode: Mode
    reference: Any
    display: Display
    exposure: float | Literal["maximum"] | None
    shadows: bool
    perspective: bool
    parallax: bool | None
    varnish: Varnish | None
    background: tuple[float, float, float]

    def __init__(
        self,
        lights: ArrayLike | Sequence[Light] = (),
        *,
        environment: Environment | None = None,
        illuminant: Any = "D65",
        view: ArrayLike | PointView | None = None,
        adaptation: float | None = None,
        adaptation_mode: Mode = "planck",
        reference: Any = "D65",
        display: Display | str = "srgb",
        exposure: float | Literal["maximum"] | None = None,
        shadows: bool = False,
        perspective: bool = False,
        parallax: bool | None = None,
        varnish: Varnish | None = None,
        background: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        if not (environment is None or isinstance(environment, Environment)):
            raise ArgumentError(
                f"environment: expected an impasto.Environment, found {type(environment).__name__}"
            )
        dark = environment is not None and _empty(lights)
        stand_in: Any = [DistantLight(FRONTAL)] if dark else lights
        rig = Rig(stand_in, views=FRONTAL if view is None else view, pitch_mm=1.0)
        for index, light in enumerate(rig.lights):
            if not light.direction[2] > 0.0:
                raise GeometryError(
                    f"lights: light {index} is not in front of the painting "
                    f"(z is {light.direction[2]:g})"
                )
        x, y, z = rig.views[0].tolist()
        if not z > 0.0:
            raise GeometryError(f"view: the eye must be in front of the painting, found z = {z:g}")
        lamps = () if dark else rig.lights
        count = len(lamps) + (environment is not None)
        spectra = list(illuminant) if isinstance(illuminant, list) else [illuminant] * count
        if len(spectra) != count:
            more = " and one for the environment" if environment is not None else ""
            raise ArgumentError(f"{COUNT} ({len(lamps)}){more}, found {len(spectra)}")
        for one in spectra:
            checked_illuminant(one)
        checked_illuminant(reference, "reference")
        degree = "a degree from 0 to 1, or None"
        if adaptation is not None and not 0.0 <= number(adaptation, "adaptation", degree) <= 1.0:
            raise ArgumentError(f"adaptation: expected {degree}, found {adaptation}")
        if adaptation_mode not in get_args(Mode):
            raise ArgumentError(
                f'adaptation_mode: expected "planck" or "anchored", found {adaptation_mode!r}'
            )
        if exposure is not None and not (isinstance(exposure, str) and exposure == "maximum"):
            positive(exposure, "exposure", 'a positive factor or "maximum" or None')
        if varnish is not None:
            instance(varnish, Varnish, "varnish", "an impasto.Varnish, or None")
        fill = numbers(background, "background", "three numbers, 0 to 1")
        if fill.shape != (3,) or not ((fill >= 0) & (fill <= 1)).all():
            raise ArgumentError(f"background: expected three numbers, 0 to 1, found {background}")
        set_ = object.__setattr__
        set_(self, "lights", lamps)
        set_(self, "environment", environment)
        set_(self, "illuminants", tuple(spectra))
        given = view is None or isinstance(view, PointView)
        set_(self, "view", view if given else (x, y, z))
        set_(self, "adaptation", adaptation)
        set_(self, "adaptation_mode", adaptation_mode)
        set_(self, "reference", reference)
        set_(self, "display", display if isinstance(display, Display) else Display.named(display))
        set_(self, "exposure", exposure)
        set_(self, "shadows", bool(shadows))
        set_(self, "perspective", truth(perspective, "perspective"))
        set_(self, "parallax", None if parallax is None else truth(parallax, "parallax"))
        set_(self, "varnish", varnish)
        set_(self, "background", tuple(fill.tolist()))

    @property
    def has_parallax(self) -> bool:
        """Whether relief moves what is seen from the side: ``parallax``, else ``shadows``."""
        return self.shadows if self.parallax is None else self.parallax

    def changed(self, **options: Any) -> Scene:
        """The same scene with other options; the parameters are those of the class.

        One illuminant of all lights also is that of more or fewer lights, and of a room. Where they
        differ, those of an environment or of lights that are taken away go with them; other changes
        of their number need ``illuminant=``.

        Raises
        ------
        GeometryError, ArgumentError
            As the class does.
        """
        given = {
            name: getattr(self, name)
            for name in signature(Scene).parameters
            if name != "illuminant"
        }
        count = len(self.lights)
        lamps, room = list(self.illuminants[:count]), list(self.illuminants[count:])
        if options.get("environment", self.environment) is None:
            room = []
        elif "lights" in options and _empty(options["lights"]):
            lamps = []
        # Nothing is left where neither lights nor room are, which the class says.
        first, *others = spectra = [*lamps, *room] or list(self.illuminants)
        equal = all(_same(first, one) for one in others) and not isinstance(first, list)
        illuminant = first if equal else spectra
        try:
            return Scene(**{**given, "illuminant": illuminant, **options})
        except ArgumentError as error:
            if "illuminant" in options or not str(error).startswith(COUNT):
                raise
            raise ArgumentError(
                f"{error}, which are those of the scene before; give illuminant= as well"
            ) from None

    def __repr__(self) -> str:
        lamps = f"{len(self.lights)} light{'s' * (len(self.lights) != 1)}"
        if self.environment is not None:
            lamps = (
                f"{lamps} in {self.environment.name!r}"
                if self.lights
                else "in " + repr(self.environment.name)
            )
        spectra = {
            one if isinstance(one, str) else "of its own spectrum" for one in self.illuminants
        }
        eye = "" if self.adaptation is None else f", an eye adapted by {self.adaptation:g}"
        near = isinstance(self.view, PointView)
        stood = FRONTAL if self.view is None else self.view
        x, y, z = stood.position if isinstance(stood, PointView) else stood
        millimetres = " mm" if near else ""
        place = f", seen from ({x:.3g}, {y:.3g}, {z:.3g}){millimetres}"
        side = "" if (x, y) == (0.0, 0.0) and not near else place
        shadows = ", with shadows" if self.shadows else ""
        coat = "" if self.varnish is None else ", varnished"
        if self.varnish is not None and self.varnish.removed:
            coat = ", without its varnish"
        return (
            f"<Scene {lamps} ({', '.join(sorted(spectra))}){eye}{side}{shadows}{coat}, "
            f"on {self.display.name}>"
        )


def _empty(lights: Any) -> bool:
    try:
        return len(lights) == 0
    except TypeError:
        return False  # no lights at all, as a rig says


def _same(one: Any, other: Any) -> bool:
    """Whether two illuminants are one name, one temperature or one object."""
    named = (str, int, float)
    return one is other or (
        isinstance(one, named) and isinstance(other, named) and bool(one == other)
    )
