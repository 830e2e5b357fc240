"""Scanners of HELIOS++: optics, channels, ranges and the receiver of the waveform."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .document import number, place_of, rotation_of, yes

WAVEFORM = "FWFSettings"
OPTICS = ("rotating", "conic", "risley", "oscillating", "line")
CHANNEL = {"id", "name", "wavelength_nm"}  # what a channel may say of itself


@dataclass(frozen=True)
class Prism:
    """A turning wedge: degrees, negative if its second face is tilted; turns a second; refractive index."""

    angle_deg: float
    turns_hz: float
    index: float


@dataclass(frozen=True)
class Digitiser:
    """Settings by which HELIOS++ finds echoes: rings of sub-rays; bins of the waveform, and the window
    in which a maximum must be the largest, ns; how long a waveform may be, ns (0: any)."""

    rings: int = 3
    bin_ns: float = 0.25
    window_ns: float = 1.0
    longest_ns: float = 0.0


@dataclass(frozen=True)
class Device:
    """A scanner as HELIOS++ describes it.

    origin : (C, 3) metres of each channel's beam from the mount. turn : C rotations of it. incident : (C, 3)
    direction of the beam before the prisms. ranges : smallest and largest, m. scan_product : degrees times
    hertz that an oscillating mirror can do. fibres : of a line. notes : what was passed over.
    """

    name: str
    optics: str
    origin: np.ndarray
    turn: tuple[Rotation, ...]
    incident: np.ndarray
    head_axis: np.ndarray
    scan_angle_deg: float
    effective_deg: float
    scan_hz: float
    scan_product: float
    fibres: int
    prisms: tuple[Prism, ...]
    ranges: tuple[float, float]
    accuracy: float
    divergence: float
    pulse_ns: float
    wavelength_nm: float
    max_returns: int
    pulse_rate: float
    digitiser: Digitiser
    notes: tuple[str, ...] = ()


def read_device(scanner: Element, path: Path, survey: Element | None = None) -> Device:
    """A scanner of a library, with what a survey says of its detector and waveform instead.

    Raises
    ------
    SpecError : optics that are not supported, or a broken number.
    """
    name, optics = scanner.get("name", "scanner"), scanner.get("optics", "")
    if optics not in OPTICS:
        raise SpecError(str(path), f'optics "{optics}" is not supported; {", ".join(OPTICS)} are')
    for tag in ("deflectionError", "headError", "rangeError"):
        if scanner.find(tag) is not None:
            raise SpecError(str(path), f"{name} has {tag}, an expression, which is not supported")

    def value(key: str, otherwise: float | None = None) -> float:
        return number(scanner, key, path, otherwise)

    def one_of(channel: Element | None, tag: str) -> Element | None:
        own = None if channel is None else channel.find(tag)
        return scanner.find(tag) if own is None else own

    channels: list[Element | None] = [*scanner.findall("channels/channel")] or [None]
    for channel in channels:
        for key in sorted(set(channel.attrib) - CHANNEL if channel is not None else ()):
            raise SpecError(str(path), f'a channel of {name} has its own "{key}": not supported')
    origins = [one_of(c, "beamOrigin") for c in channels]
    incident = [one_of(c, "incidentBeam") for c in channels]
    prisms = tuple(
        Prism(value(f"angle{i}_deg"), value(f"rotorFreq{i}_Hz"), value(f"refrIndex{i}"))
        for i in (1, 2, 3)
        if scanner.get(f"angle{i}_deg")
    )
    axis = scanner.find("headRotateAxis")
    widest = value("scanAngleMax_deg", 0.0)
    detector = None if survey is None else survey.find("detectorSettings")
    detector = scanner if detector is None else detector
    pulse_ns = value("pulseLength_ns", 4.0)
    colours = [number(c, "wavelength_nm", path, 0.0) for c in channels if c is not None]
    colours = [one for one in colours if one] or [1064.0]
    owners = (scanner, *([] if survey is None else [survey]))
    return Device(
        name=name,
        optics=optics,
        origin=np.array([place_of(o, path) for o in origins]),
        turn=tuple(rotation_of(o, path) for o in origins),
        incident=np.array([(0.0, 1.0, 0.0) if i is None else place_of(i, path) for i in incident]),
        head_axis=np.array([0.0, 0.0, 1.0]) if axis is None else place_of(axis, path),
        scan_angle_deg=widest,
        effective_deg=value("scanAngleEffectiveMax_deg", widest),
        scan_hz=value("scanFreqMax_Hz", 0.0),
        scan_product=value("scanProduct", 1e6),
        fibres=max(int(value("numFibers", 1.0)), 1),
        prisms=prisms,
        ranges=(
            number(detector, "rangeMin_m", path, value("rangeMin_m", 0.0)),
            number(detector, "rangeMax_m", path, value("rangeMax_m", 1e4)),
        ),
        accuracy=number(detector, "accuracy_m", path, value("accuracy_m", 0.0)),
        divergence=value("beamDivergence_rad", 0.0003),
        pulse_ns=pulse_ns,
        wavelength_nm=value("wavelength_nm", colours[0]),
        max_returns=int(value("maxNOR", 0.0)),
        pulse_rate=float(scanner.get("pulseFreqs_Hz", "100000").split(",")[0]),
        digitiser=digitiser_of(owners, Digitiser(), pulse_ns, path),
        notes=tuple(_notes(owners, colours, channels)),
    )


def _notes(
    owners: tuple[Element, ...], colours: list[float], channels: list[Element | None]
) -> list[str]:
    """Sentences on what is passed over of a scanner and a survey."""
    found = []
    shared = owners[0].find(WAVEFORM)
    common = {**shared.attrib} if shared is not None else {}
    own = [c.find(WAVEFORM) for c in channels if c is not None]
    if any(said is not None and {**common, **said.attrib} != common for said in own):
        found.append(f"all channels have the scanner's {WAVEFORM}; their own are passed over")
    if len(set(colours)) > 1:
        found.append(
            f"all channels see surfaces as at {colours[0]:g} nm; their own are passed over"
        )
    if any(yes(said.get("snapToSurface"), False) for one in owners for said in one.iter(WAVEFORM)):
        found.append("ranges are those of the light, without bins: snapToSurface is passed over")
    return found


def digitiser_of(
    owners: tuple[Element, ...], before: Digitiser, pulse_ns: float, path: Path
) -> Digitiser:
    """Read the settings of the waveform that owners state, the last one last, over those before."""
    found = before
    for owner in owners:
        said = owner.find(WAVEFORM)
        if said is None:
            continue
        window = pulse_ns / 4 if before == Digitiser() else found.window_ns
        found = replace(
            found,
            rings=int(number(said, "beamSampleQuality", path, found.rings)),
            bin_ns=number(said, "binSize_ns", path, found.bin_ns),
            window_ns=number(said, "winSize_ns", path, window),
            longest_ns=number(said, "maxFullwaveRange_ns", path, found.longest_ns),
        )
    if not (1 <= found.rings <= 50 and found.bin_ns > 0 and pulse_ns / found.bin_ns < 1e5):
        raise SpecError(
            str(path), "FWFSettings: beamSampleQuality is from 1 to 50, binSize_ns above 0"
        )
    return found
