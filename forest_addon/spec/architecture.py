"""The architecture of a species: where its stem divides, how limbs stand, what dies below its crown."""

from __future__ import annotations

from .base import Normal, Settings, SpecError, param, within

MODELS = (
    *("Attims", "Champagnat", "Leeuwenberg", "Mangenot", "Massart", "Rauh", "Roux", "Scarrone"),
    "Troll",
)


class DeadBranches(Settings):
    """Branches that died in the shade and still hang on the stem below the living crown.

    They are broken, leafless, thinner to the tip, and fewer and shorter the longer they have been dead,
    which is the farther below the crown they are.
    """

    density: float = param(
        0.0, unit="1/m", help="branches on a metre of stem right below the crown", ge=0, le=100
    )
    length: float = param(
        0.6, help="length of dead branches there over the radius of the crown", ge=0, le=3
    )
    down: float = param(
        0.9, help="how far towards the ground they stay, as a share of the crown base", ge=0, le=1
    )
    decay: float = param(
        0.6,
        help="share of density and length that is lost from the crown to the lowest",
        ge=0,
        le=1,
    )
    twigs: float = param(
        2.0, unit="1/m", help="side branches that are left on a metre of dead branch", ge=0, le=50
    )
    radius: float = param(
        0.05, help="radius at the stem over the stem's radius there, at most 4 cm", ge=0.005, le=0.5
    )
    angle_deg: Normal = param(
        Normal(mean=90.0, sd=15.0), unit="deg", help="angle to the stem, upwards; over 90: hanging"
    )

    def check(self) -> None:
        within("angle_deg", self.angle_deg, 0, 180)


class Architecture(Settings):
    """The model after Hallé and Oldeman (1970) that a crown's limbs follow, and its measures.

    Without apical control (``fork`` below 1) the stem divides into a few heavy limbs; with it a leader goes
    to the top and limbs stand in whorls of a year, with weaker ones between them. Space colonisation clothes
    the limbs with branches and twigs.
    """

    model: str = param("Rauh", help="architectural model of Hallé & Oldeman (1970)", choices=MODELS)
    fork: float = param(
        1.0,
        help="where the stem first divides, from the crown's base 0 to its top; 1: it does not",
        ge=0,
        le=1,
    )
    control: float = param(
        0.12, unit="m", help="diameter below which a stem keeps its leader all the same", ge=0, le=5
    )
    limbs: float = param(8.0, help="heavy limbs of a stem of 0.5 m that divides", ge=2, le=60)
    growth: float = param(
        1.2, help="exponent with which their number grows with the stem's diameter", ge=0, le=3
    )
    divide: float = param(
        2.0, help="branches of order 2 that a heavy limb divides into", ge=0, le=10
    )
    weak: float = param(
        0.8,
        unit="1/m",
        help="weak branches on a metre of stem in the crown, where it divides",
        ge=0,
        le=20,
    )
    shoot: float = param(
        0.4, unit="m", help="growth of the leader in a year, from whorl to whorl", gt=0, le=3
    )
    whorl: Normal = param(Normal(mean=5.0, sd=1.0), help="branches of a whorl")
    between: float = param(
        0.0, help="weaker branches between two whorls, over those of a whorl", ge=0, le=5
    )
    shed: float = param(
        0.4,
        help="share of a whorl that the lowest whorls of the living crown have lost",
        ge=0,
        le=0.95,
    )
    angle_deg: Normal = param(
        Normal(mean=60.0, sd=8.0),
        unit="deg",
        help="angle of a limb to the stem at the crown's base",
    )
    top_angle_deg: float = param(
        40.0, unit="deg", help="angle of a limb to the stem at the crown's top", ge=5, le=120
    )
    tip_deg: float = param(
        30.0,
        unit="deg",
        help="elevation of a limb's tip: 90 orthotropic, 0 plagiotropic, below 0 hanging",
        ge=-90,
        le=90,
    )
    leaf_area_index: float = param(
        8.0, help="leaves of its closed stands, m² a m² of ground, which none passes", gt=0, le=30
    )
    dead: DeadBranches = param(DeadBranches(), help="dead branches below the crown")

    def check(self) -> None:
        within("whorl", self.whorl, 0, 60, open_low=True)
        within("angle_deg", self.angle_deg, 0, 150)
        if self.whorl.mean < 1:
            raise SpecError("whorl", f"{self.whorl.mean:g} is no branch; give at least 1")
