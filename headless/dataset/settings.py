"""Settings of a plan besides the scene and what varies in it: each key once, with range, default and help."""

from __future__ import annotations

from typing import ClassVar

from forest_addon.spec.base import Settings, SpecError, param
from forest_addon.spec.choices import APPLIES, GIVEN, LEFT_OUT

RULES = ("centre", "corners", "scattered", "path", "over", "pairs")
APPLIES |= {
    **dict.fromkeys(
        ("mix.kinds", "mix.density", "mix.evenness", "mix.variants", "mix.scale"),
        ("species", (GIVEN,)),
    ),
    "redealt": ("species", (LEFT_OUT,)),
    **dict.fromkeys(("ground.wavelength", "ground.roughness", "ground.step"), ("relief", (GIVEN,))),
    "placing.count": ("rule", ("scattered", "path", "pairs")),
    "placing.clear": ("rule", ("centre", "corners", "scattered", "path", "pairs")),
    "placing.apart": ("rule", ("scattered",)),
    "placing.speed": ("rule", ("path",)),
    "placing.distance": ("rule", ("pairs",)),
    "occlusion": ("voxels", (GIVEN,)),
}


class Mix(Settings):
    """Species that a scene draws in place of the base scene's plantings; none: those stay."""

    TITLE: ClassVar[str] = "mix"
    species: tuple[str, ...] = param((), help="species that may be planted", file=True)
    kinds: tuple[int, int] = param((1, 3), help="fewest and most species of a scene", ge=1, le=1000)
    density: float = param(
        0.03, unit="trees/m²", help="of all species together, before spacing", gt=0, le=100
    )
    evenness: float = param(
        1.0,
        help="how alike their shares are: parameter of a Dirichlet distribution, large: all alike",
        gt=0,
        le=1e6,
    )
    variants: int = param(3, help="different trees that are grown of each", ge=1, le=1000)
    scale: tuple[float, float] = param(
        (0.8, 1.2), help="smallest and largest size factor of a tree", gt=0, le=100
    )
    redealt: float = param(
        0.0,
        help="without species: the densities of the scene's own plantings are dealt anew about their shares, "
        "by a Dirichlet distribution of this parameter, large: nearly as written; 0: as written",
        ge=0,
        le=1e6,
    )
    season: float = param(
        0.0,
        help="season of all plantings whose measured kind sheds its leaves; 0: as written, to 1: bare",
        ge=0,
        le=1,
    )


class Ground(Settings):
    """A random ground of each scene's own: a sum of smooth waves in all directions."""

    TITLE: ClassVar[str] = "terrain"
    relief: float = param(
        0.0,
        unit="m",
        help="from the lowest to the highest place; 0: the scene's ground",
        ge=0,
        le=1e4,
    )
    wavelength: float = param(40.0, unit="m", help="length of the longest wave", gt=0, le=1e5)
    roughness: float = param(
        0.4,
        help="height of each shorter wave, of half the length, relative to the one before",
        ge=0,
        le=1,
    )
    step: float = param(1.0, unit="m", help="distance between heights", gt=0, le=1e3)


class Placing(Settings):
    """Place of a sensor by a rule; several places make several sensors NAME-1, NAME-2, ..."""

    TITLE: ClassVar[str] = "place"
    sensor: str = param(help="the name of the sensor in the scene")
    rule: str = param(
        help="at the plot's centre; its corners; scattered; along a random path; flying over all of it; or, "
        "for a reverb, in pairs of source and receiver",
        choices=RULES,
    )
    count: int = param(
        1, help="positions (scattered), poses of a sonar (path), or pairs", ge=1, le=100000
    )
    height: float = param(1.6, unit="m", help="above the ground", ge=-1e3, le=1e5)
    clear: float = param(0.8, unit="m", help="kept from the axis of every trunk", ge=0, le=1e3)
    apart: float = param(
        2.0, unit="m", help="kept between scattered positions, if there is room", ge=0, le=1e4
    )
    inset: float = param(
        2.0,
        unit="m",
        help="kept from the edge of the field; negative: outside of it",
        ge=-1e4,
        le=1e4,
    )
    speed: float = param(1.2, unit="m/s", help="along a path", gt=0, le=1e3)
    distance: float = param(10.0, unit="m", help="from source to receiver of a pair", gt=0, le=1e4)


class Splits(Settings):
    """Shares of scenes for training, validation and test."""

    TITLE: ClassVar[str] = "splits"
    train: float = param(0.7, help="share of the scenes", ge=0, le=1)
    validation: float = param(0.15, help="share of the scenes", ge=0, le=1)
    test: float = param(0.15, help="share of the scenes", ge=0, le=1)
    by: str = param(
        "scene",
        help="what is dealt to the splits: scenes, species of the mix (no split knows another's), or base "
        "scenes (sites)",
        choices=("scene", "species", "site"),
    )
    share_trees: bool = param(False, help="a library of trees may be the same one in all splits")

    def check(self) -> None:
        if abs(self.train + self.validation + self.test - 1) > 1e-9:
            raise SpecError("train", "must add up to 1 with validation and test")


class Keep(Settings):
    """Files written of each scene, besides the sensors' results and trees.csv."""

    TITLE: ClassVar[str] = "keep"
    clouds: str = param(
        "laz",
        help="point clouds as LAZ with labels as extra bytes, as NPZ that numpy alone reads, or both",
        choices=("laz", "npz", "both"),
    )
    cylinders: bool = param(True, help="cylinders.csv, all branches of all trees")
    voxels: float = param(
        0.5, unit="m", help="edge of the cells of voxels.npz; 0: none", ge=0, le=1000
    )
    occlusion: int = param(
        16,
        help="of every how many pulses occlusion is counted, in the same cells; 0: none",
        ge=0,
        le=1000000,
    )
    hidden: int = param(
        256,
        help="of every how many pulses all trees on their line are listed, seen or not; 0: none",
        ge=0,
        le=1000000,
    )
    empty: bool = param(
        False,
        help="a scene without a tree and a result without a point or an echo may be part of the dataset; "
        "else the check fails on them, and a flight above its scanner's range is refused",
    )
    for_instance: bool = param(
        False,
        help="clouds also as NAME-forinstance.laz, with the classes and field names of FOR-instance",
    )
    leaves: bool = param(False, help="leaves.npz, the truth of every leaf")
    blend: bool = param(False, help="forest.blend")
    glb: bool = param(False, help="forest.glb")
    preview: bool = param(
        False,
        help="preview.png, a render by Cycles, and preview-segments.png: class and tree of each pixel",
    )


class Running(Settings):
    """Running of scenes; results do not depend on it."""

    TITLE: ClassVar[str] = "run"
    timeout: float = param(
        3600.0, unit="s", help="a scene that takes longer is ended", gt=0, le=1e7
    )
    memory_gb: float = param(
        0.0,
        unit="GB",
        help="a Blender that needs more is ended; 0: its share of 90 % of the machine's memory",
        ge=0,
        le=1e6,
    )
    renew_after: int = param(
        200, help="scenes after which a Blender is started anew", ge=1, le=10**9
    )
    renew_grown_gb: float = param(
        1.0,
        unit="GB",
        help="growth since its first scene after which it is started anew",
        gt=0,
        le=1e6,
    )


class Head(Settings):
    """The keys of a plan that stand outside its tables."""

    TITLE: ClassVar[str] = "plan"
    name: str = param("dataset", help="title of the dataset")
    seed: int = param(0, help="one seed for the whole dataset", ge=0, le=2**63 - 1)
    count: int = param(
        0, help="how many scenes; 0: one for each cell of the grid", ge=0, le=10_000_000
    )
    licence: str = param("not chosen", help="licence of the dataset, for its card")
    trees: str = param(
        "own",
        help='"own": every scene grows trees of its own; "shared library of 200": so many trees of each '
        "species, from which every scene of a split draws",
    )

    randomise: str = param(
        "none",
        help="what varies by itself: nothing, or (measured) instrument, noise, threshold, resolution, "
        "undergrowth, relief, density, species, wind and season, within the ranges of docs/dataset.md; "
        "[vary] goes over it",
        choices=("none", "measured"),
    )

    @property
    def library(self) -> int:
        """Trees of each species that a split shares; 0: every scene grows its own."""
        return 0 if self.trees == "own" else int(self.trees.removeprefix("shared library of "))

    def check(self) -> None:
        number = self.trees.removeprefix("shared library of ")
        known = self.trees == "own" or (number != self.trees and number.isdigit() and int(number))
        if not known or (len(number) > 3 and self.trees != "own" and int(number) > 1000):
            raise SpecError(
                "trees",
                f'"{self.trees}" is neither "own" nor "shared library of N" with N from 1 to 1000',
            )
