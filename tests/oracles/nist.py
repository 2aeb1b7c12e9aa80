"""Write `crates/impasto/tests/lm/nist.txt`: the 27 nonlinear regression problems of NIST's StRD.

Usage: `python tests/oracles/nist.py FOLDER`, FOLDER holding the `.dat` files of
https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml (public domain). One line per array:

    problem NAME
    start1 ... / start2 ... / certified ... / deviation ... / cost ...
    y ... / x ... (/ z ..., the second predictor of Nelson)

One copy of `Roszman1.dat` in circulation has the certified b1 garbled (1.20196866396E-0); with
2.0196866396E-01 the sum of squares is the certified 4.9484847331E-04, with the other it is 25.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

OUT = Path(__file__).parents[2] / "crates" / "impasto" / "tests" / "lm" / "nist.txt"


def number(text: str) -> str:
    """The shortest text of the same double."""
    return repr(float(text)).removesuffix(".0")


def lines(path: Path) -> list[str]:
    text = path.read_text(encoding="ascii").replace("1.20196866396E-0 ", "2.0196866396E-01 ")
    rows = re.findall(r"^\s*b\d+\s*=\s*(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", text, re.M)
    names = ("start1", "start2", "certified", "deviation")
    cost = re.search(r"Residual Sum of Squares:\s*(\S+)", text)
    assert cost is not None, path
    data = [line.split() for line in text[text.rindex("Data:") :].splitlines()[1:] if line.strip()]
    found = [f"problem {path.stem}"]
    parameters = zip(names, zip(*rows, strict=True), strict=True)
    found += [f"{name} {' '.join(map(number, column))}" for name, column in parameters]
    found.append(f"cost {number(cost.group(1))}")
    columns = list(zip(*data, strict=True))
    return found + [f"{n} {' '.join(map(number, c))}" for n, c in zip("yxz", columns, strict=False)]


def main() -> None:
    source = Path(sys.argv[1])
    head = "# Written by tests/oracles/nist.py from NIST's Statistical Reference Datasets."
    found = [head] + [line for path in sorted(source.glob("*.dat")) for line in lines(path)]
    OUT.write_text("\n".join(found) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
