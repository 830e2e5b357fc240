"""The rules of the house: pure rooms know no Blender, arrows point one way, no circles."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ADDON = ROOT / "forest_addon"
PURE = {"spec", "rng", "acoustics", "growth", "stand", "sensing", "formats"}
# A room may import only rooms before it. Casters in blender/ fulfil the protocol of sensing/, so
# blender/ stands to the right of it.
ORDER = ["spec", "rng", "acoustics", "growth", "stand", "sensing", "formats", "blender", "ui"]
NETWORK = {"socket", "http", "urllib", "requests", "ftplib", "ssl", "smtplib", "aiohttp"}
SOURCES = sorted(ADDON.rglob("*.py"))


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


def rooms_imported(path):
    """Rooms of forest_addon that a file imports from, by following its relative imports."""
    depth = len(path.relative_to(ADDON).parts)  # 1 for forest_addon/x.py
    for module, level in imports_of(path):
        if level == depth:  # from .. in a room, from . in forest_addon itself
            yield module.split(".")[0]


@pytest.mark.parametrize(
    "path", [p for p in SOURCES if room_of(p) in PURE], ids=lambda p: str(p.relative_to(ADDON))
)
def test_pure_rooms_import_no_blender(path):
    heads = {module.split(".")[0] for module, level in imports_of(path) if level == 0}
    assert not heads & {"bpy", "mathutils", "bmesh", "gpu", "bl_ui", "addon_utils"}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ADDON)))
def test_rooms_import_only_to_their_left(path):
    room = room_of(path)
    if room == "__init__":
        return
    for other in rooms_imported(path):
        assert other in ORDER, f"{path}: {other} is no room"
        assert ORDER.index(other) <= ORDER.index(room), f"{room} imports {other}"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ADDON)))
def test_imports_inside_the_addon_are_relative_and_offline(path):
    heads = {module.split(".")[0] for module, level in imports_of(path) if level == 0}
    assert "forest_addon" not in heads
    assert "headless" not in heads
    assert not heads & NETWORK
    depth = len(path.relative_to(ADDON).parts)
    assert all(level <= depth for _, level in imports_of(path)), "reaches out of forest_addon"


def test_no_import_circles():
    names = {path: ".".join(path.relative_to(ADDON).with_suffix("").parts) for path in SOURCES}
    known = set(names.values())
    edges = {}
    for path, name in names.items():
        package = path.relative_to(ADDON).parts[:-1]
        targets = set()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if not isinstance(node, ast.ImportFrom) or not node.level:
                continue
            base = list(package[: len(package) - node.level + 1])
            whole = [*base, *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                for candidate in (".".join([*whole, alias.name]), ".".join(whole)):
                    if candidate in known and candidate != name:
                        targets.add(candidate)
                        break
        edges[name] = targets
    while True:
        leaves = {n for n, targets in edges.items() if not targets & edges.keys()}
        if not leaves:
            break
        edges = {n: t for n, t in edges.items() if n not in leaves}
    assert not edges, f"circle among {sorted(edges)}"


@pytest.mark.parametrize(
    "path",
    [*SOURCES, *sorted((ROOT / "headless").rglob("*.py"))],
    ids=lambda p: str(p.relative_to(ROOT)),
)
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
