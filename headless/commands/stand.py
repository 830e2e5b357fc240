"""``python -m headless stand``: where the trees of a scene stand, without growing any.

Positions go into a CSV or GeoJSON file, a map of them into a picture beside it; what was expected, drawn and
removed is printed as a table.
"""

from __future__ import annotations

import argparse
import time

from forest_addon.formats.ownership import claim
from forest_addon.results.coordinates import FILE, note_of, write_note
from forest_addon.results.tables import write_stand
from forest_addon.site import ForestSite, check_species
from forest_addon.spec.choices import idle, idle_in_scene
from forest_addon.stand.files import read_inputs
from forest_addon.stand.plan import labels

from ..command import read_scene
from ..progress import Stages
from ..report import can_draw, without


def run(chosen: argparse.Namespace) -> None:
    """Sample the stand."""
    settings = read_scene(chosen.scene, chosen.seed)
    folder, picture = chosen.scene.resolve().parent, chosen.out.with_suffix(".png")
    check_species(settings, folder)
    site = ForestSite(settings, folder, inputs=read_inputs(settings, folder))  # no tree is grown
    claim(chosen.out, picture)
    started = time.perf_counter()
    stand = site.plan()
    took = time.perf_counter() - started
    names = labels(settings.plantings)
    width = max([8, *map(len, names)])
    lines = [
        f"{'species':<{width}}{'expected':>14}{'trees':>11}{'trees/ha':>11}"
        f"{'too near':>10}{'no ground':>11}{'off field':>11}"
    ]
    counts, density = stand.counts(), stand.density() * 1e4
    for k, name in enumerate(names):
        error = f" ±{stand.error[k]:.2g}" if stand.error[k] else ""
        lines.append(
            f"{name:<{width}}{f'{stand.expected[k]:,.1f}{error}':>14}{counts[k]:>11,}{density[k]:>11,.1f}"
            f"{stand.too_near[k]:>10,}{stand.off_ground[k]:>11,}{stand.off_field[k]:>11,}"
        )
    if len(names) > 1:
        lines.append(
            f"{'together':<{width}}{f'{stand.expected.sum():,.1f}':>14}{len(stand):>11,}"
            f"{density.sum():>11,.1f}{stand.removed:>10,}{stand.off_ground.sum():>11,}"
            f"{stand.off_field.sum():>11,}"
        )
    for line in (*site.inputs.told, *lines):
        print(line)
    stages = Stages(quiet=False)
    named = zip(names, settings.plantings, strict=True)
    said = [f"{name}: {one}" for name, planting in named for one in idle(planting)]
    for sentence in (*said, *idle_in_scene(settings)):
        stages.warn(sentence)
    if names and not len(stand):
        stages.warn("no tree stands: expect more, or a larger field")
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    write_stand(chosen.out, stand, names, settings.offset, settings.crs)
    write_note(chosen.out.with_name(f"{chosen.out.stem}-{FILE}"), settings.offset, settings.crs)
    if not can_draw():
        print(without("The map is plain"))
    from ..report.page import draw_stand

    picture = draw_stand(stand, names, settings, site.inputs, picture)
    print(f"\nSampled in {took:.2f} s. Wrote {chosen.out} and {picture}")
    note = note_of(settings.offset, settings.crs)
    if note:
        print(note[:1].upper() + note[1:] + ".")
