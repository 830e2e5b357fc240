"""``python -m headless run SCENE.toml``: everything that a scene file asks for, into a folder; of a .blend
file, the sensors that live in it."""

from __future__ import annotations

import argparse

from forest_addon.spec import Scene, SpecError

from ..command import PROGRAM, DoubtfulError, read_scene
from ..progress import hushed
from ..store import store_of


def run(chosen: argparse.Namespace) -> None:
    """Run a scene file, or the sensors of a .blend file."""
    scene, workers = chosen.scene, chosen.workers
    is_blend = scene.suffix.lower() == ".blend"
    dry = chosen.convolve.stem if chosen.convolve else ""
    if is_blend and chosen.seed is not None:
        raise SpecError("--seed", "belongs to a scene file; what stands in a .blend has one")
    settings = Scene() if is_blend else read_scene(scene, chosen.seed, dry)
    with hushed():  # Blender says where its colours come from
        from ..pipeline import claim_files, run_blend, run_scene
    if not is_blend:
        claim_files(settings, chosen.out, dry)
    doubt = None
    how = {"quiet": chosen.quiet, "resume": chosen.resume, "strict": chosen.strict}
    if settings.tiles.size:
        from ..dataset.engine import (
            Cluster,
        )  # here: other scenes need neither workers nor catalogues
        from ..tiled import run_in_tiles

        if chosen.convolve:
            raise SpecError("--convolve", "needs a reverb, which cannot be run in tiles")
        cluster = Cluster(workers, chosen.scheduler, chosen.slurm)
        run_in_tiles(
            settings,
            scene.resolve().parent,
            chosen.out,
            share=chosen.share,
            cluster=cluster if cluster.is_elsewhere or workers > 1 else None,
            store=None if chosen.store is None else store_of(chosen.store),
            command=f"{PROGRAM} run {scene.name} --seed {settings.seed}",
            **how,
        )
    else:
        for key, is_asked in (
            ("--workers", workers > 1),
            ("--scheduler", chosen.scheduler),
            ("--store", chosen.store),
            ("--share", chosen.share),
            ("--slurm", chosen.slurm is not None),
        ):
            if is_asked:
                why = "needs a scene with [tiles]; sensors of others use all cores by themselves"
                raise SpecError(key, why)
        how |= {"verbose": chosen.verbose, "dry": chosen.convolve}
        try:
            if is_blend:
                run_blend(scene, chosen.out, **how)
            else:
                run_scene(settings, scene.resolve().parent, chosen.out, **how)
        except DoubtfulError as problem:  # all is written
            doubt = problem
    if chosen.json:
        print((chosen.out / "run.json").read_text(encoding="utf-8"))
    if doubt is not None:
        raise doubt
