"""LiDAR: SIMLIDAR's tractor, scanners on tripods, vehicles and aircraft, and what is specular to them."""

from __future__ import annotations

import math
from typing import ClassVar

from .base import AUTO, Settings, SpecError, param, places_in, refuse_absurd
from .sensor import Sensor, azimuth, kind, motion, output_name, place, range_limit


class LinkBudget(Settings):
    """Threshold of detection by the light of a pulse, in place of a reflectance at a range."""

    TITLE: ClassVar[str] = "Link Budget"
    energy: float = param(
        0.0,
        unit="µJ",
        help="light of a pulse where it leaves; 0: the faintest reflectance is the threshold",
        ge=0,
        le=1e6,
    )
    aperture: float = param(0.0, unit="m", help="diameter of the receiving optics", ge=0, le=10)
    efficiency: float = param(
        0.5, help="share of the light in the aperture that reaches the detector", gt=0, le=1
    )
    photons: float = param(
        300.0, help="photons at the detector that an echo needs to be seen", gt=0, le=1e12
    )

    def check(self) -> None:
        if bool(self.energy) != bool(self.aperture):
            raise SpecError(
                "aperture" if self.energy else "energy",
                "is missing; a link budget needs energy and aperture",
            )


POLISHED = ("mirror", "glass", "water", "retro")  # numbered so where a scene is arrays
USUAL_INDEX = {"mirror": 1.0, "glass": 1.5, "water": 1.33, "retro": 1.0}  # refractive, where "auto"


class Polished(Settings):
    """Mirror, pane of glass or surface of water, where a scanner follows light on (``bounces``); or a
    retro-reflector, for all scanners."""

    optics: str = param(
        "mirror",
        help="mirror: both faces send light on; glass: one sheet is a thin pane, light goes straight "
        "through; water: a surface whose normals point out of it, light is refracted; retro: "
        "sends light back to where it came from",
        choices=POLISHED,
    )
    index: float = param(
        AUTO, help="refractive index; auto: 1.5 of glass, 1.33 of water", ge=1, le=5, auto=True
    )
    mirror: float = param(0.9, help="share of the light that a mirror sends on", ge=0, le=1)
    extinction: float = param(
        AUTO,
        unit="1/m",
        help="light that a metre of water takes from a beam; auto: as pure water at its wavelength",
        ge=0,
        le=1e6,
        auto=True,
    )
    gain: float = param(
        785.0,
        help="light that a retro-reflector sends back, of that of a white surface; left out: 785, sheeting "
        "of 250 cd/lx/m² (ASTM D4956, type III, white, 0.2°/-4°)",
        ge=1,
        le=1e6,
    )


def property_of(field: str) -> str:
    """The name of the custom property that says a field of ``Polished``."""
    return f"forest_{field}"


class Tractor(Sensor):
    """SIMLIDAR's scanner: a vertical fan that drives past the trees and measures a matrix."""

    TITLE: ClassVar[str] = "LiDAR, tractor"
    kind: str = kind("tractor")
    name: str = output_name("scan")
    position: tuple[float, float, float] = place(
        (-1.0, 0.0, 1.0), "where the drive starts; z is the scanner's height"
    )
    heading_deg: float = azimuth(90.0, "direction of travel")
    side: str = param("right", help="side it looks to", choices=("left", "right"))
    track: float = param(30.0, unit="m", help="length of the drive", gt=0, le=1e5)
    step: float = param(0.002, unit="m", help="advance between scans (Méndez et al.)", gt=0, le=100)
    gap: int = param(0, help="scans skipped after each one taken", ge=0, le=100000)
    angle_step_deg: float = param(
        0.25, unit="deg", help="angle between beams of a scan (Méndez et al.)", gt=0, le=90
    )
    reach: float = param(
        20.0,
        unit="m",
        help="horizontal distance at which the lowest beam meets z = 0",
        gt=0,
        le=1e4,
    )
    top: float = param(12.0, unit="m", help="height that the highest beam has at that distance")
    max_range: float = range_limit(100.0)
    splits: int = param(
        0,
        help="P: a beam is (P + 1)² rays over step by angle step, the nearest hit counts (S: 2); 0: one ray",
        ge=0,
        le=16,
    )
    escape: float | None = param(
        None,
        unit="m",
        help="written into the matrix where a beam meets nothing; left out: inf",
        ge=-1e6,
        le=1e6,
    )

    def check(self) -> None:
        if self.position[2] <= 0:
            raise SpecError("position[2]", "the scanner must be above z = 0; raise it")
        if self.top <= self.position[2]:
            raise SpecError("top", f"{self.top:g} m must be above the scanner's height")
        beams, scans = self.counts
        key = "angle_step_deg" if beams > scans else "step"
        refuse_absurd(key, beams * scans, max(self.splits, 1) ** 2)

    @property
    def counts(self) -> tuple[float, float]:
        """Beams of a fan, and fans along the track."""
        rise = math.atan2(self.top - self.position[2], self.reach)
        fan = math.degrees(rise + math.atan2(self.position[2], self.reach))
        scans = places_in(self.track, self.step * (self.gap + 1))
        return places_in(fan, self.angle_step_deg), scans


class Beam(Settings):
    """The light of a scanner's pulse, its way through the air, and how its echo is read."""

    wavelength_nm: float = param(
        1550.0, unit="nm", help="wavelength; it is noted with the results", ge=100, le=20000
    )
    divergence_mrad: tuple[float, float] = param(
        (0.0, 0.0),
        unit="mrad",
        help="full angle at 1/e² of the intensity, in the direction of the sweep (azimuth on a tripod) and "
        "across it",
        ge=0,
        le=100,
    )
    exit_diameter: float = param(
        0.0, unit="m", help="diameter where the beam leaves, at 1/e² of the intensity", ge=0, le=1
    )
    subrays: int = param(
        1, help="rays that a pulse is made of; 1: one on its axis", ge=1, le=100000
    )
    pulse_ns: float = param(
        4.0,
        unit="ns",
        help="length of a pulse as the receiver sees it, full width at half maximum",
        ge=0.001,
        le=1000,
    )
    pulse_shape: tuple[float, ...] = param(
        (),
        help="power of a pulse at even times, as the receiver sees it, with tail and ringing; of recorded "
        "waveforms and Gaussians that are fitted; left out: a Gaussian of the length of a pulse",
        most=4096,
    )
    shape_step_ns: float = param(
        1.0, unit="ns", help="time between two values of the shape of a pulse", gt=0, le=1000
    )
    max_returns: int = param(
        1, help="echoes that are kept of a pulse; the receiver chooses which", ge=1, le=15
    )
    extinction: float = param(
        0.0, unit="1/m", help="light that a metre of air takes from a beam", ge=0, le=10
    )

    def check(self) -> None:
        if self.pulse_shape and sum(self.pulse_shape) <= 0:
            raise SpecError("pulse_shape", "holds no light; its values must sum to more than 0")


class Surfaces(Settings):
    """Reflectance of surfaces at the scanner's wavelength; an object may have its own."""

    other: float = param(0.5, help="share that other things send back (Lambert)", ge=0, le=1)
    wood: float = param(0.5, help="share that wood sends back", ge=0, le=1)
    leaf: float = param(0.5, help="share that a leaf sends back", ge=0, le=1)
    ground: float = param(0.5, help="share that the ground sends back", ge=0, le=1)
    leaf_transmittance: float = param(
        0.0, help="share of the light that passes a leaf", ge=0, le=0.99
    )
    passing: str = param(
        "probability",
        help="a ray passes a leaf whole with that probability, or a share of its light passes each leaf",
        choices=("probability", "share"),
    )

    def check(self) -> None:
        if self.leaf + self.leaf_transmittance > 1:
            raise SpecError(
                "leaf_transmittance",
                f"{self.leaf_transmittance:g} passes a leaf that sends {self.leaf:g} back: more light than "
                "arrives; their sum may be 1 at most, so lower leaf or leaf_transmittance",
            )


class Noise(Settings):
    """Noise of a scanner: spreads are standard deviations and add up as squares."""

    range_sd: float = param(
        0.0, unit="m", help="standard deviation of the range, at any distance", ge=0, le=100
    )
    range_ppm: float = param(
        0.0, unit="ppm", help="standard deviation of the range, in millionths of it", ge=0, le=1e5
    )
    incidence_sd: float = param(
        0.0,
        unit="m",
        help="standard deviation of the range, times the tangent of the angle of incidence",
        ge=0,
        le=100,
    )
    drop_out: float = param(0.0, help="share of the returns that get lost", ge=0, le=1)
    registration_sd: float = param(
        0.0,
        unit="m",
        help="standard deviation, along each axis, of where the whole scan or flight line is put as it is "
        "joined with others",
        ge=0,
        le=100,
    )
    registration_deg: float = param(
        0.0,
        unit="deg",
        help="standard deviation of how the whole scan or flight line is turned about each axis as it is "
        "joined with others",
        ge=0,
        le=10,
    )
    registration_s: float = param(
        0.0,
        unit="s",
        help="time in which both of these change, as errors of satellite positioning and inertial systems do "
        "along a way; 0: they do not",
        ge=0,
        le=1e6,
    )

    @property
    def registration_sd_or_deg(self) -> float:
        """The larger of both errors of registration; 0: there is none."""
        return max(self.registration_sd, self.registration_deg)


class Receiver(Settings):
    """Returns that a scanner's electronics make of the echoes of a pulse."""

    dead_zone: float = param(
        0.0,
        unit="m",
        help="least range between two returns of a pulse: after a return the receiver is blind so long; 0: "
        "what the waveform tells apart",
        ge=0,
        le=1000,
    )
    echoes: str = param(
        "crests",
        help="what an echo is: a crest of the waveform, or a Gaussian fitted to its samples, one for each "
        "crest (least squares)",
        choices=("crests", "gaussians"),
    )
    sample_ns: float = param(
        0.0,
        unit="ns",
        help="waveforms are recorded with so much time between samples; 0: none is",
        ge=0,
        le=1000,
    )
    las_format: str = param(
        "9",
        help="point format of LAS files with waveforms: 9, as older programs read it (4), or with colours of "
        "parts (10)",
        choices=("4", "9", "10"),
    )
    keep: str = param(
        "first",
        help="which returns are kept where a pulse has more than are kept of it",
        choices=("first", "last", "strongest", "strongest+last"),
    )
    dynamic_range: float = param(
        0.0,
        unit="dB",
        help="light this much above the faintest that is seen saturates: more of it reads the same; 0: never",
        ge=0,
        le=200,
    )
    threshold_snr: float = param(
        0.0,
        help="threshold of detection over the standard deviation of the noise: weak echoes come and go, and "
        "noise above it is false points; 0: no noise",
        ge=0,
        le=100,
    )
    beyond: str = param(
        "resolved",
        help="echoes from beyond the range that light covers there and back between two pulses: resolved, "
        "or folded into the range of the next pulse",
        choices=("resolved", "folded"),
    )
    blanking: float = param(
        0.0,
        unit="m",
        help="light that arrives while a later pulse is sent, and so many metres of range after it, is lost: "
        "gaps where echoes cross from one zone of multiple time around into the next; 0: none is",
        ge=0,
        le=1e4,
    )
    halo: float = param(
        0.0,
        help="share of the light that the optics scatter beside the beam: retro-reflectors bloom; 0: none",
        ge=0,
        le=0.5,
    )
    halo_mrad: float = param(
        20.0, unit="mrad", help="full angle of that light at 1/e²", gt=0, le=500
    )
    reading: str = param(
        "received",
        help="what the intensity says: light that came back, or the reflectance that it stands for",
        choices=("received", "reflectance"),
    )


class Scanner(Sensor):
    """Settings that LiDAR scanners of every platform share."""

    scanner: str = param(
        "",
        help="an instrument of assets/scanners, or a scanner file (.toml), that settings start from",
        file=True,
    )
    min_range: float = param(0.1, unit="m", help="nothing nearer is seen", ge=0, le=1e5)
    max_range: float = range_limit(120.0)
    faintest: float = param(
        0.0,
        help="reflectance that a facing surface needs to be seen at the largest range; 0: everything is seen",
        ge=0,
        le=1,
    )
    pulse_rate: float = param(100e3, unit="Hz", help="pulses a second", ge=1, le=1e9)
    beam: Beam = param(Beam(), help="light and echo")
    surfaces: Surfaces = param(Surfaces(), help="reflectance and transmittance")
    receiver: Receiver = param(Receiver(), help="which echoes become returns")
    link: LinkBudget = param(
        LinkBudget(), help="threshold by energy, aperture and photons, in place of faintest"
    )
    noise: Noise = param(Noise(), help="what is measured wrongly")
    motion: bool = motion()
    bounces: bool = param(
        False,
        help="light that a mirror, glass or water turns meets one surface more: ghosts, and what is behind "
        "panes and under water; left out: these send back light as any surface",
    )

    def check(self) -> None:
        if self.bounces and self.motion:
            raise SpecError(
                "bounces", "is for scenes that stand still; leave out bounces, or motion"
            )
        if self.min_range >= self.max_range:
            raise SpecError("min_range", "must be smaller than max_range")
        if self.link.energy and self.faintest:
            raise SpecError(
                "faintest", "is given beside a link budget; both state the threshold, leave one out"
            )
        if self.receiver.beyond == "folded" and self.receiver.sample_ns:
            raise SpecError(
                "receiver.sample_ns",
                'does not go with beyond = "folded": a record is of one pulse; leave one of them out',
            )
        if self.receiver.las_format == "4" and self.beam.max_returns > 7:
            raise SpecError(
                "receiver.las_format",
                f"4 counts 7 returns of a pulse, beam.max_returns is {self.beam.max_returns}; take format 9",
            )
        for key in ("dynamic_range", "threshold_snr", "sample_ns"):
            if getattr(self.receiver, key) and not (self.faintest or self.link.energy):
                raise SpecError(
                    f"receiver.{key}",
                    "counts from the faintest light that is seen, but faintest = 0 sees all; give faintest, "
                    "the reflectance that is seen at max_range",
                )


class Terrestrial(Scanner):
    """A scanner on a tripod: azimuth by elevation, a point cloud."""

    TITLE: ClassVar[str] = "LiDAR, terrestrial"
    kind: str = kind("terrestrial")
    name: str = output_name("cloud")
    position: tuple[float, float, float] = place((0.0, 0.0, 1.6), "where it stands")
    azimuth_deg: tuple[float, float] = param(
        (0.0, 360.0), unit="deg", help="first and last azimuth, from +X towards +Y", ge=-360, le=720
    )
    elevation_deg: tuple[float, float] = param(
        (-40.0, 80.0),
        unit="deg",
        help="first and last elevation, from the horizon up",
        ge=-90,
        le=90,
    )
    angle_step_deg: float = param(0.25, unit="deg", help="angle between beams", gt=0, le=90)
    line_step_deg: float | None = param(
        None,
        unit="deg",
        help="angle between beams in elevation; left out: as in azimuth",
        gt=0,
        le=90,
    )

    def check(self) -> None:
        for key in ("azimuth_deg", "elevation_deg"):
            low, high = getattr(self, key)
            if low >= high:
                raise SpecError(key, f"[{low:g}, {high:g}] must be [from, to] with from < to")
        across, along = (high - low for low, high in (self.azimuth_deg, self.elevation_deg))
        line_step = self.angle_step_deg if self.line_step_deg is None else self.line_step_deg
        columns, rows = places_in(across, self.angle_step_deg), places_in(along, line_step)
        key = "line_step_deg" if self.line_step_deg and rows > columns else "angle_step_deg"
        refuse_absurd(key, columns * rows, self.beam.subrays)
        super().check()


class MovingScanner(Scanner):
    """Settings of scanners on vehicles and aircraft: how the beam sweeps while they move."""

    pattern: str = param(
        "lines",
        help="how the beam sweeps: parallel lines (rotating mirror), three fans in turn (downwards, ahead, "
        "back), a zigzag (oscillating mirror), circles (a cone about nadir), several channels that spin "
        "about the vertical, or a rosette (a head that turns while its beam swings up and down)",
        choices=("lines", "fans", "zigzag", "circles", "spinning", "rosette"),
    )
    field_deg: tuple[float, float] = param(
        (-30.0, 30.0),
        unit="deg",
        help="from, to; from nadir, right positive (circles: to is the cone's angle; spinning, rosette: "
        "elevation)",
        ge=-180,
        le=180,
    )
    line_rate: float = param(100.0, unit="Hz", help="lines, or turns, a second", gt=0, le=1e6)
    channels: int = param(16, help="beams one above the other (spinning)", ge=1, le=1024)
    fan_deg: float = param(
        10.0,
        unit="deg",
        help="angle ahead and back of the second and third fan (fans)",
        ge=0,
        le=80,
    )
    petals: float = param(
        12.7,
        help="swings up and down in a turn of the head; a whole number repeats every turn (rosette)",
        gt=0,
        le=1e5,
    )
    mount_deg: tuple[float, float, float] = param(
        (0.0, 0.0, 0.0),
        unit="deg",
        help="roll, pitch and yaw of the scanner on its platform",
        ge=-180,
        le=180,
    )

    def check(self) -> None:
        if self.field_deg[0] >= self.field_deg[1]:
            raise SpecError("field_deg", "must be [from, to] with from < to")
        super().check()


class Pose(Settings):
    """Pose of a platform at one time; in between it moves evenly."""

    time: float = param(0.0, unit="s", help="time of this pose", ge=-1e9, le=1e9)
    position: tuple[float, float, float] = place((0.0, 0.0, 2.0), "where")
    heading_deg: float = azimuth(0.0, "direction of travel")
    pitch_deg: float = param(0.0, unit="deg", help="nose up: positive", ge=-180, le=180)
    roll_deg: float = param(0.0, unit="deg", help="right side down", ge=-180, le=180)


class Mobile(MovingScanner):
    """A scanner on a vehicle, a drone or a back: it follows poses, a curve, or an animated object."""

    TITLE: ClassVar[str] = "LiDAR, mobile"
    kind: str = kind("mobile")
    name: str = output_name("track")
    follow: str = param(
        "", help="curve or animated object that it follows; its X axis is forward, Z is up"
    )
    speed: float = param(1.5, unit="m/s", help="speed along a curve", gt=0, le=1e4)
    poses: tuple[Pose, ...] = param(
        (), help="where it is at what time, where it follows nothing", most=100_000
    )

    def check(self) -> None:
        for index, (before, after) in enumerate(zip(self.poses, self.poses[1:], strict=False), 1):
            if before.time >= after.time:
                raise SpecError(f"poses[{index}].time", "must be later than the pose before")
        if self.poses:
            lasts = self.poses[-1].time - self.poses[0].time
            refuse_absurd("poses", lasts * self.pulse_rate, self.beam.subrays)
        super().check()


class Airborne(MovingScanner):
    """A scanner in an aircraft that flies parallel strips, back and forth, and looks down."""

    TITLE: ClassVar[str] = "LiDAR, airborne"
    kind: str = kind("airborne")
    name: str = output_name("flight")
    position: tuple[float, float, float] = place((0.0, 0.0, 100.0), "where the first strip starts")
    heading_deg: float = azimuth(90.0, "direction of flight")
    track: float = param(100.0, unit="m", help="length of a strip", gt=0, le=1e6)
    speed: float = param(30.0, unit="m/s", help="speed over ground", gt=0, le=1e4)
    strips: int = param(
        1, help="how many strips, each to the right of the one before", ge=1, le=10000
    )
    spacing: float = param(50.0, unit="m", help="distance between strips", ge=0, le=1e5)

    def check(self) -> None:
        lasts = self.track / self.speed * self.strips
        refuse_absurd("speed", lasts * self.pulse_rate, self.beam.subrays)
        super().check()
