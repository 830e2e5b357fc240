"""Whatever is wrong with a file of settings is said in one sentence with file, key and what is allowed."""

import re
import tempfile
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forest_addon.base.places import version
from forest_addon.formats.toml_file import read_settings, write_settings
from forest_addon.spec import Forest, Scene, Sonar, SpecError

ROOT = Path(__file__).resolve().parents[2]


def read(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_settings(path, Scene)


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


def test_an_empty_file_is_the_default_scene(tmp_path):
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
    ],
)
def test_one_sentence_names_file_key_and_what_is_allowed(tmp_path, text, key, words):
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text)
    said = str(caught.value)
    assert said.startswith(f"{tmp_path / 'scene.toml'}: {key}: ")
    assert words in said
    assert "\n" not in said


@pytest.mark.parametrize("text", ["[forest", "a = ", b"\xff\xfe\x00", b"\x00\x01", "a=1\na=2"])
def test_what_is_not_toml_is_said_to_be_so(tmp_path, text):
    with pytest.raises(SpecError, match=re.escape(str(tmp_path / "scene.toml"))) as caught:
        read(tmp_path, text)
    assert re.search("is not TOML|not a text file", str(caught.value))


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


@pytest.mark.parametrize("said", ['"{next}.0"', '"{next}.2.1"', '"soon"', "1.0", '"1"', '"-1.0"'])
def test_a_file_of_a_later_major_version_or_none_is_refused(tmp_path, said):
    major = int(version().split(".")[0])
    with pytest.raises(SpecError, match=r"install|is no version") as refused:
        read(tmp_path, f"version = {said.format(next=major + 1)}")
    assert "scene.toml" in str(refused.value)


def test_the_first_scene_file_of_all_is_read_as_it_was(tmp_path):
    """The demo of version 0.1.0, as it was committed."""
    scene = read_settings(Path(__file__).with_name("demo-0.1.0.toml"), Scene)
    assert [sensor.kind for sensor in scene.sensors]
    assert scene.plantings
