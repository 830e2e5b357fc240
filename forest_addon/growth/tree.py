"""One tree: grown to the last twig as a skeleton, or grafted from templates (Tanveer et al. 2020a).

A species without a template is a skeleton with leaf sites, of which meshes are made. With one, either a
grammar fitted to that tree makes siblings of it out of its own pieces (``own_tree.sibling``), or Tanveer et
al.'s L-system gives trunk and first-level nodes, templates give the branches: the trunk is a tube along
the skeleton's axis of order 0; at every node where an axis of order 1 leaves it, and at the trunk's tip, a
branch template is grafted whose length is that of the whole axis. With as many templates as nodes they
match one to one, from the lowest up; otherwise they are drawn.

Trees grow old and lose their leaves. Stems and branches keep elastic similarity (McMahon, T. 1973. Size and
shape in biology. Science 179, 1201): their lengths go with the power 2/3 of their diameters, which grow in
proportion to age. With each halving of its age a tree that is branched by rules has one generation fewer.
Trees of templates keep what their allometry says (``own_tree.habit``); of trees that are grown to measure the
stand has the diameters (``stand.measured``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..base.rng import child_keys, truncated_normal
from ..base.trimesh import DEAD, LEAF, WOOD, TriMesh, join
from ..spec import Discrete, Normal, Siblings, Species
from .draw import draw_inclination
from .lsystem.branching import interpret, skeleton_of, string_of
from .measured.allometry import Kind, Wanted, one_tree
from .measured.crown import scaled_to, with_dead
from .measured.curves import curved
from .measured.meet import Parts, grow_measured, lowest_kept, reshaped
from .mesh.blades import (
    Blade,
    coarse_shoot,
    facings,
    lay,
    leaf_areas,
    leaf_blade,
    shoot_of,
    thin_leaves,
    truth_of,
)
from .mesh.leaves import Leaves, about_vertical, incline_leaves, incline_sites
from .mesh.meshing import SMALLEST, Relief, mesh_wood, repeated_edges, sides_for, tube
from .own_tree.habit import Habit
from .own_tree.relay import mesh_of, skeleton_of_grown
from .own_tree.sibling import grow_sibling
from .own_tree.template import GraftSite, TreeTemplate, graft
from .skeleton import Axes, Skeleton, branch_feet, find_axes, first_level

TOLERANCE = 0.002  # metres between a trunk's polygon and its circle
FEWEST = 7  # blades of a shoot
SUNK = 0.15  # metres the trunk goes on below the ground, so that no gap shows
ROOTS = 4.5  # how far roots stand out of a stem in relief, over how much wider its foot is


@dataclass(frozen=True)
class Tree:
    """A grown tree, foot at the origin, z up.

    mesh : wood in material slot 0, leaves in slot 1.
    leaves : the truth of its leaves; ``branch`` counts the first-level branches, -1 on the trunk.
    skeleton : all of its wood; of one that is grafted by Tanveer et al.'s grammar, trunk and first-level
        axes.
    grafted : whether its branches come from templates, so that the mesh knows more than the skeleton.
    wanted : what it was to measure, None where nothing was said. missed : what of that could not be.
    relief : of its bark, None where stems are round.
    """

    mesh: TriMesh
    leaves: Leaves
    skeleton: Skeleton
    grafted: bool = True
    wanted: Wanted | None = None
    missed: tuple[str, ...] = ()
    relief: Relief | None = None

    @cached_property
    def height(self) -> float:
        """Metres from the ground to the highest point."""
        return float(self.mesh.vertices[:, 2].max(initial=0.0))

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays."""
        parts = (self.mesh, self.leaves, self.skeleton)
        arrays = [value for part in parts for value in vars(part).values()]
        return sum(value.nbytes for value in arrays if isinstance(value, np.ndarray))


def grow(
    species: Species,
    template: TreeTemplate | Habit | Kind | Blade | None,
    rng: np.random.Generator,
    wanted: Wanted | None = None,
) -> Tree:
    """Grow one tree of a species from its random stream.

    template : its branches, or the grammar fitted to them; for a species without, its allometry, its own
    leaf or None. wanted : what the tree is to measure, in place of what its species says.

    Raises
    ------
    SpecError : what it is to measure cannot be.
    """
    if isinstance(template, Habit | TreeTemplate):
        asked, siblings = species, species.siblings or Siblings()
        if wanted and species.siblings is not None:
            siblings = siblings.changed(age=1.0, height=wanted.height, dbh=wanted.dbh)
            asked = species.changed(siblings=siblings)
        if isinstance(template, Habit):
            grown = grow_sibling(template, siblings, int(rng.integers(2**63)))
            mesh, leaves, foot = mesh_of(template.anatomy, grown, siblings.variety)
            parts = Parts(mesh, leaves, foot, skeleton_of_grown(grown))
            tree = _of_parts(asked, parts, rng, wanted)
        else:
            tree = _grafted(asked, template, rng, wanted)
        return tree if species.detail.leaves else without_leaves(tree)
    kind = template if isinstance(template, Kind) else Kind(None, template)
    if wanted is None and species.targets is not None:
        wanted = one_tree(species.targets, kind.allometry, species.name, rng)
    return _whole(species, blade_of(species, kind.blade), rng, wanted)


def without_leaves(tree: Tree) -> Tree:
    """The same tree, bare."""
    return replace(tree, mesh=tree.mesh.select(tree.mesh.part != LEAF), leaves=Leaves.none())


def wood_of(skeleton: Skeleton, tolerance: float, relief: Relief | None = None) -> TriMesh:
    """Mesh a skeleton's wood; dead branches have the part ``DEAD``, and no bark."""
    dead = skeleton.is_dead
    if not dead.any():
        return mesh_wood(skeleton, tolerance, sunk=SUNK, relief=relief)
    gone = mesh_wood(skeleton.some(dead), tolerance, sunk=SUNK if dead.all() else 0.0)
    gone = replace(gone, part=np.full_like(gone.part, DEAD))
    return gone if dead.all() else join([wood_of(skeleton.some(~dead), tolerance, relief), gone])


def with_tolerance(tree: Tree, tolerance: float) -> Tree:
    """The same tree, whose wood is all in its skeleton, meshed to another tolerance."""
    wood = wood_of(tree.skeleton, tolerance, tree.relief)
    return replace(tree, mesh=join([wood, tree.mesh.select(tree.mesh.part == LEAF)]))


def blade_of(species: Species, own: Blade | None) -> Blade:
    """The leaf of a species: its own, a shoot of needles, or a shape."""
    needles = species.needles
    if own is None and needles is not None:
        length, blades = species.leaf.length.mean, blades_left(species)
        fewer = blades < (needles.blades or needles.count)
        return coarse_shoot(needles, length, blades) if fewer else shoot_of(needles, length)
    return own or leaf_blade(species.leaf, species.detail.tolerance)


def has_curves(species: Species) -> bool:
    """Tell whether the limbs of a species are smooth curves: as it says, else those that fill a crown."""
    limbs = species.detail.limbs
    return species.crown is not None if limbs == "auto" else limbs == "curves"


def blades_left(species: Species) -> int:
    """Blades of a shoot that the level of detail leaves: first these become fewer, then the shoots."""
    all_of_them = species.needles.blades or species.needles.count if species.needles else 1
    share = species.detail.leaves
    return all_of_them if share == 1 else min(all_of_them, max(FEWEST, round(share * all_of_them)))


def leaves_left(species: Species) -> float:
    """The share of leaves, or of shoots, that the level of detail leaves."""
    needles, share = species.needles, species.detail.leaves
    if needles is None or share == 1:
        return share
    return min(1.0, share * (needles.blades or needles.count) / blades_left(species))


def _of_parts(
    species: Species, parts: Parts, rng: np.random.Generator, wanted: Wanted | None
) -> Tree:
    """A tree of a template's parts, brought to its targets where it has some."""
    missed: tuple[str, ...] = ()
    if wanted is not None:
        parts, missed = reshaped(parts, wanted, int(rng.integers(2**63)), species.name)
    mesh, leaves = parts.mesh, parts.leaves
    if species.inclination is not None and len(leaves):
        angle = draw_inclination(species.inclination, _leaf_keys(len(leaves), rng))
        mesh, leaves = incline_leaves(mesh, leaves, parts.foot, angle)
    return Tree(mesh, leaves, parts.skeleton, wanted=wanted, missed=missed)


def _whole(
    species: Species, blade: Blade, rng: np.random.Generator, wanted: Wanted | None = None
) -> Tree:
    """A tree whose wood is all in its skeleton."""
    missed: tuple[str, ...] = ()
    if wanted is None:
        skeleton, sites = skeleton_of(species, rng)
    else:
        skeleton, sites, missed = grow_measured(species, wanted, blade, rng)
    if has_curves(species):
        skeleton, sites = curved(skeleton, sites, species.crown.collar if species.crown else 0.0)
        skeleton = skeleton if wanted is None else scaled_to(skeleton, wanted.dbh)
    if species.architecture is not None and wanted is not None:
        key = rng.integers(2**63, size=1).astype(np.uint64)
        skeleton = with_dead(skeleton, species.architecture, wanted, key)
    if species.inclination is not None and len(sites):
        angle = draw_inclination(species.inclination, _leaf_keys(len(sites), rng))
        sites = incline_sites(sites, angle, facings(sites, blade))
    left = leaves_left(species)
    area = leaf_areas(sites, blade) if blade.by_facets and left < 1 else None
    sites = thin_leaves(sites, left, rng, blade.middle[0], area) if left else sites.none()
    bearer = np.maximum(sites.segment, 0)
    known = sites.segment >= 0
    branch = np.where(known, first_level(skeleton)[bearer], -1) if len(sites) else sites.segment
    order = np.where(known, skeleton.order[bearer], 0) if len(sites) else sites.segment
    if species.dead:
        skeleton = replace(skeleton, dead=np.ones(len(skeleton), dtype=bool))
    bark, relief = species.bark, None
    if species.detail.relief and (bark.relief or bark.ovality):
        texture = (bark.texture, max(bark.size, SMALLEST), bark.relief, bark.ovality)
        roots = ROOTS * species.crown.flare if species.crown else 0.0
        relief = Relief(*texture, bark.upper_from, int(rng.integers(2**63)), roots)
    wood = wood_of(skeleton, species.detail.tolerance, relief)
    mesh = lay(sites, blade, order=order, wood=wood)
    leaves = truth_of(sites, blade, branch)
    return Tree(mesh, leaves, skeleton, grafted=False, wanted=wanted, missed=missed, relief=relief)


def _grafted(
    species: Species, template: TreeTemplate, rng: np.random.Generator, wanted: Wanted | None
) -> Tree:
    """A tree of a trunk and branch templates."""
    symbols = string_of(species.grammar)
    skeleton = interpret(symbols, species.grammar, species.jitter, rng)
    axes = find_axes(skeleton)
    trunk = axes.chain(0)
    sites = _sites(skeleton, axes, species, rng)
    scions = template.branches
    one_each = len(sites) == len(scions)
    chosen = np.arange(len(sites)) if one_each else rng.integers(len(scions), size=len(sites))
    roll = np.deg2rad(15.0) * truncated_normal(rng, len(sites))
    branches, truths, feet = [], [], []
    for number, (pick, site, turn) in enumerate(zip(chosen, sites, roll, strict=True)):
        branch, truth, foot = graft(scions[pick], site, species.jitter.leaf_size, turn, rng)
        branches.append(branch)
        feet.append(foot)
        truths.append(replace(truth, branch=np.full(len(truth), number, dtype=np.int32)))
    kept, wood = list(range(len(sites))), skeleton.some(skeleton.order <= 1)
    if wanted is not None:
        start = np.array([site.foot[2] for site in sites])
        leaf = np.array([truth.centre[:, 2].min(initial=np.inf) for truth in truths])
        top = max(float(branch.vertices[:, 2].max()) for branch in branches)
        lowest = lowest_kept(start, leaf, top, wanted)
        kept, level = np.flatnonzero(start >= lowest).tolist(), first_level(wood)
        wood = wood.some((level < 0) | (wood.start[branch_feet(wood), 2][level] >= lowest))
    mesh = join([_trunk_mesh(skeleton, trunk), *(branches[k] for k in kept)])
    leaves, foot = Leaves.joined([truths[k] for k in kept]), np.concatenate([feet[k] for k in kept])
    parts = Parts(mesh, leaves, foot, wood)
    return _of_parts(species, parts, rng, wanted)


def _leaf_keys(count: int, rng: np.random.Generator) -> np.ndarray:
    """A key for each leaf of a tree."""
    own = np.full(count, rng.integers(2**63), np.uint64)
    return child_keys(own, np.arange(count))


def _sites(
    skeleton: Skeleton, axes: Axes, species: Species, rng: np.random.Generator
) -> list[GraftSite]:
    """Foot, direction and length of every first-level branch, from the lowest up, then the tip."""
    length, trunk = skeleton.length, axes.chain(0).tolist()
    onward = dict(pairwise(trunk))
    sites: list[GraftSite] = []
    for first in branch_feet(skeleton):
        reach = float(length[axes.chain(first)].sum())
        direction = skeleton.end[first] - skeleton.start[first]
        direction /= np.linalg.norm(direction)
        node = onward.get(int(skeleton.parent[first]))
        for copy in range(species.grammar.copies):
            foot = skeleton.start[first]
            if node is not None and copy:  # a further copy: turned about the trunk, and raised
                axis = skeleton.end[node] - skeleton.start[node]
                foot = foot + axis * copy / species.grammar.copies * (1 - rng.random() * 0.3)
            turn = np.pi * (copy / species.grammar.copies)  # two copies stand at 90°
            way = about_vertical(direction[None], np.cos(turn), np.sin(turn))[0]
            sites.append(GraftSite(foot, way, reach))
    sites.sort(key=lambda site: float(site.foot[2]))
    tip = trunk[-1]
    upward = skeleton.end[tip] - skeleton.start[tip]
    upward_length = float(np.linalg.norm(upward))
    sites.append(GraftSite(skeleton.start[tip], upward / upward_length, 1.5 * upward_length))
    return sites


def _trunk_mesh(skeleton: Skeleton, trunk: np.ndarray) -> TriMesh:
    """The trunk as one tube, smooth through the nodes, with a flare at the foot."""
    from scipy.interpolate import PchipInterpolator

    nodes = np.concatenate([skeleton.start[trunk], skeleton.end[trunk[-1:]]])
    radius = np.concatenate([skeleton.radius[trunk, 0], skeleton.radius[trunk[-1:], 1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])
    fine = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(along)]))
    fine = np.unique(np.concatenate([fine, radius[0] * np.array([0.5, 1.0, 2.0, 4.0])]))
    fine = fine[fine <= along[-1]]
    points = np.asarray(PchipInterpolator(along, nodes)(fine))
    thickness = np.interp(fine, along, radius)
    thickness *= 1 + 0.35 * np.exp(-fine / (1.5 * radius[0]))  # root flare
    points = np.concatenate([points[:1] - [[0.0, 0.0, SUNK]], points])
    thickness = np.concatenate([thickness[:1] * 1.1, thickness])
    vertices, triangles = tube(points, thickness, sides_for(float(radius[0]), TOLERANCE))
    mesh = TriMesh.of_part(vertices, triangles, WOOD)
    return replace(mesh, edges=repeated_edges(mesh.triangles, 0, 1))


ELASTIC = 2 / 3  # power of a diameter that a length goes with
TURNED = 0.5  # season at which all leaves have turned and begin to fall
OLDEST = (0.2, 3.0)  # of what a template's tree can be made


def aged(species: Species, age: float) -> Species:
    """The species at so many times its age; one that is grown to measure is left as it is."""
    if age == 1 or species.targets is not None:
        return species
    long, fewer = age**ELASTIC, min(0, round(math.log2(age)))
    if species.siblings is not None:
        own = species.siblings
        if own.height or own.dbh:
            return species.changed(
                siblings=own.changed(height=own.height * long, dbh=own.dbh * age)
            )
        older = min(max(own.age * age, OLDEST[0]), OLDEST[1])
        return species.changed(siblings=own.changed(age=older))
    if species.rules is not None:
        rules = species.rules
        generations = max(1, rules.generations + fewer)
        return species.changed(
            rules=rules.changed(scale=rules.scale * long, generations=generations)
        )
    if species.honda is not None:
        honda = species.honda
        levels = tuple(max(1, level + fewer) for level in honda.levels.values)
        return species.changed(
            honda=honda.changed(
                levels=Discrete(values=levels, weights=honda.levels.weights),
                length=_times(honda.length, long),
                radius=_times(honda.radius, age),
            )
        )
    own_rules = species.grammar
    return species.changed(
        grammar=own_rules.changed(
            length=own_rules.length * long,
            radius=own_rules.radius * age,
            generations=max(1, own_rules.generations + fewer),
        )
    )


def in_season(species: Species, season: float) -> Species:
    """The species with its leaves turned as they are in a season, 0 summer to 1 winter."""
    turned = max(species.look.autumn, min(1.0, season / TURNED))
    return species if not season else species.changed(look=species.look.changed(autumn=turned))


def fallen(season: float) -> float:
    """Share of the leaves that lies on the ground in a season."""
    return max(0.0, (season - TURNED) / (1 - TURNED))


def with_fallen(tree: Tree, share: float, rng: np.random.Generator) -> Tree:
    """The tree without this share of its leaves; one that has fallen is also gone at a larger share."""
    if share <= 0 or not len(tree.leaves):
        return tree
    if share >= 1:
        return without_leaves(tree)
    stays = rng.random(len(tree.leaves)) >= share
    mesh = tree.mesh
    stays_there = np.ones(len(mesh.leaf), dtype=bool)
    of_leaf = (mesh.part == LEAF) & (mesh.leaf >= 0)
    stays_there[of_leaf] = stays[mesh.leaf[of_leaf]]
    left = mesh.select(stays_there)
    number = np.cumsum(stays) - 1
    leaf = np.where(left.leaf >= 0, number[left.leaf], -1).astype(left.leaf.dtype)
    kept = tree.leaves.select(stays)
    return replace(tree, mesh=replace(left, leaf=leaf), leaves=kept)


def _times(spread: Normal, factor: float) -> Normal:
    said = {"mean": spread.mean, "sd": spread.sd, "low": spread.low, "high": spread.high}
    return Normal(**{name: v if v is None else v * factor for name, v in said.items()})
