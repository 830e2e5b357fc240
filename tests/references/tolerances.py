"""Cases in which a tolerance may break: drawn scenes of each simulator against its exact, slow way.

Tests take the hardest, and `make fuzz` draws new ones. A number is the same scene every time.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from forest_addon.base.trimesh import OTHER, WOOD, TriMesh, join
from forest_addon.blender.rays.casters import make_caster
from forest_addon.sensing.rays.exact import Referee
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions, arrivals_of, judged
from forest_addon.sensing.reverb.sums.scattering import direct_sum, trunk_paths
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.sensing.sonar.beam import BeamPattern, MeasuredBeam, MeasuredSphere
from forest_addon.sensing.sonar.calls import synthesise
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.station import Equipment
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Rays, Reverb, Sonar

from .echoes import scene_of, square_leaves

RAYS, GRAZING = 200, 2e-3  # of a scene; cosine of the incidence, 89.89°
HARDER = (
    10**6
)  # number from which on pings may be of all many times, whose errors add up, by measured ears


@dataclass(frozen=True)
class Case:
    """Outcome of one scene, which its number draws again.

    error : the true one over the tolerance. told_of : largest true error over what is told of it. warned :
    whether the result says that the tolerance was not reached.
    """

    number: int
    tolerance: float
    error: float
    told_of: float
    warned: bool


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def air_of(rng: np.random.Generator) -> Air:
    """Any air that the settings take: dry, cold and thin ones as often as usual ones."""
    if rng.random() < 0.3:
        return Air()
    return Air(
        temperature_c=float(rng.choice([-40.0, 50.0, rng.uniform(-40, 50)])),
        humidity=float(rng.choice([0.01, 100.0, _log(rng, 0.01, 100)])),
        pressure_kpa=float(rng.choice([20.0, 120.0, rng.uniform(60, 105)])),
    )


def sonar_case(number: int) -> Case:
    """A ping at leaves, a post and a board, by one of three models of a leaf, with ears, beams and motion."""
    rng = np.random.default_rng((48, number))
    model = str(rng.choice(["exact", "piston", "paper"]))
    tolerance = 10.0 ** -rng.uniform(2, 8)
    count, side = int(_log(rng, 40, 250)), _log(rng, 2e-3, 0.15)
    nearest = rng.choice([0.2, 0.7, 2.0])
    centre = rng.uniform(
        [nearest, -1, -1], [nearest + rng.choice([0.1, 1.0, 6.0]), 1, 1], (count, 3)
    )
    normal = rng.normal(size=(count, 3))
    if rng.random() < 0.2:
        normal[:] = (1.0, 0.05, 0.0)
    parts = [square_leaves(centre, normal, side, number)]
    with_post, with_board = (rng.random(2) < 0.5).tolist()
    if with_post:
        parts.append(_post(rng))
    if with_board:
        corners = np.array([(5, -1, -1.0), (5.2, 1, -1.0), (5.2, 1, 1), (5, -1, 1)])
        parts.append(TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), OTHER))
    low, wide = _log(rng, 15e3, 90e3), _log(rng, 500, 40e3)
    beam = str(rng.choice(["gaussian", "horseshoe", "omni"]))
    if beam == "horseshoe":  # its width is known there
        low, wide = rng.uniform(60e3, 70e3), rng.uniform(500, 10e3)
    ears = int(rng.choice([1, 1, 2, 3]))
    moves = bool(rng.random() < (0.25 if number < HARDER else 0.5))
    sonar = Sonar(
        position=(0.0, 0.0, 0.0),
        leaf_model=model,
        tolerance=tolerance,
        cull=0.0,
        shading="none",
        near_limit=0.02,
        beam=beam,
        beam_width_deg=(_log(rng, 8, 120), _log(rng, 8, 120)),
        ears=ears,
        ear_spacing=0.3 * rng.random(),
        ear_turn_deg=float(rng.uniform(-40, 40)) if ears > 1 else 0.0,
        band=(low, low + wide),
        sample_rate=max(100e3, 2.2 * (low + wide)),
        call="fm" if moves else "impulse",
        call_duration=_log(rng, 3e-4, 5e-3),
        doppler=bool(moves),
        speed=float(rng.uniform(0, 12)) if moves else 0.0,
        max_range=40.0,
    )
    air = air_of(rng)
    mesh, copies, equipment = join(parts), 1, None
    if number >= HARDER:
        copies = int(rng.choice([1, 1, 30]))
        equipment = Equipment.of(sonar, hears=_ears(rng, low, wide))
    given = {"equipment": equipment}
    fast = ping(EchoTargets(scene_of(mesh, *copies * [np.eye(3, 4)])), sonar, air, **given)
    exact = ping(EchoTargets(scene_of(mesh)), replace(sonar, tolerance=0.0), air, **given)
    error = _apart(fast.spectra / copies, exact.spectra, exact)
    called = 0.0
    if moves:
        loudest = np.abs(synthesise(sonar).spectrum(exact.frequency)).max()
        called = _apart(fast.called / copies, exact.called, exact) / loudest
    told = fast.error_bound + fast.table_error
    warned = bool(fast.error_bound > tolerance)
    worst = max(error, called) / tolerance
    return Case(number, tolerance, worst, error / max(told, 1e-15), warned)


def _ears(rng: np.random.Generator, low: float, wide: float) -> tuple[BeamPattern, ...]:
    """Those of the settings, or a pattern that was measured: around the axis or all round, with kinks at some
    frequencies."""
    at = low + wide * np.linspace(rng.uniform(-0.2, 0.4), rng.uniform(0.6, 1.2), 5)
    angle, towards = np.radians(np.arange(0.0, 181.0, 15.0)), rng.normal(size=(60, 3))
    level = rng.normal(0, 1.5, (13, 5)) - np.minimum(30.0, 20.0 * angle**2)[:, None]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    ball = MeasuredSphere.all_round(towards, at, rng.uniform(-40, 0, (60, 5)))
    kinds = (), (MeasuredBeam(angle, at, level),), (ball,)
    return kinds[int(rng.integers(3))]


def _apart(found: np.ndarray, exact: np.ndarray, of: Echo) -> float:
    """Largest error at any ear and frequency, of Σ max|A| of that ear."""
    heard = of.size > 0
    if not heard.any():
        return 0.0
    return float((np.abs(found - exact).max(axis=1)[heard] / of.size[heard]).max())


def _post(rng: np.random.Generator) -> TriMesh:
    radius, turn = _log(rng, 2e-3, 0.2), np.linspace(0, 2 * np.pi, 9)[:-1]
    ring = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(8)], axis=1)
    rings = np.concatenate([ring + np.array([3, 0.2, z]) for z in np.linspace(-0.8, 0.8, 5)])
    first = np.arange(8)
    quads = np.stack([first, (first + 1) % 8, 8 + (first + 1) % 8, 8 + first], axis=1)
    quads = (quads + 8 * np.arange(4)[:, None, None]).reshape(-1, 4)
    return TriMesh.of_part(rings, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]), WOOD)


def reverb_case(number: int) -> Case:
    """The sum over trunks of one radius, a few or many, thin ones too, in any air, with any losses.

    Where the source moves, a second one with what the first set up.
    """
    rng = np.random.default_rng((49, number))
    count = int(_log(rng, 6, 50))
    spread = str(rng.choice(["one", "few", "many"]))
    low = float(rng.choice([0.0035, 0.007, 0.02, _log(rng, 1e-3, 1.0)]))
    if spread == "one":
        radius = np.full(count, low)
    elif spread == "few":
        radius = rng.choice(low * np.exp(rng.uniform(0, 2, 3)), count)
    else:
        radius = low * np.exp(rng.uniform(0, rng.choice([0.3, 2.0, 4.0]), count))
    radius = np.minimum(radius, 2.0)
    rate = float(rng.choice([1000.0, 2000.0, 4000.0]))
    side, distance = _log(rng, 5, 60), _log(rng, 0.5, 30)
    place = rng.uniform(-side / 2, side / 2, (count, 2))
    tolerance = 10.0 ** -rng.uniform(2, 6)
    air = air_of(rng)
    ends = np.array(
        [[-distance / 2, 0.0, _log(rng, 0.1, 10)], [distance / 2, 0.0, _log(rng, 0.1, 10)]]
    )
    losses = None
    if rng.random() < 0.5:
        reverb = Reverb(
            model="forest",
            surface=str(rng.choice(["constant", "snow", "forest floor", "grass", "asphalt"])),
            ground=float(rng.uniform(-1, 1)),
            extinction=str(rng.choice(["none", "energy", "coherent"])),
            bark=float(rng.choice([0.0, 0.05, 0.9])),
            leaf_absorption=float(rng.choice([0.0, 0.0015, 0.01])),
            turbulence=float(rng.choice([0.0, 1.0, 100.0])),
            lean_deg=float(rng.choice([0.0, 2.0, 20.0])),
            path_ground=bool(rng.random() < 0.8),
        )
        stand = TrunkStand(
            _log(rng, 1e-3, 1.0),
            tuple(np.unique(radius)[:5].tolist()),
            float(rng.choice([0.0, 0.3, 3.0, 20.0])),
            float(rng.choice([0.0, 5.0, 20.0])),
        )
        losses = Losses.of(reverb, air, stand, *ends)
    moves = bool(rng.random() < 0.3)
    trunks = Trunks(place, radius, np.arange(count))
    prepared = Expansions()
    worst = told_of = told = 0.0
    for step in range(1 + moves):
        source = ends[0, :2] + step * np.array([0.37, 0.21])
        paths = trunk_paths(trunks, source, ends[1, :2], 2.0, 0.7, None, losses is not None)
        count = int(rate * (min(float(paths.length.max()) / air.speed(), 0.3) + 0.05))
        exact = direct_sum(paths, rate, count, air, None, losses, max(0.03 * tolerance, 1e-7))
        found, estimated = prepared.sum(paths, rate, count, air, tolerance, losses)
        arrivals = arrivals_of(paths, losses, air.speed())
        errors = judged(found, exact, rate, tolerance, arrivals)
        worst = max(worst, *errors.values())
        told = max([told, *estimated.values()])
        for octave, error in estimated.items():
            told_of = max(told_of, errors.get(f"{octave:g} Hz", 0.0) / max(error, 1e-12))
    return Case(number, tolerance, worst / tolerance, told_of, told > tolerance)


def lidar_case(number: int) -> Case:
    """Distances of rays to leaves, far from the origin too, turned, stretched and mirrored, by both engines.

    The tolerance is what audits allow: 1 nm and the rounding of the coordinates. Rays that graze a leaf by
    less than GRAZING are left out: there Embree may name the other half of a leaf, up to 1.5 mm off.
    """
    rng = np.random.default_rng((50, number))
    count, side = int(_log(rng, 3, 60)), _log(rng, 1e-3, 0.5)
    mesh = square_leaves(rng.normal(0, 1, (count, 3)), rng.normal(size=(count, 3)), side, number)
    offset = float(rng.choice([0.0, 1e2, 1e4, 1e6]))
    places = []
    for _ in range(3):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 3.0, 3)
        places.append(np.column_stack([turn, offset + rng.normal(0, 3, 3)]))
    scene = scene_of(mesh, *places)
    engine = str(rng.choice(["embree", "bvhtree"]))
    caster = make_caster(scene, Rays(engine=engine))
    origins = offset + rng.normal(0, _log(rng, 1, 200), (RAYS, 3))
    leaf = mesh.vertices[mesh.triangles[rng.integers(0, 2 * count, RAYS)]]
    aims = np.einsum("rci,rc->ri", leaf, rng.dirichlet(np.ones(3), RAYS))
    aims = aims @ places[0][:, :3].T + places[0][:, 3]
    found = caster.cast(origins, aims - origins)
    exact = Referee(caster).cast(origins, aims - origins)
    missed = ~(found.found & exact.found) & (found.found | exact.found)
    away = np.where(missed, np.inf, 0.0)
    both = found.found & exact.found
    corners = mesh.vertices[mesh.triangles[exact.triangle]]
    corners = np.einsum("rci,rji->rcj", corners, scene.transform[exact.instance][:, :, :3])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.abs(((aims - origins) * normal).sum(axis=1))
    facing /= np.linalg.norm(aims - origins, axis=1) * np.linalg.norm(normal, axis=1)
    both &= facing > GRAZING
    away[both] = np.abs(found.distance[both] - exact.distance[both])
    allowed = 1e-9 + 64.0 * 2.0**-52 * (offset + 200.0)
    return Case(number, allowed, float(away.max()) / allowed, 0.0, False)


CASES: dict[str, Callable[[int], Case]] = {
    "sonar": sonar_case,
    "reverb": reverb_case,
    "lidar": lidar_case,
}
