"""Trees grown to measure: what they are to reach, crowns that fill a shape, shoots of needles."""

from __future__ import annotations

from .base import Normal, Settings, SpecError, param, within


class Targets(Settings):
    """Targets of a tree's measures; a target left at 0 is drawn as its kind was measured.

    Definitions are the forester's: diameter at 1.3 m up the stem, height of the highest point, width of
    the crown as the mean of its diameters, base where the lowest living branch leaves the stem, one-sided
    leaf area.
    """

    allometry: str = param(
        "",
        help="measured kind of trees: a file of assets/allometry, or an allometry file (.toml)",
        file=True,
    )
    dbh: Normal | None = param(
        None, unit="m", help="diameters at breast height, where a list of trees gives none"
    )
    height: float = param(0.0, unit="m", help="height; 0: as its kind was measured", ge=0, le=150)
    crown_width: float = param(
        0.0, unit="m", help="width of the crown; 0: as its kind was measured", ge=0, le=100
    )
    crown_base: float = param(
        0.0, unit="m", help="height of the crown's base; 0: as its kind was measured", ge=0, le=150
    )
    leaf_area: float = param(
        0.0, unit="m²", help="one-sided leaf area; 0: as its kind was measured", ge=0, le=1e5
    )

    def check(self) -> None:
        if self.dbh is not None:
            within("dbh", self.dbh, 0, 20, open_low=True)
        if self.height and self.crown_base >= self.height:
            raise SpecError(
                "crown_base", f"{self.crown_base:g} m is not below the height, {self.height:g} m"
            )


class Crown(Settings):
    """A tree that grows into the space of its crown (space colonisation, Runions et al. 2007).

    Points that attract branches are strewn in an envelope; branches grow towards those that are nearest to
    them and take them away. Stems follow the pipe model: the power ``pipe`` of a radius is the sum of that
    of what it bears, and ends at the diameter at breast height.
    """

    widest: float = param(
        0.3, help="height of the widest place, from the crown's base 0 to its top 1", ge=0, le=0.9
    )
    dome: float = param(
        0.0,
        help="how much higher that place is of a stem of 0.4 m than of 0.15 m: crowns get domes with age",
        ge=-0.9,
        le=0.9,
    )
    top: float = param(
        1.5, help="how full the crown is above that: 1 a cone, 2 a dome, more a box", ge=0.5, le=8
    )
    underside: float = param(2.0, help="how full the crown is below its widest place", ge=0.5, le=8)
    leader: float = param(
        0.4,
        help="how far up the crown one straight stem goes: 1 to the top, as in conifers",
        ge=0,
        le=1,
    )
    points: int = param(
        900, help="points that attract branches; more: finer branches", ge=20, le=20000
    )
    shell: float = param(
        0.4,
        help="how much they keep to the outside of the crown: 0 evenly, 1 all outside",
        ge=0,
        le=1,
    )
    gaps: float = param(
        0.0,
        help="share of the crown, farthest from its limbs, that stays empty (with an architecture)",
        ge=0,
        le=0.9,
    )
    rise: float = param(
        0.1, help="how much branches turn up, as a share of each step; negative: down", ge=-1, le=1
    )
    crook: float = param(0.15, help="how crooked branches are, as a share of each step", ge=0, le=1)
    pipe: float = param(
        2.2, help="exponent of the pipe model; 2: cross sections add up (da Vinci)", ge=1.5, le=3.5
    )
    disused: float = param(
        0.3, help="share of the stem's foot that fed branches which are gone", ge=0, le=0.9
    )
    flare: float = param(
        0.35, help="how much wider the stem is at the ground than above its roots", ge=0, le=2
    )
    collar: float = param(
        0.0,
        help="how much thicker a branch is where it leaves its parent; 0: no collars",
        ge=0,
        le=2,
    )
    twig: Normal = param(Normal(mean=0.25, sd=0.08), unit="m", help="length of a leaf-bearing twig")
    twig_leaves: int = param(12, help="leaves, or shoots of needles, of a twig", ge=1, le=1000)
    twig_angle_deg: Normal = param(
        Normal(mean=50.0, sd=15.0), unit="deg", help="angle between a twig and its branch"
    )
    hang: float = param(
        0.0, help="how much twigs hang: 1 as much down as along, as of a weeping birch", ge=0, le=5
    )
    twig_radius: float = param(0.0015, unit="m", help="radius of a twig", gt=0, le=0.1)

    def check(self) -> None:
        within("twig", self.twig, 0, 10, open_low=True)
        within("twig_angle_deg", self.twig_angle_deg, 0, 180)


class Needles(Settings):
    """The shoots that a conifer bears in place of leaves; ``leaf.length`` is that of a shoot.

    A shoot's mean shadow is that of all its needles, whichever number of blades is drawn for them.
    """

    length: float = param(0.02, unit="m", help="length of a needle", gt=0, le=0.5)
    diameter: float = param(0.001, unit="m", help="diameter of a needle", gt=0, le=0.02)
    count: int = param(100, help="needles of a shoot", ge=2, le=2000)
    angle_deg: float = param(50.0, unit="deg", help="angle between needle and shoot", ge=5, le=90)
    together: int = param(
        1, help="needles of a fascicle, which spring from one place: 2 of Scots pine", ge=1, le=8
    )
    blades: int = param(
        16, help="blades that are drawn for a shoot; 0: every needle", ge=0, le=2000
    )
