"""The waits of all sensors in one table: by the library of kernels and by numpy, with errors and limits.

Each row runs in turn by numpy and by the library, on one thread and warm; speeds are medians of their CPU
time. Errors are against references that use neither: float64 brute force, the sum without approximation, H
at single frequencies; those of whole pulses, from numpy's to the library's; those of steps, of rays from
where their flyers are. The limit is what Embree alone takes for the same rays, before anything is made of
them; sums over echoes have none.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from statistics import median

import numpy as np

from forest_addon.api import Air, Rays, Sonar, Terrestrial, read

from ..inside import (
    KERNELS_SWITCH,
    EchoTargets,
    EmbreeCaster,
    Expansions,
    Flyers,
    LidarSense,
    Say,
    Scan,
    Stock,
    cast_exactly,
    empty_file,
    lidar_of,
    ping,
    rays_of,
    send,
)
from ..tables import table
from . import flight, lidar, lidar_rays, reverb, sonar

TITLE = "kernels: with the library and by numpy, and Embree alone"
RUNS = 3
RAYS, CHECKED, PULSES, STEPS = 60_000, 64, 4_000, 40
SEEN = 20 * np.arange(PULSES)  # of a scan's pulses, all over the stand
TREES = (1, 100)

# What, how many of it, the work, its error, the limit.
Row = tuple[str, int, Callable[[], object], Callable[[], str], str]


def run(say: Say) -> None:
    """Print the table; some minutes."""
    head = ["a CPU second", "library", "numpy", "times", "error", "error of numpy", "Embree alone"]
    table(say, head, [])
    for make in (_rays, _pulses, _pings, _trunks, _flyers):
        for what, count, work, error, limit in make():
            speeds: dict[bool, list[float]] = {False: [], True: []}
            off = {}
            for on in (False, True):
                with _kernels(on):
                    work()
                    off[on] = error()
            for on in (False, True) * RUNS:
                with _kernels(on):
                    speeds[on].append(count / _seconds(work))
            with_, without = median(speeds[True]), median(speeds[False])
            told = [_figure(with_), _figure(without), f"{with_ / without:.2f}"]
            row = [what, *told, off[True], off[False], limit]
            say("| " + " | ".join(row) + " |")  # one by one: it takes minutes


@contextmanager
def _kernels(on: bool) -> Iterator[None]:
    """Have the library compute, or numpy."""
    before = os.environ.pop(KERNELS_SWITCH, None)
    if not on:
        os.environ[KERNELS_SWITCH] = "off"
    try:
        yield
    finally:
        os.environ.pop(KERNELS_SWITCH, None)
        if before is not None:
            os.environ[KERNELS_SWITCH] = before


def _figure(speed: float) -> str:
    return f"{speed:,.0f}" if speed >= 100 else f"{speed:.1f}"


def _seconds(work: Callable[[], object]) -> float:
    start = time.thread_time()
    work()
    return time.thread_time() - start


def _alone(
    caster: EmbreeCaster, origins: np.ndarray, ways: np.ndarray, reach: float = np.inf
) -> float:
    """Seconds of Embree for rays (R, 3) of so many metres, as float32 and in order, alone: the median."""
    taken = []
    for _ in range(RUNS):
        rays = rays_of((origins - caster._centre).T, ways.T, np.full(len(ways), reach))
        taken.append(_seconds(lambda rays=rays: send(caster._library, caster._top, rays)))
    return median(taken)


def _rays() -> Iterator[Row]:
    for trees in TREES:
        caster = EmbreeCaster(lidar_rays.plant(lidar_rays.grow_trees("200k"), trees))
        many = lidar_rays._rays(caster.scene, RAYS)["tripod"]
        error = _against_brute_force(caster, *lidar_rays._rays(caster.scene, CHECKED)["tripod"])
        limit = _figure(RAYS / _alone(caster, *many))
        yield f"rays, trees: {trees}", RAYS, lambda c=caster, m=many: c.cast(*m), error, limit


def _against_brute_force(
    caster: EmbreeCaster, origins: np.ndarray, ways: np.ndarray
) -> Callable[[], str]:
    """Errors of a caster's rays (R, 3), when they are asked for."""
    truth = cast_exactly(caster.scene, origins, ways)

    def error() -> str:
        _, tail, other, missed = lidar_rays._errors([caster.cast(origins, ways)], [truth])
        return f"{tail} m (99 %), other {other}, missed {missed}"

    return error


def _pulses() -> Iterator[Row]:
    caster = EmbreeCaster(lidar.forest(10, 200_000), threads=1)
    for subrays in (1, 19):
        beam = replace(lidar.BEAM, subrays=subrays)
        scanner = Terrestrial(
            position=(-5.0, -5.0, 1.6), azimuth_deg=(0.0, 90.0), elevation_deg=(-30.0, 60.0),
            angle_step_deg=0.3, beam=beam,
        )  # fmt: skip
        work = Scan(scanner, caster)
        with _kernels(False):
            reference = work.look_at(SEEN).returns.distance

        def error(work: Scan = work, reference: np.ndarray = reference) -> str:
            distance = work.look_at(SEEN).returns.distance
            if len(distance) != len(reference):
                return f"{len(distance) - len(reference):+d} returns"
            return f"{np.abs(distance - reference).max():.0e} m"

        axes = work.pattern.pulses(SEEN)
        seconds = subrays * _alone(caster, axes.origin, axes.direction)
        limit = _figure(PULSES / seconds)
        what = f"pulses of {subrays} rays, 10 trees"
        yield what, PULSES, lambda work=work: work.look_at(SEEN), error, limit


def _pings() -> Iterator[Row]:
    targets = EchoTargets(sonar._forest(5))
    for wood in (False, True):
        for model in ("paper", "piston", "exact"):
            one = Sonar(
                beam_width_deg=(30.0, 30.0), shading="none", cull=0.05, tolerance=1e-3, wood=wood,
                leaf_model=model, **sonar.POSE,
            )  # fmt: skip

            def error(one: Sonar = one) -> str:
                response = ping(targets, one, Air()).impulse_response
                whole = ping(targets, one.changed(tolerance=0.0), Air()).impulse_response
                return f"{np.linalg.norm(response - whole) / np.linalg.norm(whole):.0e}"

            what = f"pings, {model}" + (" with wood" if wood else "")
            yield what, 1, lambda one=one: ping(targets, one, Air()), error, "-"


def _trunks() -> Iterator[Row]:
    for count, radii in ((1_000, (0.25, 0.25)), (10_000, (0.05, 0.3))):
        paths = reverb._forest(count, 10.0, radii)
        exact, size = reverb._Exact(paths, 24e3, 8), reverb._record(paths, 24e3)
        prepared = Expansions()

        def work(
            paths: object = paths, size: int = size, prepared: Expansions = prepared
        ) -> object:
            return prepared.sum(paths, 24e3, size, reverb.AIR, 1e-4).samples

        def error(work: Callable[[], object] = work, exact: object = exact) -> str:
            return f"{exact.errors(work())[0]:.0e}"

        words = "one radius" if radii[0] == radii[1] else "many radii"
        yield f"responses of {count:,} trunks, {words}", 1, work, error, "-"


def _flyers() -> Iterator[Row]:
    empty_file()
    stock = Stock(read(flight.SCENE).changed(rays=Rays(threads=1)), flight.SCENE.parent)
    around, base = stock.surroundings(1), lidar_of(stock.settings)
    for rays, count in ((64, 1), (64, 64), (1024, 1)):
        scanner = base.changed(pulse_rate=base.line_rate * rays)
        sense = LidarSense(scanner)
        flyers = Flyers(stock.settings.flight, count, sense, None)
        flyers.enter(around)
        flyers.start(range(count), range(count))
        action = np.zeros((count, flyers.state.position.shape[1]))

        def work(flyers: Flyers = flyers, action: np.ndarray = action) -> None:
            for _ in range(STEPS):
                flyers.sense()
                over = np.flatnonzero(flyers.step(action).ended).tolist()
                flyers.start(over, over)

        ways = np.tile(sense.ways, (count, 1))
        at = np.repeat(flyers.state.position, rays, axis=0)
        limit = _figure(count / _alone(around.caster, at, ways, scanner.max_range))
        some = np.linspace(0, len(at) - 1, CHECKED).astype(np.int64)
        error = _against_brute_force(around.caster, at[some], ways[some])
        yield f"steps, flyers: {count}, rays of each: {rays}", STEPS * count, work, error, limit
