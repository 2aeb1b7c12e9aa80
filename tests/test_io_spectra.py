"""Tables of spectra: many spellings of one table, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, CorruptInputError
from impasto.io.spectra_table import NANOMETRES, _along

GRID = [400.0, 500.0, 600.0, 700.0]
RED, BLUE = [0.05, 0.06, 0.4, 0.55], [0.3, 0.25, 0.1, 0.08]
NAMES = ("red ochre", "blue")

COLUMNS = [f"{w:g},{r:g},{b:g}" for w, r, b in zip(GRID, RED, BLUE, strict=True)]
HEAD = "wavelength,red ochre,blue"
CSV = "\n".join([HEAD, *COLUMNS]) + "\n"
PER_CENT = [f"{w:g};{100 * r:g};{100 * b:g}" for w, r, b in zip(GRID, RED, BLUE, strict=True)]
ROWS = [
    ",".join([name, *(f"{v:g}" for v in values)])
    for name, values in zip(NAMES, (RED, BLUE), strict=True)
]


def micrometres(text: str) -> str:
    for wavelength in GRID:
        text = text.replace(f"{wavelength:g},", f"{wavelength / 1000:g},")
    return text


SPELLINGS: dict[str, str] = {
    "comma": CSV,
    "byte order mark, Windows lines": "\ufeff" + CSV.replace("\n", "\r\n"),
    "tabs": CSV.replace(",", "\t"),
    "semicolons": CSV.replace(",", ";"),
    "spaces after commas": CSV.replace(",", ", "),
    "decimal commas": CSV.replace(",", ";").replace(".", ","),
    "decimal commas, tabs": CSV.replace(",", "\t").replace(".", ","),
    "per cent, decimal commas": "\n".join(
        ["nm;red ochre;blue", *(line.replace(".", ",") for line in PER_CENT)]
    ),
    "falling": "\n".join([HEAD, *reversed(COLUMNS)]),
    "comments, blank lines": "# by NN\n\n% 2024\n// x\n! y\n" + CSV + "\n\n",
    "a preamble": "Instrument: Mårten 3000 spectrum\nDate;1.2.2024\n" + CSV,
    "trailing separators": "\n".join(line + ",,," for line in CSV.splitlines()),
    "quoted names": CSV.replace("red ochre", '"red ochre"'),
    "micrometres": micrometres(CSV),
    "micrometres, said": micrometres(CSV).replace("wavelength", "Wavelength (µm)"),
    "numbers with exponents": CSV.replace("0.05,", "5e-2,").replace("0.4,", "+4.0E-01,"),
    "an empty wavelength": CSV + "710,,\n",
    "marked as missing": CSV + "710,-1.23e34,-9999\n720,nan,n/a\n",
    "wavelengths repeated": "nm,red ochre,nm,blue\n"
    + "\n".join(f"{w:g},{r:g},{w:g},{b:g}" for w, r, b in zip(GRID, RED, BLUE, strict=True)),
    "with standard deviations": "nm,red ochre,red ochre std dev,blue\n"
    + "\n".join(f"{w:g},{r:g},0.01,{b:g}" for w, r, b in zip(GRID, RED, BLUE, strict=True)),
    "by row": "\n".join(["name,400,500,600,700", *ROWS]),
    "by row, units": "\n".join([",400nm,500 nm,600nm,700nm", *ROWS]),
    "by row, letters": "\n".join(["paint,R_400,R_500,R_600,R_700", *ROWS]),
    "by row, no corner": "\n".join(["400,500,600,700", *ROWS]),
    "by row, micrometres": "\n".join(["name,0.4,0.5,0.6,0.7", *ROWS]),
    "by row, falling, semicolons": "\n".join(
        ["name;700;600;500;400"]
        + [";".join([row.split(",")[0], *row.split(",")[:0:-1]]) for row in ROWS]
    ),
}


def read(folder: Path, text: str | bytes, **options: object) -> impasto.Training:
    path = folder / "paints.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return impasto.read_spectra(path, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_is_the_same_table(spelling: str, tmp_path: Path) -> None:
    found = read(tmp_path, SPELLINGS[spelling])
    np.testing.assert_allclose(found.wavelengths, GRID, rtol=1e-15)
    # Per cent are divided by 100.
    np.testing.assert_allclose(found.reflectance, [RED, BLUE], rtol=1e-15)
    assert found.names == NAMES
    assert found.name == "paints.csv"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_names_keep_their_letters(encoding: str, tmp_path: Path) -> None:
    text = CSV.replace("red ochre", "rötlicher Ocker")
    assert read(tmp_path, text.encode(encoding)).names == ("rötlicher Ocker", "blue")


def test_a_table_of_spaces_and_no_names(tmp_path: Path) -> None:
    lines = [f"  {w:g}   {r:.4f} {b:.4f}" for w, r, b in zip(GRID, RED, BLUE, strict=True)]
    found = read(tmp_path, "\n".join(lines))
    np.testing.assert_allclose(found.reflectance, [RED, BLUE])
    assert found.names == ()
    rows = "\n".join(" ".join(f"{v:g}" for v in row) for row in (GRID, RED, BLUE))
    np.testing.assert_allclose(read(tmp_path, rows).reflectance, [RED, BLUE])


def test_rows_with_several_words_before_the_numbers(tmp_path: Path) -> None:
    table = "no,name,400,500,600,700\n1,red ochre,5,6,40,55\n2,blue,30,25,10,8\n"
    found = read(tmp_path, table)
    np.testing.assert_allclose(found.reflectance, [RED, BLUE])
    assert found.names == ("1 red ochre", "2 blue")


def test_a_spectrum_of_the_usgs_library(tmp_path: Path) -> None:
    """Layout of splib06: text, then wavelength, reflectance and standard deviation in columns."""
    text = (
        "USGS Digital Spectral Library splib06a\n"
        "For further information on spectrsocopy, see: http://speclab.cr.usgs.gov\n"
        "ASCII Spectral Data file contents:\n"
        "line 15 title\nline 16 history\n"
        "line 17 to end:  3-columns of data:\n"
        "     wavelength    reflectance    standard deviation\n"
        " (standard deviation of 0.000000 means not measured)\n"
        "(      -1.23e34  indicates a deleted number)\n"
        "----------------------------------------------------\n"
        "Cinnabar HS133.3B   W1R1Ba AREF\ncopy of splib05a r 2051\n"
        "       0.390000     -1.23e34      0.000000\n"
        + "".join(
            f"       {w / 1000:.6f}       {r:.6f}      0.002000\n"
            for w, r in zip(GRID, RED, strict=True)
        )
    )
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.wavelengths, GRID)
    np.testing.assert_allclose(found.reflectance, [RED])


def test_one_column_needs_its_wavelengths(tmp_path: Path) -> None:
    text = "a title of the spectrum\n" + "\n".join(f" {value:.3e}" for value in RED)
    with pytest.raises(CorruptInputError, match="wavelengths="):
        read(tmp_path, text)
    found = read(tmp_path, text, wavelengths=np.array(GRID) / 1000)
    np.testing.assert_allclose(found.wavelengths, GRID)
    np.testing.assert_allclose(found.reflectance, [RED])
    with pytest.raises(ArgumentError, match=r"wavelengths: .* has 4 rows, found shape \(3,\)"):
        read(tmp_path, text, wavelengths=GRID[:3])


def test_what_is_told_overrules_what_is_guessed(tmp_path: Path) -> None:
    dark = "nm,black\n400,1.1\n550,1.2\n700,1.9\n"
    assert read(tmp_path, dark).reflectance.max() == 1.9
    assert read(tmp_path, dark, percent=True).reflectance.max() == pytest.approx(0.019)
    bright = "nm,fluorescent\n400,0.2\n550,2.4\n700,0.9\n"
    assert read(tmp_path, bright, percent=False).reflectance.max() == 2.4
    assert read(tmp_path, CSV, unit="nm").wavelengths[0] == 400.0
    with pytest.raises(ArgumentError, match="unit: expected 'nm' or 'um', found 'mm'"):
        read(tmp_path, CSV, unit="mm")


REFUSED: dict[str, tuple[str, str]] = {
    "empty": ("", "is empty"),
    "words": ("hello\nworld\n", "no table of numbers"),
    "a word": ("nm,a\n400,0.1\n500,x\n600,0.2\n", "line 3: expected numbers, found 'x'"),
    "too many": ("nm,a\n400,0.1\n500,0.1,0.2\n600,0.2\n", "line 3: expected 2 numbers, found 3"),
    "too few": ("nm a\n400 0.1 0.2\n500 0.1\n600 0.2 0.2\n", "line 3: expected 3 numbers, found 2"),
    "a gap": ("nm,a,b\n400,0.1,0.1\n500,,0.1\n600,0.2,0.1\n", "a has no value at 500 nm: fill it"),
    "no wavelength": ("nm,a\n400,0.1\n,0.1\n600,0.2\n", "line 3: the wavelength is missing"),
    "twice": ("nm,a\n400,0.1\n400,0.2\n600,0.2\n", "not repeat, found 400 nm beside 400 nm"),
    "out of order": ("nm,a\n400,0.1\n600,0.2\n500,0.2\n", "found 600 nm beside 500 nm: sort"),
    "angstroms": ("A,a\n4000,0.1\n5500,0.2\n7000,0.2\n", "neither nm nor um: say unit="),
    "wavenumbers": ("wavenumber (cm-1),a\n400,0.1\n500,0.2\n", "another unit"),
    "infrared": ("nm,a\n900,0.1\n1000,0.2\n1100,0.2\n", "between 400 and 700 nm"),
    "counts": ("nm,a\n400,8000\n500,3000\n600,20\n", "reach 8000: expected fractions"),
    "nothing": ("nm,a\n400,\n500,nan\n600,-\n", "no table of numbers|every cell is blank"),
    "no spectrum": ("nm,nm\n400,400\n500,500\n", "no spectrum beside them"),
    "a header alone": ("name,400,500,600\n", "line 1 has wavelengths; no spectrum follows"),
    "a short row": ("name;400;500;600\nred;0.1;x;0.2\n", "line 2: expected numbers, found 'x'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_read_is_refused_by_place_and_cure(case: str, tmp_path: Path) -> None:
    text, words = REFUSED[case]
    with pytest.raises(CorruptInputError, match=words) as caught:
        read(tmp_path, text)
    assert "paints.csv" in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=r"none\.csv"):
        impasto.read_spectra(tmp_path / "none.csv")


def test_spectra_are_learnt_from(tmp_path: Path) -> None:
    """A table is a training set: the same estimate as from its arrays."""
    rng = np.random.default_rng(1)
    grid = np.arange(400.0, 701.0, 20.0)
    spectra = rng.uniform(0.1, 0.9, (12, 2)) @ np.stack([grid / 700.0, 1.0 - grid / 900.0])
    lines = ["nm," + ",".join(f"p{i}" for i in range(12))]
    rows = np.column_stack([grid, spectra.T]).tolist()
    table = read(tmp_path, "\n".join(lines + [",".join(map(repr, row)) for row in rows]))
    camera = impasto.simulate.camera("rgb")
    rho = camera.response(spectra[:3], grid).T[:, None].astype(np.float32)
    one, other = (
        impasto.fit_reflectance(None, rho, camera, training=training)
        for training in (table, (grid, spectra))
    )
    np.testing.assert_array_equal(one.coefficients, other.coefficients)
    assert one.info["training"] == "paints.csv"


def test_infinite_numbers_are_no_wavelengths() -> None:
    assert not _along([400.0, np.inf, np.inf], NANOMETRES)
    assert _along([400.0, 500.0, 600.0], NANOMETRES)
