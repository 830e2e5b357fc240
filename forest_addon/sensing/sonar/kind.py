"""Record of the sonar: pings at leaves, wood and ground, from one place or along a route."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.progress import Progress
from ...base.words import keep
from ...spec import AUTO, Choice, Scene, Sonar
from ..audit import AuditPart
from ..kind import (
    AROUND,
    ECHO,
    Cost,
    Observation,
    Seen,
    SensorKind,
    chain,
    cost_of_work,
    rays_to,
    why_nothing,
)
from ..looks import EchoLook

if TYPE_CHECKING:
    from ..trajectory import Follower, Trajectory

BEGIN = 1.4  # s, a first guess: axes of branches and the sound of leaves, found once in a scene
IN_REACH = 0.045  # s, a first guess: an ear hears one ping of a tree
HEARD = 0.3  # s, a first guess: an ear hears one ping of leaves that are exact discs
FITTED = 0.1  # s, the same of the papers' leaves and of pistons
MOMENT = 1e-3  # s, that a scene is looked at for a ping
RAYS = 8  # lines from a sonar to the contour of its beam
TABLE = 1e-5  # of its value straight on, that the exact disc is looked up within
FORMULA = 1e-4  # far below the per cents that physical optics and the paper's fit are off by
CULLED = 10.0  # times the tolerance: what is left out is known by a bound far above the truth


def targets_of(seen: Seen) -> Any:
    """``EchoTargets``, everything in a scene that sounds back; ask for it by ``seen.once``."""
    from .targets import EchoTargets

    if seen.sway is None:
        return EchoTargets(seen.geometry)
    from .windy import EchoWind

    return EchoTargets(seen.geometry, wind=EchoWind(seen.geometry, *seen.sway))


def _targets(job: Observation) -> Any:
    """Targets that sound back, as they move where that is asked for."""
    still = job.seen.once(targets_of)
    if job.moving is None:
        return still
    from .targets import EchoTargets
    from .windy import EchoMotion, EchoWind

    geometry, moving, sway = job.seen.geometry, job.moving, job.seen.sway
    wind = None if sway is None else EchoWind(geometry, sway[0])
    return EchoTargets(geometry, still, wind, EchoMotion(moving.moving))


def _casters(job: Observation) -> tuple[Any, Any]:
    """Rays that pass leaves and rays that meet everything, None where ``shading`` has no use for them."""
    sonar, seen = job.sensor, job.seen
    wood = everything = None
    if "trunks" in sonar.shading:
        wood = seen.swaying_wood if job.moving is None else seen.moving_wood(job.moving)
    if "extinction" in sonar.shading:
        everything = seen.swaying if job.moving is None else job.moving
    return wood, everything


def _lasts(sonar: Sonar, trajectory: Any) -> float:
    """Seconds of a scene that moves until the last ping."""
    if not sonar.motion:
        return 0.0
    return MOMENT + (0.0 if trajectory is None else float(np.max(trajectory.time)))


def _equipment(job: Observation) -> Any:
    from .equipment_files import equip

    return equip(job.sensor, job.folder)


def _listen(job: Observation, progress: Progress | None) -> Any:
    """One ping, or one from every pose of a route."""
    from .ping import fly, ping
    from .station import posed, poses_of

    sonar, air, targets = job.sensor, job.settings.air, _targets(job)
    wood, everything = _casters(job)
    given: dict[str, Any] = {"equipment": _equipment(job), "everything": everything}
    given["seed"] = job.settings.seed
    if job.trajectory is None:
        pose = replace(posed(sonar), time=job.start)
        return ping(targets, sonar, air, wood, progress, pose=pose, **given)
    return fly(targets, sonar, air, poses_of(job.trajectory), wood, progress, **given)


def _audit(job: Observation, found: Any) -> list[AuditPart]:
    from .audit import Pings, parts_of_echoes
    from .station import posed, poses_of

    sonar, settings = job.sensor, job.settings
    echoes, poses = (found,), [replace(posed(sonar), time=job.start)]
    if job.trajectory is not None:
        echoes, poses = found.echoes, poses_of(job.trajectory)
    pings = Pings(
        echoes,
        poses,
        _targets(job),
        sonar,
        settings.air,
        *_casters(job),
        _equipment(job),
        settings.seed,
    )
    return parts_of_echoes(pings, settings.accuracy.audit)


def _glance(job: Observation) -> Any:
    from .glance import listen

    return listen(job, job.seen.once(targets_of))


def _trajectory(sonar: Sonar, folder: Path, follower: Follower) -> Trajectory | None:
    """The poses of a route's file, or along what it follows."""
    from ..trajectory import followed
    from .equipment_files import find, read_route

    if sonar.route:
        return read_route(find(sonar.route, folder, "route"), sonar.speed)
    if not sonar.follow:
        return None
    if follower.curve(sonar.follow) is None:
        return follower.motion(sonar.follow, sonar.poses)
    turn, rise = math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg)
    return followed(follower, sonar.follow, 1.0).visits(sonar.poses, turn, rise, sonar.speed)


def _silence(job: Observation, found: Any) -> str:
    """The reason why no ping has an echo."""
    echoes = getattr(found, "echoes", (found,))
    if any(np.any(echo.spectra) for echo in echoes):
        return ""
    said = "silence" if len(echoes) == 1 else "silence in all pings"
    where = np.array([echo.pose.position for echo in echoes])
    return why_nothing(said, where, job.sensor.max_range, job.seen.geometry)


def _cost(sonar: Sonar, trajectory: Any, _engine: str) -> Cost:
    pings = 1 if trajectory is None else len(trajectory)
    an_ear = HEARD if sonar.leaf_model == "exact" else FITTED
    return cost_of_work(sonar, "pings", pings, an_ear * sonar.ears, begin=BEGIN)


def _seconds_among(sonar: Sonar, settings: Scene, trees: int, pings: int) -> tuple[float, float]:
    """Seconds that trees in reach take, of half a circle."""
    dense = trees / float(np.prod(settings.forest.size))
    near = min(dense * math.pi * sonar.max_range**2 / 2, trees)
    return 0.0, IN_REACH * near * sonar.ears * pings


def beam_outline(sonar: Sonar) -> np.ndarray:
    """The -3 dB contour of one way of the beam at ``max_range``, rays to it, and the axis."""
    from ..trajectory import frame_of

    turn = np.linspace(0.0, 2.0 * math.pi, AROUND + 1)
    across, along = (math.radians(width) / 2.0 for width in sonar.beam_width_deg)
    azimuth, elevation = across * np.cos(turn), along * np.sin(turn)
    angle = np.minimum(np.hypot(azimuth, elevation), math.pi)
    share = np.sinc(angle / math.pi)  # sin(angle)/angle: offsets are laid out along the side
    local = np.stack([np.cos(angle), share * azimuth, share * elevation], axis=1)
    frame = frame_of(math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg))
    position = np.asarray(sonar.position)
    contour = position + sonar.max_range * local @ frame
    rays = contour[:: AROUND // RAYS][:RAYS]
    return np.concatenate(
        [
            chain(contour),
            rays_to(position, rays),
            rays_to(position, position + sonar.max_range * frame[:1]),
        ]
    )


def _choose(sonar: Sonar) -> tuple[Choice, ...]:
    model, fine = f'the "{sonar.leaf_model}" leaf', FORMULA
    if sonar.leaf_model == "exact":
        model, fine = "the exact disc's table", TABLE
    why = f"of all amplitudes; {model} is no truer"
    made = []
    if sonar.tolerance == AUTO:
        made.append(Choice("tolerance", fine, fine, why))
    if sonar.cull == AUTO:
        value = CULLED * (fine if sonar.tolerance == AUTO else max(sonar.tolerance, fine))
        made.append(Choice("cull", value, value, why))
    return tuple(made)


def _look(sonar: Sonar) -> EchoLook:
    moves = bool(sonar.route or sonar.follow)
    narrow = min(sonar.beam_width_deg) if sonar.beam == "gaussian" else 10.0
    return EchoLook(
        name=sonar.name,
        corners=None if moves else np.array([sonar.position], dtype=float),
        range=sonar.max_range,
        leaves=sonar.leaves or "extinction" in sonar.shading,
        exact_wood=sonar.wood or "trunks" in sonar.shading,
        beam_width=math.radians(narrow),
        band=sonar.band,
        hears_leaves=sonar.leaves,
    )


def _fixed(group: Any) -> str:
    if group.follow:
        return keep("Move what it follows")
    return keep("It flies its route") if group.route else keep("Its ears stay level")


SONAR = SensorKind(
    Sonar,
    run=_listen,
    audit=_audit,
    empty=_silence,
    lasts=_lasts,
    sways=True,
    trajectory=_trajectory,
    check=_equipment,
    positions=lambda job: np.atleast_2d(
        job.sensor.position if job.trajectory is None else job.trajectory.position
    ),
    cost=_cost,
    seconds_among=_seconds_among,
    outline=beam_outline,
    choose=_choose,
    look=_look,
    family="sonar",
    help=keep("A bat's call, and what it hears of leaves and branches"),
    icon="OUTLINER_OB_SPEAKER",
    colour=ECHO,
    fixed=_fixed,
    glance=_glance,
    listens=True,
)
