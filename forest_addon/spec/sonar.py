"""Biosonar: a bat-like sonar, where it goes and what it hears."""

from __future__ import annotations

from typing import ClassVar

from .base import SpecError, param, refuse_too_fine
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

HORSESHOE_BAND = (60e3, 80e3)  # Hz, of the call whose beam width Tanveer et al. (2020a) give


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
