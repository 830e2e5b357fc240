"""The rules of the house: pure rooms know no Blender, arrows point one way, no circles.

Every import counts, also those inside functions: a circle that is hidden there is a circle.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ADDON = ROOT / "forest_addon"
HEADLESS = ROOT / "headless"
PURE = {"spec", "rng", "acoustics", "growth", "stand", "sensing", "formats"}
# A room may import only rooms before it. Casters in blender/ fulfil the protocol of sensing/, so
# blender/ stands to the right of it.
ORDER = [
    *("spec", "rng", "acoustics", "growth", "stand", "sensing", "formats"),
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
    "growth": {
        "mesh": set(),
        "lsystem": set(),
        "template": {"lsystem", "mesh"},
    },
    "stand": {
        "intensity": set(),
        "statistics": {"intensity"},
    },
    "ui": {
        "species": set(),
        "results": set(),
        "sensors": {"results"},
        "forest": {"species", "results"},
    },
}
LONGEST = 400  # lines; a file that needs more says here why
LONG = {}
NETWORK = {"socket", "http", "urllib", "requests", "ftplib", "ssl", "smtplib", "aiohttp"}
SOURCES = sorted(ADDON.rglob("*.py"))
ALL = [*SOURCES, *sorted(HEADLESS.rglob("*.py"))]


def room_of(path):
    return path.relative_to(ADDON).with_suffix("").parts[0]


def imports_of(path):
    """(module, level) of every import anywhere in a file, also within functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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


def project_imports():
    """{module: modules of the project that it imports}, imports inside functions counted."""
    known = {name_of(path) for path in ALL}
    arrows = {}
    for path in ALL:
        name = name_of(path)
        package = path.relative_to(ROOT).parts[:-1]
        targets = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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


ARROWS = project_imports()


@pytest.mark.parametrize(
    "path", [p for p in SOURCES if room_of(p) in PURE], ids=lambda p: str(p.relative_to(ADDON))
)
def test_pure_rooms_import_no_blender(path):
    heads = {module.split(".")[0] for module, level in imports_of(path) if level == 0}
    assert not heads & {"bpy", "mathutils", "bmesh", "gpu", "bl_ui", "addon_utils"}


@pytest.mark.parametrize("name", [n for n in ARROWS if n.startswith("forest_addon.")])
def test_rooms_import_only_to_their_left(name):
    room = name.split(".")[1]
    for target in ARROWS[name]:
        if target == "forest_addon":
            continue
        other = target.split(".")[1]
        assert other in ORDER, f"{other} is no room"
        assert ORDER.index(other) <= ORDER.index(room), f"{room} imports {target}"


@pytest.mark.parametrize("room", WINGS)
def test_wings_of_a_room_import_only_what_they_may(room):
    """The three sensors never import each other; lsystem and mesh know no template."""
    wings = WINGS[room]
    for name, targets in ARROWS.items():
        parts = name.split(".")
        if parts[:2] != ["forest_addon", room] or len(parts) < 3 or parts[2] not in wings:
            continue
        for target in targets:
            there = target.split(".")
            if there[:2] == ["forest_addon", room] and len(there) > 2 and there[2] in wings:
                assert there[2] in wings[parts[2]] | {parts[2]}, f"{name} imports {target}"


def test_folders_of_a_room_are_its_wings():
    for room, wings in WINGS.items():
        assert {p.name for p in (ADDON / room).iterdir() if (p / "__init__.py").exists()} == set(
            wings
        )


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ADDON)))
def test_imports_inside_the_addon_are_relative_and_offline(path):
    heads = {module.split(".")[0] for module, level in imports_of(path) if level == 0}
    assert "forest_addon" not in heads
    assert "headless" not in heads
    assert not heads & NETWORK
    depth = len(path.relative_to(ADDON).parts)
    assert all(level <= depth for _, level in imports_of(path)), "reaches out of forest_addon"


def test_no_import_circles():
    """Files that only import files outside any circle are taken away until nothing changes."""
    rest = {name: set(targets) for name, targets in ARROWS.items()}
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


@pytest.mark.parametrize("path", ALL, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_file_is_too_long(path):
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= LONGEST or str(path.relative_to(ROOT)) in LONG, f"{lines} lines"


@pytest.mark.parametrize("path", ALL, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_eval_no_path_tricks_no_global_random(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"eval", "exec", "compile"}, f"line {node.lineno}"
        if isinstance(node, ast.Attribute):
            text = ast.unparse(node)
            assert not text.startswith("sys.path"), f"line {node.lineno}"
            allowed = ("Generator", "SeedSequence", "PCG64", "Philox")
            if text.startswith(("np.random.", "numpy.random.")):
                assert text.split(".")[2] in allowed, f"line {node.lineno}: {text}"


def test_the_shim_imports_nothing_at_load():
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    assert not [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
