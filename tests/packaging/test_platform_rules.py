"""The rules of extensions.blender.org as a checklist, on the zip that a user gets.

Taken from its terms of service (extensions.blender.org/terms-of-service), the guidelines of its moderators
(developer.blender.org/docs/features/extensions/moderation/guidelines) and the manual's chapter on
extensions. What Blender's own tool checks (identifiers, tags, the form of versions and wheels) is tested in
test_manifest.py, what stays after disabling in test_extension.py.
"""

import ast
import email
import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
PLATFORM_TAGS = {"linux-x64": "manylinux", "windows-x64": "win_amd64", "macos-arm64": "macosx"}
SHIPPED_BY_BLENDER = {"numpy"}
NETWORK = {
    *("socket", "ssl", "http", "urllib", "requests", "ftplib", "smtplib", "poplib", "imaplib"),
    *("aiohttp", "httpx", "websockets", "xmlrpc", "webbrowser", "pip", "ensurepip", "asyncio"),
}
# Licences that may be part of a work under GPL-3.0-or-later (gnu.org/licenses/license-list).
COMPATIBLE = {
    *("MIT", "MIT-CMU", "BSD", "BSD-2-Clause", "BSD-3-Clause", "Apache-2.0", "MPL-2.0", "PSF-2.0"),
    *("MIT License", "BSD License", "BSD 3-Clause License", "Python Software Foundation License"),
}
BINARY = {
    b"\x7fELF": "ELF",
    b"MZ": "Windows",
    b"\xcf\xfa\xed\xfe": "Mach-O",
    b"\xca\xfe\xba\xbe": "Mach-O",
}
# Run by hand or by `blender --command forest`, in a process of their own.
COMMAND_LINE = "headless/"
LOADER = "headless/in_blender.py"
OF_DATASETS = "headless/dataset/convert/loader.py"  # copied into datasets, never run in Blender


@pytest.fixture(scope="module")
def shipped(archive):
    """Every file in the zip, by its name."""
    with zipfile.ZipFile(archive) as opened:
        return {name: opened.read(name) for name in opened.namelist() if not name.endswith("/")}


@pytest.fixture(scope="module")
def code(shipped):
    """The nodes of every Python file in the zip."""
    files = {name: text for name, text in shipped.items() if name.endswith(".py")}
    return {name: list(ast.walk(ast.parse(text))) for name, text in files.items()}


@pytest.fixture(scope="module")
def wheels(archive):
    """What each wheel in the zip says of itself."""
    said = {}
    with zipfile.ZipFile(archive) as opened:
        for name in opened.namelist():
            if name.endswith(".whl"):
                with opened.open(name) as file, zipfile.ZipFile(file) as wheel:
                    about = next(n for n in wheel.namelist() if n.endswith(".dist-info/METADATA"))
                    said[Path(name).name] = (
                        email.message_from_bytes(wheel.read(about)),
                        wheel.namelist(),
                    )
    return said


# --------------------------------------------------------------------------------------- the manifest


def test_the_licence_is_gpl_3_or_later_and_comes_along(shipped):
    assert MANIFEST["license"] == ["SPDX:GPL-3.0-or-later"]
    text = shipped["LICENSE"].decode()
    assert "GNU GENERAL PUBLIC LICENSE" in text
    assert "Version 3, 29 June 2007" in text
    assert all(re.match(r"\d{4}(-\d{4})? \S", holder) for holder in MANIFEST["copyright"])


def test_name_and_tagline_are_plain():
    assert "blender" not in MANIFEST["name"].lower()
    assert len(MANIFEST["tagline"]) <= 64
    assert MANIFEST["tagline"][-1] not in ".!?"
    assert MANIFEST["maintainer"]


def test_there_is_a_website():
    """The one open point of the list, until the project has a public address (CONTRIBUTING, Publish)."""
    if "website" not in MANIFEST:
        pytest.xfail("no website in blender_manifest.toml: fill it in before publishing")
    assert MANIFEST["website"].startswith("https://")


def test_permissions_are_those_that_are_used_and_say_why(code):
    assert list(MANIFEST["permissions"]) == ["files"]
    assert all(len(why) <= 64 and why[-1] != "." for why in MANIFEST["permissions"].values())
    written = {ast.unparse(node) for nodes in code.values() for node in nodes
               if isinstance(node, ast.Attribute) and node.attr == "clipboard"}  # fmt: skip
    assert not written


def test_it_says_the_oldest_blender_that_is_tested():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tested = re.findall(r"bpy>=(\d+\.\d+)", " ".join(project["optional-dependencies"]["bpy"]))
    assert MANIFEST["blender_version_min"] == f"{min(tested)}.0"


# ----------------------------------------------------------------------------------- self-contained


def test_wheels_are_there_for_every_platform_and_python():
    builds = {}
    for wheel in MANIFEST["wheels"]:
        name, _, python, _, tag = Path(wheel).stem.split("-")
        builds.setdefault(name, set()).add((python, tag))
    assert set(MANIFEST["platforms"]) == set(PLATFORM_TAGS)
    for name, found in builds.items():
        if any(tag != "any" for _, tag in found):
            for python in ("cp311", "cp313"):
                for platform in MANIFEST["platforms"]:
                    fitting = [t for p, t in found if p == python and PLATFORM_TAGS[platform] in t]
                    assert len(fitting) == 1, f"{name}: {python}, {platform}"
        else:
            assert len(found) == 1, name


def test_wheels_need_nothing_that_does_not_come_along(wheels):
    there = {canonicalize_name(about["Name"]) for about, _ in wheels.values()} | SHIPPED_BY_BLENDER
    for file, (about, _) in wheels.items():
        for text in about.get_all("Requires-Dist", []):
            needed = Requirement(text)
            wanted = [v for v in ("3.11", "3.13") if needed.marker is None or needed.marker.evaluate(
                {"python_version": v, "python_full_version": f"{v}.0", "extra": ""})]  # fmt: skip
            assert not wanted or canonicalize_name(needed.name) in there, f"{file}: {text}"


def test_wheels_are_free_software_that_fits_the_gpl(wheels):
    for file, (about, names) in wheels.items():
        stated = about["License-Expression"] or ""
        if not stated:
            classified = [text.rpartition(" :: ")[2] for text in about.get_all("Classifier", [])
                          if text.startswith("License :: OSI Approved :: ")]  # fmt: skip
            stated = " AND ".join(classified) or about["License"] or ""
        choices = [set(re.split(" AND ", choice)) for choice in stated.strip("()").split(" OR ")]
        assert any(choice <= COMPATIBLE for choice in choices), f"{file}: {stated}"
        assert [n for n in names if re.search("(?i)licen[cs]e|copying", n)], f"{file}: no licence"


def test_what_is_imported_is_ours_or_in_the_zip_or_in_blender(code, wheels):
    """No package that the user would have to find elsewhere."""
    tops = {name.split("/")[0].partition(".")[0] for _, names in wheels.values() for name in names}
    known = tops | SHIPPED_BY_BLENDER | set(sys.stdlib_module_names)
    known |= {
        "bpy",
        "bmesh",
        "bl_operators",
        "bl_ui",
        "bpy_extras",
        "mathutils",
        "gpu",
        "gpu_extras",
        "aud",
        "blf",
        "imbuf",
        "forest_addon",
        "headless",
    }
    # matplotlib draws the pictures of commands and notebooks: see the test below.
    drawers = {"matplotlib", "PIL"}
    # The benchmarks' other programs, the scheduler of datasets, the rules of flights: each is used by
    # commands and scripts where it is installed, and says what to install where it is not. So are formats
    # that Blender has no package for: the panel does not offer them.
    optional = {"pyroomacoustics", "pyhelios", "dask", "distributed", "dask_jobqueue", "gymnasium"}
    optional |= {"copclib", "pandas", "pye57", "pyproj", "rosbags", "sofar", "xarray"}
    for name, nodes in code.items():
        lacking = imported(nodes) - known - optional - drawers
        assert not lacking, f"{name}: {lacking}"


def test_what_a_window_does_draws_without_matplotlib(code):
    """Who asks for it can do without, or draws for notebooks and for who plays a flight from Python."""
    asking = {
        name
        for name, nodes in code.items()
        if not name.startswith(COMMAND_LINE) and imported(nodes) & {"matplotlib", "PIL"}
    }
    assert asking == {
        "forest_addon/api/results.py",
        "forest_addon/drawing/echoes.py",
        "forest_addon/drawing/figures.py",
        "forest_addon/drawing/stands.py",
        "forest_addon/flight/top_view.py",
        "forest_addon/formats/raster_file.py",
    }


def test_the_zip_holds_no_binaries_and_no_bytecode(shipped):
    for name, content in shipped.items():
        if name.startswith("wheels/"):
            assert name.endswith(".whl")
            continue
        assert not re.search(r"\.(so|dll|dylib|pyd|exe|pyc|pyo|whl|zip|sh|bat)$", name), name
        assert not any(content.startswith(magic) for magic in BINARY), name
        if name.endswith((".py", ".toml", ".md")) or name == "LICENSE":
            content.decode("utf-8")
    assert max(len(content) for name, content in shipped.items() if "wheels/" not in name) < 3e6


def test_the_zip_says_which_wheels_it_holds(shipped):
    said = tomllib.loads(shipped["blender_manifest.toml"].decode())
    assert {f"./{name}" for name in shipped if name.endswith(".whl")} == set(said["wheels"])
    assert len(said["platforms"]) == 1


# ------------------------------------------------------------------------------------------ the code


def imported(nodes):
    """Top names of all absolute imports anywhere in a file."""
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module.split(".")[0])
    return names


def attributes(nodes, module):
    """Names that a file asks a module for."""
    return {
        node.attr
        for node in nodes
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == module
    }


def test_nothing_asks_the_network(code):
    for name, nodes in code.items():
        assert not imported(nodes) & NETWORK, name


def test_the_add_on_starts_no_programs(code):
    for name, nodes in code.items():
        if not name.startswith(COMMAND_LINE):
            assert "subprocess" not in imported(nodes), name
            used = attributes(nodes, "os")
            assert not {u for u in used if u in ("system", "popen") or u.startswith("exec")}, name


def test_code_can_be_reviewed(code, shipped):
    """Nothing obfuscated, nothing that is run from a text."""
    for name, nodes in code.items():
        called = {node.func.id for node in nodes
                  if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}  # fmt: skip
        assert not called & {"eval", "exec", "compile", "__import__"}, name
        assert not imported(nodes) & {"marshal", "pickle", "codecs"}, name
        assert "b64decode" not in shipped[name].decode(), name
        assert max(map(len, shipped[name].decode().splitlines()), default=0) <= 120, name


def test_python_s_paths_and_modules_are_left_alone(code):
    for name, nodes in code.items():
        if name in (LOADER, OF_DATASETS):
            continue
        used = {a for a in attributes(nodes, "sys") if a.startswith(("path", "modules"))}
        assert not used | ({"addsitedir"} & attributes(nodes, "site")), name


def test_the_add_on_prints_nothing(code):
    for name, nodes in code.items():
        if name.startswith("forest_addon/"):
            called = {node.func.id for node in nodes
                      if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}  # fmt: skip
            assert not called & {"print", "breakpoint"}, name


def test_classes_are_named_as_blender_wants_them():
    pytest.importorskip("bpy")
    import bpy

    from forest_addon import ui

    letters = {bpy.types.Operator: "OT", bpy.types.Panel: "PT", bpy.types.Menu: "MT",
               bpy.types.UIList: "UL", bpy.types.PropertyGroup: "PG",
               bpy.types.AddonPreferences: "AP"}  # fmt: skip
    for cls in ui._classes():
        (kind,) = (letters[base] for base in letters if issubclass(cls, base))
        assert cls.__name__.startswith(f"FOREST_{kind}_"), cls
        if kind == "OT":
            room, _, verb = cls.bl_idname.partition(".")
            assert (room, f"FOREST_OT_{verb}") == ("forest", cls.__name__)
            assert cls.__doc__ or hasattr(cls, "description"), cls
            assert not cls.__doc__.endswith("."), cls


# ------------------------------------------------------------------------------------- while it runs


def test_it_writes_only_where_the_user_said_or_into_its_own_folder(session):
    home = str(session["resources"].parent)
    results = f"{home}/results"
    for path in session["written"]:
        if "__pycache__" in path or path == "/dev/null":  # Python's own; nothing
            continue
        said = (results, session["own_folder"])
        allowed = said if path.startswith(home) else tuple(session["temporary"])
        assert path.startswith(allowed), path
    assert any(path.startswith(results) for path in session["written"])  # the watch was awake


def test_its_own_directory_stays_as_it_was_installed(session):
    assert session["changed"] == []


def test_it_neither_asks_the_network_nor_starts_programs(session):
    assert session["suspicious"] == []


def test_its_modules_live_under_the_name_that_blender_gave_it(session):
    assert session["foreign_names"] == []
