"""Words, scenes and maps that no command can use: one sentence says what, and nothing is written."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from references.model_tree import tree

bpy = pytest.importorskip("bpy")

from forest_addon.formats.stl import write_stl
from forest_addon.formats.wav import write_wav

SMALL = Path(__file__).with_name("small.toml").read_text(encoding="utf-8")
FIELD = SMALL.partition("[[sensors]]")[0]


def sensor(kind, more="", name="a"):
    return f"[[sensors]]\nkind = '{kind}'\nname = '{name}'\n{more}\n"


def planting(species, more="expected = 2"):
    return f"[[plantings]]\nspecies = '{species}'\n{more}\n"


SCENES = [
    ("[forest]\nsize = [-3, 4]", "forest.size[0]: -3 m is out of range; use larger than 0"),
    ("[forest]\nsise = [3, 4]", 'forest.sise: is not known; did you mean "size"?'),
    ("this is not toml", "is not TOML"),
    ("seed = -1", "-1 is out of range; use from 0 to 9,223,372,036,854,775,807"),
    ("[plantings]\nspecies = 'maple'\nexpected = 3", "plantings: is one table"),
    ("[tiles]\nsize = 0.0001\n", "give at least 0.03 m"),
    (
        "[forest]\npolygon = [[0, 0], [9, 9], [9, 0], [0, 9]]\n" + planting("maple"),
        "cross or touch",
    ),
    (planting("oak"), "use one of abop-monopodial-a"),
    (planting("oak.toml"), "oak.toml: there is no such file"),
    (
        planting("spuce") + planting("apple") + planting("hazlenut"),
        'plantings[0].species, plantings[2].species: "spuce" (did you mean "spruce"?), "hazlenut" (did',
    ),
    (
        planting("maple", "expected = 3\ngaussians = [{ centre = [9e6, 0], width = [1, 1] }]"),
        "put nothing on the field",
    ),
    (planting("maple", "expected = 1e9"), "plantings[0].expected"),
    (planting("maple", "expected = 5e7"), "50,000,000 trees, more than 20,000,000"),
    (planting("maple", "expected = 2\nrasters = [{ file = 'gone.npy' }]"), "gone.npy: there is no"),
    (
        planting("scots-pine", "expected = 9\ntargets = {dbh = {mean = 2.8}}"),
        "times the largest measured of Pinus",
    ),
    (planting("gone-stl.toml"), "gone-stl.toml: template: there is no file"),
    (planting("page-stl.toml"), "page-stl.toml: template: page.stl is not an STL"),
    (planting("cut-stl.toml"), "cut-stl.toml: template: cut.stl is cut"),
    (sensor("reverb", "sample_rate = 8000.5"), "need a whole number of hertz"),
    (sensor("terrestrial", name="x" * 300), "give a shorter one"),
    (FIELD + sensor("sonar", name="leaves"), "leaves.npz, as the scene does"),
    (FIELD + sensor("terrestrial", name="preview"), "preview.png, as the scene does"),
    (sensor("terrestrial", name="tls") + sensor("sonar", name="TLS"), 'as sensor "tls" does'),
    (sensor("reverb") + sensor("reverb", name="a-dry"), 'a-dry.wav, as sensor "a" does'),
    (sensor("sonar") + sensor("sonar", name="a-heard"), 'a-heard.npz, as sensor "a" does'),
    *(  # forests have grown and nothing is written when these are met
        (FIELD + sensor("sonar", name="b") + sensor(kind, more), said)
        for kind, more, said in (
            ("sonar", "call = 'file'\ncall_file = 'dry.wav'", "holds nothing above 4000 Hz"),
            ("sonar", "hearing = 'file'\nhearing_file = 'gone.csv'", '"gone.csv" is not in'),
            ("sonar", "route = 'map.csv'", "needs the columns x_m"),
            ("mobile", "follow = 'Drone'", "Drone"),
            ("reverb", "heard_as = 'binaural'\nhead_file = 'gone.sofa'", "gone.sofa"),
            ("reverb", "source_objects = 'Horn'", 'no Speaker, Empty or Camera "Horn"'),
            ("terrestrial", "angle_step_deg = 0.002", "GB of memory"),
        )
    ),
]
SCAN = "--scanner riegl-vz-400i --at -1,0.5,1.6 --set angle_step_deg=1.0"
WORDS = [
    ("--versoin", 'did you mean "--version"'),
    ("rnu demo", 'did you mean "run"'),
    ("run dmo", 'did you mean "demo"'),
    ("run demo --quite", 'did you mean "--quiet"'),
    ("run demo hedge", "hedge: is a word too many"),
    ("run demo --workers=0", "--workers"),
    ("run demo --workers=-3", "--workers"),
    ("run demo --out ''", "is empty; name a file or folder"),
    ("run small.toml --seed -1", "--seed: -1 is out of range"),
    ("run small.toml --out small.toml/o", "cannot be written to"),
    ("run 'a\x1b[2Jb.toml' --out o", "a\\x1b[2Jb.toml"),  # names do not command the terminal
    ("canopy small.toml --at '1;2'", "is not 2 or 3 numbers"),
    ("canopy small.toml --at 1,2,3,4", "is not 2 or 3 numbers"),
    ("canopy small.toml --at nan,2", "is not 2 or 3 numbers"),
    ("canopy small.toml --grid 0", "out of range"),
    ("convolve none.wav dry.wav", "none.wav"),
    ("convolve dry.wav dry.wav --normalise nan", "nan is no finite number"),
    ("convolve dry.wav head.wav --out wet.mp3", "must end in .wav"),
    ("convolve dry.wav head.wav --out head.wav", "is read by"),
    ("convolve head.wav dry.wav", "its head is broken"),
    ("convolve . dry.wav", "is a folder; name a WAV file in it"),
    ("dataset --convert none --to s3dis", "holds no finished scene"),
    ("dataset --convert empty", "needs --to"),
    ("derive apple --generations 40", "symbols, more than 50,000,000"),
    ("derive apple --generations -1", "--generations: -1 is out of range"),
    ("derive apple --seed -1", "--seed: -1 is out of range"),
    ("derive honda-birch", "not by an L-system"),
    ("derive scots-pine", "not by an L-system"),
    ("derive aple", '"aple" is not known'),
    ("estimate map.csv --out map.csv", "must end in .toml"),
    ("lidar", "needs a .blend file"),
    ("lidar park.blend", "--scanner: is missing"),
    ("lidar park.blend --scanner rigel", "use one of dji-zenmuse-l2, faro-focus-s350"),
    ("lidar park.blend --scanner riegl-vz-400i", "--at: is missing"),
    ("lidar park.blend --scanner riegl-vz-400i --at 1,2", "is not 3 numbers with commas"),
    ("lidar park.blend --scanner riegl-vz-400i --along Drone", "is no mobile scanner"),
    ("lidar park.blend --scanner riegl-vux-1uav --along Road", "curves and empties here: Drone"),
    (f"lidar bare.blend {SCAN}", "has nothing to scan"),
    (f"lidar park.blend {SCAN} --set angel_step_deg=1", 'did you mean "angle_step_deg"'),
    (f"lidar park.blend {SCAN} --set max_range=-3", "max_range: -3 m is out of range"),
    (f"lidar park.blend {SCAN} --set nonsense", "is not KEY=VALUE"),
    (f"lidar park.blend {SCAN} --seed -1", "--seed: -1 is out of range"),
    (f"lidar park.blend {SCAN} --chunk 0", "--chunk: 0 is out of range"),
    (f"lidar park.blend {SCAN} --out x.txt", "must end in one of .laz"),
    (f"lidar none.blend {SCAN}", "there is no such file"),
    (f"lidar small.toml {SCAN}", "must end in one of .blend, .glb"),
    ("species hazelnut --pixels 5", "--pixels"),
    ("species plum-pudding", "plum-pudding"),
    ("stand demo --out points.xls", "must end in .csv or .geojson"),
    ("stand demo --out points.png", "must end in .csv or .geojson"),
    ("stand demo --out points", "must end in .csv or .geojson"),
    ("template nowhere.stl --name x", "there is no file nowhere.stl"),
    ("template w.stl --name 'a b'", "letters, digits"),
    ("template w.stl --name x --height -1", "out of range"),
    ("template w.stl --name x --siblings 1", "--siblings: 1 is out of range"),
    ("template w.stl --name x --unit miles", "use one of metres"),
]
MAPS = [  # a table of trees, further words of ``estimate``
    *(
        ("x,y\n1,2\n", f"--species maple --window {window}", said)
        for window, said in (
            ("0 0 10", "give X0 Y0 X1 Y1"),
            ("0 0 0 9", "give X0 Y0 X1 Y1"),
            ("0 a 1 9", "could not convert"),
            ("none.csv", "there is no such file"),
        )
    ),
    ("", "", "is empty; it needs a header"),
    ("x,y\n", "", "has no trees below its header"),
    ("a,b\n1,2\n", "", "has no column x, only a, b; call one of them x, another y"),
    ("x,y\n1,2\n3,zwei\n", "", 'row 3: y is "zwei", not a finite number'),
    ("x,y\n3,nan\n", "", "has no trees below its header"),
    ("x,y,bhd\n1,2,31.5\n3,4,28\n", "--species maple", "say the unit in the header, as dbh_cm"),
    ("x,y\n1\n", "", "row 2 has 1 values, its header 2"),
    ("x,y\n1,2\n", "", "some trees have no species; say what grows there"),
    ("x,y,species\n1,2,pine\n", "", '"pine" is no preset; say what grows in its place'),
    (
        "x,y,SPCD\n1,2,318\n3,4,202\n5,6,318\n",
        "",
        '"202", "318" are no presets; say what grows in their place, as '
        "--species 202=douglas-fir --species 318=PRESET. Presets: ",
    ),
    (
        "x;y;Baumart\n1;2;Fi\n3;4;Bu\n5;6;Picea abies\n",
        "",
        "as --species Bu=european-beech --species Fi=norway-spruce "
        "--species 'Picea abies=norway-spruce'. ",
    ),
    ("x,y,taxonID\n1,2,ACSA3\n", "--species ACSA3=acer", "as --species ACSA3="),
    (
        "x,y,species\n1,2,pine\n",
        "--species oak=maple",
        'no tree of the map is "oak"; it has "pine"',
    ),
    ("x,y,species\n1,2,pine\n", "--species pine=oak.toml", "there is no file oak.toml"),
    ("x,y,species\n1,2,pine\n", "--species pine=elm", '--species: "elm" is no preset'),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write the files that commands find beside them, sound and broken."""
    folder = tmp_path_factory.mktemp("refused")
    (folder / "empty").mkdir()
    (folder / "small.toml").write_text(SMALL)
    (folder / "map.csv").write_text("x,y\n1,2\n")
    write_stl(folder / "w.stl", tree().wood())
    write_stl(folder / "l.stl", tree().leaves())
    (folder / "cut.stl").write_bytes((folder / "w.stl").read_bytes()[:-1000])
    (folder / "page.stl").write_text("<html>not found</html>")
    for name in ("gone", "page", "cut"):
        told = f'name = "a"\n[template]\nwood = "{name}.stl"\n'
        (folder / f"{name}-stl.toml").write_text(told)
    write_wav(folder / "dry.wav", np.sin(np.arange(4000.0)), 8000)
    (folder / "head.wav").write_bytes(b"RIFF\0\0\0\0WAVE")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "bare.blend"))
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.empty_add()
    bpy.context.object.name = "Drone"
    for frame in (1, 5):
        bpy.context.object.keyframe_insert("location", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "park.blend"))
    return folder


def content(folder):
    return {p: p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


@pytest.fixture
def refused(headless, folder, monkeypatch):
    """The one sentence by which a command ends that cannot be done, and leaves all as it was."""

    def run(words):
        monkeypatch.chdir(folder)
        before = content(folder)
        said = headless(*shlex.split(words), ends=2).stderr
        assert content(folder) == before
        assert said.count("error: ") == 1
        return said

    return run


@pytest.mark.slow
@pytest.mark.parametrize(("words", "said"), WORDS)
def test_words_that_cannot_be_used(refused, words, said):
    assert said in refused(words)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "said"), SCENES)
def test_scenes_that_cannot_be_used(refused, folder, scene, said):
    (folder / "s.toml").write_text(scene)
    assert said in refused("run s.toml --out o --quiet --convolve dry.wav")


@pytest.mark.medium
@pytest.mark.parametrize(("table", "words", "said"), MAPS)
def test_maps_that_cannot_be_used(refused, folder, table, words, said):
    (folder / "t.csv").write_text(table)
    assert said in refused(f"estimate t.csv --out o/s.toml {words}")
