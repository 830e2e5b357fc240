"""Biosonar: a bat-like sonar, where it goes and what it hears."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar

from .base import Settings, SpecError, param, refuse_too_fine, shown
from .sensor import (
    PATTERNS,
    Sensor,
    azimuth,
    beam_width,
    elevation,
    kind,
    motion,
    output_name,
    place,
)

LOUDEST = 200.0  # dB, that gains and shapes of spectra change by at most
HORSESHOE_BAND = (60e3, 80e3)  # Hz, of the call whose beam width Tanveer et al. (2020a) give


class SonarReceiver(Settings):
    """Receiver of a sonar: transducer, noise, gain and converter, in physical units.

    Levels of pressure are re 20 µPa, spectral levels re 1 µPa²/Hz.
    """

    TITLE: ClassVar[str] = "Receiver"
    source_level_db: float | None = param(
        None,
        unit="dB",
        help="level of the call's peak at 0.1 m on the axis, re 20 µPa; left out: all is relative to the "
        "call at 1 m, and there is no noise",
        ge=0,
        le=200,
    )
    resonance: float = param(
        0.0,
        unit="Hz",
        help="resonance of the transducer, which call and echo pass; 0: it is alike at all frequencies",
        ge=0,
        le=1e6,
    )
    bandwidth: float = param(
        5e3, unit="Hz", help="-3 dB width of that resonance, one way", ge=10, le=1e6
    )
    transducer_file: str = param(
        "",
        help="WAV file with the transducer's impulse response, one way, in place of a resonance",
        file=True,
    )
    ringing_db: float | None = param(
        None,
        unit="dB",
        help="level at which the ears hear the call itself as it is sent, re the call at 1 m; it rings on as "
        "the transducer does; left out: they do not",
        ge=-200,
        le=60,
    )
    blanking: float = param(
        0.0,
        unit="s",
        help="time from the beginning of the call in which nothing is heard",
        ge=0,
        le=1,
    )
    gain: tuple[tuple[float, float], ...] = param(
        (),
        help="gain over time: pairs of s after the call begins, rising, and dB; straight lines between "
        "them; empty: none",
        most=1000,
    )
    self_noise_db: float | None = param(
        None,
        unit="dB",
        help="spectral level of the receiver's own noise as sound before the transducer, re 1 µPa²/Hz; left "
        "out: none",
        ge=-200,
        le=200,
    )
    self_noise_shape: tuple[tuple[float, float], ...] = param(
        (),
        help="how this differs over frequency: pairs of Hz, rising, and dB that are added; straight lines "
        "between them; empty: white",
        most=1000,
    )
    ambient: str = param(
        "none",
        help="noise of the surroundings, from all sides: none, wind in vegetation, rain on leaves, or "
        "insects of a tropical night",
        choices=("none", "wind", "rain", "insects"),
    )
    ambient_level_db: float | None = param(
        None,
        unit="dB",
        help="level of it over the frequencies at which it was measured, re 20 µPa; left out: as published, "
        "which rain is not",
        ge=-100,
        le=200,
    )
    wind_speed: float = param(3.0, unit="m/s", help="wind that makes the noise", gt=0, le=30)
    noise_file: str = param(
        "",
        help="WAV file with further noise, as of propellers; each ping hears a stretch of it by chance",
        file=True,
    )
    noise_level_db: float | None = param(
        None,
        unit="dB",
        help="root mean square level of that file, re 20 µPa; left out: its samples are pascals",
        ge=-100,
        le=200,
    )
    noise_from: tuple[float, float, float] | None = param(
        None,
        unit="m",
        help="place of what was recorded, as seen from the sonar: ahead, left and up; the file is then taken "
        "as heard at 1 m from it, and every ear hears it by the direct path; left out: from all sides",
    )
    overload_db: float | None = param(
        None,
        unit="dB",
        help="level of the largest pressure that the converter holds, after the gain, re 20 µPa; left out: "
        "nothing clips",
        ge=0,
        le=200,
    )
    bits: int = param(0, help="bits of the converter; 0: nothing is rounded", ge=0, le=32)
    threshold_db: float | None = param(
        None,
        unit="dB",
        help="crests of the envelope this much above the root mean square noise in the band are detections; "
        "left out: none are looked for",
        ge=-20,
        le=100,
    )

    @property
    def noisy(self) -> bool:
        """Presence of noise of any kind."""
        return self.self_noise_db is not None or self.ambient != "none" or bool(self.noise_file)

    def check(self) -> None:
        if self.source_level_db is None and (self.noisy or self.overload_db is not None):
            raise SpecError(
                "source_level_db",
                "is missing; noise and overload are pressures, and the echo has one by the level of its call",
            )
        if self.threshold_db is not None and not self.noisy:
            raise SpecError(
                "threshold_db", "counts from the noise; give self_noise_db, or other noise"
            )
        if self.resonance and self.transducer_file:
            raise SpecError(
                "resonance", "is given beside transducer_file; both say how it rings, leave one out"
            )
        if self.ambient == "rain" and self.ambient_level_db is None:
            raise SpecError(
                "ambient_level_db", "is missing; no level of rain is published in air, give one"
            )
        if self.noise_from == (0.0, 0.0, 0.0):
            raise SpecError("noise_from", "is where the sonar itself is; move it away")
        for key in ("gain", "self_noise_shape"):
            pairs = getattr(self, key)
            if any(after[0] <= before[0] for before, after in pairwise(pairs)):
                raise SpecError(key, f"{shown(pairs)} must rise in the first number of its pairs")
            if any(abs(level) > LOUDEST for _, level in pairs):
                raise SpecError(key, f"{shown(pairs)} must stay within {LOUDEST:g} dB")


class Sonar(Sensor):
    """A bat-like sonar that listens to the echo of foliage (Tanveer et al. 2020a)."""

    TITLE: ClassVar[str] = "Biosonar"
    kind: str = kind("sonar")
    name: str = output_name("echo")
    position: tuple[float, float, float] = place((0.0, 0.0, 2.0), "where it is")
    azimuth_deg: float = azimuth(0.0, "direction of the beam")
    elevation_deg: float = elevation(0.0, "direction of the beam")
    route: str = param(
        "",
        help="CSV file with a pose a row (x_m, y_m, z_m, azimuth_deg, elevation_deg and, if wanted, "
        "beam_width_deg or time_s), relative to the scene file; empty: one ping from the position above",
        file=True,
    )
    follow: str = param(
        "",
        help="name of a Blender object to move with, where there is no route: over the scene's frames, "
        "or along a curve",
    )
    poses: int = param(12, help="pings along what it follows", ge=1, le=100000)
    speed: float = param(
        0.0,
        unit="m/s",
        help="speed along its beam, route or curve, for the Doppler effect; an animated object has its own",
        ge=0,
        le=100,
    )
    doppler: bool = param(False, help="shift the echoes of a call by the speed")
    motion: bool = motion()
    beam: str = param(
        "gaussian",
        help="how the call spreads: a Gaussian of the width below, the "
        "horseshoe bat's (Tanveer et al. 2020a; its width follows from the frequency), a measured "
        "pattern, or everywhere alike",
        choices=PATTERNS,
    )
    beam_width_deg: tuple[float, float] = beam_width(30.0, "a Gaussian beam")
    beam_file: str = param(
        "",
        help="CSV file of a measured pattern: angle_deg, or azimuth_deg and elevation_deg, then dB in a "
        "column a frequency in Hz",
        file=True,
    )
    hearing: str = param(
        "same",
        help="directivity of the ears; same: as the call",
        choices=("same", *PATTERNS),
    )
    hearing_width_deg: tuple[float, float] = beam_width(60.0, "Gaussian ears")
    hearing_file: str = param(
        "", help="CSV file of the ears' measured pattern, or SOFA file of a head", file=True
    )
    ears: int = param(1, help="receivers, on a level line across the beam", ge=1, le=64)
    ear_spacing: float = param(
        0.02, unit="m", help="distance between the outermost of several ears", ge=0, le=100
    )
    ear_turn_deg: float = param(
        0.0, unit="deg", help="angle by which the outermost ears are turned outwards", ge=-90, le=90
    )
    band: tuple[float, float] = param(
        (60e3, 80e3),
        unit="Hz",
        help="lowest and highest frequency; the same twice: a tone",
        ge=1000,
        le=1e6,
    )
    sample_rate: float = param(400e3, unit="Hz", help="sampling rate", ge=1000, le=1e7)
    call: str = param(
        "impulse",
        help="what is sent: a pulse of the whole band, a falling sweep through it, a tone at its top "
        "that ends in such a sweep, or a WAV file",
        choices=("impulse", "fm", "cf-fm", "file"),
    )
    call_duration: float = param(
        0.002, unit="s", help="length of a sweep, or of tone and sweep", gt=0, le=1
    )
    call_file: str = param("", help="WAV file with the call", file=True)
    record: float = param(
        0.0,
        unit="s",
        help="length of the record; later echoes are cut, and counted. 0: as long as the last needs",
        ge=0,
        le=60,
    )
    leaves: bool = param(True, help="let leaves sound")
    wood: bool = param(True, help="let trunks and branches sound, as cylinders")
    facets: bool = param(True, help="let ground, rocks and walls sound, as facets")
    leaf_model: str = param(
        "exact",
        help="how a leaf scatters: as a hard disc, exactly or by physical optics (piston), or by the "
        "paper's fit",
        choices=("exact", "piston", "paper"),
    )
    shading: str = param(
        "trunks",
        help="what weakens an echo: nothing (paper), wood in the way (trunks), leaves in the way "
        "(extinction; large ones hide), or both",
        choices=("none", "trunks", "extinction", "trunks+extinction"),
    )
    shading_rays: int = param(
        4,
        help="rays along each side of a cell 4° wide that look for leaves in the way (extinction)",
        ge=1,
        le=32,
    )
    absorption: bool = param(True, help="let the air absorb sound")
    near_limit: float = param(
        0.05, unit="m", help="what is nearer is left out, and counted", gt=0, le=100
    )
    max_range: float = param(
        15.0, unit="m", help="what is farther is left out, and counted", gt=0, le=1e4
    )
    cull: float = param(
        1e-4,
        help="what together adds less than this share of all amplitudes may be left out",
        ge=0,
        le=0.1,
        auto=True,
    )
    tolerance: float = param(
        1e-6,
        help="largest error of the fast sum, as a share of all amplitudes; 0: the direct sum; the report "
        "says what was reached",
        ge=0,
        le=0.01,
        auto=True,
    )
    time_expansion: float = param(
        20.0, help="how many times slower the echo's WAV plays", ge=1, le=1000
    )
    contributions: bool = param(
        False, help="also write what each leaf, branch and facet adds, and where it is"
    )

    receiver: SonarReceiver | None = param(
        None, help="transducer, noise and converter; left out: echoes are heard as they are"
    )

    @property
    def followed(self) -> str:
        """The object that it moves with; empty where a route says where it goes."""
        return "" if self.route else self.follow

    def check(self) -> None:
        if self.band[0] > self.band[1]:
            raise SpecError("band", f"{list(self.band)} must be [lowest, highest] in Hz")
        if self.band[1] > self.sample_rate / 2:
            raise SpecError(
                "band",
                f"{self.band[1]:g} Hz is above half the sample_rate; lower it or sample faster",
            )
        if self.near_limit >= self.max_range:
            raise SpecError("near_limit", "must be smaller than max_range")
        refuse_too_fine(self.tolerance)
        for key in ("beam", "hearing", "call"):
            if getattr(self, key) == "file" and not getattr(self, f"{key}_file"):
                raise SpecError(f"{key}_file", f'is needed for {key} = "file"; name a file')
        if "horseshoe" in (self.beam, self.hearing) and not (
            HORSESHOE_BAND[0] <= self.band[0] and self.band[1] <= HORSESHOE_BAND[1]
        ):
            raise SpecError(
                "band", "must lie within 60 to 80 kHz, where Tanveer et al.'s beam width is known"
            )
        if self.doppler and self.call == "impulse":
            raise SpecError(
                "doppler", 'needs a call that lasts; use call = "fm", "cf-fm" or "file"'
            )
        if self.call != "impulse" and self.band[0] == self.band[1]:
            raise SpecError("call", "needs a band; a tone has none")
        if self.receiver is not None:
            if self.band[0] == self.band[1]:
                raise SpecError("receiver", "needs a band; a tone has none")
            if self.receiver.resonance > self.sample_rate / 2:
                raise SpecError(
                    "receiver.resonance",
                    f"{self.receiver.resonance:g} Hz is above half the sample_rate; sample faster",
                )
