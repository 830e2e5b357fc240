"""The rules of the house: which room imports which, how large rooms are, how they are written.

Lint (``pyproject.toml``, [tool.importlinter] and [tool.ruff.lint]) holds most of them; here stand the rules
that no tool knows, and the budgets, which only go down: one goes up only with a line that says why.
"""

import ast
import re
import subprocess
import sys
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
LONGEST_FILE, LARGEST_FOLDER = 800, 25

# Packages of others that a room may import, beside the standard library.
NUMBERS = {"numpy", "scipy"}
PACKAGES = {
    "forest_addon.base": NUMBERS,
    "forest_addon.spec": set(),
    "forest_addon.kernels": {"numpy"},
    "forest_addon.formats": NUMBERS
    | {
        "OpenImageIO",
        "PIL",
        "cattrs",
        "copclib",
        "laspy",
        "lazrs",
        "openpyxl",
        "png",
        "pye57",
        "pyogrio",
        "pyproj",
        "rosbags",
        "shapely",
        "sofar",
        "tifffile",
        "tomli_w",
    },
    "forest_addon.acoustics": NUMBERS,
    "forest_addon.growth": NUMBERS,
    "forest_addon.stand": NUMBERS,
    "forest_addon.sensing": NUMBERS,
    "forest_addon.drawing": NUMBERS | {"matplotlib"},
    "forest_addon.results": NUMBERS,
    "forest_addon.site": NUMBERS,
    "forest_addon.tiles": NUMBERS,
    "forest_addon.blender": NUMBERS | {"bmesh", "bpy", "mathutils"},
    "forest_addon.api": NUMBERS | {"bpy", "matplotlib", "pandas", "xarray"},
    "forest_addon.flight": NUMBERS | {"gymnasium", "matplotlib"},
    "forest_addon.ui": NUMBERS
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
    "headless.dataset": NUMBERS
    | {"bpy", "dask", "distributed", "laspy", "matplotlib", "tomli_w", "tqdm"},
    "headless.report": NUMBERS | {"PIL", "bpy", "matplotlib"},
    "studies": NUMBERS
    | {"bpy", "distributed", "laspy", "mathutils", "matplotlib", "pgeof", "psutil", "pyhelios"}
    | {"sklearn", "tlseparation", "tomli_w"},
    "headless": NUMBERS
    | {"bpy", "laspy", "matplotlib", "pyproj", "pystac", "shtab", "tqdm", "upath"},
}


# Statements (docstrings weigh nothing) and modules of each room: they only go down.
# formats, stand and what tells of them grew: places, units and systems of files by other hands are read.
# headless and ui grew: the sensors in a .blend file run without a window.
# spec, stand and headless grew: settings without effect in a scene or plan are named.
# sensing and spec grew: a sonar has a receiver with a transducer, noise and a converter.
# headless grew: a stand says what has no effect. blender and ui: stand-ins are whole near the camera,
# an estimate knows what came or went.
# flight grew: forests, gaps and poles by id without Blender, and listeners; headless/commands: a doctor, a
# plot's twin; acoustics, results and headless/dataset: errors that cancel as echoes do, receivers.
# sensing, results, formats and spec grew: waveforms are recorded, written and decomposed; studies/validation:
# a plot's twin is judged.
# headless grew: datasets go to stores, poses without effect are said; stand:
# 10^8 trees are planned; api: crowns are measured in clouds;
# studies/validation: real pulses, the same trees by several instruments.
# studies/bench: a stand in wind beside a still one.
BUDGETS = {
    "forest_addon": (459, 3),
    "forest_addon/acoustics": (1056, 14),
    "forest_addon/api": (879, 5),
    "forest_addon/base": (384, 12),
    "forest_addon/blender": (4947, 37),
    "forest_addon/drawing": (593, 6),
    "forest_addon/flight": (1790, 12),
    "forest_addon/formats": (3700, 29),
    "forest_addon/growth": (7799, 36),
    "forest_addon/kernels": (55, 1),
    "forest_addon/results": (1112, 13),
    "forest_addon/sensing": (12237, 93),
    "forest_addon/spec": (1333, 11),
    "forest_addon/stand": (3551, 15),
    "forest_addon/ui": (5265, 36),
    "headless": (1644, 13),
    "headless/accuracy": (466, 3),
    "headless/commands": (1304, 17),
    "headless/dataset": (2388, 13),
    "headless/report": (501, 3),
    "studies": (158, 5),
    "studies/bench": (1520, 17),
    "studies/flight": (549, 7),
    "studies/papers": (372, 3),
    "studies/sim_to_real": (910, 5),
    "studies/validation": (3732, 18),
}
# Functions and files that a pulse, a ping and a clap pass on their way to a file.
# Pings and claps rose by kernels in C beside numpy and by the standard errors of a tail (990, 910 before);
# all rose by settings without effect that are said before a run, pings by receivers (857, 1000, 915 before).
# Claps rose by one search for still scenes and for what moves (877 before).
# Pulses rose by errors of joining that change along a way (843 before), pings by the terms of wood (997).
# Claps rose by a module of what a response is, apart from the sums, which a start does not import (878, 122).
FLOWS = {"pulse": (775, 111), "ping": (941, 122), "clap": (856, 119)}


@pytest.fixture(scope="module")
def sources():
    """Path from the root to text, of every file of the product."""
    tops = ("forest_addon", "headless", "studies")
    return {
        p.relative_to(ROOT).as_posix(): p.read_text("utf-8")
        for top in tops
        for p in sorted((ROOT / top).rglob("*.py"))
    }


@cache
def tree_of(text):
    return ast.parse(text)


@cache
def nodes_of(text):
    return tuple(ast.walk(tree_of(text)))


def test_rooms_import_what_they_may():
    """In a process of its own: import-linter switches off the loggers that are there."""
    words = (
        "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    )
    ended = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout


def test_packages_of_others_are_listed(monkeypatch):
    monkeypatch.chdir(ROOT)
    tops = "forest_addon", "headless", "studies"
    graph = grimp.build_graph(*tops, include_external_packages=True, cache_dir=None)
    known = {*tops, *sys.stdlib_module_names}
    wrong = [
        f"{module} imports {package}"
        for module in graph.modules
        for package in graph.find_modules_directly_imported_by(module)
        if package.split(".")[0] not in known | allowed(module)
    ]
    assert not wrong


def allowed(module):
    room = ".".join(module.split(".")[:2])
    return PACKAGES.get(room, PACKAGES.get(room.split(".")[0], set()))


def test_what_studies_take_from_inside_is_there_and_used(sources):
    pytest.importorskip("bpy")
    from studies import inside

    assert all(hasattr(inside, name) for name in inside.INSIDE)
    texts = [text for path, text in sources.items() if path.startswith("studies/")]
    words = {
        word for text in texts if "INSIDE = {" not in text for word in re.findall(r"\w+", text)
    }
    assert not set(inside.INSIDE) - words


def test_files_are_chapters_and_folders_shelves(sources):
    long = [path for path, text in sources.items() if len(text.splitlines()) > LONGEST_FILE]
    files = Counter(p.rpartition("/")[0] for p in sources)
    full = [folder for folder, count in files.items() if count > LARGEST_FOLDER + 1]  # __init__
    assert not long + full


def test_rooms_keep_their_budgets(sources):
    size = defaultdict(lambda: [0, 0])
    for path, text in sources.items():
        room = "/".join(path.split("/")[:2]) if path.count("/") > 1 else path.split("/")[0]
        size[room][0] += statements(text)
        size[room][1] += 1
    over = {
        room: (tuple(used), BUDGETS.get(room))
        for room, used in size.items()
        if any(a > b for a, b in zip(used, BUDGETS.get(room, (0, 0)), strict=True))
    }
    assert not over


def statements(text):
    return sum(
        isinstance(node, ast.stmt)
        and not (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        )
        for node in nodes_of(text)
    )


def test_class_names_are_unique(sources):
    places = defaultdict(list)
    for path, text in sources.items():
        for node in tree_of(text).body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(path)
    assert not {name: paths for name, paths in places.items() if len(paths) > 1}


def test_public_names_are_used(sources):
    """A public function, class or constant that nothing but its tests uses can go.

    Classes FOREST_* are Blender's: ``ui`` registers all that a room is written with.
    """
    used = set()
    for text in sources.values():
        for node in nodes_of(text):
            match node:
                case ast.Name(id=name, ctx=ast.Load()) | ast.Attribute(attr=name):
                    used.add(name)
                case ast.ImportFrom():
                    used |= {alias.name for alias in node.names}
                case ast.Constant(value=str(words)) if len(words) < 2000:
                    used |= set(re.findall(r"\w+", words))
    unused = []
    for path, text in sources.items():
        for node in tree_of(text).body:
            names = [node.name] if isinstance(node, ast.FunctionDef | ast.ClassDef) else []
            if isinstance(node, ast.Assign):
                names = [t.id for t in node.targets if isinstance(t, ast.Name)]
            public = [n for n in names if not n.startswith(("_", "FOREST_"))]
            unused += [f"{path}: {n}" for n in public if n not in used]
    assert not unused


def test_no_module_touches_the_path_of_imports(sources):
    assert not [path for path, text in sources.items() if re.search(r"\bsys\.path\b", text)]


# Functions that numpy 1.26 computes in one of two ways for columns of arrays (``base.vectors.column``).
TWO_WAYS = re.compile(
    r"np\.(a?(?:rc)?(?:sin|cos|tan)h?|arctan2|cbrt|power|exp2?|expm1|log(?:2|10|1p)?)$"
)


def test_functions_of_columns_take_copies(sources):
    """Last bits are the same under every numpy."""
    wrong = [
        f"{path}:{node.lineno}: {ast.unparse(node)}"
        for path, text in sources.items()
        for node in nodes_of(text)
        if isinstance(node, ast.Call)
        and TWO_WAYS.match(ast.unparse(node.func))
        and any(is_column(argument) for argument in node.args)
    ]
    assert not wrong


def is_column(node):
    """Tell whether an expression is a column or some columns of an array: ``a[:, 1]``, ``a[..., :2]``."""
    if not (isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple)):
        return False
    before, last = ast.unparse(node.slice.elts[-2]), ast.unparse(node.slice.elts[-1])
    return (":" in before or before == "...") and last not in (":", "None")


OPENING = re.compile(
    r"(What|Who|Whose|Where|How|Whether|Which|When|Why|Of|As|It|Some|For|From|With|In|By|So|Those|Not|Both)\b"
)


def test_docstrings_open_with_a_verb_or_a_noun(sources):
    wrong = [
        f"{path}: {ast.get_docstring(node).splitlines()[0]}"
        for path, text in sources.items()
        for node in nodes_of(text)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and OPENING.match(ast.get_docstring(node) or "")
    ]
    assert not wrong


def test_the_shim_imports_nothing_at_load():
    """Blender's own ``__init__.py`` at the root is read by tools that have no Blender."""
    imports = (ast.Import, ast.ImportFrom)
    assert not any(
        isinstance(n, imports) for n in ast.parse((ROOT / "__init__.py").read_text()).body
    )


SENSORS = {
    "pulse": 'kind = "terrestrial"\nposition = [5.0, 5.0, 1.6]\nangle_step_deg = 10.0\n',
    "ping": 'kind = "sonar"\nposition = [5.0, 5.0, 1.6]\nleaf_model = "piston"\n',
    "clap": 'kind = "reverb"\n',
}
SCENE = """\
seed = 7
[forest]
size = [10.0, 10.0]
[[plantings]]
species = "maple"
variants = 1
expected = 1
exact = true
[output]
report = false
preview = false
pictures = false
blend = false
[[sensors]]
"""
# Run by a Python of its own, in a child for each job: counts functions of ours that run, but for those that
# run while modules load.
COUNT = """\
import os, sys
from pathlib import Path
root, seen, watch = os.getcwd() + os.sep, set(), sys.monitoring
ours = tuple(root + top + os.sep for top in ("forest_addon", "headless"))
def begun(code, _):
    function = code.co_flags & 1 and not code.co_name.startswith("<")
    if function and code.co_filename.startswith(ours):
        outer = sys._getframe(1).f_back
        while outer is not None:
            if outer.f_code.co_name == "<module>" and outer.f_code.co_filename.startswith(root):
                return None
            outer = outer.f_back
        seen.add((code.co_filename, code.co_qualname))
    return watch.DISABLE
import headless.pipeline
from headless.cli import main
for scene in map(Path, sys.argv[1:]):
    if os.fork():
        os.wait()
        continue
    watch.use_tool_id(watch.PROFILER_ID, "flow")
    watch.register_callback(watch.PROFILER_ID, watch.events.PY_START, begun)
    watch.set_events(watch.PROFILER_ID, watch.events.PY_START)
    assert main(["run", str(scene), "--out", str(scene.with_suffix(""))]) == 0
    watch.set_events(watch.PROFILER_ID, 0)
    print("FLOW", scene.stem, len(seen), len({file for file, _ in seen}), flush=True)
    os._exit(0)
"""


@pytest.mark.skipif(sys.version_info < (3, 12), reason="Python cannot watch itself so cheaply")
@pytest.mark.slow
def test_one_job_passes_few_functions(tmp_path):
    """A reader follows one pulse, ping or clap through so many functions and files."""
    pytest.importorskip("bpy")
    scenes = [tmp_path / f"{job}.toml" for job in SENSORS]
    for scene in scenes:
        scene.write_text(SCENE + SENSORS[scene.stem])
    ended = subprocess.run(
        [sys.executable, "-c", COUNT, *scenes], cwd=ROOT, capture_output=True, text=True
    )
    flows = [line.split()[1:] for line in ended.stdout.splitlines() if line.startswith("FLOW")]
    counted = {job: (int(functions), int(files)) for job, functions, files in flows}
    assert counted.keys() == FLOWS.keys(), ended.stderr[-500:]
    assert not [job for job in FLOWS if any(map(int.__gt__, counted[job], FLOWS[job]))], counted
