"""One Blender session, run by test_extension.py: install, enable, use, run commands, disable, look again.

Usage: extension_session.py ARCHIVE FOLDER SCENE.toml, with BLENDER_USER_RESOURCES on an empty folder.
FOLDER/answer.json says where modules come from, what enabling added, what was installed after each command
and what disabling left behind. Commands run as ``blender --command forest`` runs them: the Blender that comes
as a module has no ``--command``; the window's test runs commands through that.
"""

import importlib.util
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module, metadata
from pathlib import Path

import bpy

# Blender's own module, there once bpy is loaded.
import addon_utils  # isort: skip

MODULE = "bl_ext.user_default.forest_sensing"


def main(archive: str, folder: str, scene: str) -> None:
    home = Path(folder)
    lacking = [name for name in ("scipy", "laspy", "lazrs", "cattrs") if not has(name)]
    before = snapshot()
    installed = bpy.ops.extensions.package_install_files(
        filepath=archive, repo="user_default", enable_on_install=True
    )
    enabled = snapshot()
    loaded = addon_utils.check(MODULE)[1]
    local = [folder for folder in sys.path if ".local" in Path(folder).parts]
    origins = {name: import_module(name).__file__ for name in (*lacking, "numpy")}
    wheels = {
        dist.name.replace("-", "_"): dist.version for dist in metadata.distributions(path=local)
    }
    from scipy.special import j1  # compiled code, on this Blender's numpy

    j1(1.0)
    extension = Path(import_module(MODULE).__file__).parent
    tree = files_of(extension)
    with watched() as acts:
        pressed = press_every_button(home / "results")
        typed = type_in_the_console(home / "results" / "typed.laz")
    changed, foreign = sorted(tree ^ files_of(extension)), names_outside(extension)
    seen = run_commands(scene, home / "out")
    disabled = bpy.ops.preferences.addon_disable(module=MODULE)
    result = {
        "lacking": lacking,
        "installed": sorted(installed),
        "loaded": loaded,
        "origins": origins,
        "wheels": wheels,
        "added": sorted(enabled - before),
        "pressed": pressed,
        "typed": typed,
        "written": sorted(acts["written"]),
        "suspicious": sorted(acts["suspicious"]),
        "own_folder": bpy.utils.extension_path_user(MODULE),
        "temporary": [bpy.app.tempdir, tempfile.gettempdir()],
        "changed": changed,
        "foreign_names": foreign,
        "seen": seen,
        "disabled": sorted(disabled),
        "still_loaded": addon_utils.check(MODULE)[1],
        "left": sorted(snapshot() - before),
        "lost": sorted(before - snapshot()),
    }
    (home / "answer.json").write_text(json.dumps(result, indent=1))


@contextmanager
def watched() -> Iterator[dict[str, set[str]]]:
    """What Python opens for writing meanwhile, and whether it asks the network or starts programs."""
    acts: dict[str, set[str]] = {"written": set(), "suspicious": set()}
    watching = True

    def hear(event: str, arguments: tuple) -> None:
        if not watching:
            return
        if event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
            path, mode, flags = arguments
            if set(mode or "") & set("wxa+") or (flags or 0) & (os.O_WRONLY | os.O_RDWR):
                acts["written"].add(os.fsdecode(path))
        elif event in ("os.mkdir", "os.rename"):
            acts["written"].add(os.fsdecode(arguments[event == "os.rename"]))
        elif event.split(".")[0] in (
            "socket",
            "urllib",
            "http",
            "ftplib",
            "subprocess",
            "webbrowser",
        ):
            acts["suspicious"].add(event)

    sys.addaudithook(hear)
    yield acts
    watching = False


def files_of(folder: Path) -> set[str]:
    """Every file below a folder with its size and time; what Python itself compiles is left out."""
    return {
        f"{file} {file.stat().st_size} {file.stat().st_mtime_ns}"
        for file in folder.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }


def names_outside(extension: Path) -> list[str]:
    """Modules of the extension that go by a name outside its own."""
    return sorted(
        name
        for name, module in list(sys.modules.items())
        if str(getattr(module, "__file__", None) or "").startswith(str(extension))
        and name.split(".forest_addon")[0] != MODULE
    )


def press_every_button(folder: Path) -> dict[str, list[str]]:
    """Builds a small forest and runs each sensor; then an empty file, as it was before.

    The answer of each operator, the kinds of what it left in the panel, and the files that were saved.
    """
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    props = bpy.context.scene.forest_sensing
    props.forest.size = (6, 6)
    planting = props.plantings.add()
    planting.species = "hazelnut"
    planting.use_expected, planting.expected = True, 3
    coarse = {
        "terrestrial": ("cloud", "angle_step_deg", 6),
        "tractor": ("scan", "step", 1),
        "sonar": ("echo", "max_range", 5),
        "reverb": ("reverb", "duration", 0.1),
    }
    for kind, (name, key, value) in coarse.items():
        bpy.ops.forest.add_sensor(kind=kind)
        bpy.context.view_layer.objects.active.name = name
        setattr(getattr(bpy.data.objects[name].forest_sensor, kind), key, value)
    props.output = str(folder)
    pressed = {"build": sorted(bpy.ops.forest.build())}
    for name, _, _ in coarse.values():
        pressed[name] = sorted(bpy.ops.forest.run(sensor=name))
    pressed["results"] = sorted(result.name for result in props.results)
    pressed["objects"] = sorted({obj.type for obj in bpy.data.objects})
    pressed["files"] = sorted(file.name for file in folder.iterdir())
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    return pressed


def type_in_the_console(path: Path) -> dict[str, bool]:
    """The Python API from the installed extension; whether each audit is within what was asked."""
    forest = import_module(f"{MODULE}.forest_addon.api")
    bush = forest.Planting(species="hazelnut", variants=1, expected=3, exact=True)
    forest.build(forest.Scene(seed=1, plantings=(bush,)))
    world = forest.current()
    cloud = world.scan(forest.Terrestrial(position=(0, 0, 1.6), angle_step_deg=5))
    echo = world.ping(forest.Sonar(position=(3, 0, 1.5), max_range=6))
    clap = forest.Reverb(source=(0, 0, 1.5), receiver=(9, 0, 1.5), duration=0.1)
    sound = world.impulse_response(clap)
    cloud.save(path)
    kept = {r.sensor.kind: bool(r.audit.kept) for r in (cloud, echo, sound)}
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    return kept | {"saved": path.stat().st_size > 500}


def run_commands(scene: str, out: Path) -> list[dict[str, object]]:
    """What the extension brought, as it lies on the disk, before and after each command; an empty file."""
    command = import_module(f"{MODULE}.forest_addon.ui.settings.preferences")
    local = Path(bpy.utils.user_resource("EXTENSIONS")) / ".local"
    folders = [str(path) for path in local.rglob("site-packages")]
    own = ["--scanner", "riegl-vz-400i", "--at", "5,5,1.6", "--set", "angle_step_deg=5.0"]
    seen: list[dict[str, object]] = []
    for words in (
        [],
        ["run", scene, "--out", str(out), "--quiet"],
        ["lidar", str(out / "forest.blend"), *own, "--out", str(out / "own.laz"), "--quiet"],
        ["stand", scene, "--out", str(out / "points.csv")],
    ):
        code = command.run(words) if words else 0
        packages = sorted({dist.name for dist in metadata.distributions(path=folders)})
        enabled = addon_utils.check(MODULE)
        seen.append({"code": code, "packages": packages, "enabled": enabled})
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    return seen


def has(name: str) -> bool:
    return importlib.util.find_spec(name) is not None


def snapshot() -> set[str]:
    """Names of all that an add-on can add to Blender: what it registers, hooks, appends, binds and makes."""
    names = set()
    for name in dir(bpy.types):
        kind = getattr(bpy.types, name)
        names.add(f"class {name}")
        if hasattr(kind, "bl_rna"):
            names.update(f"property {name}.{key.identifier}" for key in kind.bl_rna.properties)
        for drawer in getattr(getattr(kind, "draw", None), "_draw_funcs", []):
            if not drawer.__module__.startswith(
                "bl_ui."
            ):  # Blender's own, listed at the first append
                names.add(f"drawn in {name}: {drawer}")
    for room in dir(bpy.ops):
        names.update(f"operator {room}.{name}" for name in dir(getattr(bpy.ops, room)))
    for name in dir(bpy.app.handlers):
        hooked = getattr(bpy.app.handlers, name)
        if isinstance(hooked, list):
            names.update(f"handler {name}: {handler}" for handler in hooked)
    for configuration in bpy.context.window_manager.keyconfigs:
        for keymap in configuration.keymaps:
            names.update(f"key {keymap.name}: {item.idname}" for item in keymap.keymap_items)
    for collection in (getattr(bpy.data, name) for name in dir(bpy.data)):
        if isinstance(collection, bpy.types.bpy_prop_collection):
            names.update(f"data {block!r}" for block in collection)
    names.update(f"add-on {addon.module}" for addon in bpy.context.preferences.addons)
    return names


if __name__ == "__main__":
    main(*sys.argv[1:])
