"""Records what a version of the product gives, one line a fact, sorted, for ``diff`` against another's.

Parts: ``spec`` (keys with types and defaults), ``api`` (names and signatures), ``panel`` (operators, panels
and their properties), ``help`` (of every command), ``outputs`` (hashes of what the scenes of assets/scenes
give at two seeds through command, Python and panel), ``others`` (hashes of what other commands write),
``errors`` (of each simulator at each tolerance against its own direct sum).

    PYTHONPATH=. python packaging/record.py spec api panel help > before.txt
    PYTHONPATH=. python packaging/record.py outputs --scenes demo hedge-bat > before.txt
    PYTHONPATH=. python packaging/record.py > all.txt      # about eight minutes of one core

Scenes are run small: few trees and variants, coarse scans, no pictures. Arrays of .npz are facts of their
own, with size and root mean square, so that a sound that moved below its tolerance is told from one that is
wrong. Left out is what differs between runs: dates, seconds, memory, versions, the folder, and whole files
that hold a date or a number of their own (.mat, .e57, .blend), pictures and report.html.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hashlib
import inspect
import io
import json
import os
import re
import shutil
import tempfile
import typing
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from forest_addon import api as forest, spec
from forest_addon.formats.toml_file import write_settings
from headless.cli import main as headless

ROOT = Path(__file__).resolve().parent.parent
SCENES = ROOT / "assets" / "scenes"
SEEDS = (1, 2)
COARSE = {  # settings of sensors, and what they are at least or at most
    "angle_step_deg": (2.0, max),
    "pulse_rate": (2000.0, min),
    "line_rate": (20.0, min),
    "step": (0.02, max),
    "sample_rate": (250e3, min),
    "continue_to": (60.0, min),
    "tolerance": (1e-5, max),
}
UNSAID = ("seconds", "memory", "versions", "platform", "cores", "settings", "files")  # keys of JSON
Facts = Iterator[tuple[str, object]]


def main() -> None:
    """Print the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("part", nargs="*", help=f"{', '.join(PARTS)}; default all")
    parser.add_argument(
        "--scenes", nargs="+", default=sorted(p.stem for p in SCENES.glob("*.toml"))
    )
    chosen = parser.parse_args()
    if unknown := set(chosen.part) - set(PARTS):
        parser.error(f"{', '.join(unknown)} is no part; use {', '.join(PARTS)}")
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what commands and Blender say does not belong to the record
    for part in chosen.part or PARTS:
        facts = PARTS[part](chosen.scenes) if part == "outputs" else PARTS[part]()
        for key, value in sorted((key, str(value)) for key, value in facts):
            print(part, key, value, file=out, flush=True)


def spec_facts() -> Facts:
    """Every setting with its type, unit, range and default."""
    for name in sorted(dir(spec)):
        group = getattr(spec, name)
        if not (inspect.isclass(group) and issubclass(group, spec.Settings)):
            continue
        if not dataclasses.is_dataclass(group):
            continue
        hints = typing.get_type_hints(group)
        for field in dataclasses.fields(group):
            known = spec.param_of(field)
            kind = re.sub(r"\b[a-z_]+(\.[a-z_]+)*\.(?=[A-Z])", "", str(hints[field.name]))
            default = "needed" if known.required else repr(field.default)
            allowed = known.choices or known.allowed()
            yield f"{name}.{field.name}", f"{kind} [{known.unit}] {allowed} default {default}"


def api_facts() -> Facts:
    """Names of the Python API, with the signatures of what is called."""
    for name in forest.__all__:
        thing = getattr(forest, name)
        yield name, signature_of(thing)
        if not inspect.isclass(thing) or issubclass(thing, spec.Settings):
            continue
        for member in sorted(dir(thing)):
            if not member.startswith("_"):
                yield f"{name}.{member}", signature_of(inspect.getattr_static(thing, member))


def signature_of(thing: object) -> str:
    """The signature of a function, method or class, or the kind of anything else."""
    thing = getattr(thing, "__func__", thing)
    if not callable(thing):
        return type(thing).__name__
    try:
        return re.sub(" at 0x[0-9a-f]+", "", str(inspect.signature(thing)))
    except ValueError:
        return type(thing).__name__


def panel_facts() -> Facts:
    """Operators with their properties, panels, and properties of scenes and objects."""
    with panel():
        for name in dir(bpy.ops.forest):
            kind = getattr(bpy.ops.forest, name).get_rna_type()
            yield f"operator {name}", kind.name
            for known in list(kind.properties)[1:]:
                yield f"operator {name}.{known.identifier}", described(known)
        for name in dir(bpy.types):
            if re.match("(FOREST|VIEW3D|OBJECT|SCENE)_(PT|UL|MT)_forest|FOREST_(PT|UL|MT)", name):
                yield f"panel {name}", getattr(getattr(bpy.types, name), "bl_label", "")
        for owner, name in (
            (bpy.types.Scene, "forest_sensing"),
            (bpy.types.Object, "forest_sensor"),
        ):
            yield from settings_below(f"property {name}", owner.bl_rna.properties[name].fixed_type)


def settings_below(path: str, kind: bpy.types.Struct) -> Facts:
    """Properties of a group and of groups in it."""
    for known in list(kind.properties)[2:]:
        yield f"{path}.{known.identifier}", described(known)
        base = known.fixed_type.base if known.type in ("POINTER", "COLLECTION") else None
        if base is not None and base.identifier == "PropertyGroup":
            yield from settings_below(f"{path}.{known.identifier}", known.fixed_type)


def described(known: bpy.types.Property) -> str:
    """The type, default and label of a property."""
    default = getattr(known, "default", "")
    if getattr(known, "is_array", False):
        default = list(known.default_array)
    return f"{known.type} {default!r} {known.name!r}"


def help_facts() -> Facts:
    """Lines of the help of the program and of every command."""
    os.environ["COLUMNS"] = "100"
    listed = helped("--help")
    names = re.findall(r"^    ([a-z-]+) ", listed, re.MULTILINE)
    for name in ["", *names]:
        text = helped(*([name] if name else []), "--help")
        for number, line in enumerate(text.splitlines()):
            yield f"{name or 'program'} {number:03}", line


def helped(*words: str) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        headless(words)
    return said.getvalue()


def output_facts(scenes: list[str]) -> Facts:
    """Hashes of what each scene gives by command, by Python and by the panel."""
    for name in scenes:
        with tempfile.TemporaryDirectory() as folder:
            home = Path(folder)
            scene = small(forest.read(SCENES / f"{name}.toml"), home)
            file = home / f"{name}.toml"
            write_settings(file, scene)
            for seed in SEEDS:
                for door in (by_command, by_python, by_panel):
                    out = home / f"{seed}-{door.__name__[3:]}"
                    out.mkdir()
                    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
                    try:
                        door(file, seed, out)
                    except Exception as problem:
                        yield f"{name} {seed} {door.__name__[3:]} failed", repr(problem)
                    for key, value in folder_facts(out, home):
                        yield f"{name} {seed} {door.__name__[3:]} {key}", value
                    shutil.rmtree(out)


def small(scene: forest.Scene, home: Path) -> forest.Scene:
    """The scene with fewer trees, coarser sensors, two poses of a route and no pictures."""
    plantings = tuple(
        dataclasses.replace(
            planting,
            variants=min(planting.variants, 2),
            expected=min(planting.expected or 4.0, 4.0),
            rows=dataclasses.replace(planting.rows, trees=min(planting.rows.trees, 4)),
        )
        for planting in scene.plantings
    )
    stems = tuple(dataclasses.replace(each, count=min(each.count, 3000)) for each in scene.stems)
    nothing = {"blend": False, "preview": False, "pictures": False, "report": False}
    return scene.changed(
        plantings=plantings,
        stems=stems,
        sensors=tuple(coarse(sensor, home) for sensor in scene.sensors),
        output=dataclasses.replace(scene.output, **nothing, qsm=bool(plantings)),
    )


def coarse(sensor: forest.Sensor, home: Path) -> forest.Sensor:
    """The sensor with coarser settings; a folder gets its shorter route."""
    changes = {
        key: choose(getattr(sensor, key), value)
        for key, (value, choose) in COARSE.items()
        if isinstance(getattr(sensor, key, None), float)
    }
    if sensor.kind == "reverb":
        changes["duration"] = 0.25
    if getattr(sensor, "route", ""):
        lines = Path(sensor.route).read_text("utf-8").splitlines(keepends=True)
        changes["route"] = str(home / "route.csv")
        (home / "route.csv").write_text("".join(lines[:3]), "utf-8")
    return dataclasses.replace(sensor, **changes)


def by_command(file: Path, seed: int, out: Path) -> None:
    """Run a scene file as ``headless run`` does."""
    command("run", str(file), "--seed", str(seed), "--out", str(out), "--quiet")


def by_python(file: Path, seed: int, out: Path) -> None:
    """Build it, look with each sensor, and save results in every format."""
    world = forest.build(forest.read(file).changed(seed=seed))
    for sensor in world.scene.sensors:
        result = world.look(sensor)
        for ending in result.endings:
            try:
                result.save(out / f"{sensor.name}{ending}")
            except forest.SpecError as problem:  # a library that is not installed
                (out / f"{sensor.name}{ending}.txt").write_text(problem.problem)
        (out / f"{sensor.name}.json").write_text(json.dumps(result.record()))


def by_panel(file: Path, seed: int, out: Path) -> None:
    """Open it in the panel, press the buttons, and export results and the scene."""
    with panel():
        ops, scene = bpy.ops.forest, bpy.context.scene
        ops.load_scene(filepath=str(file))
        scene.forest_sensing.seed = seed
        scene.forest_sensing.output = str(out)
        ops.build()
        for sensor in forest.read(file).sensors:
            ops.run(sensor=sensor.name)
        ops.save_scene(filepath=str(out / "scene.toml"))


@contextlib.contextmanager
def panel() -> Iterator[None]:
    """The extension, registered."""
    from forest_addon import ui

    ui.register()
    try:
        yield
    finally:
        ui.unregister()


def command(*words: str) -> None:
    """Run a command, which has to end well."""
    code = headless(words)
    if code not in (0, 3, 5):
        raise SystemExit(f"{' '.join(words)} ended with {code}")


def folder_facts(out: Path, home: Path) -> Facts:
    """Hashes of all files below a folder, of what does not differ between runs."""
    for file in sorted(path for path in out.rglob("*") if path.is_file()):
        name = file.relative_to(out).as_posix()
        if file.suffix == ".npz":
            with np.load(file) as arrays:
                for key in arrays.files:
                    yield f"{name} {key}", array_fact(arrays[key])
        elif file.suffix == ".json":
            for key, value in leaves_of(json.loads(file.read_text("utf-8"))):
                yield f"{name} {key}", without(str(value), home)
        elif file.suffix not in (".png", ".blend", ".html", ".mat", ".e57"):
            data = file.read_bytes()
            if file.suffix in (".toml", ".csv", ".xml", ".txt", ".md", ".obj", ".mtl"):
                data = without(data.decode("utf-8"), home).encode()
            yield name, hashed(data)


def array_fact(values: np.ndarray) -> str:
    """Type, shape, hash, and root mean square of an array; a text as it is."""
    if values.dtype.kind == "U" and not values.ndim:
        return str(values)
    said = f"{values.dtype} {values.shape} {hashed(np.ascontiguousarray(values).tobytes())}"
    if values.dtype.kind not in "fc" or not values.size:
        return said
    finite = np.abs(values[np.isfinite(values)])
    return f"{said} rms {np.sqrt(np.mean(finite**2)):.5g}" if len(finite) else said


def leaves_of(value: object, path: str = "") -> Facts:
    """Values of JSON by their paths, without those that differ between runs."""
    if isinstance(value, dict) and "checks" in value:  # an audit
        for check in value["checks"]:
            yield (
                f"{path} {check['what']}",
                f"{check['error']:.0e} {check['unit']}, {check['kept']}",
            )
    elif isinstance(value, dict | list):
        inside = value.items() if isinstance(value, dict) else enumerate(value)
        for key, each in inside:
            if not any(word in str(key) for word in UNSAID):
                yield from leaves_of(each, f"{path}.{key}" if path else str(key))
    elif isinstance(value, float):  # of an error only its size: its digits are rounding
        yield path, f"{value:.0e}" if re.search("error|rms", path) else f"{value:.5g}"
    else:
        yield path, value


def without(text: str, home: Path) -> str:
    """A text without the folders of this machine."""
    return text.replace(str(home), "TEMP").replace(str(ROOT), "ROOT")


def hashed(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def other_facts() -> Facts:
    """Hashes of derived strings, and of what commands beside ``run`` write."""
    for species in sorted(path.stem for path in (ROOT / "assets" / "species").glob("*.toml")):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            headless(("derive", species, "--seed", "3"))
        yield f"derive {species}", hashed(said.getvalue().encode())
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        file = home / "small.toml"
        write_settings(file, small(forest.read(SCENES / "demo.toml"), home))
        flight, trees = SCENES / "flight-hedge.toml", SCENES / "rioja-pines.csv"
        windy = home / "windy.toml"
        write_settings(windy, in_wind(small(forest.read(SCENES / "demo.toml"), home)))
        every = home / "every.toml"
        kinds = sorted(path.stem for path in (ROOT / "assets" / "species").glob("*.toml"))
        one = {"variants": 1, "expected": 1.0, "exact": True}
        planted = tuple(forest.Planting(species=kind, **one) for kind in kinds)
        nothing = dataclasses.replace(small(forest.Scene(), home).output, glb=False)
        write_settings(every, forest.Scene(plantings=planted, output=nothing))
        for words in (
            ("run", str(every), "--quiet", "--out", str(home / "every")),
            ("run", str(windy), "--quiet", "--out", str(home / "wind")),
            ("stand", str(SCENES / "demo.toml"), "--out", str(home / "stand" / "points.csv")),
            ("canopy", str(file), "--grid", "2", "--out", str(home / "canopy")),
            ("export", str(file), "--quiet", "--out", str(home / "export")),
            (
                "estimate",
                str(trees),
                "--species",
                "spruce",
                "--out",
                str(home / "estimate" / "s.toml"),
            ),
            (
                "fly",
                str(flight),
                "--policy",
                "echo",
                "--episodes",
                "1",
                "--no-blend",
                "--out",
                str(home / "fly"),
            ),
        ):
            try:
                command(*words)
            except Exception as problem:
                yield f"{' '.join(words[:1])} {Path(words[1]).stem} failed", repr(problem)
        for part in ("every", "wind", "stand", "canopy", "export", "estimate", "fly"):
            for key, value in folder_facts(home / part, home):
                yield f"{part} {key}", value


def in_wind(scene: forest.Scene) -> forest.Scene:
    """The scene in wind, with scans and pings in which things move meanwhile."""
    sensors = [
        dataclasses.replace(sensor, motion=True) if hasattr(sensor, "motion") else sensor
        for sensor in scene.sensors
    ]
    return scene.changed(wind=forest.Wind(speed=8.0), sensors=tuple(sensors))


def error_facts() -> Facts:
    """Errors against the direct sums (``tolerance`` 0), of engines against each other, and audits."""
    scene = small(forest.read(SCENES / "demo.toml"), Path())
    tractor, tripod, bat, clap = scene.sensors
    ranges = {}
    for engine in ("embree", "bvhtree"):
        world = forest.build(scene.changed(rays=forest.Rays(engine=engine)))
        for scanner in (tractor, tripod):
            result = world.look(scanner)
            yield from audit_facts(f"lidar {scanner.kind} {engine}", result)
        ranges[engine] = result.points
    apart = np.abs(ranges["embree"] - ranges["bvhtree"]).max()
    yield "lidar embree against bvhtree, m", f"{apart:.0e}"
    for model in ("exact", "piston", "paper"):
        for changes in ({"wood": False, "facets": False}, {"shading": "trunks+extinction"}):
            sensor = dataclasses.replace(bat, leaf_model=model, max_range=8.0, **changes)
            yield from sound_errors(
                world, sensor, f"sonar {model} {'alone' if 'wood' in changes else 'all'}"
            )
    for model in ("paper", "forest"):
        sensor = dataclasses.replace(clap, model=model, tail="none", duration=0.1)
        yield from sound_errors(world, sensor, f"reverb {model}")


def sound_errors(world: forest.World, sensor: forest.Sensor, name: str) -> Facts:
    """Errors of a sonar's spectra or a reverb's samples by tolerance, L2, as a share of the exact ones."""

    def heard(**changes: object) -> np.ndarray:
        found = world.look(dataclasses.replace(sensor, **changes))
        return np.asarray(found.samples if sensor.kind == "reverb" else found.pings[0].spectra)

    culled = {"cull": 0.0} if sensor.kind == "sonar" else {}
    exact = heard(tolerance=0.0, **culled)
    size = float(np.linalg.norm(exact))
    yield f"{name} 0 size", f"{size:.6g}"
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-6):
        off = float(np.linalg.norm(heard(tolerance=tolerance, **culled) - exact)) / size
        yield f"{name} {tolerance:.0e} error", f"{off:.1e}"


def audit_facts(name: str, result: forest.Result) -> Facts:
    """Sentences of a result's audit."""
    for key, value in leaves_of(result.record()):
        yield f"{name} {key}", value


PARTS = {
    "spec": spec_facts,
    "api": api_facts,
    "panel": panel_facts,
    "help": help_facts,
    "outputs": output_facts,
    "others": other_facts,
    "errors": error_facts,
}

if __name__ == "__main__":
    main()
