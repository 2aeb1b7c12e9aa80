"""Functions that call single vector instructions: parts of kernels that were not inlined.

    python benches/python/kernel_calls.py [LIBRARY]

Code of a kernel may use the processor's wide registers only where it is inlined into the kernel. A
closure or an iterator adapter that stays a function of its own lacks them, and each of its
multiplications becomes a call. Few of these calls matter, such as those that make constants once
per tile: compare them with a profile. Without LIBRARY, the release build is made with line numbers
first, which takes some minutes. Needs objdump and addr2line (binutils).
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from record import ROOT, show

FUNCTION = re.compile(r"^[0-9a-f]+ <(.*)>:$")
CALL = re.compile(
    r"^\s*([0-9a-f]+):\s+(?:call|jmp)\s+[0-9a-f]+ <core::core_arch::x86::\w+::_mm\w+>"
)


def built() -> Path:
    """The release build of the numerics, with line numbers."""
    lines = os.environ | {"CARGO_PROFILE_RELEASE_DEBUG": "line-tables-only"}
    command = ["cargo", "build", "--release", "-p", "impasto-py"]
    subprocess.run(command, cwd=ROOT, env=lines, check=True)
    return Path(ROOT, "target", "release", "lib_core.so")


def calls(library: Path) -> Iterator[tuple[str, str]]:
    """Function and address of each call of a single instruction."""
    command = ["objdump", "--disassemble", "--no-show-raw-insn", "--demangle", str(library)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listing:
        function = ""
        for line in listing.stdout or ():
            if begin := FUNCTION.match(line):
                function = begin[1]
            elif call := CALL.match(line):
                yield function, call[1]


def places(library: Path, addresses: list[str]) -> dict[str, str]:
    """The innermost line of this project's own code at each address, registers left out."""
    command = ["addr2line", "--exe", str(library), "--inlines", "--addresses"]
    found = subprocess.run([*command, *addresses], capture_output=True, text=True, check=True)
    lines: dict[str, str] = {}
    address = ""
    for line in found.stdout.splitlines():
        if line.startswith("0x"):
            address = line.removeprefix("0x").lstrip("0")
        elif (own := re.search(r"/crates/(\S+)", line)) and "/math/" not in line:
            lines.setdefault(address, own[1])
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", nargs="?", type=Path, metavar="LIBRARY")
    library = parser.parse_args().library
    missing = [tool for tool in ("objdump", "addr2line") if shutil.which(tool) is None]
    if missing:
        parser.error(f"{missing[0]} is not installed: install binutils")
    if library is None:
        library = built()
    elif not library.is_file():
        parser.error(f"{library}: no such file")
    found = list(calls(library))
    if not found:
        print(f"{library}: no such calls, or no names of functions (a stripped library)")
        return
    lines = places(library, [address for _, address in found])
    count = Counter((lines.get(address, "-"), function) for function, address in found)
    rows = [
        {"calls": number, "line": line, "function": function}
        for (line, function), number in sorted(count.items())
    ]
    show("Calls of single vector instructions", rows)


if __name__ == "__main__":
    main()
