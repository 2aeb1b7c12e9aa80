"""The one door to colour-science: imported when first needed, and quietly.

``import impasto`` must stay fast, and ``import colour`` takes about a second.
"""

from __future__ import annotations

import importlib
import warnings
from functools import cache
from typing import Any


@cache
def science() -> Any:
    """Colour-science, the module.

    On import it warns once for each optional package (SciPy, Matplotlib, ...) that is absent; none
    of them is needed here, and a caller who turns warnings into errors must still get the module.
    Only that message is silenced. Leaving the block also takes back the warning filters that
    colour-science installs for the whole process.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"(?s).*related API features")
        return importlib.import_module("colour")
