"""Files that a sonar is given: measured beam patterns, routes, calls, a transducer's response, noise.

A pattern is a CSV of levels in dB, a column a frequency in Hz: by ``angle_deg`` off the axis, or by
``azimuth_deg`` and ``elevation_deg`` all round, with ``ear`` (0 is the left one) where ears differ. Of ears
it may be a SOFA file of a head, of which levels are used (delays follow from where the ears are). A route
is a CSV with ``x_m, y_m, z_m, azimuth_deg, elevation_deg`` and perhaps ``beam_width_deg``, one pose a row. A
call is a WAV file. Names are relative to the folder of the scene file, or else to ``assets/scenes``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.places import ASSETS, FORMER
from ...formats.foreign import guarded
from ...formats.sofa import HeadResponses, read_head
from ...formats.table import read_columns
from ...formats.wav import read_wav
from ...spec import Sonar, SpecError
from ..trajectory import Trajectory, looking
from .beam import BeamPattern, MeasuredBeam, MeasuredSphere
from .calls import Call, resampled
from .receiver import REFERENCE
from .station import Equipment

PLACES = ("x_m", "y_m", "z_m", "azimuth_deg", "elevation_deg")
WIDTH, TIME = "beam_width_deg", "time_s"
SPHERE, EAR = ("azimuth_deg", "elevation_deg"), "ear"  # of patterns all round
BANDS = 33  # frequencies that a head's responses are read at
LEAST_WITHIN, MOST_OFFSET = 0.01, 0.05  # of a call's energy in the band; of its largest sample
DEAF = 1e-4  # of the loudest: -80 dB, the least that an ear hears


def equip(sonar: Sonar, folder: Path) -> Equipment:
    """The equipment of a sonar, its files read.

    Raises
    ------
    SpecError : a file is missing, or is not what it should be; the sentence says where.
    """
    emit: BeamPattern | None = None
    hears: tuple[BeamPattern, ...] = ()
    if sonar.beam == "file":
        file = find(sonar.beam_file, folder, "beam_file")
        emit, *others = read_patterns(file)
        if others:
            raise SpecError(str(file), "has patterns of several ears; a beam takes one")
    if sonar.hearing == "file":
        hears = _ears(sonar, find(sonar.hearing_file, folder, "hearing_file"))
    call = None
    if sonar.call == "file":
        call = read_call(find(sonar.call_file, folder, "call_file"), sonar)
    transducer = noise = None
    if (receiver := sonar.receiver) is not None:
        if receiver.transducer_file:
            file = find(receiver.transducer_file, folder, "receiver.transducer_file")
            transducer = read_sound(file, sonar)
        if receiver.noise_file:
            file = find(receiver.noise_file, folder, "receiver.noise_file")
            noise = read_noise(file, sonar, receiver.noise_level_db)
    return Equipment.of(sonar, emit, hears, call, transducer, noise)


def _ears(sonar: Sonar, file: Path) -> tuple[BeamPattern, ...]:
    """One pattern for all ears, or one for each."""
    if file.suffix.lower() == ".sofa":
        hears = ears_of_head(read_head(file), sonar.band, str(file))
    else:
        hears = read_patterns(file)
    if len(hears) not in (1, sonar.ears):
        raise SpecError(str(file), f"is of {len(hears)} ears; set ears = {len(hears)}")
    return hears


def find(name: str, folder: Path, key: str) -> Path:
    """The file of this name beside the scene file or in assets/scenes.

    Raises
    ------
    SpecError : there is none.
    """
    for place in (folder / name, ASSETS / "scenes" / FORMER.get(name, name)):
        if place.is_file():
            return place
    raise SpecError(key, f'"{name}" is not in {folder}; check the name')


@guarded("a CSV of levels")
def read_patterns(path: Path) -> tuple[BeamPattern, ...]:
    """Measured patterns of a CSV: one, or one an ear where it has the column ``ear``.

    Raises
    ------
    SpecError : a column that is no frequency, angles that do not rise from 0, a level that is no number.
    """
    sheet = read_columns(path)
    head = [*sheet.columns]
    round_about = head[:1] != ["angle_deg"]
    keys = [name for name in (*SPHERE, EAR) if name in head] if round_about else ["angle_deg"]
    if len(head) <= len(keys) or (round_about and not {*SPHERE} <= {*head}):
        raise SpecError(
            str(path),
            'needs the column "angle_deg", or "azimuth_deg" and "elevation_deg", and one or more '
            "frequencies in Hz",
        )
    columns = [number for number, name in enumerate(head) if name not in keys]
    try:
        frequency = np.array([float(head[number].replace(",", ".")) for number in columns])
    except ValueError:
        raise SpecError(
            str(path), "has a column that is no frequency; name them 60000, 70000"
        ) from None
    rising = np.isfinite(frequency).all() and (np.diff(frequency) > 0).all()
    if not rising or frequency[0] <= 0:
        raise SpecError(str(path), "needs frequencies in Hz that rise from left to right")
    rows = sheet.matrix(*head)
    level = rows[:, columns]
    if round_about:
        return _spheres(path, {name: rows[:, head.index(name)] for name in keys}, frequency, level)
    angle = np.deg2rad(rows[:, 0])
    if len(angle) < 2 or angle[0] != 0 or (np.diff(angle) <= 0).any():
        raise SpecError(str(path), "needs two or more angles that rise from 0")
    return (MeasuredBeam(angle, frequency, level),)


def _spheres(
    path: Path, at: dict[str, np.ndarray], frequency: np.ndarray, level: np.ndarray
) -> tuple[BeamPattern, ...]:
    """A pattern of each ear from azimuths and elevations, degrees."""
    azimuth, elevation = (np.deg2rad(at[name]) for name in SPHERE)
    flat = np.cos(elevation)
    towards = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    ear = at.get(EAR, np.zeros(len(level)))
    numbers = np.unique(ear)
    if not len(numbers) or not np.array_equal(numbers, np.arange(len(numbers))):
        raise SpecError(str(path), "needs a row or more for each ear; number ears from 0, the left")
    return tuple(
        MeasuredSphere.all_round(towards[ear == one], frequency, level[ear == one])
        for one in numbers
    )


def ears_of_head(
    head: HeadResponses, band: tuple[float, float], place: str
) -> tuple[BeamPattern, ...]:
    """The directivity of a head's two ears in a band, dB re the loudest direction of both.

    Raises
    ------
    SpecError : the band goes beyond what was measured; names ``place``.
    """
    if band[1] > head.sample_rate / 2:
        raise SpecError(
            place,
            f"was measured up to {head.sample_rate / 2:,.0f} Hz and the band goes to {band[1]:,.0f} Hz; "
            "lower the band, or give a file of a higher sampling rate",
        )
    frequency = np.linspace(*band, BANDS) if band[0] < band[1] else np.array(band[:1])
    time = np.arange(head.responses.shape[2]) / head.sample_rate
    turning = np.exp(-2j * np.pi * np.outer(time, frequency))
    size = np.abs(head.responses @ turning)  # (D, 2, F)
    if not size.max() > 0:
        raise SpecError(place, "is silent in the band; give another file")
    level = 20.0 * np.log10(np.maximum(size / size.max(), DEAF))
    return tuple(
        MeasuredSphere.all_round(head.directions, frequency, level[:, ear]) for ear in range(2)
    )


@guarded("a CSV of poses")
def read_route(path: Path, speed: float) -> Trajectory:
    """The trajectory of a route, flown at a speed in m/s.

    Raises
    ------
    SpecError : columns that are missing or not known, no rows, a width that is not positive, times that do
    not
        rise.
    """
    sheet = read_columns(path, *PLACES)
    if not {*sheet.columns} <= {*PLACES, WIDTH, TIME}:
        raise SpecError(
            str(path), f"needs the columns {', '.join(PLACES)} and may have {WIDTH}, {TIME}"
        )
    column = dict(zip(sheet.columns, sheet.matrix(*sheet.columns).T, strict=True))
    width = np.deg2rad(column[WIDTH]) if WIDTH in column else None
    if width is not None and not (width > 0).all():
        raise SpecError(str(path), f"{WIDTH} must be larger than 0")
    time = column.get(TIME)
    if time is not None and not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise SpecError(
            str(path), f"{TIME} must rise from row to row; put the rows in order of time"
        )
    return looking(
        np.stack([column[name] for name in PLACES[:3]], axis=1),
        np.deg2rad(column["azimuth_deg"]),
        np.deg2rad(column["elevation_deg"]),
        width,
        speed,
        time,
    )


@guarded("a WAV file")
def read_sound(path: Path, sonar: Sonar) -> Call:
    """The first channel of a WAV file at a sonar's rate, as loud as it is.

    Raises
    ------
    SpecError : it is no WAV file, or has nothing in the sonar's band.
    """
    samples, rate = read_wav(path)
    if rate / 2 <= sonar.band[0]:
        raise SpecError(
            str(path),
            f"is sampled at {rate:g} Hz and holds nothing above {rate / 2:g} Hz, where the band of "
            f"{sonar.band[0]:g} to {sonar.band[1]:g} Hz lies; if it plays slower, save it at its own rate",
        )
    try:
        return resampled(samples, rate, sonar)
    except ValueError as problem:
        raise SpecError(str(path), f"cannot be used as a sound: {problem}") from None


def read_call(path: Path, sonar: Sonar) -> Call:
    """The same as a call, its largest sample 1.

    Raises
    ------
    SpecError : as that; next to nothing of it lies in the sonar's band, or it has an offset.
    """
    sound = read_sound(path, sonar)
    peak, offset = np.abs(sound.samples).max(), np.abs(sound.samples.mean())
    power = np.abs(np.fft.rfft(sound.samples)) ** 2
    frequency = np.fft.rfftfreq(len(sound.samples), 1 / sound.sample_rate)
    within = np.abs(np.clip(frequency, *sonar.band) - frequency) <= 1 / sound.duration
    share = power[within].sum() / power.sum()
    if share < LEAST_WITHIN or offset > MOST_OFFSET * peak:
        raise SpecError(
            str(path),
            f"has {100 * share:.1f} % of its energy in the band of {sonar.band[0]:g} to "
            f"{sonar.band[1]:g} Hz, and an offset of {100 * offset / peak:.0f} % of its largest sample; "
            "filter it to the call alone, or set the band to the call's",
        )
    return replace(sound, samples=sound.samples / peak)


def read_noise(path: Path, sonar: Sonar, level_db: float | None) -> Call:
    """The same as noise in pascals, of a root mean square level re 20 µPa where one is given."""
    sound = read_sound(path, sonar)
    if level_db is None:
        return sound
    loud = REFERENCE * 10.0 ** (level_db / 20.0)
    return replace(sound, samples=sound.samples * (loud / np.sqrt(np.mean(sound.samples**2))))
