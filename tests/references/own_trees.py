"""Trees that our own growers make, as the facets that a user would bring, with their skeleton as truth."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.growth.likeness import axes_of
from forest_addon.growth.own_tree.anatomy import Anatomy, dissect
from forest_addon.growth.own_tree.habit import Habit, fit
from forest_addon.growth.own_tree.recognise import Recognition, recognise
from forest_addon.growth.tree import Tree, grow
from forest_addon.spec import (
    Detail,
    Discrete,
    Honda,
    Leaf,
    Normal,
    Rules,
    Siblings,
    Species,
    Template,
)

WHORL = "".join(
    f"[&({78 + 2 * (k % 3)}-k*2)B({1.65 + 0.05 * (k % 4)}-k*0.13,w*0.33)]/(72)" for k in range(5)
)
WHORLED = Rules(
    axiom="!(0.18)F(0.9)A(1,0.16,0)",
    generations=14,
    productions=(
        f"A(l,w,k) : k<12 -> {WHORL}/(31)!(w*0.92)F(0.5*l)A(l*0.97,w*0.88,k+1)",
        "B(l,w) -> !(w)F(l*0.2)^(4)F(l*0.15)[+(48)C(l*0.42,w*0.5)][-(46)C(l*0.4,w*0.5)]!(w*0.8)^(3)"
        "F(l*0.2)[+(44)C(l*0.33,w*0.45)][-(47)C(l*0.34,w*0.45)]!(w*0.6)^(5)F(l*0.25)D",
        "C(l,w) -> !(w)F(l*0.5)^(5)DF(l*0.3)DF(l*0.2)D",
        "D -> [+(50)~(0.07)][-(50)~(0.07)][&(50)~(0.07)][^(50)~(0.07)]",
    ),
)
MONOPODIAL = Rules(  # ABOP fig. 2.6 with leaves
    axiom="A(1,0.1)",
    constants=("r1 = 0.9", "r2 = 0.65", "a0 = 45", "a2 = 45", "wr = 0.707"),
    generations=9,
    productions=(
        "A(l,w) -> !(w)F(l)[&(a0)B(l*r2,w*wr)]/(137.5)A(l*r1,w*wr)",
        "B(l,w) -> !(w)F(l)[-(a2)$C(l*r2,w*wr)~(0.1)]C(l*r1,w*wr)",
        "C(l,w) -> !(w)F(l)[+(a2)$B(l*r2,w*wr)~(0.1)]B(l*r1,w*wr)",
    ),
)
NARROW = Leaf(shape="needle", width_ratio=Normal(mean=0.2, sd=0.0))
SPECIES = {
    "honda": Species(
        name="honda",
        honda=Honda(
            levels=Discrete(values=(3,)),
            sprouting="along",
            daughters=Discrete(values=(5, 6, 7)),
            trunk_daughters=Discrete(values=(18,)),
            length=Normal(mean=8.0, sd=0.0),
            radius=Normal(mean=0.12, sd=0.0),
            length_ratio=Normal(mean=0.35, sd=0.0),
            radius_ratio=Normal(mean=0.4, sd=0.0),
            cone=0.5,
        ),
    ),
    "weeping": Species(
        name="weeping",
        honda=Honda(
            levels=Discrete(values=(3,)),
            sprouting="along",
            daughters=Discrete(values=(5, 6, 7)),
            trunk_daughters=Discrete(values=(12,)),
            length=Normal(mean=6.0, sd=0.0),
            radius=Normal(mean=0.14, sd=0.0),
            length_ratio=Normal(mean=0.45, sd=0.0),
            radius_ratio=Normal(mean=0.4, sd=0.0),
            angle_deg=Normal(mean=55.0, sd=5.0),
            pieces=8,
            droop=2.5,
            bare=0.4,
        ),
        leaf=Leaf(length=Normal(mean=0.09, sd=0.01), width_ratio=Normal(mean=0.2, sd=0.0)),
    ),
    "whorled": Species(name="whorled", rules=WHORLED, leaf=NARROW),
    "abop": Species(name="abop", rules=MONOPODIAL),
}


@dataclass(frozen=True, eq=False)
class OwnTree:
    """A tree, its facets, and what is made of them."""

    tree: Tree
    wood: np.ndarray
    leaves: np.ndarray
    found: Recognition
    anatomy: Anatomy
    habit: Habit


@cache
def own_tree(name: str) -> OwnTree:
    """One tree of a species, recognised and taken apart."""
    species = SPECIES[name]
    tree = grow(replace(species, detail=Detail(tolerance=0.004)), None, stream(3, "own", name))
    facets = tree.mesh.vertices[tree.mesh.triangles]
    wood, leaves = facets[tree.mesh.part == WOOD], facets[tree.mesh.part == LEAF]
    found = recognise(wood, leaves)
    anatomy = dissect(found)
    return OwnTree(tree, wood, leaves, found, anatomy, fit(anatomy))


def sibling(name: str, seed: int, **siblings: float) -> Tree:
    """A sibling of an own tree."""
    kin = Species(name=name, template=Template(wood="wood.stl"), siblings=Siblings(**siblings))
    return grow(kin, own_tree(name).habit, stream(seed, "sibling", name))


def mothers_of(tree: Tree) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the axes of a skeleton: parent, foot (A, 3) and tip (A, 3)."""
    wood = tree.skeleton
    first, axis = axes_of(wood)
    last = np.zeros(len(first), np.int64)
    last[axis] = np.arange(len(axis))  # the last that is written stays
    parent = wood.parent[first]
    return np.where(parent < 0, -1, axis[parent]), wood.start[first], wood.end[last]
