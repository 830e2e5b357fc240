"""Leaves for a template tree that has none: set on its outermost branches, as facets like an STL file's.

A piece of wood that bears no other is a twig. Along its outer part stand ``leaf.nodes`` nodes of
``leaf.per_node`` leaves each, turned from node to node by ``leaf.fan_deg``, the last at the tip (Tanveer
et al. 2020a's growing tips). What comes out goes the way of a user's own leaves: recognised, measured and
grafted.
"""

from __future__ import annotations

import numpy as np

from ...base.rng import daughter_keys
from ...spec import Leaf
from ..mesh.blades import Blade, lay
from ..mesh.foliage import across, set_leaves
from ..recognise.recognise import recognise

BARE = 0.25  # share of a twig, from its foot, that bears no leaves
KEY = 0x1EAF  # every draw is keyed by twig and leaf below this


def dress(wood: np.ndarray, leaf: Leaf, blade: Blade, unit: float) -> np.ndarray:
    """(T, 3, 3) facets of leaves for the wood's facets (T, 3, 3), in the wood's own units.

    unit : metres per unit of the wood.

    Raises
    ------
    TemplateError : there is no trunk with branches in the wood.
    """
    found = recognise(wood)
    bears = np.zeros(len(found.parent), dtype=bool)
    bears[found.parent[found.parent >= 0]] = True
    bears[found.trunk] = True
    share = np.linspace(BARE, 1.0, leaf.nodes)
    feet, headings, twigs = [], [], np.flatnonzero(~bears)
    for twig in twigs:
        knots = slice(found.lines.first[twig], found.lines.first[twig + 1])
        knot, along = found.lines.knot[knots], found.lines.along[knots]
        backwards = found.hierarchy.foot_end[twig] == 1
        place = along[-1] * (1.0 - share if backwards else share)
        feet.append(np.stack([np.interp(place, along, axis) for axis in knot.T], axis=1))
        step = np.diff(knot, axis=0)
        of_step = np.clip(np.searchsorted(along, place, side="right") - 1, 0, len(step) - 1)
        heading = step[of_step] * (-1.0 if backwards else 1.0)
        headings.append(heading / np.linalg.norm(heading, axis=1, keepdims=True))

    each = leaf.nodes * leaf.per_node
    node, rank = np.divmod(np.tile(np.arange(each), len(twigs)), leaf.per_node)
    rows = np.repeat(np.arange(len(twigs) * leaf.nodes), leaf.per_node)
    foot, heading = np.concatenate(feet)[rows] * unit, np.concatenate(headings)[rows]
    azimuth = 2 * np.pi * rank / leaf.per_node + np.deg2rad(leaf.fan_deg) * node
    keys = daughter_keys(np.full(len(rows), KEY, np.uint64), np.repeat(twigs, each))
    keys = daughter_keys(keys, np.tile(np.arange(each), len(twigs)))
    sites = set_leaves(leaf, keys, foot, heading, across(heading), azimuth, np.repeat(twigs, each))
    mesh = lay(sites, blade)
    facets: np.ndarray = mesh.vertices[mesh.triangles] / unit
    return facets
