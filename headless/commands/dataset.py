"""``python -m headless dataset PLAN.toml``: thousands of labelled scenes from one plan."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from forest_addon.spec import SpecError

from ..command import Command, add_cluster_options, refuse_beyond

CONVERTED = ("semantic-kitti", "s3dis", "coco-panoptic")


class DatasetCommand(Command):
    name = "dataset"
    help = "make thousands of labelled scenes from one plan"
    outputs = ("out", "check")
    description = (
        "Make the scenes of a plan, each with its truth, into a folder that describes itself."
    )
    epilog = """\
examples:
  python -m headless dataset tiny --out out/tiny            a plan of assets/plans
  python -m headless dataset my.toml --dry-run              how long, how large
  python -m headless dataset my.toml --out data             on all cores; again: goes on
  python -m headless dataset my.toml --out data --scheduler tcp://host:8786
  python -m headless dataset my.toml --out data --slurm partition=cpu,jobs=40,memory=8GB
  python -m headless dataset my.toml --out data --store s3://forests/data
  python -m headless dataset --convert data --to semantic-kitti --out kitti
  python -m headless dataset --check data                   every hash, every label
  python -m headless dataset my.toml --set count=20 --set scene.sensors[tls].angle_step_deg=0.5

Stop it, kill it: the same command goes on, and the bytes come out the same.
Exit code 4: some scenes could not be made; manifest.csv says why."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "plan", nargs="?", metavar="PLAN", help="a .toml file, or one of assets/plans"
        )
        parser.add_argument("--out", type=Path, metavar="DIR", help="default out/PLAN")
        parser.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="KEY=VALUE",
            help="any other key of the plan",
        )
        parser.add_argument("--workers", type=int, metavar="N", help="here; default: one a core")
        add_cluster_options(parser)
        parser.add_argument(
            "--dry-run", action="store_true", help="time some scenes, say what all will cost"
        )
        parser.add_argument(
            "--replace", action="store_true", help="make scenes anew whose settings changed"
        )
        parser.add_argument(
            "--convert", type=Path, metavar="DIR", help="write a made dataset in another format"
        )
        parser.add_argument(
            "--to",
            metavar="FORMAT",
            choices=CONVERTED,
            help="of --convert: " + ", ".join(CONVERTED),
        )
        parser.add_argument("--check", type=Path, metavar="DIR", help="verify a dataset")
        parser.add_argument(
            "--store",
            metavar="URL",
            help="s3://, gs:// or another of fsspec's, to which scenes are copied as they are finished, in "
            "the end all files; what is there is not made again",
        )
        parser.add_argument(
            "--shards", type=int, metavar="MB", help="also pack WebDataset tars of this size"
        )
        parser.add_argument("--quiet", action="store_true", help="say nothing but errors")

    def output(self, chosen: argparse.Namespace) -> Path:
        if chosen.convert is not None:
            if chosen.to is None:
                raise SpecError("--convert", f"needs --to, one of {', '.join(CONVERTED)}")
            return Path(chosen.out or f"{chosen.convert}-{chosen.to}")
        if chosen.out is None and chosen.check is None:
            if chosen.plan is None:
                raise SpecError("dataset", "needs a plan, or --check or --convert and a folder")
            return Path("out") / Path(chosen.plan).stem
        return Path(chosen.out or chosen.check)

    def kept(self, chosen: argparse.Namespace) -> str:
        return f"finished scenes are kept in {chosen.out}; the same command goes on"

    def run(self, chosen: argparse.Namespace) -> None:
        if chosen.check is not None:
            from ..dataset.check import check_dataset

            check_dataset(chosen.check, _say(chosen.quiet))
            return
        if chosen.convert is not None:
            from ..dataset.formats import convert_dataset

            convert_dataset(chosen.convert, chosen.to, chosen.out, _say(chosen.quiet))
            return
        refuse_beyond("--workers", 1 if chosen.workers is None else chosen.workers, 1)
        refuse_beyond("--shards", 1 if chosen.shards is None else chosen.shards, 1)
        from ..dataset.plan import find_plan, idle_in_plan, read_plan
        from ..progress import Stages

        plan = read_plan(find_plan(chosen.plan), chosen.set)
        stages = Stages(chosen.quiet)
        for sentence in idle_in_plan(plan):
            stages.warn(sentence)
        if chosen.dry_run:
            from ..dataset.estimate import estimate, tell

            say = _say(False)
            tell(estimate(plan, say), say)
            return
        from ..dataset.engine import Cluster
        from ..dataset.factory import Asked, copy_to, make_dataset

        cluster = Cluster(chosen.workers or 0, chosen.scheduler, chosen.slurm)
        store = None
        if chosen.store is not None:
            from ..store import store_of

            if chosen.replace:
                raise SpecError("--replace", "does not go with --store; take an empty store")
            store = store_of(chosen.store)
        make_dataset(plan, chosen.out, Asked(cluster, chosen.replace, chosen.quiet, store))
        if chosen.shards is not None:
            from ..dataset.disk import write_shards

            write_shards(chosen.out, chosen.shards * 10**6)
            if store is not None:
                copy_to(store, chosen.out)


def _say(quiet: bool):
    def say(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    return say
