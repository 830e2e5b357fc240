"""Forest reverb: sources, receivers, ground and trunks."""

from __future__ import annotations

from typing import ClassVar

from .base import Settings, SpecError, param, refuse_too_fine
from .sensor import Sensor, azimuth, elevation, kind, output_name, place


class Place(Settings):
    """Place of one more source or receiver."""

    position: tuple[float, float, float] = place((0.0, 0.0, 1.5), "where it is")

    def check(self) -> None:
        if self.position[2] <= 0:
            raise SpecError("position[2]", "must be above the ground, z = 0; raise it")


class Reverb(Sensor):
    """The impulse response of a forest of trunks between sources and receivers (Kaneko & Gamper 2021)."""

    TITLE: ClassVar[str] = "Forest reverb"
    kind: str = kind("reverb")
    name: str = output_name("reverb")
    source: tuple[float, float, float] = place((5.0, 10.0, 1.5), "where sound starts")
    receiver: tuple[float, float, float] = place((15.0, 10.0, 1.5), "where it is heard")
    sources: tuple[Place, ...] = param((), help="further sources")
    receivers: tuple[Place, ...] = param((), help="further receivers")
    source_objects: str = param(
        "", help="names of Speakers that are further sources, separated by commas"
    )
    receiver_objects: str = param(
        "", help="names of Empties and Cameras that are further receivers, separated by commas"
    )
    array: int = param(
        1,
        help="microphones of each receiver, in a row around it: 2 are a pair of ears without a head",
        ge=1,
        le=256,
    )
    array_spacing: float = param(
        0.18, unit="m", help="distance between microphones of a row", gt=0, le=100
    )
    array_azimuth_deg: float = azimuth(
        90.0, "direction from the first microphone of a row to the last"
    )
    array_elevation_deg: float = elevation(0.0, "the same")
    array_file: str = param(
        "",
        help="CSV of an array's microphones, columns x, y, z: metres from each receiver; instead of a row",
        file=True,
    )
    source_path: str = param(
        "",
        help="CSV of where the first source goes, columns time, x, y, z: seconds and metres",
        file=True,
    )
    receiver_path: str = param(
        "",
        help="CSV of where the first receiver goes, and the microphones around it, columns time, x, y, z",
        file=True,
    )
    path_step: float = param(
        0.1,
        unit="s",
        help="time between the impulse responses of a source or a receiver that moves",
        gt=0,
        le=60,
    )
    heard_as: str = param(
        "omni",
        help="each receiver is a microphone; or four channels of first-order ambisonics; or two ears by "
        "the head of a SOFA file",
        choices=("omni", "ambisonics", "binaural"),
    )
    head_file: str = param(
        "", help="SOFA file (AES69) of a head's impulse responses, SimpleFreeFieldHRIR", file=True
    )
    head_azimuth_deg: float = azimuth(180.0, "where ambisonics and the head face")
    noise_db: tuple[float, ...] = param(
        (),
        help="background noise in octaves from 63 Hz up, re the mean square of the dry sound at 1 m; "
        "added where a dry sound is heard",
        unit="dB",
        ge=-200,
        le=100,
    )
    directivity: str = param(
        "omni",
        help="how sources send: alike all round, as a cardioid, or as a file says",
        choices=("omni", "cardioid", "measured"),
    )
    directivity_file: str = param(
        "",
        help="CSV: first column degrees from the axis, further columns dB at the header's Hz",
        file=True,
    )
    facing_azimuth_deg: float = azimuth(0.0, "where sources point")
    facing_elevation_deg: float = elevation(0.0, "where sources point")
    sample_rate: float = param(24e3, unit="Hz", help="sampling rate", ge=1000, le=384e3)
    duration: float = param(
        0.0,
        unit="s",
        help="length of the impulse response; 0: until what is left is 75 dB below the whole in every "
        "octave, or the last trunk was heard, 20 s at most",
        ge=0,
        le=60,
    )
    ground: float = param(
        0.8, help="reflection coefficient of a constant ground (Kaneko & Gamper 2021)", ge=-1, le=1
    )
    surface: str = param(
        "as model",
        help="what the ground is: the same at all frequencies, or an impedance by flow resistivity; as "
        "model: constant for the paper's, forest floor for a forest",
        choices=("as model", "constant", "snow", "forest floor", "grass", "soil", "asphalt"),
    )
    impedance_model: str = param(
        "miki", help="impedance of a surface", choices=("miki", "delany-bazley")
    )
    flow_resistivity: float = param(
        0.0,
        unit="kPa·s/m²",
        help="flow resistivity of the surface; 0: the usual one of its kind",
        ge=0,
        le=1e6,
    )
    strength: float = param(
        2.0, help="β, weight of the scattered field (Kaneko & Gamper 2021)", ge=0, le=1000
    )
    spreading: float = param(
        0.7,
        help="α, spreading from tree to receiver: 0.5 cylindrical, 1 spherical (Kaneko & Gamper 2021)",
        ge=0,
        le=2,
    )
    model: str = param(
        "paper",
        help="paper: weights β and α, the air's losses alone; forest: the cylinder's own "
        "weights, and the losses below",
        choices=("paper", "forest"),
    )
    extinction: str = param(
        "energy",
        help="forest: what trunks take from a sound on its way: nothing, what they scatter away from "
        "straight on, or all that leaves the coherent wave",
        choices=("none", "energy", "coherent"),
    )
    tail: str = param(
        "transport",
        help="forest: sound scattered more than once: none, or noise with the energy that transport "
        "through the stand gives it",
        choices=("none", "transport"),
    )
    multiple_share: float = param(
        0.9,
        help="forest: from when, in every octave, this share of the energy still to come is scattered more "
        "than once or by branches, or the rest is 40 dB below the octave, all is noise; 1: never",
        gt=0,
        le=1,
    )
    path_ground: bool = param(
        True, help="forest: sound by way of trunks is reflected at the ground too"
    )
    turbulence: float = param(
        1.0,
        unit="1e-6",
        help="forest: mean square of the fluctuation of the refractive index in millionths, which parts "
        "the direct from the reflected sound (Daigle 1979); 0: still air",
        ge=0,
        le=100,
    )
    lean_deg: float = param(
        2.0,
        unit="deg",
        help="forest: how far trunks lean, standard deviation in each of two directions, which parts sound "
        "by way of them from its reflection at the ground; 0: upright",
        ge=0,
        le=20,
    )
    bark: float = param(
        0.05,
        help="forest: share of the energy that bark of trunks and branches absorbs of a wave head on (Li et "
        "al. 2020: below 0.1)",
        ge=0,
        le=0.9,
    )
    foliage: bool = param(True, help="forest: leaves at the height of the path absorb")
    leaf_area_density: float = param(
        0.0,
        unit="m²/m³",
        help="forest: area of leaves in the air at the height of the path; 0: as in the scene",
        ge=0,
        le=20,
    )
    leaf_absorption: float = param(
        0.0015,
        help="forest: G of the share G·√f that a leaf absorbs, f in Hz (Watanabe & Yamada 1996: 0.001 "
        "to 0.002)",
        ge=0,
        le=0.01,
    )
    branches: bool = param(
        True, help="forest: branches, twigs and leaves scatter sound, up and down too"
    )
    boundary_loss: bool = param(
        True,
        help="forest: the viscous, heat-conducting air at the bark of branches and twigs takes sound",
    )
    branch_area_density: float = param(
        0.0,
        unit="m²/m³",
        help="forest: bark of branches in the air below the canopy; 0: as the scene's trees, by height",
        ge=0,
        le=5,
    )
    floor_leaf_area: float = param(
        0.0,
        unit="m²/m²",
        help="forest: leaves of herbs and dwarf shrubs on the floor, which take from sound that goes by the "
        "ground, besides those that stand in the scene",
        ge=0,
        le=10,
    )
    branch_radius: float = param(
        0.006, unit="m", help="forest: mean radius of these branches", gt=0, le=0.1
    )
    leaf_radius: float = param(
        0.0,
        unit="m",
        help="forest: of a disc as large as a leaf, which says what leaves scatter; birch 0.02; 0: as the "
        "scene's; needles have settings of their own",
        ge=0,
        le=0.5,
    )
    needle_area_density: float = param(
        0.0,
        unit="m²/m³",
        help="forest: half the surface of needles in the air below the canopy, which are thin cylinders to "
        "sound; 0: as the scene's shoots, by height",
        ge=0,
        le=20,
    )
    needle_radius: float = param(
        0.0005, unit="m", help="forest: of needles, the scene's too", gt=0, le=0.005
    )
    canopy_return: float = param(
        0.0,
        help="forest: share of the sound leaving the canopy that comes back, as a wind or an inversion "
        "bends it",
        ge=0,
        le=1,
    )
    litter: float = param(
        0.1,
        help="forest: share of the sound of branches and leaves on the ground that litter scatters all ways",
        ge=0,
        le=1,
    )
    trunk_height: float = param(
        0.0,
        unit="m",
        help="forest: where trunks end, on average; 0: as the scene's trees, stems are endless",
        ge=0,
        le=150,
    )
    min_radius: float = param(
        0.01, unit="m", help="thinner stems are left out, and counted", gt=0, le=10
    )
    continue_to: float = param(
        0.0,
        unit="m",
        help="beyond the field, go on with trunks of the same density up to this distance",
        ge=0,
        le=2000,
    )
    tolerance: float = param(
        1e-4,
        help="relative error allowed to the sum over trunks, in all, in each octave and in each tenth of "
        "the record; 0, and from 1e-9 to 1e-6, sums every trunk and frequency",
        ge=0,
        le=0.01,
        auto=True,
    )
    rescattering: int = param(
        0,
        help="trunks around the pair for which single scattering is compared with exact multiple "
        "scattering; 0: no comparison",
        ge=0,
        le=400,
    )

    @property
    def source_or_receiver_path(self) -> str:
        """The file of where one of them goes; empty where both stand still."""
        return self.source_path or self.receiver_path

    @property
    def ground_kind(self) -> str:
        """The surface, by the model where it is left to that."""
        if self.surface != "as model":
            return self.surface
        return "forest floor" if self.model == "forest" else "constant"

    def check(self) -> None:
        for key in ("source", "receiver"):
            if getattr(self, key)[2] <= 0:
                raise SpecError(f"{key}[2]", "must be above the ground, z = 0; raise it")
        if self.sample_rate % 1:
            raise SpecError(
                "sample_rate", f"{self.sample_rate:g} Hz: sound files need a whole number of hertz"
            )
        refuse_too_fine(self.tolerance)
        if self.heard_as == "binaural" and not self.head_file:
            raise SpecError("head_file", "is needed where heard_as is binaural; name a SOFA file")
        if self.directivity == "measured" and not self.directivity_file:
            raise SpecError(
                "directivity_file", "is needed where directivity is measured; name a CSV"
            )
