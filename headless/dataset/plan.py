"""A plan: base scenes, what varies in them, and for every scene of the dataset the recipe that follows.

A recipe is all that decides the bytes of a scene: settings, seed, ground, rules for sensors, what is
kept, and the content of every file that it names; its digest is their SHA-256. Which scene goes to which
split is dealt by the golden ratio, so that every run of scenes has nearly the shares that were asked
for, and a larger count leaves earlier scenes where they are.

Keys are dotted paths into tables, such as ``air.humidity``, ``sensors[tls].angle_step_deg`` and
``plantings[*].scale[0]``: an index is a number, the name of an entry (its ``name``, ``sensor`` or
``species``), or ``*`` for all.

Trees of templates, of crowns and of Honda's branches with a spread of lengths draw numbers that no two
share. Of all other species two trees are grown and compared: one that knows no chance is one tree in
every split.
"""

from __future__ import annotations

import copy
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import (
    idle_in_sensor,
    later,
    parse_tables,
    read_settings,
    read_tables,
    structure,
    table_of,
    without_version,
)
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.tree import grow
from forest_addon.results.kinds import files_of
from forest_addon.sensing import kinds as _kinds  # noqa: F401  whose words a plan may name
from forest_addon.spec import (
    Accuracy,
    Mobile,
    Output,
    Scene,
    SpecError,
    Species,
    refuse_unknown,
    unknown,
)
from forest_addon.spec.base import Settings, with_files
from forest_addon.spec.choices import idle, idle_in_scene

from . import vary
from .place import refuse_out_of_range
from .settings import Ground, Head, Keep, Mix, Placing, Running, Splits
from .vary import randomised


@cache
def knows_chance(name: str, folder: Path) -> bool:
    """Return whether two trees of a species differ."""
    path = find_species(name, folder)
    species = read_settings(path, Species)
    if species.template is not None or species.crown is not None or species.targets is not None:
        return True
    if species.rules is None and species.honda is not None and species.honda.length.sd > 0:
        return True
    kind = load_species(path)
    one, other = (grow(*kind, stream(0, "chance", number)).mesh.vertices for number in (1, 2))
    return not np.array_equal(one, other)


STEP = re.compile(r"([A-Za-z_]\w*)((?:\[[^\[\]]+\])*)")
NAMES = ("name", "sensor", "species", "kind")


def put(table: dict[str, Any], path: str, value: Any) -> None:
    """Set what a path means, in place; tables on the way are made, entries of lists must be there.

    Raises
    ------
    SpecError : it is no path, or leads to an entry that there is not; says which there are.
    """
    *way, last = _steps(path)
    places: list[Any] = [table]
    for step in way:
        places = [
            place[key] if step.startswith("[") else place.setdefault(key, {})
            for place in places
            for key in _keys(place, step, path)
        ]
    for place in places:
        for key in _keys(place, last, path):
            place[key] = value


def _steps(path: str) -> list[str]:
    steps: list[str] = []
    for word in path.split("."):
        step_match = STEP.fullmatch(word)
        if step_match is None:
            raise SpecError(
                path, 'is no path; write one as air.humidity or "sensors[tls].angle_step_deg"'
            )
        steps += [step_match[1], *re.findall(r"\[[^\[\]]+\]", step_match[2])]
    return steps


def _keys(place: Any, step: str, path: str) -> Sequence[Any]:
    """Keys of a table, or numbers of a list's entries, that one step means."""
    if not step.startswith("["):
        if not isinstance(place, dict):
            raise SpecError(
                path, f"{step} is asked of what is no table; an entry of a list is [0] or [name]"
            )
        return [step]
    if not isinstance(place, list):
        raise SpecError(path, f"{step} is asked of what is no list in the base scene")
    word = step[1:-1]
    if word == "*":
        return range(len(place))
    if word.isdigit():
        indices = [int(word)] if int(word) < len(place) else []
    else:
        indices = [
            number
            for number, entry in enumerate(place)
            if isinstance(entry, dict) and word in [entry.get(key) for key in NAMES]
        ]
    if not indices:
        there = [
            next((str(entry[key]) for key in NAMES if key in entry), str(number))
            for number, entry in enumerate(place)
            if isinstance(entry, dict)
        ]
        raise SpecError(
            path, f"[{word}] is not there; use one of {', '.join(there) or 'none'}, or *"
        )
    return indices


SHEDDING = (  # measured kinds (assets/allometry) that lose their leaves in a winter
    *("acer", "betula", "corylus", "deciduous-broadleaf", "deciduous-conifer", "fagus", "larix"),
    *("malus", "populus", "quercus"),
)


def mixed(mix: Mix, species: Sequence[str], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Draw plantings of some of the species, with shares of the mix's density."""
    most = min(mix.kinds[1], len(species))
    kinds = int(rng.integers(min(mix.kinds[0], most), most + 1))
    chosen = sorted(rng.permutation(len(species))[:kinds].tolist())
    shares = rng.dirichlet(np.full(kinds, mix.evenness))
    return [
        {
            "species": species[which],
            "density": float(mix.density * share),
            "variants": mix.variants,
            "scale": list(mix.scale),
        }
        for which, share in zip(chosen, shares, strict=True)
    ]


def redealt(
    plantings: Sequence[Mapping[str, Any]], parameter: float, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Deal the densities of plantings anew: their sum stays, and the mean of every share.

    parameter : of the Dirichlet distribution, times the number of plantings. Plantings without a density
    stay as they are.
    """
    dealt = [dict(one) for one in plantings]
    dense = [one for one in dealt if one.get("density")]
    if len(dense) > 1:
        density = np.array([float(one["density"]) for one in dense])
        shares = rng.dirichlet(parameter * len(dense) * density / density.sum())
        for one, value in zip(dense, (shares * density.sum()).tolist(), strict=True):
            one["density"] = value
    return dealt


def in_season(
    plantings: Sequence[Mapping[str, Any]], season: float, folder: Path
) -> list[dict[str, Any]]:
    """Set the season of the plantings whose species sheds its leaves. folder : of the scene."""
    return [
        {**one, "season": season} if _sheds(str(one["species"]), folder) else dict(one)
        for one in plantings
    ]


@cache
def _sheds(name: str, folder: Path) -> bool:
    """Return whether a species is of a measured kind that loses its leaves."""
    species = read_settings(find_species(name, folder), Species)
    return species.targets is not None and species.targets.allometry in SHEDDING


PLANS = ASSETS / "plans"
TABLES = ("scene", "scenes", "vary", "mix", "terrain", "place", "splits", "keep", "run")
OWN = ("mix", "terrain", "place")  # tables of a plan whose keys may vary, beside the scene's
SPLITS = ("train", "validation", "test")
GOLDEN = (5**0.5 - 1) / 2
LOOKED_AT = 8  # scenes, in which a setting without effect is looked for


@dataclass(frozen=True)
class Base:
    """A base scene: its name, its table, how often it is taken relative to others."""

    name: str
    table: dict[str, Any]
    folder: Path
    weight: float


@dataclass(frozen=True)
class Recipe:
    """One scene of a dataset, all that decides its bytes.

    scene : its settings as a scene file's table. folder : that file names in it start from.
    ground, places, keep : tables of the plan. library : how many trees of each species are shared, and their
    seed. varied : what was drawn, for the histograms. digest : SHA-256 of all of it.
    """

    number: int
    split: str
    seed: int
    base: str
    scene: dict[str, Any]
    folder: str
    ground: Ground
    places: list[Placing]
    keep: Keep
    library: tuple[int, int] | None
    varied: dict[str, Any]
    digest: str = ""

    @property
    def name(self) -> str:
        """The name of its folder."""
        return f"{self.number:06d}"

    def settings(self) -> Scene:
        """The scene as settings, before ground and sensors are placed."""
        return structure(copy.deepcopy(self.scene), Scene, Path(self.folder))


@dataclass(frozen=True)
class Plan:
    """A plan as it was read. ``tables`` are what was written, overrides included, base scenes within."""

    path: Path
    head: Head
    bases: tuple[Base, ...]
    varied: tuple[vary.Varied, ...]
    own: dict[str, Any]
    splits: Splits
    keep: Keep
    running: Running
    tables: dict[str, Any]

    @property
    def count(self) -> int:
        """Number of its scenes."""
        return self.head.count or vary.cells_of_grid(self.varied)


def find_plan(name: str) -> Path:
    """A plan file, or a plan of ``assets/plans`` by its name.

    Raises
    ------
    SpecError : neither is there.
    """
    path, presets = Path(name), sorted(preset.stem for preset in PLANS.glob("*.toml"))
    if path.is_file() or path.suffix == ".toml":
        return path
    if name not in presets:
        raise unknown("plan", name, presets, ", or a .toml file")
    return PLANS / f"{name}.toml"


def read_plan(path: Path, overrides: Sequence[str] = ()) -> Plan:
    """Read a plan; ``overrides`` are KEY=VALUE, of any dotted path within it.

    Raises
    ------
    SpecError : the file, the key, and what is allowed.
    """
    tables, written = without_version(read_tables(path), str(path))
    try:
        for said in overrides:
            key, equals, value = said.partition("=")
            if not equals:
                raise SpecError("--set", f'"{said}" must be KEY=VALUE')
            try:
                parsed = parse_tables(f"value = {value}", "--set")["value"]
            except SpecError:
                parsed = value
            key = key.strip()
            if key.startswith("vary."):  # what follows is one key, dots and all
                tables.setdefault("vary", {})[key.removeprefix("vary.")] = parsed
            else:
                put(tables, key, parsed)
        return _plan(path, tables)
    except SpecError as problem:
        raise SpecError(str(path), f"{problem.key}: {problem.problem}{later(written)}") from None


def _plan(path: Path, tables: dict[str, Any]) -> Plan:
    head = {key: value for key, value in tables.items() if key not in TABLES}
    head_fields = {field.name for field in fields(Head)}
    refuse_unknown(sorted(head), [*sorted(head_fields), *TABLES])
    bases = _bases(tables, path.parent)
    tables = {key: value for key, value in tables.items() if key not in ("scene", "scenes")}
    tables["scenes"] = [
        {"name": base.name, "weight": base.weight, "scene": base.table} for base in bases
    ]
    settings = structure(head, Head)
    tables |= {"vary": randomised(settings, [base.table for base in bases], tables)}
    varied = tuple(vary.read_varied(tables["vary"]))
    plan = Plan(
        path=path,
        head=settings,
        bases=bases,
        varied=varied,
        own={key: tables[key] for key in OWN if key in tables},
        splits=_within("splits", tables.get("splits", {}), Splits),
        keep=_within("keep", tables.get("keep", {}), Keep),
        running=_within("run", tables.get("run", {}), Running),
        tables=tables,
    )
    if plan.head.count == 0 and not any(one.kind == "grid" for one in varied):
        raise SpecError(
            "count", "is needed where nothing varies on a grid; give the number of scenes"
        )
    if not isinstance(plan.own.get("place", []), list):
        raise SpecError("place", "is not a list of tables; write [[place]]")
    for number in range(min(plan.count, len(bases))):  # every base at least once
        _resolved(plan, bases[number], vary.draw(varied, plan.head.seed, 1)[0], 0)
    return plan


def _within(key: str, table: Any, kind: type[Settings]) -> Any:
    try:
        return structure(table, kind)
    except SpecError as problem:
        raise SpecError(f"{key}.{problem.key}", problem.problem) from None


def _bases(tables: dict[str, Any], folder: Path) -> tuple[Base, ...]:
    given = tables.get("scenes", [])
    if "scene" in tables:
        given = [{"scene": tables["scene"]}, *given]
    if not given or not isinstance(given, list):
        raise SpecError("scenes", "are missing; give a [scene], or [[scenes]] with file or scene")
    bases = []
    for number, one in enumerate(given):
        place = f"scenes[{number}]"
        if not isinstance(one, dict) or ("file" in one) == ("scene" in one):
            raise SpecError(place, "needs either file or scene")
        refuse_unknown(one, ("name", "file", "scene", "weight"), f"{place}.")
        weight = one.get("weight", 1.0)
        if not isinstance(weight, (int, float)) or not weight > 0:
            raise SpecError(f"{place}.weight", "must be a number above 0")
        table, root = one.get("scene"), folder
        if "file" in one:
            file = folder / str(one["file"])
            table, root = without_version(read_tables(file), str(file))[0], file.parent
        name = str(one.get("name", Path(str(one.get("file", f"scene-{number}"))).stem))
        bases.append(Base(name, table, root.resolve(), float(weight)))
    return tuple(bases)


def recipes(plan: Plan, numbers: Sequence[int] | None = None) -> list[Recipe]:
    """The recipe of every scene, or of some.

    Raises
    ------
    SpecError : a scene whose values cannot be used; says which.
    """
    drawn = vary.draw(plan.varied, plan.head.seed, plan.count)
    drawn_recipes = []
    for number in range(plan.count) if numbers is None else numbers:
        base = _base_of(plan, number)
        try:
            drawn_recipes.append(_recipe(plan, number, base, drawn[number]))
            if drawn_recipes[-1].scene.get("tiles"):
                raise SpecError("tiles", "are for one large field (headless run); take them away")
        except SpecError as problem:
            raise SpecError(
                str(plan.path), f"scene {number:06d}: {problem.key}: {problem.problem}"
            ) from None
    if not plan.splits.share_trees:
        splits: dict[tuple[str, Path], set[str]] = {}
        for recipe in drawn_recipes:
            for planting in recipe.scene.get("plantings", []):
                key = str(planting["species"]), Path(recipe.folder)
                splits.setdefault(key, set()).add(recipe.split)
        for (name, folder), names in splits.items():
            if len(names) > 1 and not knows_chance(name, folder):
                raise SpecError(
                    str(plan.path),
                    f'splits: "{name}" knows no chance, so {" and ".join(sorted(names))} would share its '
                    'one tree; choose another species, splits.by = "species", or splits.share_trees = true',
                )
    return drawn_recipes


def _recipe(plan: Plan, number: int, base: Base, drawn: dict[str, Any]) -> Recipe:
    scene, own = _resolved(plan, base, drawn, number)
    seed = int(stream(plan.head.seed, "scene", number).integers(2**63))
    split = split_of(plan, number)
    settings = scene.changed(seed=seed)
    library = None
    if plan.head.library:
        shared = ("library",) if plan.splits.share_trees else ("library", split)
        library = (plan.head.library, int(stream(plan.head.seed, *shared).integers(2**63)))
        plantings = tuple(p.changed(variants=plan.head.library) for p in settings.plantings)
        settings = settings.changed(plantings=plantings)
    varied = {key: value for key, value in drawn.items() if not isinstance(value, (dict,))}
    recipe = Recipe(
        number=number,
        split=split,
        seed=seed,
        base=base.name,
        scene=table_of(settings),
        folder=str(base.folder),
        ground=own["terrain"],
        places=own["place"],
        keep=plan.keep,
        library=library,
        varied=varied,
    )
    told = asdict(recipe)
    del told["folder"]  # where it lies does not matter, what is in it does
    names = {settings.blend} - {""}
    with_files(settings, lambda name: names.add(name) or name)
    told["files"] = {name: _digest_of_file(name, base.folder) for name in names}
    digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
    return replace(recipe, digest=digest)


def _resolved(
    plan: Plan, base: Base, drawn: dict[str, Any], number: int
) -> tuple[Scene, dict[str, Any]]:
    """The scene's settings and the plan's own tables, with what varies put in."""
    tables: dict[str, Any] = {"scene": base.table, "mix": {}, "terrain": {}, "place": []}
    tables = copy.deepcopy(tables | plan.own)
    for path, value in drawn.items():
        own = path.split(".")[0].split("[")[0] in OWN
        put(tables, path if own else f"scene.{path}", copy.deepcopy(value))
    mix = _within("mix", tables["mix"], Mix)
    if mix.species or "plantings" in tables["scene"]:
        own = tables["scene"].get("plantings", [])
        tables["scene"]["plantings"] = _plantings(plan, mix, base, number, own)
    scene = structure(tables["scene"], Scene, base.folder)
    files_of(scene)
    places = []
    for index, one in enumerate(tables["place"]):
        places.append(_within(f"place[{index}]", one, Placing))
        names = [sensor.name for sensor in scene.sensors]
        if places[-1].sensor not in names:
            raise SpecError(
                f"place[{index}].sensor",
                f'"{places[-1].sensor}" is no sensor of the scene; use one of {", ".join(names)}',
            )
        if not plan.keep.empty:
            refuse_out_of_range(scene, places[-1], index)
    ground = _within("terrain", tables["terrain"], Ground)
    return scene, {"mix": mix, "terrain": ground, "place": places}


def idle_in_plan(plan: Plan) -> list[str]:
    """Sentences about settings that have no effect in any of a plan's first scenes."""
    count = min(plan.count, LOOKED_AT)
    drawn = vary.draw(plan.varied, plan.head.seed, count)
    sentences = [_idle_in(plan, number, drawn[number]) for number in range(count)]
    tables = [(key, getattr(plan, key)) for key in ("splits", "keep")]
    always = [f"{key}.{sentence}" for key, group in tables for sentence in idle(group)]
    return always + [one for one in sentences[0] if all(one in other for other in sentences)]


def _idle_in(plan: Plan, number: int, drawn: dict[str, Any]) -> list[str]:
    """Sentences about settings without effect in one scene."""
    base = _base_of(plan, number)
    scene, own = _resolved(plan, base, drawn, number)
    mix, plantings = own["mix"], scene.plantings
    said = [f"mix.{one}" for one in idle(mix)] + [f"terrain.{one}" for one in idle(own["terrain"])]
    said += [f"place[{k}].{one}" for k, place in enumerate(own["place"]) for one in idle(place)]
    scanners = {one.name for one in scene.sensors if isinstance(one, Mobile)}
    said += [
        f"place[{k}].count has no effect on the way of a scanner, which has no poses"
        for k, place in enumerate(own["place"])
        if place.rule == "path" and place.count > 1 and place.sensor in scanners
    ]
    one_tree = not all(knows_chance(one.species, base.folder) for one in plantings)
    looks = ("preview_size", "preview_samples")  # of a scene's picture, which [keep] may ask for
    output = Output(**{name: getattr(scene.output, name) for name in looks})
    idlers = (  # what holds, and what is said then
        (
            mix.redealt and not mix.species and sum(bool(one.density) for one in plantings) < 2,
            "mix.redealt has no effect: it needs two plantings with a density, or more",
        ),
        (
            mix.season and not any(_sheds(one.species, base.folder) for one in plantings),
            "mix.season has no effect: no planting is of a measured kind that sheds leaves",
        ),
        (
            mix.species and plan.head.library and mix.variants != Mix().variants,
            "mix.variants has no effect beside trees of a shared library",
        ),
        (
            plan.splits.share_trees and not plan.head.library and not one_tree,
            'splits.share_trees has no effect: it needs trees = "shared library of N"',
        ),
        (
            scene.output != output,
            "scene.output has no effect in a dataset; [keep] says what is written",
        ),
        (
            scene.accuracy.audit not in (0, Accuracy().audit),
            "scene.accuracy.audit has no effect in a dataset; check it by --check",
        ),
    )
    said += [sentence for holds, sentence in idlers if holds]
    said += [f"scene.{one}" for one in idle_in_scene(scene.changed(output=Output()))]
    over = {
        place.sensor for place in own["place"] if place.rule == "over"
    }  # in strips so far apart
    for one in scene.sensors:
        placed = one.changed(strips=2) if one.name in over else one
        said += [f"{one.name}: {word}" for word in idle_in_sensor(placed, base.folder)]
    return said


def _plantings(
    plan: Plan, mix: Mix, base: Base, number: int, own: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """The plantings of one scene: species of the mix, or the base scene's own, in their season."""
    rng = stream(plan.head.seed, "mix", number)
    if mix.species:
        species = list(mix.species)
        if plan.splits.by == "species":
            species = _dealt(species, plan, "species")[split_of(plan, number)]
        own = mixed(mix, species, rng)
    elif mix.redealt:
        own = redealt(own, mix.redealt, rng)
    return in_season(own, mix.season, base.folder) if mix.season else own


def split_of(plan: Plan, number: int) -> str:
    """The split of a scene."""
    if plan.splits.by == "site":
        sites = _dealt([base.name for base in plan.bases], plan, "site")
        name = _base_of(plan, number).name
        return next(split for split, mine in sites.items() if name in mine)
    place = (stream(plan.head.seed, "split").random() + number * GOLDEN) % 1.0
    ends = np.cumsum([getattr(plan.splits, split) for split in SPLITS])
    return SPLITS[min(int(np.searchsorted(ends, place, "right")), 2)]


def _dealt(things: list[str], plan: Plan, what: str) -> dict[str, list[str]]:
    """Shares of a list by split; every split that is to have scenes has at least one."""
    wanted = [split for split in SPLITS if getattr(plan.splits, split) > 0]
    if len(things) < len(wanted):
        raise SpecError(
            "splits.by",
            f'"{what}" needs at least {len(wanted)} of them, the plan has {len(things)}',
        )
    order = [things[k] for k in stream(plan.head.seed, "deal", what).permutation(len(things))]
    dealt = {split: [order[number]] for number, split in enumerate(wanted)}
    for obj in order[len(wanted) :]:
        lacking = max(wanted, key=lambda s: getattr(plan.splits, s) / len(dealt[s]))
        dealt[lacking].append(obj)
    return {split: sorted(mine, key=things.index) for split, mine in dealt.items()}


def _base_of(plan: Plan, number: int) -> Base:
    weights = np.array([base.weight for base in plan.bases])
    u = stream(plan.head.seed, "base", number).random() * weights.sum()
    return plan.bases[min(int(np.searchsorted(np.cumsum(weights), u, "right")), len(weights) - 1)]


@cache
def _digest_of_file(name: str, folder: Path) -> str:
    """SHA-256 of a file, and of those that a species file names; empty where there is none."""
    ours = [ASSETS / kind / f"{name}.toml" for kind in ("species", "scanners")]
    places = [folder / name, *ours, ASSETS / "scenes" / name]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        return ""
    total = hashlib.sha256(path.read_bytes())
    if path.suffix == ".toml" and path.parent.name != "scanners":
        try:
            species = read_settings(path, Species)
        except SpecError:  # said when it is used
            return total.hexdigest()
        with_files(
            species, lambda own: total.update(_digest_of_file(own, path.parent).encode()) or own
        )
    return total.hexdigest()
