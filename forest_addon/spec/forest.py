"""The field: which species stand where, on which ground."""

from __future__ import annotations

from .base import AUTO, Normal, Settings, SpecError, param, within
from .sensor import azimuth
from .species import Targets

METRES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}


class Gaussian(Settings):
    """One hill of the intensity function: peak·exp(-(x-a)²/h² - (y-b)²/l²) (Tanveer et al. 2020a, squared
    form)."""

    peak: float = param(
        1.0,
        unit="trees/m²",
        help="intensity at the centre, trees per m² where no expected number scales it",
        ge=0,
        le=1e6,
    )
    centre: tuple[float, float] = param(
        unit="m", help="place of the hill's centre", ge=-1e7, le=1e7
    )
    width: tuple[float, float] = param(
        unit="m",
        help="distance from the centre along x and y at which it has fallen to 37 %",
        gt=0,
        le=1e7,
    )


Corners = tuple[tuple[float, float], ...]


def _check_rings(polygon: Corners, holes: tuple[Corners, ...]) -> None:
    if holes and not polygon:
        raise SpecError("holes", "need a polygon around them; give polygon too")
    for key, ring in [("polygon", polygon), *((f"holes[{k}]", h) for k, h in enumerate(holes))]:
        if len(ring) < 3 and (ring or key != "polygon"):
            raise SpecError(key, f"has {len(ring)} corners; give at least 3")


class Raster(Settings):
    """An image, array or map that is part of an intensity function; the first row of an image is north.

    Numbers of a file that says where it lies (GeoTIFF, ASCII grid) count as they are: classes, percent.
    """

    file: str = param(
        help="GeoTIFF, ASCII grid, PNG, TIFF or npy file, relative to the scene file", file=True
    )
    use: str = param(
        "add",
        help="add it to the hills, multiply what there is, or keep trees where it reaches the threshold",
        choices=("add", "multiply", "mask"),
    )
    value: float = param(
        1.0, help="what a pixel of 1 means (white of an image): trees/m², or a factor", ge=0, le=1e6
    )
    threshold: float = param(0.5, help="smallest pixel that a mask keeps", ge=0, le=1e6)
    size: tuple[float, float] | None = param(
        None,
        unit="m",
        help="extent along x and y; left out: as its file says, of an image as the field",
        gt=0,
        le=1e7,
    )
    origin: tuple[float, float] | None = param(
        None,
        unit="m",
        help="corner with the smallest x and y; left out: as its file says less the scene's offset, of an "
        "image the field's",
        ge=-1e7,
        le=1e7,
    )


class Rows(Settings):
    """An orchard: parallel rows of trees (Méndez et al.)."""

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
    heading_deg: float = azimuth(90.0, "direction of a row")
    jitter: float = param(
        0.0,
        unit="m",
        help="spread of each tree about its place along x and y, truncated at twice that",
        ge=0,
        le=1e3,
    )


class Clusters(Settings):
    """Trees in groups: a Neyman-Scott process, of which the planting's intensity is the mean."""

    kind: str = param(
        "thomas",
        help="trees of a group: a normal distribution about its centre, or even within a disc",
        choices=("thomas", "matern"),
    )
    groups: float = param(0.005, unit="1/m²", help="centres of groups", gt=0, le=1e3)
    spread: float = param(
        3.0,
        unit="m",
        help="spread of a group: standard deviation along x and y (Thomas), or radius (Matérn)",
        gt=0,
        le=1e4,
    )


class Strauss(Settings):
    """Trees that keep apart: a Gibbs process of pairs, of which the planting's intensity is the mean."""

    radius: float = param(
        2.0, unit="m", help="distance within which two trees interact", gt=0, le=1e3
    )
    gamma: float = param(
        0.2, help="a near pair is this much rarer than by chance; 0: a hard core", ge=0, le=1
    )


class HandTree(Settings):
    """A tree that somebody has set by hand: it stays where it is whatever is drawn around it.

    What is left out is drawn as of any other tree of its planting.
    """

    position: tuple[float, float] = param(unit="m", help="where it stands", ge=-1e7, le=1e7)
    rotation_deg: float | None = param(
        None, unit="deg", help="turn about the vertical, counter-clockwise", ge=-360, le=360
    )
    scale: float | None = param(
        None, help="size factor; counts where trees are not grown to measure", gt=0, le=100
    )
    diameter: float | None = param(
        None,
        unit="m",
        help="diameter at breast height; counts where trees are grown to measure",
        gt=0,
        le=20,
    )
    variant: int | None = param(
        None, help="which of the planting's variants it is, counted from 0", ge=0, le=999
    )


class Clearing(Settings):
    """A disc on which nothing that a planting draws or lists stands; trees set by hand may."""

    position: tuple[float, float] = param(unit="m", help="centre of the disc", ge=-1e7, le=1e7)
    radius: float = param(0.01, unit="m", help="radius of the disc", gt=0, le=1e5)


class Planting(Settings):
    """One species of the forest and where its trees stand.

    Its intensity is hills + base + rasters and paint that are added, times those that multiply, within
    masks, polygon and limits; nothing to add: the same everywhere.
    """

    species: str = param(help="a species of assets/species, or a species file (.toml)", file=True)
    variants: int = param(3, help="how many different trees are grown and instanced", ge=1, le=1000)
    layout: str = param(
        "poisson",
        help="how places are drawn: at random, in groups, keeping apart, in rows, or from a list",
        choices=("poisson", "clusters", "strauss", "rows", "list"),
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
        help="mean of the intensity over the ground where it may stand (polygons, masks, slope, altitude); "
        "scales it, in place of an expected number",
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
    age: float = param(
        1.0,
        help="age over that of the species as it is written: diameters grow in proportion; of trees grown to "
        "measure that of 1.3 m, and all else as their kind was measured",
        ge=0.2,
        le=3,
    )
    season: float = param(
        0.0,
        help="0: summer; to 0.5 leaves turn their colour, to 1 they fall; evergreens stay at 0",
        ge=0,
        le=1,
    )
    targets: Targets | None = param(
        None, help="what its trees are to measure, in place of the species' own and of scale"
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
    clusters: Clusters = param(Clusters(), help="groups of trees that stand near each other")
    strauss: Strauss = param(Strauss(), help="how trees keep apart")
    rows: Rows = param(Rows(), help="rows of an orchard")
    trees: str = param(
        "",
        help="CSV of trees: x,y on the map, offset included, and any of species, scale, rotation, "
        "dbh, height, crown_width, crown_base (metres), leaf_area",
        file=True,
    )
    collection: str = param(
        "", help="collection of the Blender scene whose objects say where trees stand"
    )
    by_hand: tuple[HandTree, ...] = param(
        (), help="trees set by hand, besides those that are drawn; spacing takes none of them away"
    )
    clearings: tuple[Clearing, ...] = param(
        (), help="discs that are kept free of trees that are drawn or listed"
    )

    def check(self) -> None:
        for key in ("scale", "slope_deg", "altitude"):
            low, high = getattr(self, key)
            if low > high:
                raise SpecError(key, f"{[low, high]} must be [smallest, largest]")
        _check_rings(self.polygon, self.holes)
        if self.expected is not None and self.density is not None:
            raise SpecError("density", "cannot be given beside expected; remove one of them")
        drawn = self.layout in ("poisson", "clusters", "strauss")
        if self.exact and self.layout in ("clusters", "strauss"):
            raise SpecError("exact", f"cannot be used with {self.layout}; remove it")
        known = (
            *(self.gaussians, self.base, self.painted, self.expected is not None),
            *(self.density is not None, *(raster.use == "add" for raster in self.rasters)),
        )
        if drawn and not any(known):
            raise SpecError("expected", "is needed where there are no gaussians; give a number")
        if self.layout == "list" and bool(self.trees) == bool(self.collection):
            raise SpecError("trees", "a list needs a file in trees, or else a collection; give one")


class Distance(Settings):
    """Distance between trees of two plantings, in place of the forest's spacing."""

    species: str = param(help="one of the two species, as the report names it")
    other: str = param(help="the other species; the same name twice: between its own trees")
    distance: float = param(unit="m", help="least distance between trees of the two", ge=0, le=1e5)


class Terrain(Settings):
    """The ground: flat, a heightmap or a triangulated surface."""

    file: str = param(
        "",
        help="heights on the map (GeoTIFF, ASCII grid, xyz, ground of a LAS), a heightmap (PNG, TIFF, npy) "
        "or a surface (STL, OBJ, PLY); neither file nor object: flat",
        file=True,
    )
    object: str = param("", help="mesh object of the Blender scene, in place of a file")
    unit: str = param(
        "auto",
        help="of the heights in a file that says where it lies; auto: what it or its system says, else m",
        choices=("auto", *METRES),
    )
    fill_holes: bool = param(
        False, help="give pixels without a height one that is linear between their neighbours"
    )
    base: float = param(
        0.0, unit="m", help="height where a pixel is 0, or of flat ground", ge=-1e5, le=1e5
    )
    relief: float = param(
        1.0, unit="m", help="height of a pixel of 1 (white of an image) above that", ge=-1e5, le=1e5
    )
    size: tuple[float, float] | None = param(
        None,
        unit="m",
        help="extent of a heightmap; left out: as its file says, of an image as the field",
        gt=0,
        le=1e7,
    )
    origin: tuple[float, float] | None = param(
        None,
        unit="m",
        help="its corner with the smallest x and y; left out: as its file says less the scene's offset, of "
        "an image the field's",
        ge=-1e7,
        le=1e7,
    )

    roughness: float = param(
        AUTO,
        unit="m",
        help="bumps of level ground or a heightmap, of a few decimetres to metres: between the lower and "
        "the higher ground; auto: 0.1 m where undergrowth stands, else 0",
        ge=0,
        le=1,
        auto=True,
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
        (0.0, 0.0), unit="m", help="corner of the field with the smallest x and y", ge=-1e7, le=1e7
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
    undergrowth: str = param(
        "auto",
        help="what stands and lies between the trees; auto: sparse where a scanner or a sonar looks at "
        "measured trees, unless undergrowth is planted",
        choices=("auto", "none", "sparse", "dense"),
    )
    margin: float = param(
        20.0, unit="m", help="how far the ground reaches beyond the field", ge=0, le=1e4
    )
    instancing: str = param(
        "auto",
        help="trees in Blender: objects that can be moved one by one, points of one object that geometry "
        "nodes put trees on (a hundred thousand stay light), or points above 1,000 trees",
        choices=("auto", "objects", "points"),
    )

    def check(self) -> None:
        _check_rings(self.polygon, self.holes)


class Stems(Settings):
    """Trees that are upright cylinders only: reverb hears them, nothing is grown or drawn (Kaneko & Gamper
    2021)."""

    count: int = param(help="how many, evenly at random over the field", ge=0, le=20_000_000)
    radius: Normal = param(Normal(mean=0.25), unit="m", help="radius of each")

    def check(self) -> None:
        within("radius", self.radius, 0, 20, open_low=True)
