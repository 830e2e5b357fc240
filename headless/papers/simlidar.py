"""``python -m headless simlidar``: S's experiment with 42 orchards, its table and regressions beside ours.

Each orchard is grown, built as a Blender scene, and scanned on the evaluated depsgraph twice: with one ray a
beam, and with S's solid beam (P = 2). Its row is written when it is finished; an experiment that was
interrupted goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from forest_addon.formats.table import write_csv
from forest_addon.growth.truth import Wood, wood_of_skeleton
from forest_addon.sensing.lidar import wood_indices
from forest_addon.spec import Rays, Scene, SpecError
from forest_addon.stand.forest import Forest

from . import orchards
from .orchards import Orchard
from .simlidar_report import draw, print_report

if TYPE_CHECKING:
    from forest_addon.blender.observe import Observer

Progress = Callable[[int, int], None]
SOLID = 2  # S's P
QUICK_GAP = 9


@dataclass(frozen=True)
class Finding:
    """A row of orchards.csv: what was asked for, down to the engine, and what came out (times: CPU s)."""

    iterations: int
    trees: int
    smallest_m: float
    pruned: bool
    stochastic: bool
    seed: int
    internode_m: float
    gap: int
    engine: str
    branches: int
    triangles: int
    scans: int
    beams: int
    volume_m3: float
    area_m2: float
    projected_m2: float
    impacted_m2: float
    impacted_solid_m2: float
    impacted_eq14_m2: float
    hits: int
    hits_solid: int
    build_s: float
    scan_s: float
    scan_solid_s: float

    @property
    def orchard(self) -> Orchard:
        """Which one it is."""
        return Orchard(self.iterations, self.trees, self.smallest_m, self.pruned, self.stochastic)


@dataclass(frozen=True)
class TreeFinding:
    """A row of trees.csv: one tree of one orchard."""

    iterations: int
    trees: int
    smallest_m: float
    pruned: bool
    stochastic: bool
    tree: int
    branches: int
    volume_m3: float
    area_m2: float
    projected_m2: float
    impacted_m2: float
    impacted_solid_m2: float


def add_simlidar(commands: argparse._SubParsersAction) -> None:
    """The command's arguments."""
    simlidar = commands.add_parser(
        "simlidar",
        help="SIMLIDAR's 42 orchards: its table and regressions beside ours",
        description="Grow, build and scan the 42 orchards of Méndez et al. (SIMLIDAR); print their table "
        "and regressions beside ours. Finished orchards are kept, and not done again.",
    )
    simlidar.add_argument(
        "--quick", action="store_true", help="only 4 and 5 iterations, every tenth scan"
    )
    simlidar.add_argument(
        "--out",
        type=Path,
        default=Path("out") / "simlidar",
        metavar="DIR",
        help="folder for tables and picture (default out/simlidar)",
    )
    simlidar.add_argument("--seed", type=int, default=1, help="seed of the trees (default 1)")
    simlidar.add_argument(
        "--engine", default="auto", choices=("auto", "bvhtree", "embree"), help="who casts rays"
    )
    simlidar.add_argument("--quiet", action="store_true", help="no progress, only the report")
    simlidar.set_defaults(do=_simlidar)


def _simlidar(chosen: argparse.Namespace) -> int:
    if chosen.seed < 0:
        raise SpecError("--seed", f"{chosen.seed} is out of range; use at least 0")
    run_experiment(
        chosen.out,
        quick=chosen.quick,
        seed=chosen.seed,
        engine=chosen.engine,
        quiet=chosen.quiet,
    )
    return 0


def run_experiment(
    out: Path, *, quick: bool = False, seed: int = 1, engine: str = "auto", quiet: bool = False
) -> list[Finding]:
    """Do what is not done yet, print the report, draw the picture.

    Raises
    ------
    ValueError : the engine cannot be used; rows in the folder that cannot be read.
    OSError : a file could not be written; what was finished before is kept.
    """
    from ..progress import Stages

    out.mkdir(parents=True, exist_ok=True)
    stages = Stages(quiet)
    with stages.stage("calibrate the first internode"):
        internode = orchards.first_internode()
    gap = QUICK_GAP if quick else 0
    known = _Kept(out)
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
) -> tuple[Finding, list[TreeFinding]]:
    """Grow, build and scan one orchard. With a gap, each scan stands for those that are left out.

    Raises
    ------
    ValueError : the engine cannot be used; says why.
    """
    begin = time.process_time()
    forest = orchards.plant(orchard, internode, seed)
    thin = orchards.tractor_for(forest, 0, gap)
    scene = orchards.scene_of(forest, thin)
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
    whole = Finding(
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


def stand_up(forest: Forest, scene: Scene, rays: Rays) -> Observer:
    """Build an orchard as a Blender scene, in place of all there is, and read what it evaluates to.

    Raises
    ------
    ValueError : the engine cannot be used; says why.
    """
    from ..progress import hushed

    with hushed():
        import bpy

        from forest_addon.blender.forest import build
        from forest_addon.blender.observe import Observer

        bpy.ops.wm.read_factory_settings(use_empty=True)
    build(bpy.context.scene, scene, forest)
    return Observer(bpy.context.evaluated_depsgraph_get(), rays)


class _Kept:
    """The rows of orchards that are finished, in two files that grow orchard by orchard."""

    def __init__(self, out: Path) -> None:
        self._orchards, self._trees = out / "orchards.csv", out / "trees.csv"
        self.rows = _read(self._orchards, Finding)
        finished = {row.orchard for row in self.rows}
        self._tree_rows = [
            row for row in _read(self._trees, TreeFinding) if _orchard(row) in finished
        ]

    def find(
        self, orchard: Orchard, seed: int, internode: float, gap: int, engine: str
    ) -> Finding | None:
        """The row of an orchard that was done with these settings."""
        for row in self.rows:
            same = (row.orchard, row.seed, row.internode_m, row.gap) == (
                *(orchard, seed, internode, gap),
            )
            if same and engine in ("auto", row.engine):
                return row
        return None

    def add(self, row: Finding, trees: Sequence[TreeFinding]) -> None:
        """Write an orchard, in place of one that was done with other settings."""
        self._tree_rows = [t for t in self._tree_rows if _orchard(t) != row.orchard] + list(trees)
        self.rows = [r for r in self.rows if r.orchard != row.orchard] + [row]
        _write(self._trees, TreeFinding, self._tree_rows)
        _write(self._orchards, Finding, self.rows)  # last: what stands here is finished


def _orchard(row: TreeFinding) -> Orchard:
    return Orchard(row.iterations, row.trees, row.smallest_m, row.pruned, row.stochastic)


def _write(path: Path, kind: type, rows: Sequence[object]) -> None:
    write_csv(path, {f.name: [getattr(row, f.name) for row in rows] for f in fields(kind)})


def _read(path: Path, kind: type) -> list:
    """Rows of a file of ours, none where there is no file.

    Raises
    ------
    SpecError : it is not such a file.
    """
    if not path.is_file():
        return []
    readers = {
        "int": int,
        "float": float,
        "str": str,
        "bool": {"True": True, "False": False}.__getitem__,
    }
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return [
                kind(**{f.name: readers[str(f.type)](line[f.name]) for f in fields(kind)})
                for line in csv.DictReader(file)
            ]
    except (KeyError, ValueError, TypeError, csv.Error):
        raise SpecError(
            str(path), "is not of this experiment; remove it, or choose another --out"
        ) from None


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
