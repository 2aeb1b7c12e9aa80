"""The one door to colour-science: imported when first needed, and quietly.

``import impasto`` must stay fast, and ``import colour`` takes most of a second. Where Matplotlib,
SciPy and pandas are installed it imports these, too, which takes three.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

OPTIONAL = ("cycler", "matplotlib", "pandas", "scipy")
"""What colour-science imports if it is installed, mocks if it is not, and what takes long."""

_alone = False


def alone() -> None:
    """Say that nobody but impasto uses this process, as on the command line.

    Colour-science is then imported as where its optional packages are not installed, in a quarter
    of the time. Its diagrams are missing then: not in a process in which somebody may want them.
    """
    global _alone
    _alone = True


@cache
def science() -> Any:
    """Colour-science, the module.

    On import it warns once for each optional package (SciPy, Matplotlib, ...) that is absent; none
    of them is needed here, and a caller who turns warnings into errors must still get the module.
    Only that message is silenced. Leaving the block also takes back the warning filters that
    colour-science installs for the whole process.
    """
    with warnings.catch_warnings(), _absent(OPTIONAL if _alone else ()):
        warnings.filterwarnings("ignore", message=r"(?s).*related API features")
        return importlib.import_module("colour")


@contextmanager
def _absent(packages: tuple[str, ...]) -> Iterator[None]:
    """Packages that are not imported yet cannot be, for a while.

    Colour-science puts mocks of them among the modules; they leave with this, too.
    """
    hidden = [name for name in packages if name not in sys.modules]
    modules: dict[str, Any] = sys.modules
    try:
        modules.update(dict.fromkeys(hidden))
        yield
    finally:
        for name in [name for name in modules if name.partition(".")[0] in hidden]:
            del modules[name]
