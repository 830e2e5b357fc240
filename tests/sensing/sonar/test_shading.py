"""Shading: Beer-Lambert through leaves by rays, trunks as hard edges, both."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.echo_scenes import scene_of, square_leaves
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import WOOD, TriMesh, join
from forest_addon.sensing.sonar.ping import Echo, ping
from forest_addon.sensing.sonar.shading import CELL, Extinction
from forest_addon.sensing.sonar.station import Equipment, Station, posed
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)


def haze(count: int, side: float, seed: int = 0, facing: bool = False) -> TriMesh:
    """Leaves at random in a box 2 to 3 m ahead, 1.2 m wide."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform([2, -0.6, -0.6], [3, 0.6, 0.6], (count, 3))
    normal = np.tile([1.0, 0, 0], (count, 1)) if facing else rng.normal(size=(count, 3))
    return square_leaves(centre, normal, side, seed)


def depths(mesh: TriMesh, distance: float, spread: int = 9) -> np.ndarray:
    sonar = Sonar(position=(0, 0, 0))
    station = Station(sonar, AIR, posed(sonar), Equipment.of(sonar))
    angles = (np.arange(spread) - spread // 2) * CELL / 2
    az, el = (grid.ravel() for grid in np.meshgrid(angles, angles))
    caster = BruteCaster(scene_of(mesh))
    far = np.full(len(az), distance - 1e-3)
    return -np.log(Extinction(caster, station).transmission(np.stack([az, el]), far))


@pytest.mark.slow
@pytest.mark.parametrize(("facing", "g"), [(True, 1.0), (False, 0.5)])
def test_optical_depth_is_projected_leaf_area_on_the_way(facing: bool, g: float) -> None:
    """τ = G·u·s: 1 for leaves face-on, ½ for leaves any way round; within four standard errors."""
    count, side = 2000, 0.05
    density = count * side**2 / 1.2**2  # leaf area over the area of the box, along x
    found = depths(haze(count, side, facing=facing), 4.0, spread=7)
    error = 4 * math.sqrt(g * density / (49 * 16 / 4))
    assert found.mean() == pytest.approx(g * density, abs=error)


@pytest.mark.slow
def test_depth_grows_along_the_way_and_starts_at_nothing() -> None:
    mesh = haze(1500, 0.06)
    assert not depths(mesh, 1.9).any()
    steps = [depths(mesh, r, spread=5).mean() for r in (2.0, 2.3, 2.6, 3.2)]
    assert steps == sorted(steps)
    assert steps[0] == 0
    assert steps[2] == pytest.approx(0.6 * steps[3], rel=0.2)


@pytest.mark.medium
def test_two_ways_weaken_the_pressure_by_the_depth() -> None:
    """A target behind a wall of leaves: e^{-τ}, and nothing is lost in front of it."""
    screen = haze(800, 0.05, facing=True)
    target = square_leaves(
        np.array([[4.0, 0, 0], [1.5, 0.3, 0]]), np.array([[1.0, 0, 0]] * 2), 0.05
    )
    targets = EchoTargets(scene_of(join([screen, target])))
    caster = BruteCaster(targets.scene)
    settings = {"position": (0, 0, 0), "cull": 0.0}
    clear = ping(targets, Sonar(shading="none", **settings), AIR)
    dim = ping(targets, Sonar(shading="extinction", **settings), AIR, everything=caster)

    def size(echo, leaf):
        return float(echo.heard.amplitude[echo.heard.number == leaf].sum())

    assert size(dim, 801) == pytest.approx(size(clear, 801), rel=1e-9)
    depth = -math.log(size(dim, 800) / size(clear, 800))
    assert depth == pytest.approx(depths(screen, 4.0, spread=1)[0], rel=1e-3)
    with pytest.raises(ValueError, match="needs rays"):
        ping(targets, Sonar(shading="extinction", **settings), AIR)


@pytest.mark.medium
def test_trunks_and_leaves_together() -> None:
    board = TriMesh.of_part(
        np.array([(3.5, -5, -5), (3.5, 0, -5), (3.5, 0, 9), (3.5, -5, 9)], np.float64),
        np.array([[0, 1, 2], [0, 2, 3]]),
        WOOD,
    )
    behind = square_leaves(
        np.array([[4.0, 0.2, 0], [4.0, -0.2, 0]]), np.array([[1.0, 0, 0]] * 2), 0.05
    )
    mesh = join([board, haze(800, 0.05, facing=True), behind])
    targets = EchoTargets(scene_of(mesh))
    everything, wood = BruteCaster(targets.scene), BruteCaster(targets.scene.solid())
    settings = {"position": (0, 0, 0), "cull": 0.0, "wood": False}
    both = ping(
        targets, Sonar(shading="trunks+extinction", **settings), AIR, wood, everything=everything
    )
    assert both.hidden == 1
    leaf = {int(n): a for n, a in zip(both.heard.number, both.heard.amplitude, strict=True)}
    assert 801 not in leaf
    clear = ping(targets, Sonar(shading="none", **settings), AIR)
    whole = {int(n): a for n, a in zip(clear.heard.number, clear.heard.amplitude, strict=True)}
    assert leaf[800] < 0.9 * whole[800]


def pinged(targets: EchoTargets, **settings: object) -> Echo:
    base = {"position": (0, 0, 0), "wood": False, "shading": "extinction", "tolerance": 0.0}
    return ping(targets, Sonar(**{**base, **settings}), AIR, everything=BruteCaster(targets.scene))


@pytest.mark.slow
def test_culling_keeps_its_promise_behind_a_thicket() -> None:
    """Loud leaves behind a dense screen; what is left out is weak only until they are shaded."""
    rng = np.random.default_rng(4)
    screen_at = rng.uniform([2, -0.3, -0.3], [2.5, 0.3, 0.3], (120, 3))
    loud_at = rng.uniform([4, -0.2, -0.2], [5, 0.2, 0.2], (20, 3))
    faint_at = rng.uniform([2.5, 0.9, -0.3], [3, 1.2, 0.3], (150, 3))  # beside it, off the beam
    ahead = np.array([[1.0, 0, 0]])
    mesh = join(
        [
            square_leaves(screen_at, ahead + np.zeros((120, 1)), 0.1),
            square_leaves(loud_at, ahead + np.zeros((20, 1)), 0.1),
            square_leaves(faint_at, rng.normal(size=(150, 3)), 0.03),
        ]
    )
    targets = EchoTargets(scene_of(mesh))
    beam = {"beam_width_deg": (25.0, 25.0)}
    whole = pinged(targets, cull=0.0, **beam)
    for cull in (1e-2, 0.1):
        part = pinged(targets, cull=cull, **beam)
        assert len(part.heard) < len(whole.heard)
        heard = float(part.heard.amplitude.sum())
        assert 0 < part.cull_bound <= cull
        assert whole.heard.amplitude.sum() - heard <= part.cull_bound * heard


@pytest.mark.parametrize(("side", "passes"), [(0.02, (0.5, 1.0)), (0.6, (0.0, 1e-3))])
def test_a_leaf_larger_than_the_fresnel_zone_casts_a_shadow(side: float, passes) -> None:
    """Half way to a leaf at 4 m the zone's radius is 7 cm: leaves of 1 cm do next to nothing."""
    at = np.array([[2.0, 0.05, 0.05], [4.0, 0.1, 0.1]])
    screen = square_leaves(at[:1], np.array([[1.0, 0, 0]]), side)
    target = square_leaves(at[1:], np.array([[1.0, 0, 0]]), 0.05)
    targets = EchoTargets(scene_of(join([screen, target])))

    def size(echo: Echo) -> float:
        return float(echo.heard.amplitude[echo.heard.number == 1].sum())

    share = size(pinged(targets, cull=0.0)) / size(pinged(targets, cull=0.0, shading="none"))
    assert passes[0] <= share <= passes[1]


def test_a_leaf_does_not_shade_itself() -> None:
    """Tilted, its upper half stands before its middle."""
    leaf = square_leaves(np.array([[3.0, 0.05, 0.05]]), np.array([[1.0, 0, 1.0]]), 0.3)
    targets = EchoTargets(scene_of(leaf))
    dim, clear = (pinged(targets, cull=0.0, shading=way) for way in ("extinction", "none"))
    np.testing.assert_allclose(dim.spectrum, clear.spectrum, rtol=1e-12)
