"""Species: how a tree grows, what it measures and what it looks like."""

from __future__ import annotations

from .base import Discrete, Normal, Settings, SpecError, param, within

DBH = 0.2  # metres, the diameter that laws start from


class Law(Settings):
    """One measure over the diameter D at breast height.

    log y = intercept + slope·x + curve·x², x = log(D/0.2 m). Of the crown base y is the odds
    base/(height - base). ``low`` and ``high`` are the residuals that 5 % of the measured trees lie below
    and above; half of them lie below the law itself.
    """

    intercept: float = param(help="log y of a stem of 0.2 m", ge=-50, le=50)
    slope: float = param(help="how log y grows with log D", ge=-20, le=20)
    curve: float = param(0.0, help="how that slope changes, half a step of log D", ge=-20, le=20)
    low: float = param(help="residual of log y that 5 % lie below", ge=-10, le=-1e-3)
    high: float = param(help="residual of log y that 5 % lie above", ge=1e-3, le=10)
    dbh: tuple[float, float] = param(
        unit="m", help="smallest and largest diameter measured", gt=0, le=20
    )
    trees: int = param(help="how many trees were measured", ge=1, le=10**9)
    within: float = param(
        1.0, help="spread of residuals within one study, or stand, over that of all", gt=0, le=1
    )
    of: str = param("", help="whose trees, where they are not of the kind itself")

    def check(self) -> None:
        if self.dbh[0] >= self.dbh[1]:
            raise SpecError("dbh", f"{list(self.dbh)} must be [smallest, largest]")


class Allometry(Settings):
    """Height, crown and leaf area of one kind of tree over its diameter, and how they differ together."""

    name: str = param(help="name of the species or group")
    source: str = param("", help="where the trees were measured")
    height: Law = param(help="height, m")
    crown_width: Law = param(help="width of the crown, m")
    crown_base: Law = param(help="odds of the crown's base, base/(height - base)")
    leaf_area: Law = param(help="leaf area, half of the leaves' surface, m²")
    correlation: tuple[float, float, float, float, float, float] = param(
        help="of residuals: height and width, height and base, height and leaves, width and base, "
        "width and leaves, base and leaves",
        ge=-1,
        le=1,
    )


class Look(Settings):
    """Colours of bark and leaves, linear RGB from 0 to 1."""

    bark: tuple[float, float, float] = param((0.09, 0.06, 0.04), help="bark colour", ge=0, le=1)
    leaf: tuple[float, float, float] = param((0.06, 0.15, 0.02), help="leaf colour", ge=0, le=1)
    autumn: float = param(
        0.0, help="how far leaves have turned: 0 summer, 1 autumn (winter: leaves off)", ge=0, le=1
    )
    autumn_leaf: tuple[float, float, float] = param(
        (0.42, 0.19, 0.025), help="colour of leaves that have turned", ge=0, le=1
    )

    def foliage(self) -> tuple[float, float, float]:
        """The colour that leaves have in their season."""
        pairs = zip(self.leaf, self.autumn_leaf, strict=True)
        r, g, b = (summer + self.autumn * (turned - summer) for summer, turned in pairs)
        return r, g, b


class Bark(Settings):
    """Bark: its texture in pictures, and its relief where that is meshed (``detail.relief``).

    Relief and oval shape leave the area of every cross-section as it is, and so volume and DBH (that of the
    circle of the same area).
    """

    texture: str = param(
        "cracked",
        help="what its surface is like",
        choices=("cracked", "smooth", "furrowed", "plated", "peeling"),
    )
    size: float = param(
        0.04, unit="m", help="width of a ridge or plate on a thick stem", ge=0.005, le=0.5
    )
    upper: tuple[float, float, float] = param(
        (0.30, 0.14, 0.06), help="colour of the upper stem and its branches", ge=0, le=1
    )
    upper_from: float = param(
        1.0, help="height from which bark has that colour, of the tree's; 1: nowhere", ge=0, le=1
    )
    moss: float = param(
        0.15, help="how much green there is on the foot of the stem: 0 none, 1 covered", ge=0, le=1
    )
    relief: float = param(
        0.006,
        unit="m",
        help="depth of furrows, from their ground to the ridges, on a stem thicker than 24 cm; in "
        "proportion on a thinner one",
        ge=0,
        le=0.1,
    )
    ovality: float = param(
        0.05,
        help="largest less smallest diameter of a cross-section, over their mean",
        ge=0,
        le=0.4,
    )


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
    understorey: float = param(
        0.0,
        help="share of the trees that are young or suppressed under the canopy, where no list gives "
        "diameters",
        ge=0,
        le=1,
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

    model: str = param(
        "Rauh",
        help="name of the architectural model (Hallé & Oldeman 1970) that the measures below are "
        "of; they alone count",
        choices=MODELS,
    )
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
        help="weaker limbs on a metre of stem in the crown, of a stem of 0.5 m that divides; a thinner one "
        "has more",
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


MAX_REACH = 1000.0  # metres that a branch may end from the foot of its tree


class Grammar(Settings):
    """An L-system of Tanveer et al. 2020a (g -> d(g)[g)+g, axiom g)) or of 2020b (whorls on one trunk)."""

    dialect: str = param(
        "tanveer-2020a",
        help="paper whose grammar this is",
        choices=("tanveer-2020a", "tanveer-2020b"),
    )
    whorls: int = param(
        2, help="the dialect tanveer-2020b only: groups d(d)+d) on the trunk", ge=1, le=12
    )
    generations: int = param(7, help="how often the grammar is rewritten", ge=0, le=12)
    copies: int = param(
        2,
        help="how many times the first-level branches are set, each copy turned and raised",
        ge=1,
        le=4,
    )
    length: float = param(2.0, unit="m", help="length of the first internode", gt=0, le=100)
    side_ratio: float = param(
        0.62, help="length of a side branch's first internode over its parent's", gt=0, le=2
    )
    centre_ratio: float = param(
        0.826, help="length of an internode over the one before it on the same axis", gt=0, le=2
    )
    angle_deg: float = param(
        50.0, unit="deg", help="angle between a side branch and its parent", ge=0, le=180
    )
    twist_deg: float = param(
        -43.75, unit="deg", help="turn about the parent axis per internode", ge=-180, le=180
    )
    radius: float = param(0.04, unit="m", help="radius at the foot of the trunk", gt=0, le=10)
    radius_ratio: float = param(
        0.7, help="radius of a side branch over its parent's at the fork", gt=0, le=1
    )

    def check(self) -> None:
        ratio = max(self.side_ratio, self.centre_ratio)
        reach = self.length * sum(ratio**level for level in range(self.generations + 1))
        if reach > MAX_REACH:
            raise SpecError(
                "generations",
                f"{self.generations} with a ratio of {ratio:g} make branches that reach {reach:,.0f} m, "
                f"more than {MAX_REACH:g} m; use fewer, or smaller ratios",
            )


class Jitter(Settings):
    """Spread of a tree about its grammar: standard deviations, truncated at two of them."""

    length: float = param(0.08, help="relative spread of lengths", ge=0, le=0.45)
    angle_deg: float = param(5.0, unit="deg", help="spread of branching angles", ge=0, le=45)
    twist_deg: float = param(8.0, unit="deg", help="spread of twists", ge=0, le=90)
    raise_ratio: float = param(
        0.6,
        help="a symmetric branch starts up to this share of an internode above the one that it mirrors",
        ge=0,
        le=0.95,
    )
    lean_deg: float = param(2.0, unit="deg", help="bend of the trunk per internode", ge=0, le=30)
    leaf_size: float = param(0.12, help="relative spread of leaf size", ge=0, le=0.45)


class Template(Settings):
    """STL files of one full tree, which is split into trunk, branches and leaves."""

    wood: str = param(
        help="STL file of trunk and branches, relative to the species file", file=True
    )
    leaves: str = param("", help="STL file of the leaves; empty: the tree is leafless", file=True)
    grow_leaves: bool = param(
        False, help="where there is no STL of leaves, grow leaves on the outermost branches"
    )
    height: float = param(
        0.0, unit="m", help="height of the tree in the files; 0: they are in metres", ge=0, le=200
    )


class Siblings(Settings):
    """Trees like the one in the template: a grammar is fitted to it, and its own pieces stand on what grows.

    Left out, a template's branches are set on the grammar of Tanveer et al. 2020a or 2020b.
    """

    variety: float = param(
        1.0,
        help="0: the tree of the files itself; 1: as different as trees of a stand are",
        ge=0,
        le=1,
    )
    age: float = param(
        1.0,
        help="age over that of the tree of the files: its diameter grows in proportion",
        ge=0.2,
        le=3,
    )
    height: float = param(
        0.0, unit="m", help="height; 0: follows from age and diameter", ge=0, le=200
    )
    dbh: float = param(
        0.0, unit="m", help="diameter at breast height; 0: follows from age and height", ge=0, le=20
    )
    allometry: str = param(
        "any",
        help="whose measured proportions: how height and crown grow with the stem",
        choices=(
            *("any", "broadleaf", "conifer", "abies", "acer", "betula", "eucalyptus", "fagus"),
            *("larix", "picea", "pinus", "populus", "pseudotsuga", "quercus"),
        ),
    )

    def check(self) -> None:
        if self.age != 1 and (self.height or self.dbh):
            given = "height" if self.height else "dbh"
            raise SpecError(given, "cannot be used beside age; remove one of them")


class Rules(Settings):
    """An L-system in full: productions as ABOP and cpfg write them, and a turtle that reads them.

    ``A(l, w) : l > 0.1 -> !(w)F(l)[&(a)A(l*r, w*0.7)] : 1/3`` has a condition and a probability, each
    optional. Angles in productions are degrees; ``n`` is the generation that is being made, ``N`` their
    number.
    """

    dialect: str = param("ABOP", help="paper whose symbols these are", choices=("ABOP", "simlidar"))
    axiom: str = param(help="the string that is rewritten")
    productions: tuple[str, ...] = param((), help="what symbols are replaced by")
    constants: tuple[str, ...] = param((), help='named numbers, "r = 0.9"')
    symbols: tuple[str, ...] = param(
        (), help='what the turtle does at a symbol, over the dialect\'s, "I(n) = draw(h0/n)"'
    )
    generations: int = param(5, help="how often the string is rewritten", ge=0, le=1000)
    angle_deg: float = param(
        45.0, unit="deg", help="turn of + - & ^ without a number", ge=-360, le=360
    )
    rotation_deg: float = param(
        45.0, unit="deg", help="turn of T t (Méndez et al.) without a number", ge=-360, le=360
    )
    length: float = param(1.0, help="length of F without a number, times scale", gt=0, le=1e6)
    diameter: float = param(0.1, help="diameter before the first !, times scale", gt=0, le=1e6)
    thinning: float = param(0.707, help="diameter after ! without a number", gt=0, le=10)
    scale: float = param(1.0, unit="m", help="metres of a length 1", gt=0, le=1e4)
    tropism: tuple[float, float, float] = param(
        (0.0, 0.0, -1.0), help="direction that branches bend to", ge=-1e3, le=1e3
    )
    elasticity: float = param(
        0.0, unit="rad", help="bend of a segment at right angles to the tropism", ge=0, le=10
    )
    prune_descending: bool = param(
        False, help="remove branches in which the turtle descends (Méndez et al.)"
    )


class Honda(Settings):
    """Wahed et al.'s trees after Honda (1971): parents bear children, smaller by a ratio, recursively."""

    levels: Discrete = param(
        Discrete(values=(5,)), help="per tree: how often branches bear children"
    )
    length: Normal = param(Normal(mean=2.0, sd=0.2), unit="m", help="per tree: length of the trunk")
    radius: Normal = param(
        Normal(mean=0.1, sd=0.01), unit="m", help="per tree: radius at the trunk's foot"
    )
    length_ratio: Normal = param(
        Normal(mean=0.75, sd=0.03), help="per tree: length of a child over its parent's"
    )
    radius_ratio: Normal = param(
        Normal(mean=0.6, sd=0.03), help="per tree: radius of a child over its parent's"
    )
    sprouting: str = param(
        "apex",
        help="where children leave their parent: at its tip, or at random places along it",
        choices=("apex", "along"),
    )
    bare: float = param(
        0.15,
        help="share of a parent's length, from its foot, without children along it",
        ge=0,
        le=0.99,
    )
    cone: float = param(
        0.0,
        help="how much shorter the last child is than the first, of children along it",
        ge=0,
        le=0.99,
    )
    daughters: Discrete = param(
        Discrete(values=(2, 3)), help="per branch: how many children it bears"
    )
    trunk_daughters: Discrete | None = param(
        None, help="how many the trunk bears; left out: as any branch"
    )
    angle_deg: Normal = param(
        Normal(mean=40.0, sd=5.0), unit="deg", help="per branch: angle to its parent"
    )
    twist_deg: Normal = param(
        Normal(mean=137.5, sd=8.0),
        unit="deg",
        help="per branch: turn about the parent: along it from one child to the next; at its tip of all "
        "children, which stand evenly around it, against their parent's plane",
    )
    leader_ratio: float = param(
        0.0, help="length of a straight leader at the apex over its parent's; 0: none", ge=0, le=2
    )
    pieces: int = param(4, help="straight pieces of a branch", ge=1, le=64)
    crook_deg: Normal = param(
        Normal(mean=0.0, sd=3.0), unit="deg", help="per piece: bend to each side"
    )
    droop: float = param(
        0.0, unit="rad", help="bend of a level branch towards the ground; negative: up", ge=-6, le=6
    )
    droop_from: int = param(
        1, help="first order that droops; trunk and its leaders are 0", ge=0, le=12
    )
    tip: float = param(0.5, help="radius at a branch's tip over that at its foot", gt=0, le=1)
    leaves: Discrete = param(
        Discrete(values=(8, 10, 12)), help="per branch of the last levels: how many leaves"
    )
    leaf_levels: int = param(1, help="how many of the last levels bear leaves", ge=0, le=12)

    def check(self) -> None:
        within("length", self.length, 0, 200, open_low=True)
        within("radius", self.radius, 0, 20, open_low=True)
        within("length_ratio", self.length_ratio, 0, 2, open_low=True)
        within("radius_ratio", self.radius_ratio, 0, 1, open_low=True)
        within("angle_deg", self.angle_deg, 0, 180)
        if max(self.levels.values) > 12:
            raise SpecError("levels", f"can draw {max(self.levels.values)}; use at most 12")


class Leaf(Settings):
    """Leaves of a species that grows without a template, or on one that has none."""

    on: bool = param(True, help="grow leaves; switching them off moves no branch")
    shape: str = param(
        "ellipse",
        help="shape of the blade",
        choices=("ellipse", "oval", "maple", "needle", "beech", "birch", "oak", "palmate"),
    )
    mesh: str = param(
        "", help="STL file of one leaf instead of a shape, relative to the species file", file=True
    )
    length: Normal = param(Normal(mean=0.05, sd=0.01), unit="m", help="length of a leaf")
    width_ratio: Normal = param(Normal(mean=0.6, sd=0.05), help="width of a leaf over its length")
    petiole: float = param(
        0.0, help="length of the stalk over that of the blade; blades of species only", ge=0, le=2
    )
    curl_deg: float = param(
        0.0,
        unit="deg",
        help="how far a blade bends down from its foot to its tip; blades of species only",
        ge=-180,
        le=180,
    )
    angle_deg: Normal = param(
        Normal(mean=50.0, sd=10.0), unit="deg", help="angle between a leaf and its branch"
    )
    nodes: int = param(
        4, help="leaf-bearing nodes of a growing tip (Tanveer et al. 2020a)", ge=1, le=100
    )
    per_node: int = param(4, help="leaves at each node (Tanveer et al. 2020a)", ge=1, le=100)
    fan_deg: float = param(
        10.0,
        unit="deg",
        help="turn from one node's leaves to the next (Tanveer et al. 2020a)",
        ge=-360,
        le=360,
    )

    def check(self) -> None:
        within("length", self.length, 0, 10, open_low=True)
        within("width_ratio", self.width_ratio, 0, 10, open_low=True)
        within("angle_deg", self.angle_deg, 0, 180)


class Inclination(Settings):
    """Inclination of leaves: the distribution of the angle between a leaf and the horizontal, 0 to 90°.

    A beta distribution of this mean and standard deviation (Goel & Strahler 1984), or shares as measured.
    """

    mean_deg: float = param(45.0, unit="deg", help="mean inclination of the leaves", gt=0, le=89)
    sd_deg: float = param(
        18.0, unit="deg", help="standard deviation of that inclination", gt=0, le=44
    )
    shares: tuple[float, ...] = param(
        (),
        help="how many leaves in each of as many equal classes from 0° to 90°, relative to the others; "
        "in place of mean and deviation",
        ge=0,
        le=1e9,
    )

    def check(self) -> None:
        if self.shares and sum(self.shares) <= 0:
            raise SpecError("shares", "are all zero; make one larger")
        widest = (self.mean_deg * (90 - self.mean_deg)) ** 0.5
        if not self.shares and self.sd_deg >= 0.99 * widest:
            raise SpecError(
                "sd_deg",
                f"{self.sd_deg:g} is too wide for a mean of {self.mean_deg:g}; use at most "
                f"{0.98 * widest:.3g}",
            )


class Detail(Settings):
    """Resolution of the mesh of a tree without a template."""

    tolerance: float = param(
        0.002, unit="m", help="largest distance between a branch and its mesh", gt=0, le=1
    )
    limbs: str = param(
        "auto",
        help="how limbs run from node to node: as smooth curves that leave their parent in a collar, or "
        "straight; auto: curves where they fill a crown",
        choices=("auto", "curves", "straight"),
    )
    relief: bool = param(
        False,
        help="mesh the relief of the bark, the oval shape of the stem and the roots at its foot",
    )
    leaves: float = param(
        1.0,
        help="share of the leaves that is made, each enlarged to keep their area; 0: none, also of a "
        "template's",
        ge=0,
        le=1,
    )


class Species(Settings):
    """One kind of tree and its looks.

    With a template, a grammar gives the trunk and the places of branches from STL files: one fitted to
    that tree (``siblings``), or Tanveer et al.'s. Without one the whole tree is grown: by ``rules``, by
    ``honda``, into a ``crown``, or by the grammar alone.
    """

    name: str = param(help="name of the species")
    source: str = param("", help="where the numbers come from")
    template: Template | None = param(
        None, help="STL files that branches and leaves are taken from"
    )
    siblings: Siblings | None = param(
        None,
        help="trees like the template's own, by a grammar fitted to it instead of Tanveer et al.'s",
    )
    grammar: Grammar = param(Grammar(), help="the L-system of Tanveer et al. 2020a or 2020b")
    rules: Rules | None = param(None, help="an L-system of your own, for the whole tree")
    honda: Honda | None = param(None, help="branching by angles and ratios, for the whole tree")
    crown: Crown | None = param(None, help="a crown that fills a shape, for the whole tree")
    architecture: Architecture | None = param(
        None, help="limbs and dead branches of a crown, by the architectural model of its species"
    )
    targets: Targets | None = param(None, help="what a tree is to measure, without a template")
    dead: bool = param(False, help="its wood is dead: stumps and lying stems")
    needles: Needles | None = param(None, help="shoots of needles in place of leaves")
    jitter: Jitter = param(Jitter(), help="natural variation around the grammar")
    leaf: Leaf = param(Leaf(), help="leaves, where there is no template")
    inclination: Inclination | None = param(
        None,
        help="how leaves incline, whatever bears them; left out: as they grow on their branches",
    )
    detail: Detail = param(Detail(), help="level of detail, where there is no template")
    look: Look = param(Look(), help="colours")
    bark: Bark = param(Bark(), help="bark, in pictures and in relief")

    @property
    def grown_by(self) -> str:
        """Name of what makes its wood."""
        given = ("siblings", "template", "rules", "honda", "crown")
        return next((key for key in given if getattr(self, key) is not None), "grammar")

    @property
    def stem_divides(self) -> bool:
        """Return whether stems of its crown do, where they are thick enough."""
        return self.architecture is not None and self.architecture.fork < 1

    @property
    def leaves_by(self) -> str:
        """Name of what makes its leaves: its template's file, or the table of needles or leaves."""
        if self.template and not self.template.grow_leaves:
            return "template"
        return "needles" if self.needles else "leaf"

    def check(self) -> None:
        given = [
            key for key in ("template", "rules", "honda", "crown") if getattr(self, key) is not None
        ]
        if len(given) > 1:
            raise SpecError(given[1], f"cannot be used beside {given[0]}; remove one of them")
        if self.siblings is not None and self.template is None:
            raise SpecError("siblings", "needs a template to be like; add one or remove it")
        for key in ("targets", "needles"):
            if self.template is not None and getattr(self, key) is not None:
                where = "; give them with a planting" if key == "targets" else ""
                raise SpecError(key, f"cannot be used beside template{where}")
        if self.architecture is not None and self.crown is None:
            raise SpecError("architecture", "needs a crown that its limbs grow into; add one")
        if self.crown is not None and self.targets is None:
            raise SpecError("targets", "are needed beside crown: its allometry, or all measures")
