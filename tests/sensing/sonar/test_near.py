"""Leaves nearer than their far field: against Kirchhoff's integral, the rigid disc, facets, and a mirror."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.disc_near import RigidDisc, disc_direct
from references.echo_scenes import scene_of
from references.hard_disc import HardDisc
from references.leaf_discs import discs_of

from forest_addon.acoustics.disc import MODELS
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.sensing.sonar.leaves import FAR
from forest_addon.sensing.sonar.ping import Echo, ping
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)
QUIET = {
    "position": (0.0, 0.0, 0.0),
    "shading": "none",
    "absorption": False,
    "beam": "omni",
    "cull": 0.0,
    "tolerance": 1e-6,
}
SHARPEST = 2 * math.pi * 80e3 / 340.0


def leaf(distance: float, incidence: float, radius: float, **settings: object) -> Echo:
    normal = [math.cos(incidence), math.sin(incidence), 0.0]
    return ping(discs_of([[distance, 0, 0]], normal, radius), Sonar(**{**QUIET, **settings}), AIR)


def some(echo: Echo) -> tuple[np.ndarray, np.ndarray]:
    """A few bins: their spectrum and wavenumbers."""
    rows = np.linspace(0, len(echo.frequency) - 1, 9).astype(int)
    return echo.spectrum[rows], 2 * np.pi * echo.frequency[rows] / 340.0


@pytest.mark.medium
@pytest.mark.parametrize("radius", [0.025, 0.05])
@pytest.mark.parametrize("distance", [0.15, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("incidence", [0.0, 0.05, 0.3, 1.0, 1.4])
def test_near_leaf_is_kirchhoffs_integral(radius: float, distance: float, incidence: float) -> None:
    echo = leaf(distance, incidence, radius, leaf_model="piston")
    found, k = some(echo)
    wanted = disc_direct(distance, incidence, radius, k)
    face_on = np.abs(disc_direct(distance, 0.0, radius, k)).max()
    if len(echo.heard) > 1:
        # What the rim's integral leaves out is 1/(2kr) of the edge; and a polygon stands for a disc.
        assert np.abs(found - wanted).max() < 0.02 * face_on
        assert np.abs(found - wanted).max() < 0.15 * np.abs(wanted).max()
    else:  # as a point, its phase is that of the middle, and nulls are a little filled
        assert np.abs(np.abs(found) - np.abs(wanted)).max() < 0.04 * face_on
        level = 10 * np.log10(np.mean(np.abs(found) ** 2) / np.mean(np.abs(wanted) ** 2))
        assert abs(level) < 0.4


@pytest.mark.parametrize("ka", [2.0, 14.0])
def test_the_rigid_disc_for_a_point_source_far_off_is_that_for_plane_waves(ka: float) -> None:
    """Two methods of Galerkin's that share nothing; what is left is the near field's ka²/2r."""
    far, angles = 3e5, np.array([0.0, 0.5, 1.2])
    found = [RigidDisc(ka).heard(far, angle) * far**2 * np.exp(2j * ka * far) for angle in angles]
    exact = HardDisc(ka).backscatter(angles) / ka
    assert np.abs(found - exact).max() < 1e-4 * np.abs(exact).max()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("ka", "places"), [(6.0, (2.0, 4.0)), (14.0, (2.0, 3.0, 6.0)), (30.0, (3.0, 6.0, 20.0))]
)
def test_near_leaf_is_the_rigid_disc_for_a_point_source(
    ka: float, places: tuple[float, ...]
) -> None:
    """At ka, and radii from the middle; of the loudest echo of that distance, as ``leaves`` says.

    With the edge heard from the middle they were up to 52 % off, and 18 % at 6 a.
    """
    radius, disc = ka / SHARPEST, RigidDisc(ka)
    tone = {"leaf_model": "exact", "near_limit": 1e-3, "band": (80e3, 80e3)}
    for away in places:
        turned = (0.0, 0.15, 0.35, 0.6, 0.9, 1.2)
        exact = np.array([disc.heard(away, angle) for angle in turned])
        found = [
            leaf(away * radius, angle, radius, **tone).spectrum[0] * radius for angle in turned
        ]
        allowed = 0.13 if away < 3 else 0.05 if away < 6 else 0.035
        assert np.abs(found - exact).max() < allowed * np.abs(exact).max()


@pytest.mark.medium
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("radius", [0.01, 0.025, 0.05, 0.3])
def test_never_louder_than_twice_a_mirror(model: str, radius: float) -> None:
    """An endless mirror's echo is 1/2r; a disc of one Fresnel zone returns twice that, and no more.

    The exact disc's edge adds its own echo, a/2(r² + a²) face-on.
    """
    for distance in (0.06, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0):
        edge = radius / (distance**2 + radius**2) if model == "exact" else 0.0
        for incidence in (0.0, 0.1):
            loudest = np.abs(leaf(distance, incidence, radius, leaf_model=model).spectrum).max()
            assert loudest <= 1.05 / distance + edge


def test_on_the_axis_it_is_the_closed_form() -> None:
    for distance in (0.3, 0.5, 0.8, 1.5, 3.0):
        found, k = some(leaf(distance, 0.0, 0.04, leaf_model="piston"))
        slant = math.hypot(distance, 0.04)
        wanted = np.exp(-2j * k * distance) / distance
        wanted = (wanted - distance / slant**2 * np.exp(-2j * k * slant)) / 2
        np.testing.assert_allclose(found, wanted, atol=0.02 / distance)


def test_same_disc_as_facets() -> None:
    turn = 2 * np.pi * np.arange(160) / 160
    rim = 0.05 * np.stack([np.zeros(160), np.cos(turn), np.sin(turn)], axis=1)
    corners = np.concatenate([[[0.0, 0, 0]], rim]) + np.array([0.5, 0, 0])
    fan = np.stack([np.zeros(160, int), 1 + np.arange(160), 1 + (np.arange(160) + 1) % 160], axis=1)
    board = ping(EchoTargets(scene_of(TriMesh.of_part(corners, fan, OTHER))), Sonar(**QUIET), AIR)
    disc = leaf(0.5, 0.0, 0.05, leaf_model="piston")
    level = [20 * np.log10(np.abs(e.spectrum[len(e.spectrum) // 2])) for e in (board, disc)]
    assert level[1] == pytest.approx(level[0], abs=0.3)


@pytest.mark.parametrize("model", ["piston", "exact"])
@pytest.mark.parametrize("incidence", [0.0, 0.02])
def test_no_step_where_the_far_field_begins(model: str, incidence: float) -> None:
    edge = FAR * SHARPEST * 0.03**2
    before, after = (
        20 * np.log10(np.abs(leaf(r, incidence, 0.03, leaf_model=model).spectrum).mean())
        for r in (0.9999 * edge, 1.0001 * edge)
    )
    assert before == pytest.approx(after, abs=0.15)


def test_near_leaves_are_counted_once() -> None:
    discs = discs_of([[0.3, 0, 0], [1.5, 0, 0], [6.0, 0, 0]], [1.0, 0, 0], 0.04)
    for model in MODELS:
        echo = ping(discs, Sonar(**QUIET, leaf_model=model), AIR)
        assert echo.leaves_heard == 3
        assert echo.close == 1
        assert (echo.near, echo.far, echo.broken) == (0, 0, 0)


@pytest.mark.parametrize("model", MODELS)
def test_culling_counts_near_leaves_by_their_faces(model: str) -> None:
    rng = np.random.default_rng(3)
    discs = discs_of(
        rng.uniform([0.2, -2, -2], [3, 2, 2], (400, 3)), rng.normal(size=(400, 3)), 0.04
    )
    beam = {"beam": "gaussian", "leaf_model": model}
    whole = ping(discs, Sonar(**{**QUIET, **beam}), AIR)
    part = ping(discs, Sonar(**{**QUIET, **beam, "cull": 0.03}), AIR)
    assert len(part.heard) < len(whole.heard)
    promised = part.cull_bound * part.heard.amplitude.sum()
    assert 0 < part.cull_bound <= 0.03
    assert whole.heard.amplitude.sum() - part.heard.amplitude.sum() <= promised
