"""Receiver of a sonar: what its transducer, noise, gain and converter make of the echoes at its ears.

An echo's sound pressure is its waveform times the pressure of the call at 1 m on the axis,
p = 20 µPa·10^(L/20)·0.1 for a call whose peak has the level L at 0.1 m. With h the response of the
transducer (1 at its best frequency), x the echo, s the noise, g the gain over time,

    recorded = round(clip(g·(p·h∗h∗x/q + p·h∗h∗c/q + h∗s)))

where c is the call itself, which the ears hear at once where ``ringing_db`` says so, and q the peak of
h∗c, so that the call as sent has the level that is asked for. A resonance at f_0 with the -3 dB width B is

    H(f) = i·f·B/(f_0² - f² + i·f·B).

Noise is Gaussian and drawn in the frequency domain, by a stream of its own for each ping and ear. Spectral
levels are one-sided and re 1 µPa²/Hz. That of the surroundings spreads a level evenly over the frequencies
at which it was measured; below it goes on alike, above it falls by 6 dB an octave, which is an assumption:

- wind: 22.7 + 22.6·lg(u) dB(A) at u m/s, exceeded in 95 % of the time over grassland, measured up to 20 kHz
  (Boersma 1997, J. Acoust. Soc. Am. 101, 2104); leaves in the way of the wind are louder.
- insects: 60 dB, the most that was measured in a tropical night (Schmidt & Römer 2011, PLoS ONE 6, e28593);
  songs of katydids reach from 2 to 80 kHz (Siegert, Römer & Hartbauer 2013, J. Exp. Biol. 216, 4655).
- rain: no level in air was found; it is given, and spread over 1 to 20 kHz.

The ratio of signal to noise is 20·lg of the envelope of the echo without noise over the root mean square
noise in the band, both behind the transducer and before the gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy import fft

from ...base.rng import stream
from ...spec import Sonar, SonarReceiver
from .calls import Band, Call

REFERENCE = 20e-6  # Pa, of levels of pressure
MICRO = 1e-6  # Pa, of spectral levels
SENT_AT = 0.1  # m, where bats' source levels are said
MEASURED = {"wind": (1e3, 20e3), "rain": (1e3, 20e3), "insects": (2e3, 80e3)}  # Hz
CELL = 0.1  # m of range, of a ratio of signal to noise
SETTLED = 14.0  # times that a resonance takes to fall to 1/e, after which it has fallen to 1e-6
FINE = 1 << 16  # samples of the transform by which noise in the band is known


@dataclass(frozen=True)
class Reception:
    """Sound at E ears behind the receiver.

    pressure : of the call at 1 m, Pa; 1 where the level of the call is not said, and all is relative to it.
    recorded : (E, N) Pa, after the gain. noise_level : (E,) Pa, root mean square in the band, before the
    gain. snr_db : (E,) of the echo's peak over it; -inf: no echo, inf: no noise. range : (R,) metres, middles
    of cells. range_snr_db : (E, R) of the largest envelope in each. detection_ear, detection_time,
    detection_snr_db : (D,) ear, s after the call and dB over the noise, of crests of the recorded envelope
    that reach the threshold. clipped : samples that the converter cut.
    """

    pressure: float
    recorded: np.ndarray
    noise_level: np.ndarray
    snr_db: np.ndarray
    range: np.ndarray
    range_snr_db: np.ndarray
    detection_ear: np.ndarray
    detection_time: np.ndarray
    detection_snr_db: np.ndarray
    clipped: int


@dataclass(frozen=True, eq=False)
class EchoReceiver:
    """A sonar's receiver with what it has in files.

    call : None of a pulse of the band. transducer : its impulse response, or None. noise : pascals, or None.
    """

    sonar: Sonar
    call: Call | None = None
    transducer: Call | None = None
    noise: Call | None = None

    @property
    def settings(self) -> SonarReceiver:
        """Settings of the receiver."""
        assert self.sonar.receiver is not None
        return self.sonar.receiver

    @cached_property
    def pressure(self) -> float:
        """Pressure of the call at 1 m, Pa; 1 where its level is not said."""
        level = self.settings.source_level_db
        return 1.0 if level is None else SENT_AT * REFERENCE * 10.0 ** (level / 20.0)

    @property
    def settles(self) -> int:
        """Samples in which the transducer, passed twice, falls silent."""
        if self.transducer is not None:
            return 2 * len(self.transducer.samples)
        if not self.settings.resonance:
            return 0
        return round(2 * SETTLED * self.sonar.sample_rate / (np.pi * self.settings.bandwidth))

    def response(self, length: int) -> np.ndarray:
        """(K,) the transducer's transfer function one way, on the grid of a transform of ``length``."""
        frequency = fft.rfftfreq(length, 1.0 / self.sonar.sample_rate)
        if self.transducer is not None:
            transfer = fft.rfft(self.transducer.samples, length)
            return np.asarray(transfer / np.abs(transfer).max())
        if not self.settings.resonance:
            return np.ones(len(frequency), dtype=np.complex128)
        turning = 1j * frequency * self.settings.bandwidth
        return np.asarray(turning / (self.settings.resonance**2 - frequency**2 + turning))

    def sent(self, length: int) -> np.ndarray:
        """(K,) spectrum of the call before the transducer, whose largest pressure is 1, on the same grid."""
        if self.call is not None:
            return np.asarray(fft.rfft(self.call.samples, length))
        window = Band(*self.sonar.band).window(fft.rfftfreq(length, 1.0 / self.sonar.sample_rate))
        return window * (length / 2.0 / window.sum())

    def density(self, frequency: np.ndarray) -> np.ndarray:
        """(K,) Pa²/Hz of noise from all sides and the receiver's own, before the transducer."""
        settings, density = self.settings, np.zeros(len(frequency))
        if settings.self_noise_db is not None:
            level = np.full(len(frequency), settings.self_noise_db)
            if settings.self_noise_shape:
                level += np.interp(frequency, *np.transpose(settings.self_noise_shape))
            density += MICRO**2 * 10.0 ** (level / 10.0)
        if settings.ambient != "none":
            low, high = MEASURED[settings.ambient]
            even = REFERENCE**2 * 10.0 ** (ambient_level(settings) / 10.0) / (high - low)
            density += even * (high / np.maximum(frequency, high)) ** 2
        return density

    @cached_property
    def band_noise(self) -> tuple[float, float]:
        """Mean square noise in the band behind the transducer, Pa²: of ``density``, of the file at 1 m."""
        rate, powers = self.sonar.sample_rate, [0.0, 0.0]
        length = FINE if self.noise is None else max(FINE, len(self.noise.samples))
        frequency = fft.rfftfreq(length, 1.0 / rate)
        inside = (self.sonar.band[0] <= frequency) & (frequency <= self.sonar.band[1])
        passed = np.abs(self.response(length)[inside]) ** 2
        powers[0] = float((self.density(frequency[inside]) * passed).mean())
        powers[0] *= self.sonar.band[1] - self.sonar.band[0]
        if self.noise is not None:
            count = len(self.noise.samples)
            lines = np.abs(fft.rfft(self.noise.samples, length)[inside]) ** 2
            powers[1] = float((lines * passed).sum()) * 2.0 / (length * count)
        return powers[0], powers[1]

    def self_noise_for(self, peak: float, snr_db: float) -> float:
        """Level of white self-noise, dB re 1 µPa²/Hz, over which an echo has a ratio of signal to noise.

        peak : of its envelope behind the transducer, Pa. snr_db : that is wanted, of the peak.
        """
        white = self.settings.changed(
            self_noise_db=0.0, self_noise_shape=(), ambient="none", noise_file=""
        )
        one = EchoReceiver(self.sonar.changed(receiver=white), None, self.transducer)
        return float(20.0 * np.log10(peak) - snr_db - 10.0 * np.log10(one.band_noise[0]))


def ambient_level(settings: SonarReceiver) -> float:
    """Level of the noise of the surroundings over the frequencies at which it was measured, dB re 20 µPa."""
    if settings.ambient_level_db is not None:
        return settings.ambient_level_db
    return (
        22.7 + 22.6 * float(np.log10(settings.wind_speed)) if settings.ambient == "wind" else 60.0
    )


def receive(
    receiver: EchoReceiver,
    waveforms: np.ndarray,
    ears: np.ndarray,
    sound_speed: float,
    seed: int,
    *ping: int | str,
) -> Reception:
    """Record that a receiver makes of echoes.

    waveforms : (E, N) re the call at 1 m. ears : (E, 3) metres, in the sonar's frame. sound_speed : m/s.
    seed, ping : of the noise: the scene's seed, and what tells this ping from all others.
    """
    settings, sonar = receiver.settings, receiver.sonar
    rate, count = sonar.sample_rate, waveforms.shape[1]
    length = fft.next_fast_len(count + receiver.settles, real=True)
    filters = _filters(receiver, length)
    heard = fft.rfft(waveforms, length) * (receiver.pressure * filters.twice)
    on = np.arange(count) / rate >= settings.blanking
    clean = _analytic(heard, length)[:, :count] * on
    sound, envelope = clean.real, np.abs(clean)
    if settings.ringing_db is not None:
        loud = receiver.pressure * 10.0 ** (settings.ringing_db / 20.0)
        ring = fft.irfft(loud * filters.twice * receiver.sent(length), length)
        sound = sound + on * ring[:count]
    away = np.ones(len(ears))
    if settings.noise_from is not None:
        away = np.linalg.norm(np.array(settings.noise_from) - ears, axis=1)
    if settings.noisy:
        key = ("receiver", sonar.name, *ping)
        drawn = [_noise(receiver, filters, stream(seed, *key, ear)) for ear in range(len(ears))]
        noise = np.array(drawn)[:, :count]
        if receiver.noise is not None:
            start = [stream(seed, *key, ear, "file").random() for ear in range(len(ears))]
            together = settings.noise_from is not None
            start = start[:1] * len(ears) if together else start
            noise += _stretches(
                receiver, filters, count, start, away, sound_speed if together else 0.0
            )
        sound = sound + on * noise
    gain = np.ones(count)
    if settings.gain:
        gain = 10.0 ** (np.interp(np.arange(count) / rate, *np.transpose(settings.gain)) / 20.0)
    recorded, clipped = converted(settings, sound * gain)
    even, filed = receiver.band_noise
    level = np.sqrt(even + filed / away**2)
    detections = _detections(settings, sonar, recorded / gain, level)
    cells = CELL * np.arange(int(np.ceil(count / rate * sound_speed / 2.0 / CELL)))
    first = np.ceil(cells * (2.0 * rate / sound_speed)).astype(np.int64)
    cells, first = cells[first < count], first[first < count]
    return Reception(
        pressure=receiver.pressure,
        recorded=recorded,
        noise_level=level,
        snr_db=over(envelope.max(axis=1), level),
        range=cells + CELL / 2.0,
        range_snr_db=over(np.maximum.reduceat(envelope, first, axis=1), level[:, None]),
        detection_ear=detections[0],
        detection_time=detections[1] / rate,
        detection_snr_db=detections[2],
        clipped=clipped,
    )


def over(size: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """20·lg of sizes over noise: inf where there is no noise, -inf where there is nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 20.0 * np.log10(np.where(size > 0, size / noise, 0.0))
    return np.asarray(found)


def converted(settings: SonarReceiver, sound: np.ndarray) -> tuple[np.ndarray, int]:
    """Sound after the converter, and how many samples it cut."""
    if settings.overload_db is None:
        return sound, 0
    full = REFERENCE * 10.0 ** (settings.overload_db / 20.0)
    cut = int(np.count_nonzero(np.abs(sound) > full))
    if not settings.bits:
        return np.clip(sound, -full, full), cut
    most = 2.0 ** (settings.bits - 1)
    return full / most * np.clip(np.round(sound * (most / full)), -most, most - 1.0), cut


@dataclass(frozen=True)
class _Filters:
    """Transfer functions on the grid of a transform of ``length``: (K,) once and twice through the
    transducer, the latter with the call's peak made 1; (K,) standard deviations of noise behind it."""

    length: int
    once: np.ndarray
    twice: np.ndarray
    spread: np.ndarray


@lru_cache(maxsize=8)
def _filters(receiver: EchoReceiver, length: int) -> _Filters:
    rate = receiver.sonar.sample_rate
    once = receiver.response(length)
    twice = once * once
    if receiver.transducer is not None or receiver.settings.resonance:
        twice = twice / np.abs(_analytic((once * receiver.sent(length))[None], length)).max()
    density = receiver.density(fft.rfftfreq(length, 1.0 / rate))
    return _Filters(length, once, twice, once * np.sqrt(density * rate * length / 4.0))


def _analytic(spectra: np.ndarray, length: int) -> np.ndarray:
    """(E, length) analytic signals of real ones with one-sided spectra (E, K)."""
    whole = np.zeros((len(spectra), length), dtype=np.complex128)
    whole[:, : spectra.shape[1]] = spectra
    whole[:, 1 : (length + 1) // 2] *= 2.0  # all but 0 Hz and half the rate
    return np.asarray(fft.ifft(whole, axis=1, overwrite_x=True))


def _noise(receiver: EchoReceiver, filters: _Filters, rng: np.random.Generator) -> np.ndarray:
    """(L,) Gaussian noise behind the transducer."""
    drawn = rng.standard_normal((len(filters.spread), 2)).view(np.complex128)[:, 0]
    return np.asarray(fft.irfft(drawn * filters.spread, filters.length))


def _stretches(
    receiver: EchoReceiver,
    filters: _Filters,
    count: int,
    start: list[float],
    away: np.ndarray,
    sound_speed: float,
) -> np.ndarray:
    """(E, N) stretches of the file of noise behind the transducer, which begin at shares of it; the file goes
    round. away : (E,) metres. sound_speed : m/s, 0 where it comes from all sides."""
    assert receiver.noise is not None
    samples, rate = receiver.noise.samples, receiver.sonar.sample_rate
    lead = receiver.settles + (int(np.ceil(away.max() / sound_speed * rate)) if sound_speed else 0)
    length = fft.next_fast_len(count + lead, real=True)
    first = (np.array(start) * len(samples)).astype(np.int64)
    heard = fft.rfft(samples[(first[:, None] + np.arange(length)) % len(samples)])
    heard *= _filters(receiver, length).once
    if sound_speed:
        turns = np.outer(away / sound_speed, fft.rfftfreq(length, 1.0 / rate))
        heard *= np.exp(-2j * np.pi * turns) / away[:, None]
    return np.asarray(fft.irfft(heard, length)[:, length - count :])


def _detections(
    settings: SonarReceiver, sonar: Sonar, sound: np.ndarray, level: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ear, sample and dB over the noise of crests of the envelope in the band that reach the threshold."""
    if settings.threshold_db is None:
        none = np.empty(0, dtype=np.int64)
        return none, none, np.empty(0)
    length = fft.next_fast_len(sound.shape[1], real=True)
    frequency = fft.rfftfreq(length, 1.0 / sonar.sample_rate)
    inside = (sonar.band[0] <= frequency) & (frequency <= sonar.band[1])
    envelope = np.abs(_analytic(fft.rfft(sound, length) * inside, length))[:, : sound.shape[1]]
    high = over(envelope, level[:, None])
    beside = np.pad(high, ((0, 0), (1, 1)), constant_values=-np.inf)
    crest = (high >= settings.threshold_db) & (high > beside[:, :-2]) & (high >= beside[:, 2:])
    ear, sample = np.nonzero(crest)
    return ear, sample, high[ear, sample]
