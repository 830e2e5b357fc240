"""The rules of the house: pure rooms know no Blender, arrows point one way, no circles.

Every import counts, also those inside functions: a circle that is hidden there is a circle.
"""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ADDON = ROOT / "forest_addon"
HEADLESS = ROOT / "headless"
PURE = {"base", "spec", "formats", "acoustics", "growth", "stand", "sensing", "results"}
# A room may import only rooms before it. Casters in blender/ fulfil the protocol of sensing/, so
# blender/ stands to the right of it.
ORDER = [
    *("base", "spec", "formats", "acoustics", "growth", "stand", "sensing", "results"),
    *("blender", "api", "flight", "ui"),
]
# Within a room: what a folder may import of its sisters; files at the room's own level may import all.
WINGS = {
    "sensing": {
        "rays": set(),
        "lidar": {"rays"},
        "sonar": {"rays"},
        "reverb": {"rays"},
    },
    "sensing/reverb": {
        "trunks": set(),
        "forest": {"trunks"},
        "sums": {"trunks", "forest"},
    },
    "growth": {
        "mesh": set(),
        "lsystem": set(),
        "template": {"lsystem", "mesh"},
        "measured": {"lsystem", "mesh"},
        "library": {"lsystem", "mesh", "measured", "template"},
    },
    "stand": {
        "intensity": set(),
        "statistics": {"intensity"},
    },
    "blender": {
        "scene": set(),
        "read": {"scene"},
        "rays": {"scene", "read"},
        "show": {"scene", "read"},
        "files": {"scene", "read"},
        "library": {"scene", "read", "rays", "show", "files"},
        "sensors": {"scene", "read", "rays", "show"},
    },
    "ui": {
        "shell": set(),
        "settings": {"shell"},
        "species": {"shell", "settings"},
        "results": {"shell", "settings"},
        "sensors": {"shell", "settings", "results"},
        "forest": {"shell", "settings", "species", "results"},
    },
}
LONGEST = 400  # lines; a file that needs more says here why
LONG = {}
NETWORK = {"socket", "http", "urllib", "requests", "ftplib", "ssl", "smtplib", "aiohttp"}
SOURCES = sorted(ADDON.rglob("*.py"))
ALL = [*SOURCES, *sorted(HEADLESS.rglob("*.py"))]


def room_of(path):
    return path.relative_to(ADDON).with_suffix("").parts[0]


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def import_nodes(path):
    """Every import anywhere in a file, also within functions."""
    kinds = ast.Import | ast.ImportFrom
    return [node for node in ast.walk(tree_of(path)) if isinstance(node, kinds)]


def imports_of(path):
    """(module, level) of every import of a file."""
    for node in import_nodes(path):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, 0
        elif isinstance(node, ast.ImportFrom):
            if node.module is None:
                for alias in node.names:
                    yield alias.name, node.level
            else:
                yield node.module, node.level


def name_of(path):
    """Dotted name of a file, a package by its own name."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def project_imports():
    """{module: modules of the project that it imports}, imports inside functions counted."""
    known = {name_of(path) for path in ALL}
    arrows = {}
    for path in ALL:
        name = name_of(path)
        package = path.relative_to(ROOT).parts[:-1]
        targets = set()
        for node in import_nodes(path):
            if isinstance(node, ast.Import):
                targets |= {alias.name for alias in node.names} & known
            if not isinstance(node, ast.ImportFrom):
                continue
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            whole = [*base, *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                for candidate in (".".join([*whole, alias.name]), ".".join(whole)):
                    if candidate in known:
                        targets.add(candidate)
                        break
        arrows[name] = targets - {name}
    return arrows


def none_of(violations):
    """A rule names every place that breaks it, not the first."""
    found = sorted(violations)
    assert not found, "\n".join(["", *found])


def absolute(path):
    """First names of what a file imports absolutely."""
    return {module.split(".")[0] for module, level in imports_of(path) if level == 0}


def test_pure_rooms_import_no_blender():
    blender = {"bpy", "mathutils", "bmesh", "gpu", "bl_ui", "addon_utils"}
    none_of(
        f"{path.relative_to(ROOT)} imports {head}"
        for path in SOURCES
        if room_of(path) in PURE
        for head in absolute(path) & blender
    )


def test_rooms_import_only_to_their_left():
    rooms = {
        name: name.split(".")[1] for name in project_imports() if name.startswith("forest_addon.")
    }
    none_of(f"{room} is no room" for room in set(rooms.values()) - set(ORDER))
    none_of(
        f"{name} imports {target}"
        for name, room in rooms.items()
        for target in project_imports()[name] & rooms.keys()
        if ORDER.index(rooms[target]) > ORDER.index(room)
    )


@pytest.mark.parametrize("room", WINGS)
def test_wings_of_a_room_import_only_what_they_may(room):
    """The three sensors never import each other; lsystem and mesh know no template."""
    wings = WINGS[room]

    def wing(name):
        parts, above = name.split("."), ["forest_addon", *room.split("/")]
        inside = parts[: len(above)] == above and len(parts) > len(above)
        return parts[len(above)] if inside and parts[len(above)] in wings else None

    none_of(
        f"{name} imports {target}"
        for name, targets in project_imports().items()
        for target in targets
        if wing(name) and wing(target) and wing(target) not in wings[wing(name)] | {wing(name)}
    )


def test_folders_of_a_room_are_its_wings():
    for room, wings in WINGS.items():
        assert {p.name for p in (ADDON / room).iterdir() if (p / "__init__.py").exists()} == set(
            wings
        )


def test_imports_inside_the_addon_are_relative_and_offline():
    none_of(
        f"{path.relative_to(ROOT)} imports {head}"
        for path in SOURCES
        for head in absolute(path) & {"forest_addon", "headless", *NETWORK}
    )
    none_of(
        f"{path.relative_to(ROOT)} reaches out of forest_addon"
        for path in SOURCES
        if any(level > len(path.relative_to(ADDON).parts) for _, level in imports_of(path))
    )


def test_no_import_circles():
    """Files that only import files outside any circle are taken away until nothing changes."""
    rest = {name: set(targets) for name, targets in project_imports().items()}
    while True:
        free = {n for n, targets in rest.items() if not targets & rest.keys()}
        if not free:
            break
        rest = {n: t for n, t in rest.items() if n not in free}
    while True:  # the same from the other end: what nobody of the rest imports is in no circle
        wanted = set().union(*rest.values()) if rest else set()
        if not rest.keys() - wanted:
            break
        rest = {n: t for n, t in rest.items() if n in wanted}
    assert not rest, "circle among " + ", ".join(sorted(rest))


def test_no_file_is_too_long():
    none_of(
        f"{name}: {lines} lines"
        for name, lines in (
            (str(path.relative_to(ROOT)), len(path.read_text(encoding="utf-8").splitlines()))
            for path in ALL
        )
        if lines > LONGEST and name not in LONG
    )


def tricks_in(path):
    """eval, sys.path and numpy's global random numbers in a file, each with its line."""
    allowed = {"Generator", "SeedSequence", "PCG64", "Philox"}
    for node in ast.walk(tree_of(path)):
        match node:
            case ast.Call(func=ast.Name("eval" | "exec" | "compile" as what)):
                yield f"{path.relative_to(ROOT)}:{node.lineno}: {what}"
            case ast.Attribute(ast.Name("sys"), "path"):
                yield f"{path.relative_to(ROOT)}:{node.lineno}: sys.path"
            case ast.Attribute(ast.Attribute(ast.Name("np" | "numpy"), "random"), what):
                if what not in allowed:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}: numpy.random.{what}"


def test_no_eval_no_path_tricks_no_global_random():
    none_of(trick for path in ALL for trick in tricks_in(path))


def test_the_shim_imports_nothing_at_load():
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    assert not [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
