"""Scanners of HELIOS++: optics, channels, ranges and the receiver of the waveform."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .document import OPTICS_ERRORS, number, place_of, rotation_of, yes

WAVEFORM = "FWFSettings"
OPTICS = ("rotating", "conic", "risley", "oscillating", "line")
CHANNEL = {"id", "name", "wavelength_nm"}  # what a channel may say of itself


@dataclass(frozen=True)
class Digitiser:
    """Settings by which HELIOS++ finds echoes: rings of sub-rays; bins of the waveform, and the window
    in which a maximum must be the largest, ns."""

    rings: int = 3
    bin_ns: float = 0.25
    window_ns: float = 1.0


@dataclass(frozen=True)
class Device:
    """A scanner as HELIOS++ describes it.

    origin : (C, 3) metres of each channel's beam from the mount. turn : C rotations of it. incident : (C, 3)
    direction of the beam before the prisms. ranges : smallest and largest, m. scan_product : degrees times
    hertz that an oscillating mirror can do. fibres : of a line. prisms : turning wedges, degrees (negative if
    the second face is tilted), turns a second and refractive index of each. notes : what was passed over.
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
    prisms: tuple[tuple[float, float, float], ...]
    ranges: tuple[float, float]
    accuracy: float
    divergence: float
    pulse_ns: float
    wavelength_nm: float
    max_returns: int
    pulse_rate: float
    digitiser: Digitiser
    notes: tuple[str, ...] = ()


def read_device(scanner: Element, path: Path, survey: Element) -> Device:
    """A scanner of a library, with what a survey says of its detector and waveform instead.

    Raises
    ------
    SpecError : optics that are not supported, or a broken number.
    """
    name, optics = scanner.get("name", "scanner"), scanner.get("optics", "")
    if optics not in OPTICS:
        raise SpecError(str(path), f'optics "{optics}" is not supported; {", ".join(OPTICS)} are')
    for tag in OPTICS_ERRORS:
        if scanner.find(tag) is not None:
            raise SpecError(str(path), f"{name} has {tag}, an expression, which is not supported")

    def value(key: str, otherwise: float | None = None) -> float:
        return number(scanner, key, path, otherwise)

    channels = scanner.findall("channels/channel")
    for channel in channels:
        for key in sorted(channel.attrib.keys() - CHANNEL):
            raise SpecError(str(path), f'a channel of {name} has its own "{key}": not supported')

    def of_each(tag: str) -> list[Element | None]:
        shared = scanner.find(tag)
        own = [channel.find(tag) for channel in channels] or [None]
        return [shared if one is None else one for one in own]

    origins, incident = of_each("beamOrigin"), of_each("incidentBeam")
    prisms = tuple(
        (value(f"angle{i}_deg"), value(f"rotorFreq{i}_Hz"), value(f"refrIndex{i}"))
        for i in (1, 2, 3)
        if scanner.get(f"angle{i}_deg")
    )
    axis, detector = scanner.find("headRotateAxis"), survey.find("detectorSettings")
    detector = scanner if detector is None else detector
    widest, pulse_ns = value("scanAngleMax_deg", 0.0), value("pulseLength_ns", 4.0)
    colours = [one for c in channels if (one := number(c, "wavelength_nm", path, 0.0))]
    owners = (scanner, survey)
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
        wavelength_nm=value("wavelength_nm", (*colours, 1064.0)[0]),
        max_returns=int(value("maxNOR", 0.0)),
        pulse_rate=float(scanner.get("pulseFreqs_Hz", "100000").split(",")[0]),
        digitiser=digitiser_of(owners, Digitiser(), pulse_ns, path),
        notes=tuple(_notes(owners, colours, channels)),
    )


def _notes(
    owners: tuple[Element, ...], colours: list[float], channels: list[Element]
) -> Iterator[str]:
    """Sentences on what is passed over of a scanner and a survey."""
    common = {key: value for one in owners[0].findall(WAVEFORM) for key, value in one.items()}
    own = [one.attrib for channel in channels for one in channel.findall(WAVEFORM)]
    if any({**common, **said} != common for said in own):
        yield f"all channels have the scanner's {WAVEFORM}; their own are passed over"
    if len(set(colours)) > 1:
        yield f"all channels see surfaces as at {colours[0]:g} nm; their own are passed over"
    if any(yes(said.get("snapToSurface"), False) for one in owners for said in one.iter(WAVEFORM)):
        yield "ranges are those of the light, without bins: snapToSurface is passed over"


def digitiser_of(
    owners: tuple[Element, ...], before: Digitiser, pulse_ns: float, path: Path
) -> Digitiser:
    """Read the settings of the waveform that owners state, the last one last, over those before."""
    digitiser = before
    for said in (said for owner in owners for said in owner.findall(WAVEFORM)[:1]):
        window = pulse_ns / 4 if before == Digitiser() else digitiser.window_ns
        digitiser = Digitiser(
            rings=int(number(said, "beamSampleQuality", path, digitiser.rings)),
            bin_ns=number(said, "binSize_ns", path, digitiser.bin_ns),
            window_ns=number(said, "winSize_ns", path, window),
        )
    if not (
        1 <= digitiser.rings <= 50 and digitiser.bin_ns > 0 and pulse_ns / digitiser.bin_ns < 1e5
    ):
        raise SpecError(
            str(path), "FWFSettings: beamSampleQuality is from 1 to 50, binSize_ns above 0"
        )
    return digitiser
