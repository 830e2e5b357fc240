"""Everything a user can set: each parameter once, with unit, range, default and help.

A scene file, the Python API and Blender's panel are all made from these frozen dataclasses. A field
is declared with ``param``; a value that is out of range never becomes an object, it raises
``SpecError`` with the key, the value and what is allowed. Lengths are metres, times seconds,
frequencies hertz; angles are degrees here (``_deg``), because people type them, and radians everywhere
else.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar


class SpecError(ValueError):
    """A setting that cannot be used: ``key`` says where, the text says what and what to do."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(f"{key}: {problem}" if key else problem)
        self.key = key
        self.problem = problem


@dataclass(frozen=True)
class Param:
    """What is known of one parameter besides its type and default."""

    help: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    open_minimum: bool = False  # the minimum itself is not allowed
    choices: tuple[str, ...] = ()
    file: bool = (
        False  # it names a file, from the folder of the one that says so, or what is shipped
    )
    required: bool = False

    def allowed(self) -> str:
        """The allowed values in words."""
        if self.choices:
            return "one of " + ", ".join(f'"{c}"' for c in self.choices)
        unit = f" {self.unit}" if self.unit else ""
        low, high = f"{self.minimum:g}", f"{self.maximum:g}"
        above = "larger than" if self.open_minimum else "at least"
        if math.isinf(self.minimum) and math.isinf(self.maximum):
            return "any finite number"
        if math.isinf(self.maximum):
            return f"{above} {low}{unit}"
        if math.isinf(self.minimum):
            return f"at most {high}{unit}"
        if self.open_minimum:
            return f"larger than {low} and at most {high}{unit}"
        return f"from {low} to {high}{unit}"


def param(
    default: Any = dataclasses.MISSING,
    *,
    help: str,
    unit: str = "",
    ge: float = -math.inf,
    gt: float | None = None,
    le: float = math.inf,
    choices: tuple[str, ...] = (),
    file: bool = False,
) -> Any:
    """A dataclass field with its unit, range and help; without a default it must be given."""
    known = Param(
        help=help,
        unit=unit,
        minimum=ge if gt is None else gt,
        maximum=le,
        open_minimum=gt is not None,
        choices=choices,
        file=file,
        required=default is dataclasses.MISSING,
    )
    return dataclasses.field(default=default, metadata={"param": known})


def param_of(field: dataclasses.Field[Any]) -> Param:
    """The ``Param`` of a dataclass field."""
    known: Param = field.metadata["param"]
    return known


class Settings:
    """Base of every group of settings: a frozen keyword dataclass that checks itself."""

    TITLE: ClassVar[str] = ""

    if TYPE_CHECKING:  # dataclass makes them; values are checked when they are given
        __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

        def __init__(self, **values: Any) -> None: ...

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        dataclass(frozen=True, kw_only=True)(cls)

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            _check(field.name, getattr(self, field.name), param_of(field))
        self.check()

    def check(self) -> None:
        """Rules between fields; raises SpecError."""


T = TypeVar("T", bound="Settings")


def with_files(settings: T, rename: Callable[[str], str]) -> T:
    """Settings in which every file that they name, at any depth, is called otherwise."""
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if isinstance(value, Settings):
            changed[field.name] = with_files(value, rename)
        elif isinstance(value, tuple) and value and isinstance(value[0], Settings):
            changed[field.name] = tuple(with_files(item, rename) for item in value)
        elif param_of(field).file and value:
            changed[field.name] = rename(value)
    return dataclasses.replace(settings, **changed)


def _check(key: str, value: Any, known: Param) -> None:
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, str):
        if known.choices and value not in known.choices:
            raise SpecError(key, f'"{value}" is not known; use {known.allowed()}')
    elif isinstance(value, (int, float)):
        low = value > known.minimum if known.open_minimum else value >= known.minimum
        if not (low and value <= known.maximum and math.isfinite(value)):
            unit = f" {known.unit}" if known.unit else ""
            raise SpecError(key, f"{value:g}{unit} is out of range; use {known.allowed()}")
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            _check(f"{key}[{index}]", item, known)


# ------------------------------------------------------------------------------------- species


MAX_REACH = 1000.0  # metres that a branch may end from the foot of its tree


class Normal(Settings):
    """A truncated normal distribution; with sd 0 always the mean."""

    mean: float = param(help="mean before truncation", ge=-1e6, le=1e6)
    sd: float = param(0.0, help="standard deviation before truncation", ge=0, le=1e6)
    low: float | None = param(None, help="nothing smaller; left out: mean - 2 sd")
    high: float | None = param(None, help="nothing larger; left out: mean + 2 sd")

    def bounds(self) -> tuple[float, float]:
        """The smallest and the largest value that can be drawn."""
        if self.sd == 0:
            return self.mean, self.mean
        low = self.mean - 2 * self.sd if self.low is None else self.low
        return low, self.mean + 2 * self.sd if self.high is None else self.high

    def check(self) -> None:
        low = self.mean if self.low is None else self.low
        high = self.mean if self.high is None else self.high
        if not low <= self.mean <= high:
            raise SpecError("mean", f"{self.mean:g} must lie between low and high")


class Discrete(Settings):
    """A distribution over a few whole numbers."""

    values: tuple[int, ...] = param(help="the numbers that may be drawn", ge=0, le=10000)
    weights: tuple[float, ...] = param(
        (), help="how often each, relative to the others; left out: all alike", ge=0, le=1e9
    )

    def check(self) -> None:
        if not self.values:
            raise SpecError("values", "is empty; give at least one number")
        if self.weights and len(self.weights) != len(self.values):
            raise SpecError("weights", f"has {len(self.weights)} values; give {len(self.values)}")
        if self.weights and sum(self.weights) <= 0:
            raise SpecError("weights", "are all zero; make one larger")


def _within(key: str, spread: Normal, low: float, high: float, open_low: bool = False) -> None:
    """Refuse a distribution that can draw what its place does not allow."""
    for value in (*spread.bounds(), spread.mean):
        if value < low or value > high or (open_low and value == low):
            above = "larger than" if open_low else "at least"
            raise SpecError(
                key,
                f"can draw {value:g}; keep it {above} {low:g} and at most {high:g} by mean, low and high",
            )


class Grammar(Settings):
    """An L-system of T20 (g -> d(g)[g)+g, axiom g)) or of A20 (whorls on one trunk)."""

    dialect: str = param("T20", help="whose grammar", choices=("T20", "A20"))
    whorls: int = param(2, help="A20 only: groups d(d)+d) on the trunk", ge=1, le=12)
    generations: int = param(7, help="how often the grammar is rewritten", ge=0, le=12)
    copies: int = param(
        2,
        help="how many times the first-level branches are set, each copy turned and raised",
        ge=1,
        le=4,
    )
    length: float = param(2.0, unit="m", help="length of the first internode", gt=0, le=100)
    side_ratio: float = param(
        0.62, help="length of a side branch's first internode over its mother's", gt=0, le=2
    )
    centre_ratio: float = param(
        0.826, help="length of an internode over the one before it on the same axis", gt=0, le=2
    )
    angle_deg: float = param(
        50.0, unit="deg", help="angle between a side branch and its mother", ge=0, le=180
    )
    twist_deg: float = param(
        -43.75, unit="deg", help="turn about the mother axis per internode", ge=-180, le=180
    )
    radius: float = param(0.04, unit="m", help="radius at the foot of the trunk", gt=0, le=10)
    radius_ratio: float = param(
        0.7, help="radius of a side branch over its mother's at the fork", gt=0, le=1
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
    """How much a tree differs from the grammar: standard deviations, truncated at two of them."""

    length: float = param(0.08, help="relative spread of lengths", ge=0, le=0.45)
    angle_deg: float = param(5.0, unit="deg", help="spread of branching angles", ge=0, le=45)
    twist_deg: float = param(8.0, unit="deg", help="spread of twists", ge=0, le=90)
    raise_ratio: float = param(
        0.6,
        help="a symmetric branch starts up to this share of an internode above its sister",
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
        False, help="where there is no STL of leaves, set those of [leaf] on the outermost branches"
    )
    height: float = param(
        0.0, unit="m", help="height of the tree in the files; 0: they are in metres", ge=0, le=200
    )


class Look(Settings):
    """Colours of bark and leaves, linear RGB from 0 to 1."""

    bark: tuple[float, float, float] = param((0.09, 0.06, 0.04), help="bark colour", ge=0, le=1)
    leaf: tuple[float, float, float] = param((0.06, 0.15, 0.02), help="leaf colour", ge=0, le=1)


class Rules(Settings):
    """An L-system in full: productions as ABOP and cpfg write them, and a turtle that reads them.

    ``A(l, w) : l > 0.1 -> !(w)F(l)[&(a)A(l*r, w*0.7)] : 1/3`` has a condition and a probability, each
    optional. Angles in productions are degrees; ``n`` is the generation that is being made, ``N`` their
    number.
    """

    dialect: str = param("ABOP", help="whose symbols", choices=("ABOP", "S"))
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
        45.0, unit="deg", help="turn of T t (S) without a number", ge=-360, le=360
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
    prune_descending: bool = param(False, help="remove branches in which the turtle descends (S)")


class Honda(Settings):
    """W's trees after Honda (1971): mothers bear daughters, smaller by a ratio, recursively."""

    levels: Discrete = param(
        Discrete(values=(5,)), help="per tree: how often branches bear daughters"
    )
    length: Normal = param(Normal(mean=2.0, sd=0.2), unit="m", help="per tree: length of the trunk")
    radius: Normal = param(
        Normal(mean=0.1, sd=0.01), unit="m", help="per tree: radius at the trunk's foot"
    )
    length_ratio: Normal = param(
        Normal(mean=0.75, sd=0.03), help="per tree: length of a daughter over her mother's"
    )
    radius_ratio: Normal = param(
        Normal(mean=0.6, sd=0.03), help="per tree: radius of a daughter over her mother's"
    )
    sprouting: str = param(
        "apex",
        help="where daughters leave their mother: at its tip, or at random places along it",
        choices=("apex", "along"),
    )
    bare: float = param(0.15, help="share of a mother without daughters (along)", ge=0, le=0.99)
    cone: float = param(
        0.0, help="how much shorter the last daughter is than the first (along)", ge=0, le=0.99
    )
    daughters: Discrete = param(
        Discrete(values=(2, 3)), help="per branch: how many daughters it bears"
    )
    trunk_daughters: Discrete | None = param(
        None, help="how many the trunk bears; left out: as any branch"
    )
    angle_deg: Normal = param(
        Normal(mean=40.0, sd=5.0), unit="deg", help="per branch: angle to its mother"
    )
    twist_deg: Normal = param(
        Normal(mean=137.5, sd=8.0),
        unit="deg",
        help="per branch: turn about the mother, from one daughter to the next (along), or of all "
        "daughters, which stand evenly around the tip, against their mother's plane (apex)",
    )
    leader_ratio: float = param(
        0.0, help="length of a straight leader at the apex over its mother's; 0: none", ge=0, le=2
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
        _within("length", self.length, 0, 200, open_low=True)
        _within("radius", self.radius, 0, 20, open_low=True)
        _within("length_ratio", self.length_ratio, 0, 2, open_low=True)
        _within("radius_ratio", self.radius_ratio, 0, 1, open_low=True)
        _within("angle_deg", self.angle_deg, 0, 180)
        if max(self.levels.values) > 12:
            raise SpecError("levels", f"can draw {max(self.levels.values)}; use at most 12")


class Leaf(Settings):
    """Leaves of a species that grows without a template, or on one that has none."""

    on: bool = param(True, help="grow leaves; switching them off moves no branch")
    shape: str = param("ellipse", help="shape of the blade", choices=("ellipse", "maple", "needle"))
    mesh: str = param(
        "", help="STL file of one leaf instead of a shape, relative to the species file", file=True
    )
    length: Normal = param(Normal(mean=0.05, sd=0.01), unit="m", help="length of a leaf")
    width_ratio: Normal = param(Normal(mean=0.6, sd=0.05), help="width of a leaf over its length")
    angle_deg: Normal = param(
        Normal(mean=50.0, sd=10.0), unit="deg", help="angle between a leaf and its branch"
    )
    nodes: int = param(4, help="leaf-bearing nodes of a growing tip (T20)", ge=1, le=100)
    per_node: int = param(4, help="leaves at each node (T20)", ge=1, le=100)
    fan_deg: float = param(
        10.0, unit="deg", help="turn from one node's leaves to the next (T20)", ge=-360, le=360
    )

    def check(self) -> None:
        _within("length", self.length, 0, 10, open_low=True)
        _within("width_ratio", self.width_ratio, 0, 10, open_low=True)
        _within("angle_deg", self.angle_deg, 0, 180)


class Detail(Settings):
    """How finely a tree without a template is meshed."""

    tolerance: float = param(
        0.002, unit="m", help="largest distance between a branch and its mesh", gt=0, le=1
    )
    leaves: float = param(
        1.0, help="share of the leaves that is made, each enlarged to keep their area", gt=0, le=1
    )


class Species(Settings):
    """One kind of tree and its looks.

    With a template, a grammar gives the trunk and the places of branches from STL files. Without one the
    whole tree is grown: by ``rules``, by ``honda``, or by the grammar alone.
    """

    name: str = param(help="name of the species")
    source: str = param("", help="where the numbers come from")
    template: Template | None = param(
        None, help="STL files that branches and leaves are taken from"
    )
    grammar: Grammar = param(Grammar(), help="the L-system of T20 or A20")
    rules: Rules | None = param(None, help="an L-system of your own, for the whole tree")
    honda: Honda | None = param(None, help="branching by angles and ratios, for the whole tree")
    jitter: Jitter = param(Jitter(), help="natural variation around the grammar")
    leaf: Leaf = param(Leaf(), help="leaves, where there is no template")
    detail: Detail = param(Detail(), help="level of detail, where there is no template")
    look: Look = param(Look(), help="colours")

    def check(self) -> None:
        given = [key for key in ("template", "rules", "honda") if getattr(self, key) is not None]
        if len(given) > 1:
            raise SpecError(given[1], f"cannot be used beside {given[0]}; remove one of them")


# ------------------------------------------------------------------------------------- forest


class Gaussian(Settings):
    """One hill of the intensity function: peak·exp(-(x-a)²/h² - (y-b)²/l²) (T20, squared form)."""

    peak: float = param(1.0, unit="trees/m²", help="intensity at the centre", ge=0, le=1e6)
    centre: tuple[float, float] = param(unit="m", help="centre (a, b)", ge=-1e7, le=1e7)
    width: tuple[float, float] = param(unit="m", help="widths (h, l)", gt=0, le=1e7)


Corners = tuple[tuple[float, float], ...]


def _check_rings(polygon: Corners, holes: tuple[Corners, ...]) -> None:
    if holes and not polygon:
        raise SpecError("holes", "need a polygon around them; give polygon too")
    for key, ring in [("polygon", polygon), *((f"holes[{k}]", h) for k, h in enumerate(holes))]:
        if len(ring) < 3 and (ring or key != "polygon"):
            raise SpecError(key, f"has {len(ring)} corners; give at least 3")


class Raster(Settings):
    """An image or array that is part of an intensity function; its first row is the north edge."""

    file: str = param(help="PNG, TIFF or npy file, relative to the scene file", file=True)
    use: str = param(
        "add",
        help="add it to the hills, multiply what there is, or keep trees where it reaches threshold",
        choices=("add", "multiply", "mask"),
    )
    value: float = param(
        1.0, help="what a pixel of 1 means (white of an image): trees/m², or a factor", ge=0, le=1e6
    )
    threshold: float = param(0.5, help="smallest pixel that a mask keeps", ge=0, le=1e6)
    size: tuple[float, float] | None = param(
        None, unit="m", help="extent along x and y; left out: as the field", gt=0, le=1e7
    )
    origin: tuple[float, float] | None = param(
        None,
        unit="m",
        help="its corner with the smallest x and y; left out: the field's",
        ge=-1e7,
        le=1e7,
    )


class Rows(Settings):
    """An orchard: parallel rows of trees (S)."""

    rows: int = param(0, help="how many rows; 0: as many as fit the field", ge=0, le=100000)
    trees: int = param(0, help="trees in each row; 0: as many as fit the field", ge=0, le=100000)
    row_spacing: float = param(4.0, unit="m", help="distance between rows", gt=0, le=1e4)
    tree_spacing: float = param(2.0, unit="m", help="distance within a row", gt=0, le=1e4)
    start: tuple[float, float] = param(
        (0.0, 0.0),
        unit="m",
        help="the first tree, from the field's origin; rows follow to the right of their heading",
        ge=-1e7,
        le=1e7,
    )
    heading_deg: float = param(
        90.0, unit="deg", help="direction of a row, from +X towards +Y", ge=-360, le=360
    )
    jitter: float = param(
        0.0,
        unit="m",
        help="spread of each tree about its place along x and y, truncated at twice that",
        ge=0,
        le=1e3,
    )


class Planting(Settings):
    """One species of the forest and where its trees stand.

    Its intensity is hills + base + rasters and paint that are added, times those that multiply, within
    masks, polygon and limits; nothing to add: the same everywhere.
    """

    species: str = param(help="a species of assets/species, or a species file (.toml)", file=True)
    variants: int = param(3, help="how many different trees are grown and instanced", ge=1, le=1000)
    layout: str = param(
        "poisson",
        help="an inhomogeneous Poisson process, rows of an orchard, or a list of trees",
        choices=("poisson", "rows", "list"),
    )
    expected: float | None = param(
        None,
        unit="trees",
        help="expected number of trees; scales the intensity. Left out: the peaks count as given",
        ge=0,
        le=1e8,
    )
    density: float | None = param(
        None,
        unit="trees/m²",
        help="mean of the intensity over the field; scales it, in place of an expected number",
        ge=0,
        le=1e6,
    )
    exact: bool = param(
        False,
        help="exactly the expected number of trees, before spacing, in place of a Poisson one",
    )
    scale: tuple[float, float] = param(
        (0.85, 1.15), help="smallest and largest size factor of a tree", gt=0, le=100
    )
    crown: float = param(
        0.0,
        unit="m",
        help="crown radius at size factor 1; crowns of two trees do not overlap",
        ge=0,
        le=1e3,
    )
    base: float = param(
        0.0, unit="trees/m²", help="intensity everywhere, added to the hills", ge=0, le=1e6
    )
    gaussians: tuple[Gaussian, ...] = param(
        (), help="hills of the intensity function; none: the same everywhere"
    )
    rasters: tuple[Raster, ...] = param((), help="images that are part of the intensity function")
    painted: str = param("", help="weights on a mesh of the Blender scene: OBJECT, or OBJECT:LAYER")
    painted_value: float = param(
        1.0, unit="trees/m²", help="intensity where the painted weight is 1", ge=0, le=1e6
    )
    polygon: Corners = param(
        (), unit="m", help="corners that it keeps within; none: the whole field", ge=-1e7, le=1e7
    )
    holes: tuple[Corners, ...] = param(
        (), unit="m", help="corners of each hole in the polygon", ge=-1e7, le=1e7
    )
    slope_deg: tuple[float, float] = param(
        (0.0, 90.0), unit="deg", help="slopes of the terrain that it grows on", ge=0, le=90
    )
    altitude: tuple[float, float] = param(
        (-1e5, 1e5), unit="m", help="heights of the terrain that it grows at", ge=-1e5, le=1e5
    )
    rows: Rows = param(Rows(), help="the orchard, where the layout is rows")
    trees: str = param(
        "",
        help="CSV of trees (list): x,y on the map, offset included, and any of species,scale,rotation",
        file=True,
    )
    collection: str = param(
        "", help="collection of the Blender scene whose objects say where trees stand (list)"
    )

    def check(self) -> None:
        for key in ("scale", "slope_deg", "altitude"):
            low, high = getattr(self, key)
            if low > high:
                raise SpecError(key, f"{[low, high]} must be [smallest, largest]")
        _check_rings(self.polygon, self.holes)
        if self.expected is not None and self.density is not None:
            raise SpecError("density", "cannot be given beside expected; remove one of them")
        if self.layout == "poisson" and not (self._has_intensity() or self._is_scaled()):
            raise SpecError("expected", "is needed where there are no gaussians; give a number")
        if self.layout == "list" and bool(self.trees) == bool(self.collection):
            raise SpecError("trees", "a list needs a file in trees, or else a collection; give one")

    def _is_scaled(self) -> bool:
        return self.expected is not None or self.density is not None

    def _has_intensity(self) -> bool:
        added = any(raster.use == "add" for raster in self.rasters)
        return bool(self.gaussians or self.base or self.painted or added)


class Distance(Settings):
    """How far apart trees of two plantings stand, in place of the forest's spacing."""

    species: str = param(help="one of them, as the report names it")
    other: str = param(help="the other; the same name twice: among themselves")
    distance: float = param(unit="m", help="no two of them stand closer", ge=0, le=1e5)


class Terrain(Settings):
    """The ground: flat, a heightmap or a triangulated surface."""

    file: str = param(
        "",
        help="heightmap (PNG, TIFF, npy) or surface (STL); neither file nor object: flat",
        file=True,
    )
    object: str = param("", help="mesh object of the Blender scene, in place of a file")
    base: float = param(
        0.0, unit="m", help="height where a pixel is 0, or of flat ground", ge=-1e5, le=1e5
    )
    relief: float = param(
        1.0, unit="m", help="height of a pixel of 1 (white of an image) above that", ge=-1e5, le=1e5
    )
    size: tuple[float, float] | None = param(
        None, unit="m", help="extent of a heightmap; left out: as the field", gt=0, le=1e7
    )
    origin: tuple[float, float] | None = param(
        None,
        unit="m",
        help="its corner with the smallest x and y; left out: the field's",
        ge=-1e7,
        le=1e7,
    )

    def check(self) -> None:
        if self.file and self.object:
            raise SpecError("object", "cannot be given beside file; remove one of them")


class Forest(Settings):
    """The field that the trees stand on."""

    size: tuple[float, float] = param(
        (30.0, 30.0), unit="m", help="extent of the field along x and y", gt=0, le=1e5
    )
    origin: tuple[float, float] = param(
        (0.0, 0.0), unit="m", help="its corner with the smallest x and y", ge=-1e7, le=1e7
    )
    polygon: Corners = param(
        (), unit="m", help="corners of the field; none: all of its extent", ge=-1e7, le=1e7
    )
    holes: tuple[Corners, ...] = param(
        (), unit="m", help="corners of each hole in the field", ge=-1e7, le=1e7
    )
    spacing: float = param(0.0, unit="m", help="no two trees stand closer than this", ge=0, le=1e5)
    spacing_rule: str = param(
        "matern",
        help="of two trees too close the younger goes, even if the older goes too (Matérn II), "
        "or only if the older stays (greedy, W)",
        choices=("matern", "greedy"),
    )
    distances: tuple[Distance, ...] = param((), help="other distances between two plantings")
    terrain: Terrain = param(Terrain(), help="the ground that trees stand on")
    margin: float = param(
        20.0, unit="m", help="how far the ground reaches beyond the field", ge=0, le=1e4
    )
    instancing: str = param(
        "auto",
        help="trees in Blender: objects that can be moved one by one, points of one object that geometry "
        "nodes put trees on (a hundred thousand stay light), or points from 1001 trees on",
        choices=("auto", "objects", "points"),
    )

    def check(self) -> None:
        _check_rings(self.polygon, self.holes)


class Stems(Settings):
    """Trees that are upright cylinders only: reverb hears them, nothing is grown or drawn (K)."""

    count: int = param(help="how many, evenly at random over the field", ge=0, le=20_000_000)
    radius: Normal = param(Normal(mean=0.25), unit="m", help="radius of each")

    def check(self) -> None:
        _within("radius", self.radius, 0, 20, open_low=True)


class Air(Settings):
    """The air that sound travels through."""

    temperature_c: float = param(20.0, unit="°C", help="temperature", ge=-40, le=50)
    humidity: float = param(50.0, unit="%", help="relative humidity", gt=0, le=100)
    pressure_kpa: float = param(101.325, unit="kPa", help="pressure", ge=20, le=120)
    sound_speed: float | None = param(
        None,
        unit="m/s",
        help="speed of sound; left out: 343.2·√(T/293.15 K) of ISO 9613-1",
        ge=250,
        le=450,
    )

    def speed(self) -> float:
        """Speed of sound in m/s."""
        if self.sound_speed is not None:
            return self.sound_speed
        return 343.2 * math.sqrt((self.temperature_c + 273.15) / 293.15)


# ------------------------------------------------------------------------------------- sensors


class Tractor(Settings):
    """SIMLIDAR's scanner: a vertical fan that drives past the trees and measures a matrix."""

    TITLE: ClassVar[str] = "LiDAR, tractor"
    kind: str = param("tractor", help="kind of sensor", choices=("tractor",))
    name: str = param("scan", help="name of its output files")
    position: tuple[float, float, float] = param(
        (-1.0, 0.0, 1.0), unit="m", help="where the drive starts; z is the scanner's height"
    )
    heading_deg: float = param(
        90.0, unit="deg", help="direction of travel, from +X towards +Y", ge=-360, le=360
    )
    side: str = param("right", help="side it looks to", choices=("left", "right"))
    track: float = param(30.0, unit="m", help="length of the drive", gt=0, le=1e5)
    step: float = param(0.002, unit="m", help="advance between scans (S)", gt=0, le=100)
    gap: int = param(0, help="scans skipped after each one taken", ge=0, le=100000)
    angle_step_deg: float = param(
        0.25, unit="deg", help="angle between beams of a scan (S)", gt=0, le=90
    )
    reach: float = param(
        20.0,
        unit="m",
        help="horizontal distance at which the lowest beam meets z = 0",
        gt=0,
        le=1e4,
    )
    top: float = param(12.0, unit="m", help="height that the highest beam has at that distance")
    max_range: float = param(100.0, unit="m", help="nothing farther is seen", gt=0, le=1e5)
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


class Beam(Settings):
    """The light of a scanner's pulse, its way through the air, and how its echo is read."""

    wavelength_nm: float = param(
        1550.0, unit="nm", help="wavelength; it is noted with the results", gt=0, le=20000
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
        gt=0,
        le=1000,
    )
    max_returns: int = param(1, help="echoes that are kept of a pulse, the first ones", ge=1, le=15)
    extinction: float = param(
        0.0, unit="1/m", help="light that a metre of air takes from a beam", ge=0, le=10
    )


class Surfaces(Settings):
    """What surfaces do to light of this wavelength; an object may say its own reflectance."""

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


class Noise(Settings):
    """What a scanner measures wrongly: spreads are standard deviations and add up as squares."""

    range_sd: float = param(0.0, unit="m", help="spread of the range, always", ge=0, le=100)
    range_ppm: float = param(
        0.0, unit="ppm", help="spread of the range for each range", ge=0, le=1e5
    )
    incidence_sd: float = param(
        0.0, unit="m", help="spread of the range for each tan(angle of incidence)", ge=0, le=100
    )
    drop_out: float = param(0.0, help="share of the returns that get lost", ge=0, le=1)


class Scanner(Settings):
    """What LiDAR scanners of every platform have."""

    scanner: str = param(
        "",
        help="an instrument of assets/scanners, or a scanner file (.toml), that settings start from",
        file=True,
    )
    min_range: float = param(0.1, unit="m", help="nothing nearer is seen", ge=0, le=1e5)
    max_range: float = param(120.0, unit="m", help="nothing farther is seen", gt=0, le=1e5)
    faintest: float = param(
        0.0,
        help="reflectance that a facing surface needs to be seen at max_range; 0: everything is seen",
        ge=0,
        le=1,
    )
    pulse_rate: float = param(100e3, unit="Hz", help="pulses a second", gt=0, le=1e9)
    beam: Beam = param(Beam(), help="light and echo")
    surfaces: Surfaces = param(Surfaces(), help="reflectance and transmittance")
    noise: Noise = param(Noise(), help="what is measured wrongly")

    def check(self) -> None:
        if self.min_range >= self.max_range:
            raise SpecError("min_range", "must be smaller than max_range")


class Terrestrial(Scanner):
    """A scanner on a tripod: azimuth by elevation, a point cloud."""

    TITLE: ClassVar[str] = "LiDAR, terrestrial"
    kind: str = param("terrestrial", help="kind of sensor", choices=("terrestrial",))
    name: str = param("cloud", help="name of its output files")
    position: tuple[float, float, float] = param((0.0, 0.0, 1.6), unit="m", help="where it stands")
    azimuth_deg: tuple[float, float] = param(
        (0.0, 360.0), unit="deg", help="from, to; from +X towards +Y", ge=-360, le=720
    )
    elevation_deg: tuple[float, float] = param(
        (-40.0, 80.0), unit="deg", help="from, to; from the horizon up", ge=-90, le=90
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
        super().check()


class MovingScanner(Scanner):
    """What scanners on vehicles and aircraft have: how the beam sweeps while they move."""

    pattern: str = param(
        "lines",
        help="how the beam sweeps: parallel lines (rotating mirror), a zigzag (oscillating mirror), circles "
        "(a cone about nadir), or several channels that spin about the vertical",
        choices=("lines", "zigzag", "circles", "spinning"),
    )
    field_deg: tuple[float, float] = param(
        (-30.0, 30.0),
        unit="deg",
        help="from, to; from nadir, right positive (circles: to is the cone's angle; spinning: elevation)",
        ge=-180,
        le=180,
    )
    line_rate: float = param(100.0, unit="Hz", help="lines, or turns, a second", gt=0, le=1e6)
    channels: int = param(16, help="beams one above the other (spinning)", ge=1, le=1024)
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
    """Where a platform is at one time; in between it moves evenly."""

    time: float = param(0.0, unit="s", help="when", ge=-1e9, le=1e9)
    position: tuple[float, float, float] = param((0.0, 0.0, 2.0), unit="m", help="where")
    heading_deg: float = param(
        0.0, unit="deg", help="direction of travel, from +X towards +Y", ge=-360, le=360
    )
    pitch_deg: float = param(0.0, unit="deg", help="nose up", ge=-180, le=180)
    roll_deg: float = param(0.0, unit="deg", help="right side down", ge=-180, le=180)


class Mobile(MovingScanner):
    """A scanner on a vehicle, a drone or a back: it follows poses, a curve, or an animated object."""

    TITLE: ClassVar[str] = "LiDAR, mobile"
    kind: str = param("mobile", help="kind of sensor", choices=("mobile",))
    name: str = param("track", help="name of its output files")
    follow: str = param(
        "", help="curve or animated object that it follows; its X axis is forward, Z is up"
    )
    speed: float = param(1.5, unit="m/s", help="speed along a curve", gt=0, le=1e4)
    poses: tuple[Pose, ...] = param((), help="where it is at what time, where it follows nothing")

    def check(self) -> None:
        for index, (before, after) in enumerate(zip(self.poses, self.poses[1:], strict=False), 1):
            if before.time >= after.time:
                raise SpecError(f"poses[{index}].time", "must be later than the pose before")
        super().check()


class Airborne(MovingScanner):
    """A scanner in an aircraft that flies parallel strips, back and forth, and looks down."""

    TITLE: ClassVar[str] = "LiDAR, airborne"
    kind: str = param("airborne", help="kind of sensor", choices=("airborne",))
    name: str = param("flight", help="name of its output files")
    position: tuple[float, float, float] = param(
        (0.0, 0.0, 100.0), unit="m", help="where the first strip starts"
    )
    heading_deg: float = param(
        90.0, unit="deg", help="direction of flight, from +X towards +Y", ge=-360, le=360
    )
    track: float = param(100.0, unit="m", help="length of a strip", gt=0, le=1e6)
    speed: float = param(30.0, unit="m/s", help="speed over ground", gt=0, le=1e4)
    strips: int = param(
        1, help="how many strips, each to the right of the one before", ge=1, le=10000
    )
    spacing: float = param(50.0, unit="m", help="distance between strips", ge=0, le=1e5)


HORSESHOE_BAND = (60e3, 80e3)  # Hz, of the call whose beam width T20 give


class Sonar(Settings):
    """A bat-like sonar that listens to the echo of foliage (T20)."""

    TITLE: ClassVar[str] = "Biosonar"
    kind: str = param("sonar", help="kind of sensor", choices=("sonar",))
    name: str = param("echo", help="name of its output files")
    position: tuple[float, float, float] = param((0.0, 0.0, 2.0), unit="m", help="where it is")
    azimuth_deg: float = param(
        0.0, unit="deg", help="direction of the beam, from +X towards +Y", ge=-360, le=360
    )
    elevation_deg: float = param(
        0.0, unit="deg", help="direction of the beam, from the horizon up", ge=-90, le=90
    )
    route: str = param(
        "",
        help="CSV file with a pose a row (x_m, y_m, z_m, azimuth_deg, elevation_deg and, if wanted, "
        "beam_width_deg), relative to the scene file; empty: one ping from the position above",
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
        help="along its beam, route or curve, for the Doppler effect; an animated object has its own",
        ge=0,
        le=100,
    )
    doppler: bool = param(False, help="shift the echoes of a call by the speed")
    beam: str = param(
        "gaussian",
        help="how the call spreads: a Gaussian of the width below, the horseshoe bat's of T20 (its width "
        "follows from the frequency), a measured pattern, or everywhere alike",
        choices=("gaussian", "horseshoe", "file", "omni"),
    )
    beam_width_deg: tuple[float, float] = param(
        (30.0, 30.0),
        unit="deg",
        help="full -3 dB width of a Gaussian beam, in azimuth and elevation",
        gt=0,
        le=360,
    )
    beam_file: str = param(
        "",
        help="CSV file of a measured pattern: angle_deg, then dB in a column a frequency in Hz",
        file=True,
    )
    hearing: str = param(
        "same",
        help="directivity of the ears; same: as the call",
        choices=("same", "gaussian", "horseshoe", "file", "omni"),
    )
    hearing_width_deg: tuple[float, float] = param(
        (60.0, 60.0),
        unit="deg",
        help="full -3 dB width of Gaussian ears, in azimuth and elevation",
        gt=0,
        le=360,
    )
    hearing_file: str = param("", help="CSV file of the ears' measured pattern", file=True)
    ears: int = param(1, help="receivers, on a level line across the beam", ge=1, le=64)
    ear_spacing: float = param(
        0.02, unit="m", help="between the outermost of several ears", ge=0, le=100
    )
    ear_turn_deg: float = param(
        0.0, unit="deg", help="that the outermost ears are turned outwards", ge=-90, le=90
    )
    band: tuple[float, float] = param(
        (60e3, 80e3),
        unit="Hz",
        help="lowest and highest frequency; the same twice: a tone",
        gt=0,
        le=1e6,
    )
    sample_rate: float = param(400e3, unit="Hz", help="sampling rate", gt=0, le=1e7)
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
        "(extinction), or both",
        choices=("none", "trunks", "extinction", "trunks+extinction"),
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
    )
    tolerance: float = param(
        1e-6,
        help="error of the fast sum, as a share of all amplitudes; 0: the direct sum, to rounding",
        ge=0,
        le=0.01,
    )
    time_expansion: float = param(
        20.0, help="how many times slower the echo's WAV plays", ge=1, le=1000
    )
    contributions: bool = param(
        False, help="also write what each leaf, branch and facet adds, and where it is"
    )

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
        for key in ("beam", "hearing", "call"):
            if getattr(self, key) == "file" and not getattr(self, f"{key}_file"):
                raise SpecError(f"{key}_file", f'is needed for {key} = "file"; name a file')
        if "horseshoe" in (self.beam, self.hearing) and not (
            HORSESHOE_BAND[0] <= self.band[0] and self.band[1] <= HORSESHOE_BAND[1]
        ):
            raise SpecError("band", "must lie within 60 to 80 kHz, where T20's beam width is known")
        if self.doppler and self.call == "impulse":
            raise SpecError(
                "doppler", 'needs a call that lasts; use call = "fm", "cf-fm" or "file"'
            )
        if self.call != "impulse" and self.band[0] == self.band[1]:
            raise SpecError("call", "needs a band; a tone has none")


class Place(Settings):
    """Where one more source or receiver is."""

    position: tuple[float, float, float] = param((0.0, 0.0, 1.5), unit="m", help="where it is")

    def check(self) -> None:
        if self.position[2] <= 0:
            raise SpecError("position[2]", "must be above the ground, z = 0; raise it")


class Reverb(Settings):
    """The impulse response of a forest of trunks between sources and receivers (K)."""

    TITLE: ClassVar[str] = "Forest reverb"
    kind: str = param("reverb", help="kind of sensor", choices=("reverb",))
    name: str = param("reverb", help="name of its output files")
    source: tuple[float, float, float] = param(
        (5.0, 10.0, 1.5), unit="m", help="where sound starts"
    )
    receiver: tuple[float, float, float] = param(
        (15.0, 10.0, 1.5), unit="m", help="where it is heard"
    )
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
    array_azimuth_deg: float = param(
        90.0,
        unit="deg",
        help="direction from the first microphone of a row to the last, from +X towards +Y",
        ge=-360,
        le=360,
    )
    array_elevation_deg: float = param(
        0.0, unit="deg", help="the same, from the horizon up", ge=-90, le=90
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
    facing_azimuth_deg: float = param(
        0.0, unit="deg", help="where sources point, from +X towards +Y", ge=-360, le=360
    )
    facing_elevation_deg: float = param(
        0.0, unit="deg", help="where sources point, from the horizon up", ge=-90, le=90
    )
    sample_rate: float = param(24e3, unit="Hz", help="sampling rate", ge=1000, le=384e3)
    duration: float = param(1.0, unit="s", help="length of the impulse response", gt=0, le=60)
    ground: float = param(0.8, help="reflection coefficient of a constant ground (K)", ge=-1, le=1)
    surface: str = param(
        "constant",
        help="what the ground is: the same at all frequencies, or an impedance by flow resistivity",
        choices=("constant", "snow", "forest floor", "grass", "soil", "asphalt"),
    )
    impedance_model: str = param(
        "miki", help="impedance of a surface", choices=("miki", "delany-bazley")
    )
    flow_resistivity: float = param(
        0.0, unit="kPa·s/m²", help="of the surface; 0: its usual one", ge=0, le=1e6
    )
    strength: float = param(2.0, help="β, weight of the scattered field (K)", ge=0, le=1000)
    spreading: float = param(
        0.7, help="α, spreading from tree to receiver: 0.5 cylindrical, 1 spherical (K)", ge=0, le=2
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
        help="relative error allowed to the sum over trunks; 0 sums every trunk and frequency",
        ge=0,
        le=0.01,
    )
    rescattering: int = param(
        0,
        help="trunks around the pair for which single scattering is compared with exact multiple "
        "scattering; 0: no comparison",
        ge=0,
        le=400,
    )

    def check(self) -> None:
        for key in ("source", "receiver"):
            if getattr(self, key)[2] <= 0:
                raise SpecError(f"{key}[2]", "must be above the ground, z = 0; raise it")
        if self.directivity == "measured" and not self.directivity_file:
            raise SpecError(
                "directivity_file", "is needed where directivity is measured; name a CSV"
            )
        if 0 < self.tolerance < 1e-6:
            raise SpecError("tolerance", "must be 0 (exact) or from 1e-6 to 0.01")


Sensor = Tractor | Terrestrial | Mobile | Airborne | Sonar | Reverb
SENSORS: dict[str, type[Settings]] = {
    "tractor": Tractor,
    "terrestrial": Terrestrial,
    "mobile": Mobile,
    "airborne": Airborne,
    "sonar": Sonar,
    "reverb": Reverb,
}


# ------------------------------------------------------------------------------------- scene


class Rays(Settings):
    """How rays are cast; what they find does not depend on it."""

    TITLE: ClassVar[str] = "Rays"
    engine: str = param(
        "auto",
        help="Blender's own Embree, its BVHTree, or the first of them that works",
        choices=("auto", "bvhtree", "embree"),
    )
    threads: int = param(0, help="threads of Embree; 0: as many as there are cores", ge=0, le=1024)


class Output(Settings):
    """What is written besides the sensors' results."""

    blend: bool = param(True, help="write forest.blend")
    glb: bool = param(True, help="write forest.glb")
    preview: bool = param(True, help="render preview.png with Cycles")
    preview_size: tuple[int, int] = param(
        (1280, 640), unit="px", help="width and height of the preview", ge=16, le=8192
    )
    preview_samples: int = param(20, help="samples a pixel of the preview", ge=1, le=65536)


class Scene(Settings):
    """A whole scene: forest, air, sensors, output. One seed decides every draw."""

    name: str = param("forest", help="title of the scene")
    seed: int = param(0, help="one seed for the whole scene", ge=0, le=2**63 - 1)
    offset: tuple[float, float, float] = param(
        (0.0, 0.0, 0.0),
        unit="m",
        help="added to coordinates that are written, in double precision: a map's origin (UTM)",
        ge=-1e8,
        le=1e8,
    )
    crs: str = param("", help="coordinate system of what is written, such as EPSG:32632")
    blend: str = param(
        "",
        help="Blender file to start from, whose objects the settings name; left out: an empty one",
    )
    forest: Forest = param(Forest(), help="the field")
    plantings: tuple[Planting, ...] = param((), help="species and where they stand")
    stems: tuple[Stems, ...] = param((), help="trees that are cylinders only, for reverb")
    air: Air = param(Air(), help="the air")
    rays: Rays = param(Rays(), help="how rays are cast")
    sensors: tuple[Sensor, ...] = param((), help="what looks at the forest")
    output: Output = param(Output(), help="what is written")

    def check(self) -> None:
        seen: dict[str, int] = {}
        for index, sensor in enumerate(self.sensors):
            name = sensor.name
            if not name or not all(c.isalnum() or c in "-_" for c in name):
                raise SpecError(
                    f"sensors[{index}].name", f'"{name}" must be letters, digits, "-" and "_"'
                )
            if name in seen:
                raise SpecError(
                    f"sensors[{index}].name",
                    f'"{name}" is taken by sensors[{seen[name]}]; give each sensor a name of its own',
                )
            seen[name] = index
