"""``python -m headless dataset PLAN.toml``: thousands of labelled scenes from one plan."""

from __future__ import annotations

import argparse
import sys

from forest_addon.spec import SpecError

from ..dataset.disk import check_dataset, write_shards
from ..dataset.engine import Cluster
from ..dataset.estimate import estimate, tell
from ..dataset.formats import convert_dataset
from ..dataset.plan import find_plan, idle_in_plan, read_plan
from ..progress import Stages
from ..store import store_of


def run(chosen: argparse.Namespace) -> None:
    """Make, estimate, check or convert a dataset."""
    say = (lambda text: None) if chosen.quiet else _say
    if chosen.check is not None:
        check_dataset(chosen.check, say)
        return
    if chosen.convert is not None:
        convert_dataset(chosen.convert, chosen.to, chosen.out, say)
        return
    plan = read_plan(find_plan(chosen.plan), chosen.set)
    stages = Stages(chosen.quiet)
    for sentence in idle_in_plan(plan):
        stages.warn(sentence)
    if chosen.dry_run:
        tell(estimate(plan, _say), _say)
        return
    from ..dataset.factory import copy_to, make_dataset

    cluster = Cluster(chosen.workers or 0, chosen.scheduler, chosen.slurm)
    if chosen.store is not None and chosen.replace:
        raise SpecError("--replace", "does not go with --store; take an empty store")
    store = None if chosen.store is None else store_of(chosen.store)
    how = {"replace": chosen.replace, "quiet": chosen.quiet, "store": store}
    make_dataset(plan, chosen.out, cluster, **how)
    if chosen.shards is not None:
        write_shards(chosen.out, chosen.shards * 10**6)
        if store is not None:
            copy_to(store, chosen.out)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
