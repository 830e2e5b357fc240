"""Méndez et al.'s experiment with 42 orchards, its table and regressions beside ours.

Each orchard is grown, built as a Blender scene, and scanned on the evaluated depsgraph twice: with one ray a
beam, and with Méndez et al.'s solid beam (P = 2). Its row is written when it is finished; an experiment
that was interrupted goes on where it was.
"""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from forest_addon.base.progress import Progress
from forest_addon.growth.truth import Wood, wood_of_skeleton
from forest_addon.sensing.lidar import wood_indices
from forest_addon.spec import Rays, Scene
from forest_addon.stand.forest import GrownForest
from headless.progress import Stages, hushed

from . import orchards
from .orchards import Orchard
from .simlidar_report import draw, print_report
from .simlidar_rows import FinishedOrchards, OrchardFinding, TreeFinding

if TYPE_CHECKING:
    from forest_addon.blender.sensors.observe import Observer

SOLID = 2  # Méndez et al.'s P
QUICK_GAP = 9


def run_experiment(
    out: Path, *, quick: bool = False, seed: int = 1, engine: str = "auto", quiet: bool = False
) -> list[OrchardFinding]:
    """Do what is not done yet, print the report, draw the picture.

    Raises
    ------
    ValueError : the engine cannot be used; rows in the folder that cannot be read.
    OSError : a file could not be written; what was finished before is kept.
    """
    out.mkdir(parents=True, exist_ok=True)
    stages = Stages(quiet)
    with stages.stage("calibrate the first internode"):
        internode = orchards.first_internode()
    gap = QUICK_GAP if quick else 0
    known = FinishedOrchards(out)
    wanted = orchards.experiment(quick)
    found = []
    for number, orchard in enumerate(wanted):
        before = known.find(orchard, seed, internode, gap, engine)
        if before is None:
            with stages.stage(_name(number, len(wanted), orchard)) as progress:
                before, trees = observe(orchard, internode, seed, gap, engine, progress)
            known.add(before, trees)
        found.append(before)
    print_report(found, out)
    draw(found, out / "regressions.png")
    return found


def observe(
    orchard: Orchard,
    internode: float,
    seed: int,
    gap: int,
    engine: str,
    progress: Progress | None = None,
) -> tuple[OrchardFinding, list[TreeFinding]]:
    """Grow, build and scan one orchard. With a gap, each scan stands for those that are left out.

    Raises
    ------
    ValueError : the engine cannot be used; says why.
    """
    begin = time.process_time()
    forest = orchards.plant(orchard, internode, seed)
    thin = orchards.tractor_for(forest, 0, gap)
    scene = orchards.scene_of(thin)
    observer = stand_up(forest, scene, Rays(engine=engine))
    caster = observer.caster
    built = time.process_time()

    share = 1 + (SOLID + 1) ** 2  # of the bar: the thin scan is short
    scan = observer.observe(thin, scene, _part(progress, 0, 1, share))
    area = (gap + 1) * wood_indices.impacted_by_tree(scan, thin, orchard.trees)
    seen = time.process_time()
    solid = orchards.tractor_for(forest, SOLID, gap)
    thick = observer.observe(solid, scene, _part(progress, 1, share - 1, share))
    solid_area = (gap + 1) * wood_indices.impacted_by_tree(thick, solid, orchard.trees)
    upright = (gap + 1) * wood_indices.beam_areas(thick, solid, from_vertical=True)
    done = time.process_time()

    same = asdict(orchard)
    same["smallest_m"] = same.pop("smallest")
    wood = [wood_of_skeleton(forest.variant_of(t).skeleton) for t in range(orchard.trees)]
    branches = [len(forest.variant_of(t).skeleton) for t in range(orchard.trees)]
    trees = [
        TreeFinding(
            **same,
            tree=t,
            branches=branches[t],
            **_metres(wood[t]),
            impacted_m2=float(area[t]),
            impacted_solid_m2=float(solid_area[t]),
        )
        for t in range(orchard.trees)
    ]
    geometry = observer.geometry
    whole = OrchardFinding(
        **same,
        seed=seed,
        internode_m=internode,
        gap=gap,
        engine=caster.engine,
        branches=sum(branches),
        triangles=sum(len(geometry.meshes[m].triangles) for m in geometry.mesh_index),
        scans=len(scan.track),
        beams=scan.distance.size,
        **{
            name: sum(getattr(tree, name) for tree in trees)
            for name in ("volume_m3", "area_m2", "projected_m2", "impacted_m2", "impacted_solid_m2")
        },
        impacted_eq14_m2=float(upright.sum()),
        hits=int((scan.returns.tree >= 0).sum()),
        hits_solid=int((thick.returns.tree >= 0).sum()),
        build_s=built - begin,
        scan_s=seen - built,
        scan_solid_s=done - seen,
    )
    return whole, trees


def stand_up(forest: GrownForest, scene: Scene, rays: Rays) -> Observer:
    """Build an orchard as a Blender scene, in place of all there is, and read what it evaluates to.

    Raises
    ------
    ValueError : the engine cannot be used; says why.
    """
    with hushed():
        import bpy

        from forest_addon.blender.files.opening import empty_file
        from forest_addon.blender.scene.forest import build
        from forest_addon.blender.sensors.observe import Observer

        empty_file()
    build(bpy.context.scene, scene, forest)
    return Observer(bpy.context.evaluated_depsgraph_get(), rays)


def _name(number: int, count: int, orchard: Orchard) -> str:
    kind = f"{orchard.iterations} it, {orchard.trees} x {1000 * orchard.smallest:g} mm"
    other = "" if orchard.pruned else ", unpruned"
    return f"{number + 1}/{count} {kind}{other}{'' if orchard.stochastic else ', one rule'}"


def _metres(wood: Wood) -> dict[str, float]:
    return {"volume_m3": wood.volume, "area_m2": wood.area, "projected_m2": wood.projected}


def _part(progress: Progress | None, before: int, share: int, whole: int) -> Progress | None:
    """Progress of one part of the work."""
    if progress is None:
        return None

    def partly(done: int, total: int) -> None:
        progress(before * total + done * share, whole * total)

    return partly
