"""Materials of HELIOS++: what a Wavefront material file says of ground and reflectance, and spectra of ASTER.

A spectrum is a text file of 26 lines about the sample, then wavelength in µm and reflectance in percent
(ASTER spectral library: Baldridge et al. 2009, Remote Sens. Environ. 113, 711). What is not said is half the
light, as in HELIOS++.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ...spec import SpecError
from ..foreign import guarded
from .document import find_file, yes

HEADER = 26  # lines of a spectrum
UNKNOWN = 0.5
SPECTRA = "data/spectra"


@dataclass(frozen=True)
class Material:
    """Material of a surface: is it ground, its reflectance (NaN: not said), the name of its spectrum."""

    ground: bool = False
    reflectance: float = float("nan")
    spectrum: str = ""

    def reflects(self, wavelength_nm: float, near: Path, assets: Path | None = None) -> float:
        """The reflectance at a wavelength, 0 to 1; a number that the material says comes before its spectrum.

        near : a document; spectra are looked for as the files that it names.
        """
        if np.isfinite(self.reflectance):
            return min(max(self.reflectance, 0.0), 1.0)
        if not self.spectrum or "/" in self.spectrum or "\\" in self.spectrum:
            return UNKNOWN
        try:
            file = find_file(f"{SPECTRA}/{self.spectrum}.txt", near, assets)
        except SpecError:
            return UNKNOWN
        return float(min(max(np.interp(wavelength_nm, *_spectrum(file)), 0.0), 1.0))


@guarded("a Wavefront material file")
def read_materials(path: Path) -> dict[str, Material]:
    """Materials of a .mtl file by name.

    Raises
    ------
    SpecError : no material, or a reflectance that is no number.
    """
    found: dict[str, Material] = {}
    said: dict[str, str] = {}
    name = ""
    for text in [*path.read_text("utf-8", errors="replace").splitlines(), "newmtl"]:
        word, *rest = text.split() or [""]
        if word == "newmtl":
            if name:
                found[name] = _material(said, path)
            name, said = " ".join(rest), {}
        elif word.startswith("helios_") and rest:
            said[word] = rest[0]
    if not found:
        raise SpecError(str(path), "holds no material (newmtl)")
    return found


def _material(said: dict[str, str], path: Path) -> Material:
    text = said.get("helios_reflectance", "nan")
    try:
        reflectance = float(text)
    except ValueError:
        raise SpecError(str(path), "helios_reflectance is not a number") from None
    return Material(
        ground=yes(said.get("helios_isGround"), False),
        reflectance=reflectance,
        spectrum=said.get("helios_spectra", ""),
    )


@cache
@guarded("a spectrum of the ASTER library")
def _spectrum(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm, ascending, and reflectances from 0 to 1."""
    try:
        rows = np.loadtxt(path, skiprows=HEADER, usecols=(0, 1), ndmin=2, encoding="latin-1")
    except ValueError:
        raise SpecError(str(path), "has a line that is not wavelength and reflectance") from None
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return rows[:, 0] * 1e3, rows[:, 1] / 100.0
