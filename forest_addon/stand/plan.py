"""The plan of a forest: which tree stands where, how large, which variant, turned how.

Every species has its own streams, keyed by its name, so adding a species moves no tree of another. Each
purpose (place, age, turn, size, variant) draws from its own stream in the order of the trees, so tree 7
is the same tree whether 10 or 10,000 are planted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..rng import stream
from ..spec import Forest, Planting
from .intensity import intensity_of
from .poisson import sample
from .spacing import matern_ii


@dataclass(frozen=True)
class Stand:
    """N trees.

    position : (N, 3) metres. rotation : (N,) radians about the vertical. scale : (N,).
    species : (N,) int64, number of the planting. variant : (N,) int64. id : (N,) int64, from 0.
    removed : trees that spacing took away.
    """

    position: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray
    species: np.ndarray
    variant: np.ndarray
    id: np.ndarray
    removed: int

    def __len__(self) -> int:
        return len(self.id)


def plan_stand(seed: int, forest: Forest, plantings: Sequence[Planting]) -> Stand:
    """Sample every species, merge them, keep the spacing.

    Raises
    ------
    ValueError : an intensity that cannot be scaled, or asks for too many trees.
    """
    columns = [
        _plant(seed, number, label, planting, forest)
        for number, (label, planting) in enumerate(zip(labels(plantings), plantings, strict=True))
    ]
    points, mark, rotation, scale, species, variant = (
        np.concatenate([column[k] for column in columns]) if columns else empty
        for k, empty in enumerate(
            [np.empty((0, 2)), *[np.empty(0)] * 3, *[np.empty(0, dtype=np.int64)] * 2]
        )
    )
    keep = matern_ii(points, mark, forest.spacing)
    return Stand(
        position=np.column_stack([points[keep], np.zeros(int(keep.sum()))]),
        rotation=rotation[keep],
        scale=scale[keep],
        species=species[keep],
        variant=variant[keep],
        id=np.arange(int(keep.sum())),
        removed=int((~keep).sum()),
    )


def labels(plantings: Sequence[Planting]) -> list[str]:
    """A name of its own for every planting: the species, numbered where one comes twice."""
    names: list[str] = []
    for planting in plantings:
        base = planting.species.replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")
        taken = sum(name == base or name.startswith(base + "-") for name in names)
        names.append(base if not taken else f"{base}-{taken + 1}")
    return names


def _plant(
    seed: int, number: int, label: str, planting: Planting, forest: Forest
) -> tuple[np.ndarray, ...]:
    points = sample(intensity_of(planting, forest), stream(seed, "stand", label, "place"))
    count = len(points)
    low, high = planting.scale

    def draw(purpose: str) -> np.ndarray:
        return stream(seed, "stand", label, purpose).random(count)

    return (
        points,
        draw("age"),
        2 * np.pi * draw("turn"),
        low * (high / low) ** draw("size"),
        np.full(count, number, dtype=np.int64),
        (draw("variant") * planting.variants).astype(np.int64),
    )
