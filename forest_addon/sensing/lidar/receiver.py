"""Receiver of a scanner: which echoes of a pulse its electronics tell apart, and which of them they keep.

An echo is seen where the power at its crest is at least that of the faintest echo (the minimum detectable
input power of Pfennigbauer & Ullrich 2010, Proc. SPIE 7684, 76841F): light that is spread over more than the
pulse's length is harder to see. The crest is that of a Gaussian with the echo's energy and width.

A discrete-return receiver starts a return where the light rises over its threshold and is blind for some time
after it: its dead zone, in metres of range. What comes meanwhile is lost and does not make the blindness
longer. A receiver that decomposes the waveform has no dead zone; the length of the pulse alone decides there
(``waveform``).

Noise is Gaussian, through a filter as long as the pulse. It is added to the light of each echo, and where it
crosses the threshold itself there is a false point: as often as a Gaussian process of that spectrum crosses
a level upwards (Rice 1945, Bell Syst. Tech. J. 24, 46, eq. 3.3-14), evenly over the gate of range, with the
heights of crests above a high level (Rayleigh).
"""

from __future__ import annotations

import numpy as np

from ...base.rng import child_keys, keyed_normal, keyed_uniform
from ...spec import Scanner
from .radiometry import detection_limit, intensity
from .waveform import FWHM, LIGHT, WaveformEchoes, pulse_length

AMPLITUDE, PLACE = (
    1 << 20,
    1 << 21,
)  # what draws of a pulse are numbered from, beside those of its returns
RAREST = 1e-12  # chance of more false points of a pulse than are drawn


def ranks(pulse: np.ndarray) -> np.ndarray:
    """(E,) how many echoes of the same pulse come before each, of sorted pulses."""
    if not len(pulse):
        return pulse
    first = np.flatnonzero(np.append(True, np.diff(pulse) != 0))
    size = np.diff(np.append(first, len(pulse)))
    return np.arange(len(pulse)) - np.repeat(first, size)


def awake(echoes: WaveformEchoes, dead_zone: float) -> np.ndarray:
    """(K,) rows of the echoes that a receiver is not blind for, ascending.

    dead_zone : metres after each return within which nothing is told apart from it.
    """
    rows = np.arange(len(echoes.pulse))
    if not dead_zone or not (np.diff(echoes.pulse) == 0).any():
        return rows
    rank = ranks(echoes.pulse)
    start = rows - rank  # of the pulse of each echo
    blind_until = np.full(len(rows), -np.inf)  # of a pulse, at the row where it starts
    seen = np.zeros(len(rows), dtype=bool)
    by_rank = np.argsort(rank, kind="stable")
    for here in np.split(by_rank, np.cumsum(np.bincount(rank))[:-1]):
        seen[here] = echoes.distance[here] >= blind_until[start[here]]
        told = here[seen[here]]
        blind_until[start[told]] = echoes.distance[told] + dead_zone
    return np.flatnonzero(seen)


def chosen_returns(echoes: WaveformEchoes, most: int, keep: str) -> np.ndarray:
    """(K,) rows of the at most ``most`` echoes of each pulse that are kept, ascending.

    keep : ``first`` and ``last`` by range, ``strongest`` by light, ``strongest+last`` the last and the
        strongest of the others; of equally strong ones the nearer.
    """
    order = np.arange(len(echoes.pulse))
    if keep == "last":
        order = order[::-1]
    elif keep != "first":
        beyond = np.append(echoes.pulse[1:], -1)  # pulse of the next echo
        others = (echoes.pulse == beyond) | (keep == "strongest")
        order = np.lexsort((-echoes.energy, others, echoes.pulse))
    return np.sort(order[ranks(echoes.pulse[order]) < most])


def reading(scanner: Scanner, light: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(E,) intensities as the receiver states them, of light (E,) 1/m² from measured ranges (E,) metres.

    Light beyond the dynamic range is read as its end. A reflectance is the light that the same target would
    send back from 1 m in clear air, so the unit stays: that of a facing surface which fills the beam at that
    range and sends as much back (Wagner 2010, ISPRS J. 65, 505, eq. 4 solved for ρ).
    """
    receiver = scanner.receiver
    if receiver.dynamic_range:
        light = np.minimum(light, detection_limit(scanner) * 10 ** (receiver.dynamic_range / 10))
    if receiver.reading == "reflectance":
        white = intensity(np.array(1.0), np.array(1.0), distance, scanner.beam.extinction)
        light = light / white
    return light


def false_alarm_rate(threshold_snr: float, pulse_ns: float) -> float:
    """False points a second, where the threshold is so many standard deviations of the noise."""
    sigma = pulse_ns * 1e-9 / FWHM  # of the filter's response; its correlation is exp(-t²/4σ²)
    return float(np.exp(-0.5 * threshold_snr**2) / (2 * np.pi * np.sqrt(2) * sigma))


def noisy_light(scanner: Scanner, echoes: WaveformEchoes, keys: np.ndarray) -> np.ndarray:
    """(E,) light of echoes with the receiver's noise, 1/m². keys : (P,) uint64 keys of the pulses."""
    drawn = child_keys(keys[echoes.pulse], AMPLITUDE + ranks(echoes.pulse))
    crest = (
        detection_limit(scanner)
        / scanner.receiver.threshold_snr
        / pulse_length(scanner.beam.pulse_ns)
    )
    return echoes.energy + crest * echoes.width * keyed_normal(drawn, "amplitude")


def false_echoes(scanner: Scanner, keys: np.ndarray) -> WaveformEchoes:
    """Echoes of noise alone, of pulses with these keys (P,); their contact is -1."""
    snr, beam = scanner.receiver.threshold_snr, scanner.beam
    gate = 2 * (scanner.max_range - scanner.min_range) / LIGHT
    mean = false_alarm_rate(snr, beam.pulse_ns) * gate
    log = np.log(max(mean, 1e-300))  # of a mean of 0, too
    most = range(1, int(mean + 10 * np.sqrt(mean) + 20))
    terms = np.exp(-mean + np.cumsum([0.0, *(log - np.log(k) for k in most)]))  # a Poisson law's
    count = np.searchsorted(np.cumsum(terms), keyed_uniform(keys, "false"), "right")
    pulse = np.repeat(np.arange(len(keys)), count)
    drawn = child_keys(keys[pulse], PLACE + ranks(pulse))
    place, height = keyed_uniform(drawn, "where"), keyed_uniform(drawn, "height")
    distance = scanner.min_range + (scanner.max_range - scanner.min_range) * place
    crest = np.sqrt(1 - 2 * np.log(np.maximum(height, RAREST)) / snr**2)
    return WaveformEchoes(
        pulse=pulse,
        distance=distance,
        energy=detection_limit(scanner) * crest,
        width=np.full(len(pulse), pulse_length(beam.pulse_ns)),
        contact=np.full(len(pulse), -1),
    )


def unambiguous_range(scanner: Scanner) -> float:
    """Metres from beyond which light arrives after the next pulse was sent."""
    return float(LIGHT / (2 * scanner.pulse_rate))


def arrives_awake(scanner: Scanner, distance: np.ndarray) -> np.ndarray:
    """(E,) bool, which echoes from true ranges (E,) metres do not arrive while a later pulse is sent."""
    zone = unambiguous_range(scanner)
    return np.asarray((distance < zone) | (distance % zone >= scanner.receiver.blanking))
