"""Whatever is wrong with a file of settings is said in one sentence with file, key and what is allowed."""

import gc
import shutil
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from references.model_tree import tree

from forest_addon import spec
from forest_addon.base.places import ASSETS, version
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF
from forest_addon.formats.stl import read_stl, write_stl
from forest_addon.formats.toml_file import (
    read_scanner,
    read_settings,
    scanner_names,
    settings_of,
    structure,
    write_settings,
)
from forest_addon.growth.library import KEPT, find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.own_tree.template import BranchTemplate
from forest_addon.growth.tree import grow
from forest_addon.spec import Forest, Scene, Sonar, SpecError

ROOT = Path(__file__).resolve().parents[2]


def read(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_settings(path, Scene)


NEXT = int(version().split(".")[0]) + 1


def test_a_whole_scene_is_read(tmp_path):
    scene = read(
        tmp_path,
        """
        name = "x"
        seed = 3
        [forest]
        size = [10, 20.5]
        [[plantings]]
        species = "maple"
        expected = 4
        gaussians = [{ centre = [1, 2], width = [3, 4] }]
        [[sensors]]
        kind = "sonar"
        beam_width_deg = [50, 30]
        """,
    )
    assert scene.forest.size == (10.0, 20.5)
    assert scene.plantings[0].gaussians[0].centre == (1.0, 2.0)
    assert isinstance(scene.sensors[0], Sonar)
    assert scene.sensors[0].beam_width_deg == (50.0, 30.0)
    assert read(tmp_path, "") == Scene()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("[forest]\nsise = [1, 2]", "forest.sise", 'did you mean "size"? Allowed: size, origin'),
        ("[forest]\nsize = [-1, 2]", "forest.size[0]", "-1 m is out of range; use larger than 0"),
        ("[forest]\nsize = [1]", "forest.size", "give 2"),
        ('[forest]\nsize = "a"', "forest.size", '"a" is not a list of 2'),
        ("forest = 3", "forest", "not a table"),
        ("seed = 1.5", "seed", "1.5 is not a whole number"),
        ("seed = true", "seed", "true is not a whole number"),
        ('seed = "1"', "seed", '"1" is not a whole number'),
        ("seed = -1", "seed", "use from 0"),
        ("name = 1", "name", "1 is not a text in quotes"),
        ("nmae = 'x'", "nmae", 'did you mean "name"'),
        ("[forest]\nspacing = nan", "forest.spacing", "use from 0 to 100000 m"),
        ("[[plantings]]\nexpected = 2", "plantings[0].species", "is missing"),
        ("[[plantings]]\nspcies = 'm'", "plantings[0].spcies", 'did you mean "species"'),
        (
            "[[plantings]]\nspecies = 'm'\n[[plantings.gaussians]]\ncentre = [1, 2]",
            "plantings[0].gaussians[0].width",
            "is missing",
        ),
        ("[[sensors]]\nkind = 'radar'", "sensors[0].kind", '"tractor", "terrestrial", "mobile"'),
        ("[[sensors]]\nname = 'x'", "sensors[0].kind", "is missing"),
        ("[[sensors]]\nkind = 'sonar'\nband = [1, 'a']", "sensors[0].band[1]", "not a number"),
        ("[output]\nblend = 1", "output.blend", "1 is not true or false"),
        *((text, "", "is not TOML") for text in ("[forest", "a = ", "a=1\na=2", b"\x00\x01")),
        (b"\xff\xfe\x00", "", "is not a text file"),
        *((f"version = '{NEXT}.{more}'", "", "install") for more in ("0", "2.1")),
        *(
            (f"version = {said}", "version", "is no version")
            for said in ("'soon'", "'1'", "'-1.0'")
        ),
        ("version = 1.0", "version", "is no version"),
    ],
)
def test_one_sentence_names_file_key_and_what_is_allowed(tmp_path, text, key, words):
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text)
    said = str(caught.value)
    assert said.startswith(f"{tmp_path / 'scene.toml'}: {key}{': ' * bool(key)}")
    assert words in said
    assert "\n" not in said


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(SpecError, match="no such file"):
        read_settings(tmp_path / "none.toml", Scene)
    with pytest.raises(SpecError, match="is a folder"):
        read_settings(tmp_path, Scene)


@pytest.mark.medium
@pytest.mark.parametrize(
    "scene", sorted((ROOT / "assets" / "scenes").glob("*.toml")), ids=lambda p: p.stem
)
def test_a_scene_that_is_written_is_read_as_it_was(scene, tmp_path):
    settings = read_settings(scene, Scene)
    write_settings(tmp_path / "again.toml", settings)
    assert read_settings(tmp_path / "again.toml", Scene) == settings


def test_what_is_the_default_is_not_written(tmp_path):
    write_settings(tmp_path / "plain.toml", Scene())
    assert tomllib.loads((tmp_path / "plain.toml").read_text()) == {"version": version()}
    write_settings(tmp_path / "sonar.toml", Scene(sensors=(Sonar(),)))
    said = tomllib.loads((tmp_path / "sonar.toml").read_text())
    assert said == {"version": version(), "sensors": [{"kind": "sonar"}]}


@pytest.mark.slow
@given(st.floats(allow_nan=False, allow_infinity=False, min_value=1e-300, max_value=1e5))
def test_numbers_are_written_to_the_last_digit(number):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        write_settings(path, Scene(forest=Forest(spacing=number)))
        assert read_settings(path, Scene).forest.spacing == number


def test_a_byte_order_mark_is_no_text(tmp_path):
    """Windows' Notepad puts one before the first key."""
    path = tmp_path / "scene.toml"
    path.write_text('name = "Tharandter Wälder"\nseed = 3\n', encoding="utf-8-sig")
    assert read_settings(path, Scene).name == "Tharandter Wälder"


def test_a_file_may_say_its_version(tmp_path):
    for said in ("0.1", "1.0", version()):
        assert read(tmp_path, f'version = "{said}"\nseed = 5').seed == 5
    write_settings(tmp_path / "mine.toml", Scene(seed=9))
    assert tomllib.loads((tmp_path / "mine.toml").read_text())["version"] == version()
    assert read_settings(tmp_path / "mine.toml", Scene) == Scene(seed=9)


def test_a_file_of_a_later_minor_version_is_read_and_named_where_a_key_is_not_known(tmp_path):
    major, minor = map(int, version().split(".")[:2])
    said = f'version = "{major}.{minor + 1}"\n'
    assert read(tmp_path, said + "seed = 5").seed == 5
    with pytest.raises(SpecError, match=rf"fog: is not known.*written for.*{major}\.{minor + 1}"):
        read(tmp_path, said + "fog = 0.3")
    with pytest.raises(SpecError, match=r"fog: is not known") as now:
        read(tmp_path, f'version = "{major}.{minor}"\nfog = 0.3')
    assert "written for" not in str(now.value)


def test_the_first_scene_file_of_all_is_read_as_it_was(tmp_path):
    """The demo of version 0.1.0, as it was committed."""
    scene = read_settings(Path(__file__).with_name("demo-0.1.0.toml"), Scene)
    assert [sensor.kind for sensor in scene.sensors]
    assert scene.plantings


# -------------------------------------------------------------------------------------- scanner file
# Instruments as settings: every preset works, a sensor's own settings go over it.


@pytest.mark.parametrize("name", scanner_names())
def test_every_preset_is_whole(name):
    file = read_scanner(name)
    assert file.source
    assert file.title
    for kind, table in file.tables.items():
        sensor = structure(table, spec.SENSORS[kind])
        assert sensor.kind == kind
        assert sensor.beam.divergence_mrad > (0, 0)
        for key in file.assumed:
            group = sensor
            for part in key.split("."):
                assert hasattr(group, part) or kind != next(iter(file.tables)), key
                group = getattr(group, part, None)


def test_presets_are_what_their_sheets_say():
    vz = structure(settings_of("riegl-vz-400i", "terrestrial"), spec.Terrestrial)
    assert (vz.max_range, vz.min_range, vz.beam.divergence_mrad) == (800, 1.5, (0.35, 0.35))
    puck = structure(settings_of("velodyne-vlp-16", "mobile"), spec.Mobile)
    assert (puck.channels, puck.field_deg, puck.pulse_rate) == (16, (-15, 15), 300e3)


def test_a_sensor_starts_from_its_scanner(tmp_path):
    scene = read(
        tmp_path,
        '[[sensors]]\nkind = "terrestrial"\nscanner = "riegl-vz-400i"\nmax_range = 50.0\n'
        "beam = { subrays = 3 }\n",
    )
    (sensor,) = scene.sensors
    assert sensor.scanner == "riegl-vz-400i"
    assert (sensor.max_range, sensor.min_range) == (50, 1.5)
    assert (sensor.beam.subrays, sensor.beam.divergence_mrad) == (3, (0.35, 0.35))


def test_a_scanner_file_of_ones_own_beside_the_scene(tmp_path):
    (tmp_path / "mine.toml").write_text("[terrestrial]\nmax_range = 33.0\n")
    scene = read(tmp_path, '[[sensors]]\nkind = "terrestrial"\nscanner = "mine.toml"\n')
    assert scene.sensors[0].max_range == 33


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("terrestrial", "riegl-vz-900", "use one of dji-zenmuse-l2, faro-focus-s350"),
        ("terrestrial", "riegl-vq-780i", 'no terrestrial scanner; use kind = "airborne"'),
        ("airborne", "none.toml", "is not known"),
        ("airborne", "bad.toml", "cannot be read"),
        ("airborne", "empty.toml", "has no table"),
        ("airborne", "typo.toml", "airbone is not known"),
        ("airborne", "wrong.toml", "beam.subrais: is not known"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, kind, name, words):
    (tmp_path / "bad.toml").write_text("[")
    (tmp_path / "empty.toml").write_text('title = "x"')
    (tmp_path / "typo.toml").write_text("[airbone]\nspeed = 3\n")
    (tmp_path / "wrong.toml").write_text("[airborne]\nbeam = { subrais = 3 }\n")
    with pytest.raises(SpecError, match=words):
        read(tmp_path, f'[[sensors]]\nkind = "{kind}"\nscanner = "{name}"\n')


# -------------------------------------------------------------------------------------- species file
# Species files: leaves of one's own, and what is wrong said in one sentence.

SPECIES = """
name = "kite tree"
[grammar]
generations = 4
radius = 0.08
[leaf]
mesh = "kite.stl"
"""
KITE = np.array([[0, 0, 0], [1, -0.6, 0], [3, 0, 0], [1, 0.6, 0]])[[[0, 1, 2], [0, 2, 3]]]


def test_leaves_of_a_users_own_shape(tmp_path):
    (tmp_path / "kite.toml").write_text(SPECIES)
    write_stl(tmp_path / "kite.stl", KITE)
    species, blade = load_species(tmp_path / "kite.toml")
    tree = grow(species, blade, stream(1, "kite"))
    assert len(tree.leaves) > 100
    assert np.sum(tree.mesh.part == LEAF) == 2 * len(tree.leaves)
    measured = measure_leaves(tree.mesh)
    np.testing.assert_allclose(tree.leaves.radius, measured.radius, rtol=1e-6)
    area = np.pi * tree.leaves.radius**2
    np.testing.assert_allclose(area, tree.leaves.length * tree.leaves.width / 2, rtol=1e-6)


@pytest.mark.parametrize(
    ("facets", "complaint"),
    [(None, "there is no file"), (KITE * [1, 0, 0], "no area")],
)
def test_a_leaf_that_cannot_be_used(tmp_path, facets, complaint):
    (tmp_path / "kite.toml").write_text(SPECIES)
    if facets is not None:
        write_stl(tmp_path / "kite.stl", facets)
    with pytest.raises(SpecError, match=complaint) as caught:
        load_species(tmp_path / "kite.toml")
    assert "leaf.mesh" in str(caught.value)


@pytest.mark.slow
def test_a_tree_is_recognised_once_as_long_as_its_files_stay_the_same(tmp_path):
    """By what is in them: a file that was written anew is read anew, at another height it is another."""

    def load(height):
        (tmp_path / "mine.toml").write_text(
            f'name = "mine"\n[template]\nwood = "wood.stl"\nheight = {height}\n'
        )
        return load_species(tmp_path / "mine.toml")[1]

    wood = tree().wood()
    write_stl(tmp_path / "wood.stl", wood)
    first = load(5.0)
    assert load(5.0) is first
    assert load(6.0).trunk_length == pytest.approx(1.2 * first.trunk_length)
    assert load(5.0) is first
    write_stl(tmp_path / "wood.stl", wood * [1, 1, 2])
    assert load(5.0) is not first
    for height in range(7, 7 + KEPT):
        load(float(height))
    write_stl(tmp_path / "wood.stl", wood)
    again = load(5.0)  # no longer kept: recognised again, the same
    assert again is not first
    for one, other in zip(again.branches, first.branches, strict=True):
        np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)


@pytest.mark.medium
def test_a_template_is_cut_once_in_a_process(tmp_path):
    """A series of scenes keeps one template and its branches, not one a scene; another solid is another."""
    first = load_species(find_species("hazelnut", tmp_path))[1]
    again = load_species(find_species("hazelnut", tmp_path))[1]
    assert again is first
    shutil.copytree(ASSETS / "templates" / "hazelnut", tmp_path / "t")
    preset = find_species("hazelnut", tmp_path).read_text()
    file = tmp_path / "own.toml"
    file.write_text(preset.replace("../templates/hazelnut", "t"))
    assert load_species(file)[1] is first
    write_stl(tmp_path / "t" / "wood.stl", 1.01 * read_stl(tmp_path / "t" / "wood.stl"))
    other = load_species(file)[1]
    assert other is not first
    assert len(other.branches) == len(first.branches)


@pytest.mark.slow
def test_what_is_kept_of_templates_does_not_grow_with_scenes(tmp_path):
    def kept():
        gc.collect()
        return sum(isinstance(obj, BranchTemplate) for obj in gc.get_objects())

    counts = []
    for _ in range(3):
        species, template = load_species(find_species("hazelnut", tmp_path))
        grow(species, template, stream(1, "series"))
        del species, template
        counts.append(kept())
    assert counts[0] == counts[1] == counts[2]
