"""One call of one version of impasto; ``versions.py`` runs this with that version's modules.

    python benches/python/version_calls.py DATA OPTIONS

Nothing here is newer than the oldest version that is compared: arrays, lights and options of
``fit_sbrdf`` only. ``DATA`` is what ``versions.py`` has written, ``OPTIONS`` are JSON. Prints JSON.
"""

import inspect
import json
import sys
import time

import numpy as np

import impasto


def main() -> None:
    data = np.load(sys.argv[1])
    options = json.loads(sys.argv[2])
    known = inspect.signature(impasto.fit_sbrdf).parameters
    if "refine" not in known:
        options.pop("refine", None)
    views = {"views": data["views"]} if "views" in data else {}
    stack = impasto.Stack(
        data["samples"], lights=data["lights"], scale=data["scale"], saturation=data["saturation"],
        **views,
    )  # fmt: skip
    begin = time.process_time()
    if options.pop("call", "fit") == "normals":
        found = impasto.fit_normals(stack, threads=1, **options)
    else:
        found = impasto.fit_sbrdf(stack, threads=1, **options)
    result = {"seconds": time.process_time() - begin}
    # By the chord: a cosine in single precision has lost small angles.
    apart = np.linalg.norm(found.normal.astype(np.float64) - data["normal"], axis=0)
    result["degrees"] = float(np.degrees(np.nanmean(2.0 * np.arcsin(0.5 * apart))))
    if hasattr(found, "predict") and "held" in data:
        seen = {"views": data["held_views"]} if "held_views" in data else {}
        shown = np.minimum(np.nan_to_num(found.predict(data["held_lights"], **seen)), data["limit"])
        held = np.minimum(data["held"], data["limit"])
        squares = np.sum((shown - held).astype(np.float64) ** 2)
        result["error"] = float(np.sqrt(squares / np.sum(held.astype(np.float64) ** 2)))
    print(json.dumps(result))


if __name__ == "__main__":
    main()
