"""A scene written for other programs, read back as a survey of HELIOS++: the same pulses and points."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.rays import BruteCaster
from scipy.spatial.transform import Rotation

from forest_addon.base.trimesh import DEAD, GROUND, LEAF, OTHER, WOOD, TriMesh
from forest_addon.blender.files.others import write_parts
from forest_addon.formats.helios.document import read_document
from forest_addon.formats.helios.scene import read_scene
from forest_addon.formats.helios.survey import read_survey
from forest_addon.sensing.lidar.pattern import Pulses, pattern_of
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.lidar.surveys.export import write_survey
from forest_addon.sensing.lidar.surveys.leg import SurveyLeg
from forest_addon.sensing.lidar.tractor import axes, drive, fan, positions
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import (
    Airborne,
    Beam,
    Mobile,
    Noise,
    Pose,
    Sonar,
    SpecError,
    Surfaces,
    Terrestrial,
    Tractor,
)
from headless.surveys import geometry_of, scan_survey, sensor_of_survey

SURFACES = Surfaces(other=0.2, wood=0.35, leaf=0.55, ground=0.15)


def some_scene():
    """Two meshes of triangles of all parts, placed evenly, turned, sheared and mirrored, above a ground."""
    rng = np.random.default_rng(4)
    meshes = []
    for _ in range(2):
        corners = rng.normal(size=(90, 3)) + np.repeat(rng.normal(size=(30, 3)) * 3, 3, axis=0)
        part = rng.choice([OTHER, WOOD, LEAF, DEAD], 30)
        mesh = TriMesh.of_part(corners, np.arange(90).reshape(-1, 3), OTHER)
        meshes.append(replace(mesh, part=part.astype(mesh.part.dtype)))
    floor = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 60.0
    meshes.append(TriMesh.of_part(floor, np.array([[0, 1, 2], [0, 2, 3]]), GROUND))
    turn = Rotation.from_euler("xyz", [0.3, -1.2, 2.5]).as_matrix()
    linear = [
        np.eye(3),
        1.7 * turn,
        turn @ np.diag([1, 1, -1]),
        turn @ np.diag([1, 2, 1]),
        np.eye(3),
    ]
    places = [(5, 0, 4), (-6, 3, 5), (0, -8, 4), (3, 9, 6), (0, 0, 0)]
    index = np.array([0, 1, 0, 0, 2])
    none = np.full(5, -1)
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=np.array([np.column_stack(pair) for pair in zip(linear, places, strict=True)]),
        mesh_index=index,
        object_name=tuple("abcde"),
        tree=none,
        species=none.copy(),
        reflectance=np.array([np.nan, 0.9, np.nan, np.nan, np.nan]),
    )


def read_back(sensor, folder):
    scene = some_scene()
    _, unsaid = write_parts(scene, folder, "ex", SURFACES)
    way = [pattern_of(sensor).path] if isinstance(sensor, Mobile) else []
    survey, of_sensor = write_survey(sensor, folder, "ex", SURFACES, *way)
    return scene, read_survey(folder / survey), unsaid, of_sensor


def pulses_of(sensor, folder):
    """All pulses of the first leg of a sensor's survey, and those that the sensor sends."""
    _, survey, *_ = read_back(sensor, folder)
    theirs, ours = SurveyLeg(survey, survey.legs[0]), pattern_of(sensor)
    assert theirs.count == ours.count
    return [pattern.pulses(np.arange(ours.count)) for pattern in (theirs, ours)]


def test_parts_and_materials(tmp_path):
    sensor = Terrestrial(angle_step_deg=20, surfaces=SURFACES)
    scene, survey, unsaid, _ = read_back(sensor, tmp_path)
    assert unsaid == ["2 instances are sheared or mirrored: each has an OBJ file of its own"]
    assert len(list((tmp_path / "data/sceneparts/ex").glob("*.obj"))) == 5
    back = geometry_of(survey)
    for row, part in enumerate(survey.parts):
        mesh = scene.meshes[scene.mesh_index[row]]
        world = mesh.vertices[mesh.triangles] @ scene.transform[row, :, :3].T
        assert part.corners == pytest.approx(world + scene.transform[row, :, 3], abs=1e-12)
        each = np.arange(len(mesh.triangles))
        of_part = np.array([0.2, 0.35, 0.55, 0.15, 0.35])[mesh.part]
        want = scene.reflectance_at(np.full(len(each), row), each, np.nan)
        want = np.where(np.isnan(want), of_part, want)
        assert back.reflectance_at(np.full(len(each), row), each, np.nan).tolist() == want.tolist()
        assert (part.mesh.ground == (mesh.part == GROUND)).all()


@pytest.mark.medium
@pytest.mark.parametrize("azimuth", [(10.0, 200.0), (0.0, 360.0)])
def test_a_tripod_sends_the_same_pulses_and_finds_the_same_points(tmp_path, azimuth):
    sensor = Terrestrial(
        position=(0.5, 0.3, 2.6),
        azimuth_deg=azimuth,
        elevation_deg=(-30.0, 60.0),
        angle_step_deg=3.0,
        line_step_deg=2.0,
        max_range=70.0,
        surfaces=SURFACES,
        beam=Beam(max_returns=3),
        noise=Noise(range_sd=0.01),
    )
    one, other = pulses_of(sensor, tmp_path)
    scene, survey, *_ = read_back(sensor, tmp_path)
    assert survey.device.accuracy == 0.01
    (leg,) = survey.legs
    pattern = SurveyLeg(survey, leg)
    assert one.direction == pytest.approx(other.direction, abs=1e-9)
    assert one.origin == pytest.approx(other.origin, abs=1e-12)
    told = replace(sensor_of_survey(survey, leg, "leg"), noise=Noise())
    read = Scan(told, BruteCaster(geometry_of(survey)), pattern=pattern).look(0, pattern.count)
    here = scan(replace(sensor, noise=Noise()), BruteCaster(scene))
    assert len(here) > 200
    assert np.array_equal(read.pulse, here.pulse)
    assert read.position == pytest.approx(here.position, abs=1e-6)
    assert read.intensity == pytest.approx(here.intensity, rel=1e-6)
    assert np.array_equal(read.returns.instance, here.returns.instance)


def test_an_aircraft_sweeps_the_same_lines_over_the_same_way(tmp_path):
    sensor = Airborne(
        position=(3.0, -30.0, 60.0),
        heading_deg=75.0,
        track=40.0,
        speed=20.0,
        strips=2,
        spacing=8.0,
        field_deg=(-20.0, 35.0),
        pulse_rate=4000.0,
        line_rate=20.0,
        mount_deg=(1.0, 2.0, 3.0),
        max_range=200.0,
        surfaces=SURFACES,
    )
    _, survey, *_ = read_back(sensor, tmp_path)
    ours = pattern_of(sensor)
    per_strip = ours.count // 2
    for strip, leg in enumerate(leg for leg in survey.legs if leg.active):
        pattern = SurveyLeg(survey, leg)
        assert abs(pattern.count - per_strip) <= 41  # lines cut at the ends of the mirror
        one = pattern.pulses(np.arange(pattern.count))
        other = ours.pulses(strip * per_strip + np.arange(per_strip))
        # A sweep of theirs starts in the middle of a line and may have a pulse more at its end.
        line = other.direction[:200]
        away = np.linalg.norm(one.direction[:600, None] - line[None], axis=2)
        step = np.deg2rad(55.0) * 20.0 / 4000.0
        assert away.min(axis=1).max() < 1.01 * step
        assert np.mean(away.min(axis=1) < 1e-9) > 0.98
        turns = np.diff(away.argmin(axis=1)) % 200  # the same way round, a pulse a pulse
        assert np.mean(np.isin(turns, (0, 1, 2))) > 0.98
        assert np.mean(turns == 1) > 0.9
        sent = np.rint(one.time * 4000.0).astype(int)
        place = other.origin[np.minimum(sent, per_strip - 1)]
        assert np.abs(one.origin - place).max() < 20.0 / 4000.0 * 1.01


@pytest.mark.parametrize("pattern", ["circles", "spinning"])
def test_cones_and_spinning_heads_send_the_same_pulses(tmp_path, pattern):
    settings = {"pattern": pattern, "field_deg": (-15.0, 20.0), "channels": 4, "surfaces": SURFACES}
    settings |= {"pulse_rate": 4000.0, "line_rate": 20.0, "mount_deg": (1.0, 2.0, 3.0)}
    sensor = Airborne(
        position=(3.0, -30.0, 60.0), heading_deg=75.0, track=10.0, speed=20.0, **settings
    )
    one, other = pulses_of(sensor, tmp_path)
    assert one.direction == pytest.approx(other.direction, abs=1e-9)
    assert np.abs(one.origin - other.origin).max() < 4 * 20.0 / 4000.0 * 1.01  # a column's beams


@pytest.mark.medium
@pytest.mark.parametrize("pattern", ["fans", "zigzag"])
def test_fans_and_zigzags_look_where_ours_do(tmp_path, pattern):
    sensor = Airborne(
        position=(3.0, -30.0, 60.0), heading_deg=75.0, track=18.0, speed=20.0, pattern=pattern,
        field_deg=(-30.0, 30.0), fan_deg=10.0, pulse_rate=12000.0, line_rate=20.0,
        mount_deg=(1.0, 2.0, 3.0), surfaces=SURFACES,
    )  # fmt: skip
    _, survey, *_ = read_back(sensor, tmp_path)
    theirs, ours = SurveyLeg(survey, survey.legs[0]), pattern_of(sensor)
    assert abs(theirs.count - ours.count) <= 0.01 * ours.count
    one = theirs.pulses(np.arange(theirs.count)).direction
    other = ours.pulses(np.arange(600 * (3 if pattern == "fans" else 2))).direction
    away = np.linalg.norm(one[::7, None] - other[None], axis=2).min(axis=1)
    step = np.deg2rad(60.0) / 600
    assert away.max() < 1.3 * step
    if pattern == "fans":
        assert np.mean(away < 1e-9) > 0.98
        from_all = np.linalg.norm(other[::7, None] - one[None, :4000], axis=2).min(axis=1)
        assert from_all.max() < 1.01 * step  # all three fans are there
    else:
        ends = one @ other[[0, 599]].T  # both ends of the field are reached, and no more
        assert ends.max(axis=0) == pytest.approx(1.0, abs=2e-5)
        swings = np.diff(one @ (other[0] - other[599]) > 0)  # past the middle, once a line
        assert abs(int(np.sum(swings)) - 18) <= 1


POSED = [
    {"pattern": "fans", "field_deg": (-20.0, 40.0)},
    {"pattern": "zigzag", "pulse_rate": 1000.0, "line_rate": 20.0},
    {"pattern": "rosette", "field_deg": (-7.0, 52.0), "petals": 3.7},
]


@pytest.mark.medium
@pytest.mark.parametrize("settings", POSED, ids=lambda settings: settings["pattern"])
def test_what_has_no_optics_of_theirs_turns_its_platform(tmp_path, settings):
    sensor = Airborne(
        **{"pulse_rate": 2000.0, "line_rate": 20.0} | settings,
        position=(3.0, -30.0, 60.0), heading_deg=75.0, track=6.0, speed=20.0, strips=2, spacing=8.0,
        mount_deg=(1.0, 2.0, 3.0), surfaces=SURFACES,
    )  # fmt: skip
    one, other = pulses_of(sensor, tmp_path)
    assert one.direction == pytest.approx(other.direction, abs=1e-9)
    assert one.across == pytest.approx(other.across, abs=1e-9)
    assert one.origin == pytest.approx(other.origin, abs=1e-9)
    assert one.time == pytest.approx(other.time + 1 / sensor.pulse_rate, abs=1e-12)


def test_a_rosette_on_a_vehicle_is_written(tmp_path):
    poses = (
        Pose(time=0.0, position=(0, 0, 2)),
        Pose(time=1.0, position=(8, 1, 2.5), heading_deg=30),
    )
    sensor = Mobile(
        poses=poses, pattern="rosette", field_deg=(-7.0, 52.0), line_rate=10.0, pulse_rate=4000.0,
        surfaces=SURFACES,
    )  # fmt: skip
    one, other = pulses_of(sensor, tmp_path)
    assert "no rosette" in read_back(sensor, tmp_path)[-1][0]
    assert len(one.time) == 4000
    assert one.direction == pytest.approx(other.direction, abs=1e-9)
    assert one.origin == pytest.approx(other.origin, abs=1e-9)


def test_a_row_a_pulse_has_an_end(tmp_path):
    sensor = Airborne(pattern="rosette", pulse_rate=500_000.0, track=100.0, speed=20.0)
    survey, unsaid = write_survey(sensor, tmp_path, "ex", SURFACES)
    assert survey is None
    assert "no rosette, and a row for each of 2,500,000 pulses" in unsaid[0]


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_tractor_sends_the_beams_of_its_matrix(tmp_path, side):
    sensor = Tractor(
        position=(-2.0, -1.0, 1.0), heading_deg=70.0, track=2.0, step=0.25, gap=1, angle_step_deg=5.0,
        side=side, max_range=50.0,
    )  # fmt: skip
    scene, survey, *_ = read_back(sensor, tmp_path)
    leg = survey.legs[0]
    theirs = SurveyLeg(survey, leg)
    scans, angles = len(positions(sensor)), len(fan(sensor))
    assert theirs.count == scans * angles
    pulses = theirs.pulses(np.arange(theirs.count))
    origin, way = axes(sensor, *np.divmod(np.arange(theirs.count), angles))
    assert pulses.origin == pytest.approx(origin, abs=1e-9)
    assert pulses.direction == pytest.approx(way, abs=1e-9)
    told = replace(sensor_of_survey(survey, leg, "leg"), noise=Noise())
    read = Scan(told, BruteCaster(geometry_of(survey)), pattern=theirs).look(0, theirs.count)
    here = drive(sensor, BruteCaster(scene)).distance.ravel()
    met = np.flatnonzero(np.isfinite(here))
    assert len(met) > 10
    assert np.array_equal(read.pulse, met)
    assert read.true_range == pytest.approx(here[met], abs=1e-6)


def test_a_vehicle_goes_its_way_with_its_attitudes(tmp_path):
    poses = [
        Pose(time=0.0, position=(0, 0, 2)),
        Pose(time=2.0, position=(8, 1, 2.5), heading_deg=30),
    ]
    poses += [Pose(time=3.0, position=(9, 6, 3), heading_deg=80, roll_deg=5, pitch_deg=-4)]
    sensor = Mobile(
        poses=tuple(poses), pattern="spinning", channels=4, field_deg=(-15.0, 15.0), line_rate=10.0,
        pulse_rate=4000.0, surfaces=SURFACES,
    )  # fmt: skip
    _, survey, *_ = read_back(sensor, tmp_path)
    ours, pattern = pattern_of(sensor), SurveyLeg(survey, survey.legs[0])
    assert abs(pattern.count - ours.count) <= 4
    one, other = (p.pulses(np.arange(ours.count - 4)) for p in (pattern, ours))
    # the beams of a column leave together, a millisecond late, while the vehicle turns by 50 degrees a second
    assert np.abs(one.direction - other.direction).max() < 2e-3
    assert (
        np.abs(one.origin - other.origin).max() < 0.02
    )  # and poses are a hundredth of a second apart


def test_what_cannot_be_said_is_said_in_words(tmp_path):
    assert write_survey(Sonar(), tmp_path, "ex", SURFACES) == (None, ["HELIOS++ has no sonar"])
    survey, unsaid = write_survey(Mobile(), tmp_path, "ex", SURFACES)
    assert survey is None
    assert "its way is in scene.json" in unsaid[0]
    rich = Terrestrial(
        angle_step_deg=20,
        faintest=0.1,
        bounces=True,
        beam=Beam(subrays=10, divergence_mrad=(0.3, 0.5), exit_diameter=0.01, extinction=1e-4),
        noise=Noise(range_ppm=5.0),
    )
    unsaid = " ".join(write_survey(rich, tmp_path, "ex", SURFACES)[1])
    for word in (
        "reflectances",
        "round",
        "exit",
        "rings of 19",
        "faintest",
        "range_sd",
        "air",
        "bounces",
    ):
        assert word in unsaid


@pytest.mark.slow
def test_the_command_writes_what_it_says(tmp_path):
    pytest.importorskip("bpy")
    from headless.cli import main

    scene = tmp_path / "one.toml"
    scene.write_text(
        'name = "one"\nseed = 7\n[forest]\nsize = [8, 8]\nundergrowth = "none"\n[[plantings]]\n'
        'species = "hazelnut"\nvariants = 1\nexpected = 3\nexact = true\n[[sensors]]\n'
        'kind = "terrestrial"\nname = "tripod"\nangle_step_deg = 4\n[[sensors]]\nkind = "airborne"\n'
        'name = "plane"\nposition = [0, 0, 50]\ntrack = 10\nmax_range = 90\n'
    )
    out = tmp_path / "out"
    main(["export", str(scene), "--out", str(out), "--quiet"])
    said = json.loads((out / "scene.json").read_text())
    assert (said["seed"], said["materials"]["2"]) == (7, "leaf")
    trees = [part for part in said["parts"] if part["tree"] >= 0]
    assert sorted(part["tree"] for part in trees) == [0, 1, 2]
    assert len({part["file"] for part in trees}) == 1  # trees share a mesh
    assert len(said["ways"]["plane"]["time_s"]) == 2
    assert (out / "forest.glb").read_bytes()[:4] == b"glTF"
    assert (out / "scene.blend").stat().st_size > 10_000
    for found in said["surveys"]:
        assert read_survey(out / found["survey"]).legs


# -------------------------------------------------------------------------------------------- survey
# Surveys of HELIOS++: small ones of our own, whose pulses and ranges have closed forms.

SURVEY_GROUND = """mtllib ground.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
usemtl soil
f 1 2 3 4
"""
BLOCK = """v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f -4 -3 -2
f 1//1 3//1 4//1
"""
SCENE = """<document><scene id="s">
<part><filter type="objloader"><param key="filepath" value="parts/ground.obj"/></filter>
<filter type="scale"><param key="scale" value="100"/></filter>
<filter type="translate"><param key="offset" value="0;0;2"/></filter></part>
<part id="block"><filter type="objloader"><param key="filepath" value="parts/block.obj"/></filter>
<filter type="translate"><param key="onGround" value="-1"/><param key="offset" value="10;0;50"/></filter>
<filter type="rotate"><param key="rotation"><rot axis="z" angle_deg="90"/></param></filter>
<filter type="scale"><param key="scale" value="3"/></filter>EXTRA</part>
</scene></document>"""
LIBRARY = """<document>
<platform id="tripod" type="static"><scannerMount z="1.5"/></platform>
<platform id="plane" type="linearpath">
<scannerMount><rot axis="x" angle_deg="-90"/></scannerMount></platform>
<platform id="copter" type="multicopter"/><platform id="hover" type="hovercraft"/>
<scanner id="fan" optics="rotating" scanAngleMax_deg="90" scanAngleEffectiveMax_deg="60"
 pulseFreqs_Hz="1000" rangeMin_m="0.5" pulseLength_ns="4" beamDivergence_rad="0.0003">
<beamOrigin x="0" y="0" z="0.2"/></scanner>
<scanner id="cone" optics="conic" scanAngleMax_deg="20" scanFreqMax_Hz="10" pulseFreqs_Hz="1000"/>
<scanner id="swing" optics="oscillating" scanAngleMax_deg="20"/>
<scanner id="prism" optics="spiral"/>
</document>"""
TRIPOD = """<document><scannerSettings id="t" pulseFreq_hz="1000" scanFreq_hz="10">TEMPLATE</scannerSettings>
<survey name="n" scene="scene.xml#s" platform="library.xml#PLATFORM"
 scanner="library.xml#SCANNER">LEGS</survey>
</document>"""
LEG = """<leg><platformSettings x="0" y="0" z="9" onGround="true"/><scannerSettings template="t"
 headRotatePerSec_deg="20" headRotateStart_deg="-90" headRotateStop_deg="-50"
 verticalAngleMin_deg="-44" verticalAngleMax_deg="-30"/></leg>"""
FLIGHT = """<leg><platformSettings x="0" y="-10" z="52" movePerSec_m="20"/>
<scannerSettings template="t" scanAngle_deg="20"/></leg>
<leg><platformSettings x="0" y="10" z="52"/><scannerSettings active="false"/></leg>"""


def written(
    folder: Path,
    legs: str = LEG,
    platform: str = "tripod",
    scanner: str = "fan",
    extra: str = "",
    template: str = "",
) -> Path:
    (folder / "parts").mkdir(exist_ok=True)
    (folder / "parts/ground.obj").write_text(SURVEY_GROUND)
    (folder / "parts/ground.mtl").write_text("newmtl soil\nhelios_isGround true\n")
    (folder / "parts/block.obj").write_text(BLOCK)
    (folder / "scene.xml").write_text(SCENE.replace("EXTRA", extra))
    (folder / "library.xml").write_text(LIBRARY)
    text = TRIPOD.replace("LEGS", legs).replace("PLATFORM", platform).replace("SCANNER", scanner)
    text = text.replace("TEMPLATE", template)
    (folder / "survey.xml").write_text(text)
    return folder / "survey.xml"


def sent(survey: Path, number: int = 0) -> Pulses:
    """All pulses of a leg of a survey."""
    read = read_survey(survey)
    pattern = SurveyLeg(read, read.legs[number])
    return pattern.pulses(np.arange(pattern.count))


def test_part_is_scaled_turned_moved_and_set_on_the_ground(tmp_path: Path) -> None:
    survey = written(tmp_path)
    (ground, block), unread = read_scene("scene.xml#s", survey)
    assert unread == []
    assert ground.mesh.ground.all()
    corners = block.corners.reshape(-1, 3)
    # 3 m along x and y, turned by 90 degrees to -3..0 by 0..3, moved by 10; its face on the ground at 2 m
    np.testing.assert_allclose(corners.min(axis=0), [7, 0, 2], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [10, 3, 2], atol=1e-12)


def test_a_part_whose_material_file_is_lost_is_told_among_the_notes(tmp_path: Path) -> None:
    file = written(tmp_path)
    (tmp_path / "parts/block.obj").write_text(f"mtllib gone.mtl\n{BLOCK}")
    (note,) = read_survey(file).notes
    assert note.startswith("block.obj: its material file gone.mtl is not there")


def test_tripod_sends_the_pulses_of_its_window(tmp_path: Path) -> None:
    pulses = sent(written(tmp_path))
    np.testing.assert_allclose(pulses.origin, np.tile([0, 0, 2 + 1.5 + 0.2], (20 * 8, 1)))
    elevation = np.rad2deg(np.arcsin(pulses.direction[:, 2]))
    # 10 lines of 180 degrees a second are 1.8 degrees a pulse: -43.2 to -30.6 of each line of 2 s
    np.testing.assert_allclose(elevation[:8], -43.2 + 1.8 * np.arange(8), atol=1e-9)
    azimuth = np.rad2deg(np.arctan2(pulses.direction[:, 1], pulses.direction[:, 0]))
    np.testing.assert_allclose(azimuth, 0 + 20 * pulses.time, atol=1e-9)  # forward is +Y


def test_cone_meets_the_ground_on_a_circle_that_flies(tmp_path: Path) -> None:
    pulses = sent(written(tmp_path, FLIGHT, "plane", "cone"))
    assert len(pulses.time) == 1000  # 20 m at 20 m/s
    np.testing.assert_allclose(pulses.direction[:, 2], -np.cos(np.deg2rad(20)), atol=1e-12)
    np.testing.assert_allclose(pulses.origin[:, 1], -10 + 20 * pulses.time, atol=1e-9)
    assert abs(pulses.direction[:, :2].mean(axis=0)).max() < 1e-9  # ten whole turns


def test_survey_runs_into_a_file_a_leg_and_meets_the_plane(tmp_path: Path) -> None:
    target = tmp_path / "out/cloud.npz"
    (leg,) = scan_survey(written(tmp_path), target, quiet=True)
    points = np.load(tmp_path / "out/cloud-leg000.npz")
    assert leg.points == len(points["x"]) == leg.pulses > 100
    np.testing.assert_allclose(
        points["z"], 2.0, atol=1e-3
    )  # all looks down at the ground or the block


def test_counts_stand_beside_those_of_a_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counts = {"points": 100, "pulses_with_returns": 100, "returns_per_pulse": {"1": 100}}
    reference = tmp_path / "reference.json"
    reference.write_text(json.dumps({"legs": {"leg000": {**counts, "mean_xyz": [0, 0, 2]}}}))
    (leg,) = scan_survey(written(tmp_path), tmp_path / "c.npz", reference=reference)
    assert f"{100 * (leg.points / 100 - 1):+.2f}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extra": '<filter type="detailedvoxels"/>'}, "detailedvoxels"),
        ({"platform": "hover"}, "hovercraft"),
        ({"scanner": "prism"}, "spiral"),
        ({"legs": LEG.replace('z="9"', 'z="9" yaw_deg="3"')}, "yaw_deg"),
        ({"legs": LEG.replace('template="t"', 'template="u"')}, '"u"'),
        ({"legs": "<detectorOverrides/>" + LEG}, "detectorOverrides"),
        ({"legs": LEG.replace("<scanner", "<wind/><scanner", 1)}, 'leg holds "wind"'),
        ({"legs": LEG.replace("<scanner", "<platformSettings/><scanner", 1)}, "platformSettings 2"),
        ({"extra": "<material/>"}, 'holds "material"'),
        ({"template": "<swap/>"}, 'scannerSettings t holds "swap"'),
        ({"extra": '<filter type="scale"><points/></filter>'}, 'filter holds "points"'),
        ({"extra": "<swap/>"}, "without filters"),
        ({"extra": '<swap swapStep="0" force_null="true"/>'}, "at least 1"),
        ({"extra": '<swap swapIndices="[1, 3]" force_null="true"/>'}, "on end"),
        ({"extra": '<swap swapIndices="all" force_null="true"/>'}, "no list"),
        ({"extra": 2 * '<swap swapIndices="[1]" force_null="1"/>'}, "another"),
        (
            {"extra": '<swap force_null="true"/><dmotion id="a" loop="1"/>'},
            "only one is supported",
        ),
    ],
)
def test_what_is_not_supported_is_refused_by_name(
    tmp_path: Path, change: dict[str, str], words: str
) -> None:
    with pytest.raises(SpecError, match=words):
        read_survey(written(tmp_path, **change))


def test_words_that_are_not_known_are_told(tmp_path: Path) -> None:
    extra = (
        '<filter type="scale"><param key="scale" value="2"/><param key="axis" value="z"/></filter>'
    )
    legs = LEG.replace("<leg>", '<leg pilot="me">', 1)
    legs = legs.replace("headRotatePerSec_deg", 'headRotatePerSecDegree="7" headRotatePerSec_deg')
    notes = read_survey(written(tmp_path, legs, extra=extra)).notes
    assert [note.split(",")[0] for note in notes] == [
        'leg says "pilot"',
        'scannerSettings says "headRotatePerSecDegree"',
        'filter "scale" says "axis"',
    ]


def test_document_types_and_entities_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "bomb.xml"
    file.write_text('<!DOCTYPE d [<!ENTITY a "aaaa">]><d>&a;</d>')
    with pytest.raises(SpecError, match="DTD"):
        read_document(file)


def test_missing_part_is_named(tmp_path: Path) -> None:
    survey = written(tmp_path)
    (tmp_path / "parts/block.obj").unlink()
    with pytest.raises(SpecError, match=r"block\.obj"):
        read_survey(survey)
