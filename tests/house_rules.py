"""The rules of the house, each a function from the sources to its violations; no violation, no line.

Imports are read from the text wherever they stand: at the top, inside functions, and as literals of
``import_module`` and ``__import__``, f-strings included, whose gaps match any name. ``House`` keeps the
sources in memory, so that a test can plant a violation in a copy and see that its rule catches it.
"""

from __future__ import annotations

import ast
import builtins
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, wraps
from pathlib import Path

# Rooms of the add-on in the order in which data flows: a room imports only rooms before it.
ROOMS = (
    *("base", "spec", "formats", "acoustics", "growth", "stand", "sensing", "results", "site"),
    *("blender", "api", "flight", "ui"),
)
PURE = ROOMS[: ROOMS.index("blender")]
# The same for the parts of ``headless``; what stands in no folder is "" and comes where the commands do.
HEADLESS = (
    *("command", "lock", "interrupt", "memory", "progress"),
    *("report", "record", "unfinished_files", "unfinished", "pipeline", "tiled"),
    *("accuracy", "dataset"),
    *("commands/work", "studies/tables", "studies/papers", "studies/bench"),
    *("studies/validation", "studies/flight"),
    *(
        "studies/sim_to_real",
        "studies/commands",
        "studies",
        "commands",
        "cli",
        "__main__",
        "in_blender",
    ),
)
APART = {"studies/papers", "studies/validation", "studies/flight"}
# Folders within a room: the sisters that each may import. Files at the room's own level import all.
WINGS: dict[str, dict[str, set[str]]] = {
    "sensing": {"rays": set(), "lidar": {"rays"}, "sonar": {"rays"}, "reverb": {"rays"}},
    "sensing/reverb": {
        "trunks": set(),
        "forest": {"trunks"},
        "sums": {"trunks", "forest"},
        "ears": {"forest", "sums"},
    },
    "growth": {
        "mesh": set(),
        "lsystem": set(),
        "recognise": {"mesh"},
        "graft": {"lsystem", "mesh", "recognise"},
        "regrow": {"mesh", "recognise", "graft"},
        "measured": {"lsystem", "mesh"},
        "sway": {"measured", "mesh"},
        "library": {"lsystem", "mesh", "measured", "recognise", "graft", "regrow"},
    },
    "stand": {"intensity": set(), "statistics": {"intensity"}, "wind": set()},
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
        "sensors": {"shell", "settings", "species", "results", "forest"},
        "forest": {"shell", "settings", "species", "results"},
    },
}
SENSORS = ("lidar", "sonar", "reverb")
BLENDER = {
    "bpy",
    "mathutils",
    "bmesh",
    "gpu",
    "gpu_extras",
    "bpy_extras",
    "bl_ui",
    "bl_operators",
    "addon_utils",
}
NUMBERS = {"numpy", "scipy"}
# Packages of others that a room may import, beside the standard library.
PACKAGES: dict[str, set[str]] = {
    "forest_addon/base": NUMBERS,
    "forest_addon/spec": set(),
    "forest_addon/formats": NUMBERS
    | {
        "PIL",
        "cattrs",
        "copclib",
        "laspy",
        "lazrs",
        "png",
        "pye57",
        "pyproj",
        "rosbags",
        "sofar",
        "tifffile",
        "tomli_w",
    },
    "forest_addon/acoustics": NUMBERS,
    "forest_addon/growth": NUMBERS,
    "forest_addon/stand": NUMBERS,
    "forest_addon/sensing": NUMBERS,
    "forest_addon/results": NUMBERS,
    "forest_addon/site": NUMBERS,
    "forest_addon/blender": NUMBERS | {"bmesh", "bpy", "mathutils"},
    "forest_addon/api": NUMBERS | {"bpy", "matplotlib", "pandas", "xarray"},
    "forest_addon/flight": NUMBERS | {"gymnasium", "matplotlib"},
    "forest_addon/ui": NUMBERS
    | {
        "aud",
        "bl_operators",
        "bl_ui",
        "blf",
        "bpy",
        "bpy_extras",
        "gpu",
        "gpu_extras",
        "imbuf",
        "mathutils",
    },
    "headless": NUMBERS | {"bpy", "matplotlib", "tqdm"},
    "headless/accuracy": NUMBERS | {"matplotlib"},
    "headless/commands": NUMBERS | {"bpy", "matplotlib"},
    "headless/dataset": NUMBERS
    | {"bpy", "dask", "distributed", "laspy", "matplotlib", "tomli_w", "tqdm"},
    "headless/report": NUMBERS | {"PIL", "bpy", "matplotlib"},
    "headless/studies": NUMBERS
    | {"bpy", "distributed", "laspy", "mathutils", "matplotlib", "pgeof", "psutil", "pyhelios"}
    | {"sklearn", "tlseparation", "tomli_w"},
}
NETWORK = {"socket", "http", "urllib", "requests", "ftplib", "ssl", "smtplib", "aiohttp"}
LONGEST_FILE, LARGEST_FOLDER = 800, 25


@dataclass(frozen=True)
class House:
    """The sources of the project: path from its root to text."""

    sources: Mapping[str, str]

    @classmethod
    def read(cls, root: Path) -> House:
        found = [p for top in ("forest_addon", "headless") for p in (root / top).rglob("*.py")]
        return cls({p.relative_to(root).as_posix(): p.read_text("utf-8") for p in sorted(found)})

    def planted(self, path: str, text: str, *, instead: bool = False) -> House:
        """A copy with text added to the end of a file, or in its place."""
        before = "" if instead else self.sources.get(path, "")
        return House({**self.sources, path: before + text})

    @cached_property
    def modules(self) -> dict[str, str]:
        """Dotted name of every module, a package by its own name, to its path."""
        return {dotted(path): path for path in self.sources}

    @cached_property
    def arrows(self) -> dict[str, set[str]]:
        """Module to the modules of the project that it imports."""
        return {name: self._targets(path) - {name} for name, path in self.modules.items()}

    def closure(self, start: str) -> set[str]:
        """Every module that importing one can bring in, wherever the imports stand."""
        found, pending = set(), [start]
        while pending:
            for target in self.arrows.get(pending.pop(), ()):
                if target not in found:
                    found.add(target)
                    pending.append(target)
        return found

    def _targets(self, path: str) -> set[str]:
        found = set()
        for whole, names in imports(path, self.sources[path]):
            if "*" in whole:  # an f-string's gap
                pattern = re.compile(re.escape(whole).replace(r"\*", r"\w+"))
                found |= {name for name in self.modules if pattern.fullmatch(name)}
            for name in names or ("",):
                longest = f"{whole}.{name}" if name else whole
                found |= {next((m for m in (longest, whole) if m in self.modules), "")}
        return found - {""}


def dotted(path: str) -> str:
    parts = path.removesuffix(".py").split("/")
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def tree_of(text: str) -> ast.Module:
    return ast.parse(text)


@cache
def nodes_of(text: str) -> tuple[ast.AST, ...]:
    """Every node of a file, walked once for all rules and planted copies."""
    return tuple(ast.walk(tree_of(text)))


def file_by_file(rule: Callable[[str, str], Iterator[str]]) -> Callable[[House], Iterator[str]]:
    """A rule of single files as one of the house; a file that did not change is not judged again."""
    judged = cache(lambda path, text: tuple(rule(path, text)))

    @wraps(rule)
    def of_house(house: House) -> Iterator[str]:
        for path, text in house.sources.items():
            yield from judged(path, text)

    return of_house


@cache
def imports(path: str, text: str) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """(module, names imported from it) of every import, absolute names; ``*`` for what is not literal."""
    package = path.split("/")[:-1]
    found: list[tuple[str, tuple[str, ...]]] = []
    for node in nodes_of(text):
        match node:
            case ast.Import():
                found += [(alias.name, ()) for alias in node.names]
            case ast.ImportFrom():
                found.append(
                    (
                        resolved(node.level, node.module or "", package),
                        tuple(alias.name for alias in node.names),
                    )
                )
            case ast.Call(args=[literal, *_]) if called(node) in {"import_module", "__import__"}:
                text_of = written(literal)
                if text_of:
                    level = len(text_of) - len(text_of.lstrip("."))
                    found.append((resolved(level, text_of[level:], package), ()))
    return tuple(found)


def resolved(level: int, module: str, package: list[str]) -> str:
    base = package[: len(package) - level + 1] if level else []
    return ".".join([*base, *(module.split(".") if module else [])])


def called(call: ast.Call) -> str:
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def written(node: ast.expr) -> str:
    """A literal, an f-string with ``*`` in its gaps; empty for anything else."""
    if isinstance(node, ast.JoinedStr):
        return "".join(p.value if isinstance(p, ast.Constant) else "*" for p in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def room_of(module: str) -> str:
    parts = module.split(".")
    return parts[1] if parts[0] == "forest_addon" and len(parts) > 1 else ""


def part_of(module: str) -> str:
    """Of a module of headless: the first entry of ``HEADLESS`` that it belongs to."""
    inside = "/".join(module.split(".")[1:])
    fits = [p for p in HEADLESS if inside == p or inside.startswith(p + "/")]
    return max(fits, key=len, default="")


# --- the rules ---


def pure_rooms_import_no_blender(house: House) -> Iterator[str]:
    for path, text in house.sources.items():
        if room_of(dotted(path)) in PURE:
            for whole, _ in imports(path, text):
                if whole.split(".")[0] in BLENDER:
                    yield f"{path} imports {whole}"


def rooms_import_only_rooms_before_them(house: House) -> Iterator[str]:
    for name, targets in house.arrows.items():
        room = room_of(name)
        if room and room not in ROOMS:
            yield f"{room} is no room"
        for target in targets:
            there = room_of(target)
            if room in ROOMS and there in ROOMS and ROOMS.index(there) > ROOMS.index(room):
                yield f"{name} imports {target}"
            if name.startswith("forest_addon") and target.startswith("headless"):
                yield f"{name} imports {target}"


def wing_of(module: str, room: str) -> str:
    inside = module.removeprefix("forest_addon." + room.replace("/", ".") + ".").split(".")
    below = module.startswith("forest_addon." + room.replace("/", ".") + ".")
    return inside[0] if below and inside[0] in WINGS[room] else ""


def wings_import_only_what_they_may(house: House) -> Iterator[str]:
    for room, wings in WINGS.items():
        for name, targets in house.arrows.items():
            own = wing_of(name, room)
            for target in targets:
                there = wing_of(target, room)
                if own and there and there not in wings[own] | {own}:
                    yield f"{name} imports {target}"


def sensors_never_reach_each_other(house: House) -> Iterator[str]:
    """Also not through a third module, wherever that stands."""
    for name in house.modules:
        own = wing_of(name, "sensing")
        if own in SENSORS:
            for target in house.closure(name):
                there = wing_of(target, "sensing")
                if there in SENSORS and there != own:
                    yield f"{name} reaches {target}"


def folders_of_a_room_are_its_wings(house: House) -> Iterator[str]:
    for room, wings in WINGS.items():
        start = f"forest_addon/{room}/"
        there = {
            p.removeprefix(start).split("/")[0]
            for p in house.sources
            if p.startswith(start) and p.count("/") > start.count("/")
        }
        yield from (f"{start}{name} is no wing" for name in there - wings.keys())
        yield from (f"{start}{name} is not there" for name in wings.keys() - there)


def packages_of_others_are_listed(house: House) -> Iterator[str]:
    for path, text in house.sources.items():
        place = "/".join(path.removesuffix(".py").split("/")[:2])
        allowed = PACKAGES.get(
            place, PACKAGES["headless"] if place.startswith("headless") else set()
        )
        for whole, _ in imports(path, text):
            first = whole.split(".")[0]
            if first and first not in {
                *sys.stdlib_module_names,
                *allowed,
                "forest_addon",
                "headless",
            }:
                yield f"{path} imports {whole}"


def headless_has_an_order(house: House) -> Iterator[str]:
    for name, targets in house.arrows.items():
        if not name.startswith("headless."):
            continue
        own = part_of(name)
        if not own:
            yield f"{name} has no place in the order"
            continue
        for target in targets:
            there = part_of(target)
            if there and HEADLESS.index(there) > HEADLESS.index(own):
                yield f"{name} imports {target}"
            if own in APART and there in APART and there != own:
                yield f"{name} imports {target}, which stands apart"


def no_circles(house: House) -> Iterator[str]:
    """Files that import only files outside any circle are taken away until nothing changes."""
    rest = {name: set(targets) for name, targets in house.arrows.items()}
    for _ in range(2):  # from the ground, then, with arrows turned, from the top
        while free := {n for n, targets in rest.items() if not targets & rest.keys()}:
            rest = {n: targets for n, targets in rest.items() if n not in free}
        turned: dict[str, set[str]] = {n: set() for n in rest}
        for name, targets in rest.items():
            for target in targets & rest.keys():
                turned[target].add(name)
        rest = turned
    yield from (f"{name} is in a circle" for name in rest)


@file_by_file
def the_addon_is_relative_and_offline(path: str, text: str) -> Iterator[str]:
    if not path.startswith("forest_addon/"):
        return
    for node in nodes_of(text):
        if isinstance(node, ast.ImportFrom) and node.level >= path.count("/") + 1:
            yield f"{path} reaches out of forest_addon"
        absolute = []
        if isinstance(node, ast.Import):
            absolute = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            absolute = [node.module or ""]
        for whole in absolute:
            if whole.split(".")[0] in {"forest_addon", "headless", *NETWORK}:
                yield f"{path} imports {whole}"


def files_are_short(house: House) -> Iterator[str]:
    for path, text in house.sources.items():
        if len(text.splitlines()) > LONGEST_FILE:
            yield f"{path}: {len(text.splitlines())} lines"


def folders_are_small(house: House) -> Iterator[str]:
    for folder, count in Counter(p.rpartition("/")[0] for p in house.sources).items():
        if count > LARGEST_FOLDER + 1:  # its __init__ beside
            yield f"{folder}: {count} files"


def class_names_are_unique(house: House) -> Iterator[str]:
    places = defaultdict(list)
    for path, text in house.sources.items():
        for node in tree_of(text).body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(path)
    yield from (f"{name}: {', '.join(found)}" for name, found in places.items() if len(found) > 1)


@cache
def names_used(text: str) -> frozenset[str]:
    """Identifiers and words of strings in a file, without those that a definition introduces."""
    used = set()
    for node in nodes_of(text):
        match node:
            case ast.Name(id=name, ctx=ast.Load()):
                used.add(name)
            case ast.Attribute(attr=name):
                used.add(name)
            case ast.ImportFrom():
                used |= {alias.name for alias in node.names}
            case ast.Constant(value=str(words)):
                used |= set(re.findall(r"\w+", words)) if len(words) < 2000 else set()
    return frozenset(used)


def public_names_are_used(house: House) -> Iterator[str]:
    """A public function, class or constant that nothing but its tests uses can go."""
    users: dict[str, set[str]] = defaultdict(set)
    for path, text in house.sources.items():
        for name in names_used(text):
            users[name].add(path)
    for path, text in house.sources.items():
        for node in tree_of(text).body:
            defined = [node.name] if isinstance(node, ast.FunctionDef | ast.ClassDef) else []
            if isinstance(node, ast.Assign):
                defined = [t.id for t in node.targets if isinstance(t, ast.Name)]
            for name in defined:
                if not name.startswith("_") and not users[name]:
                    yield f"{path}: {name}"


def sensors_are_looked_up(house: House) -> Iterator[str]:
    """Sensors and results are told apart by their records: no test of their class or kind elsewhere."""
    at_home = re.compile(r"forest_addon/(sensing/(lidar|sonar|reverb)|results)/")
    classes = frozenset(sensor_classes(house) | RESULT_CLASSES)
    for path, text in house.sources.items():
        if not at_home.match(path):
            yield from questions_of_kind(path, text, classes)


@cache
def questions_of_kind(path: str, text: str, classes: frozenset[str]) -> tuple[str, ...]:
    """Return where a file asks for the class or the kind of a sensor or a result."""
    known = names_of(text, classes)
    return tuple(
        f"{path}: {ast.unparse(node).splitlines()[0]}"
        for node in nodes_of(text)
        if tests_class(node, known) or tests_kind(node)
    )


RESULT_CLASSES = {"Cloud", "TractorScan", "Echo", "Flight", "ImpulseResponse"}
KIND_WORDS = {"tractor", "terrestrial", "mobile", "airborne", "sonar", "reverb"}


def sensor_classes(house: House) -> set[str]:
    """Return the names of the classes of settings that are sensors', by what they are made from."""
    found, more = set[str](), {"Sensor"}
    classes = [
        node
        for path, text in house.sources.items()
        if path.startswith("forest_addon/spec/")
        for node in nodes_of(text)
        if isinstance(node, ast.ClassDef)
    ]
    while more:
        found |= more
        more = {
            c.name for c in classes if {b.id for b in c.bases if isinstance(b, ast.Name)} & found
        }
        more -= found
    return found


def names_of(text: str, classes: frozenset[str]) -> set[str]:
    """Return how a file calls some classes: by their names, other names of imports, tuples and unions."""
    known = set(classes)
    for node in nodes_of(text):
        if isinstance(node, ast.ImportFrom):
            known |= {a.asname for a in node.names if a.asname and a.name in classes}
    for node in tree_of(text).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple | ast.BinOp):
            parts = {n.id for n in ast.walk(node.value) if isinstance(n, ast.Name)}
            if parts & known:
                known |= {t.id for t in node.targets if isinstance(t, ast.Name)}
    return known


def tests_class(node: ast.AST, known: set[str]) -> bool:
    """Return whether a node asks for the class of a thing, one of those known."""
    asked: list[ast.AST] = []
    match node:
        case ast.Call(func=ast.Name("isinstance" | "issubclass"), args=[_, kinds]):
            asked = [kinds]
        case ast.MatchClass(cls=kind):
            asked = [kind]
        case ast.Compare(left=ast.Call(func=ast.Name("type")), comparators=kinds):
            asked = list(kinds)
    parts = [part for one in asked for part in ast.walk(one)]
    named = {part.id for part in parts if isinstance(part, ast.Name)}
    named |= {part.attr for part in parts if isinstance(part, ast.Attribute)}
    return bool(named & known)


def tests_kind(node: ast.AST) -> bool:
    """Return whether a node compares a kind with the word of a sensor."""
    if not isinstance(node, ast.Compare):
        return False
    sides = [node.left, *node.comparators]
    words = {c.value for side in sides for c in ast.walk(side) if isinstance(c, ast.Constant)}
    names = {getattr(side, "attr", getattr(side, "id", "")) for side in sides}
    names |= {called(side) for side in sides if isinstance(side, ast.Call)}
    return bool(words & KIND_WORDS) and any(
        str(name).endswith(("kind", "kind_of")) for name in names
    )


@file_by_file
def no_eval_no_path_tricks_no_global_random(path: str, text: str) -> Iterator[str]:
    allowed = {"Generator", "SeedSequence", "PCG64", "Philox"}
    for node in nodes_of(text):
        match node:
            case ast.Call(func=ast.Name("eval" | "exec" | "compile" as what)):
                yield f"{path}:{node.lineno}: {what}"
            case ast.Attribute(ast.Name("sys"), "path"):
                yield f"{path}:{node.lineno}: sys.path"
            case ast.Attribute(ast.Attribute(ast.Name("np" | "numpy"), "random"), what):
                if what not in allowed:
                    yield f"{path}:{node.lineno}: numpy.random.{what}"


# Functions that numpy 1.26 computes in one of two ways for columns of arrays (``base.vectors.column``).
TWO_WAYS = frozenset(
    [
        *("sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan", "arctan2"),
        *("arcsinh", "arccosh", "arctanh", "cbrt", "power", "exp", "exp2", "expm1"),
        *("log", "log2", "log10", "log1p"),
    ]
)


@file_by_file
def functions_of_columns_take_copies(path: str, text: str) -> Iterator[str]:
    for node in nodes_of(text):
        match node:
            case ast.Call(func=ast.Attribute(ast.Name("np"), name), args=given) if name in TWO_WAYS:
                if any(is_column(one) for one in given):
                    yield f"{path}:{node.lineno}: {ast.unparse(node)}"


def is_column(node: ast.AST) -> bool:
    """Tell whether an expression is a column or some columns of an array: ``a[:, 1]``, ``a[..., :2]``."""
    match node:
        case ast.Subscript(
            slice=ast.Tuple([*_, ast.Slice() | ast.Constant(value=builtins.Ellipsis), last])
        ):
            whole = isinstance(last, ast.Slice) and not (last.lower or last.upper or last.step)
            return not whole and not (isinstance(last, ast.Constant) and last.value is None)
    return False


OPENING = re.compile(r"(What|Who|Whose|Where|How|Whether|Which|When|Why)\b")


@file_by_file
def docstrings_open_with_a_verb_or_a_noun(path: str, text: str) -> Iterator[str]:
    for node in nodes_of(text):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            said = ast.get_docstring(node) or ""
            if OPENING.match(said):
                yield f"{path}: {getattr(node, 'name', 'module')}: {said.splitlines()[0]}"


RULES: tuple[Callable[[House], Iterator[str]], ...] = (
    pure_rooms_import_no_blender,
    rooms_import_only_rooms_before_them,
    wings_import_only_what_they_may,
    sensors_never_reach_each_other,
    folders_of_a_room_are_its_wings,
    packages_of_others_are_listed,
    headless_has_an_order,
    no_circles,
    the_addon_is_relative_and_offline,
    files_are_short,
    folders_are_small,
    class_names_are_unique,
    public_names_are_used,
    no_eval_no_path_tricks_no_global_random,
    sensors_are_looked_up,
    functions_of_columns_take_copies,
    docstrings_open_with_a_verb_or_a_noun,
)
