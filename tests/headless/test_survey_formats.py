"""Surveys of HELIOS++ beside walls that stand: moving parts, tracks, mirrors, rasters, materials."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from scipy import stats
from scipy.spatial.transform import Rotation

from forest_addon.formats.helios import platforms
from forest_addon.formats.helios.device import Digitiser
from forest_addon.formats.helios.document import find_files
from forest_addon.formats.helios.motion import PartMotion, read_motion
from forest_addon.formats.helios.parts import (
    Material,
    read_materials,
    read_points,
    read_terrain,
    read_voxels,
)
from forest_addon.formats.helios.platforms import DrivenLeg, SurveyTrack, drive
from forest_addon.formats.helios.survey import read_survey
from forest_addon.sensing.lidar.pattern import Pulses
from forest_addon.sensing.lidar.surveys.digitised import bins_of
from forest_addon.sensing.lidar.surveys.leg import SurveyLeg, oscillating
from forest_addon.sensing.lidar.surveys.stepped import SteppedPath
from forest_addon.sensing.lidar.waveform import find_echoes
from forest_addon.spec import SpecError
from headless.surveys import (
    CountedScan,
    casters_of,
    hazes_of,
    scan_survey,
    sensor_of_survey,
)

from .test_export import FLIGHT, LEG, sent, written

MOTION = """<part dynStep="3">
<dmotion id="a" loop="2" next="b"><motion type="translation" vec="1;0;0.5"/></dmotion>
<dmotion id="b" loop="3" next="c">
 <motion type="rotation" axis="0;0;1" angle="30" selfMode="true"/>
 <motion type="helical" axis="0;1;0" angle="10" glide="0.25"/></dmotion>
<dmotion id="c" loop="1" next="LAST"><motion type="rotation" axis="1;1;0" angle="20" center="4;5;6"/>
 <motion type="glideplane" ortho="0;1;1" shift="0.5;0;0" selfMode="true"/></dmotion>
</part>"""
ORIGIN = np.array([-7.0, 2.0, 1.0])
CORNERS = np.array(
    [[3.0, 4.0, 5.0], [5.0, 4.0, 5.0], [3.0, 8.0, 5.0], [3.0, 4.0, 6.0], [5.0, 8.0, 6.0]]
)


def moved(points: np.ndarray, middle: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Points and middle after one step of a sequence of ``MOTION``, motion by motion, in HELIOS++'s frame."""
    if name == "a":
        shift = np.array([1, 0, 0.5])
        return points + shift, middle + shift
    if name == "b":
        turn = Rotation.from_rotvec([0, 0, np.pi / 6])
        points = turn.apply(points - middle) + middle
        turn = Rotation.from_rotvec([0, np.deg2rad(10), 0])
        glide = np.array([0, 0.25, 0])
        return turn.apply(points) + glide, turn.apply(middle) + glide
    turn = Rotation.from_rotvec(np.deg2rad(20) * np.array([1, 1, 0]) / np.sqrt(2))
    centre = np.array([4.0, 5.0, 6.0])
    points, middle = turn.apply(points - centre) + centre, turn.apply(middle - centre) + centre
    n = np.array([0, 1, 1]) / np.sqrt(2)
    away = points - middle
    points = middle + away - 2 * np.outer(away @ n, n) + [0.5, 0, 0]
    return points, middle + np.array([0.5, 0, 0])


@pytest.mark.parametrize(
    ("last", "order"), [("b", "aabbbc" + "bbbc" * 9), ("a", "aabbbc" * 6), ("", "aabbbc")]
)
def test_part_that_moves_is_where_step_by_step_motions_put_it(last: str, order: str) -> None:
    part = ElementTree.fromstring(MOTION.replace("LAST", last))
    motion = read_motion(ElementTree.Element("scene", dynStep="2"), part, ORIGIN, 1e3, Path("x"))
    assert isinstance(motion, PartMotion)
    assert motion.every == 6
    place = np.column_stack([Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).as_matrix(), [1, 2, 3.0]])
    own = np.linalg.solve(place[:, :3], (CORNERS - place[:, 3]).T).T
    middle = (CORNERS.min(axis=0) + CORNERS.max(axis=0)) / 2
    path = SteppedPath(place, middle, motion, 1e3, (0, 400))
    points, centre = CORNERS - ORIGIN, middle - ORIGIN
    low, high = path.swept(own.min(axis=0), own.max(axis=0))
    for step in range(36):
        time = np.array([6 * step + 1, 6 * step + 6]) / 1e3  # the first and the last pulse of it
        for placed in path.at(time):
            found = own @ placed[:, :3].T + placed[:, 3]
            np.testing.assert_allclose(found, points + ORIGIN, atol=1e-9)
            assert (found >= low - 1e-9).all()
            assert (found <= high + 1e-9).all()
        if step < len(order):
            points, centre = moved(points, centre, order[step])


def test_legs_before_count_for_where_a_part_is() -> None:
    part = ElementTree.fromstring(
        '<part><dmotion id="a" loop="0"><motion type="translation" vec="1;0;0"/></dmotion></part>'
    )
    motion = read_motion(ElementTree.Element("scene"), part, ORIGIN, 1e3, Path("x"))
    assert motion is not None
    path = SteppedPath(np.eye(3, 4), np.zeros(3), motion, 1e3, (500, 10))
    np.testing.assert_allclose(path.at(np.array([0.003]))[0, :, 3], [502, 0, 0])
    np.testing.assert_allclose(path.rate(np.array([0.003]))[:, :, 3], [[1000, 0, 0]])


def test_dynamic_time_steps_are_counted_in_pulses_of_the_first_leg() -> None:
    part = ElementTree.fromstring(
        '<part dynTimeStep="0.05"><dmotion id="a" loop="1"><motion type="identity"/></dmotion></part>'
    )
    scene = ElementTree.Element("scene", dynTimeStep="0.01")
    motion = read_motion(scene, part, ORIGIN, 2e4, Path("x"))
    assert motion is not None
    assert motion.every == 200 * 5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<dmotion id="a"><motion type="identity"/></dmotion>', "no loop"),
        ('<dmotion id="a" loop="1"/>', "no motion"),
        ('<dmotion id="a" loop="1" next="z"><motion type="identity"/></dmotion>', "z"),
        ('<dmotion id="a" loop="1"><motion type="jump"/></dmotion>', "jump"),
        ('<dmotion id="a" loop="1"><motion type="translation"/></dmotion>', "vec"),
    ],
)
def test_broken_motion_is_refused(text: str, words: str) -> None:
    part = ElementTree.fromstring(f"<part>{text}</part>")
    with pytest.raises(SpecError, match=words):
        read_motion(ElementTree.Element("scene"), part, ORIGIN, 1e3, Path("x"))


def test_oscillating_mirror_swings_between_its_ends_and_turns_slowly() -> None:
    widest = np.deg2rad(20)
    angle = oscillating(70e3, 50, widest, 1e6)
    assert len(angle) == 1400
    assert angle[0] == -widest
    assert angle[700] == pytest.approx(widest)
    assert abs(np.append(angle, angle[0])).max() == pytest.approx(widest, abs=1e-3 * widest)
    step = np.diff(angle)
    assert (step[1:698] > 0).all()
    assert (step[702:] < 0).all()
    np.testing.assert_allclose(step[60:640], step[300])  # even in between
    assert step[5] < 0.2 * step[300]
    assert len(oscillating(70e3, 50, widest, 20 * 25)) == 2800  # half as fast: its scan product


def test_swing_of_few_pulses_is_refused() -> None:
    with pytest.raises(SpecError, match="202"):
        oscillating(5e3, 50, 0.3, 1e6)


def test_track_gives_place_and_attitude_and_jumps_where_times_are_twice(tmp_path: Path) -> None:
    file = written(tmp_path)
    (tmp_path / "way.trj").write_text(
        '#TIME_COLUMN: 0\n#HEADER: "t", "roll", "pitch", "yaw", "x", "y", "z"\n'
        "0,0,0,0,0,-40,50\n5,0,0,0,0,40,50\n5,0,0,90,-40,0,60\n10,0,0,90,40,0,60\n"
    )
    legs = "".join(
        f'<leg><platformSettings trajectory="way.trj" tStart="{start}" tEnd="{start + 5}"/>'
        '<scannerSettings template="t"/></leg>'
        for start in (0, 5)
    )
    text = (tmp_path / "survey.xml").read_text()
    start = text.index("<leg>")
    text = text[:start] + legs + text[text.index("</survey>") :]
    text = text.replace('platform="library.xml#tripod"', 'platform="interpolated"')
    file.write_text(text.replace('name="n"', 'name="n" basePlatform="library.xml#tripod"'))
    mount = np.array([0, 0, 1.7])
    for number, (ahead, place) in enumerate(
        (([0, 1, 0], [0, -40, 50]), ([1, 0, 0], [-40, 0, 60]))  # north, east
    ):
        pulses = sent(file, number)
        assert len(pulses.time) > 1000
        way = pulses.time[:, None] * 16 * np.array(ahead)
        np.testing.assert_allclose(pulses.origin, place + way + mount, atol=1e-9)
        np.testing.assert_allclose(np.cross(ahead, [0, 0, 1]) @ pulses.direction.T, 0, atol=1e-12)
        assert (pulses.direction @ np.array(ahead) > 0).all()  # this fan looks ahead


def test_platform_settings_of_turns_change_nothing_on_a_straight_line(tmp_path: Path) -> None:
    legs = FLIGHT.replace('movePerSec_m="20"', 'movePerSec_m="20" stopAndTurn="true"')
    assert len(sent(written(tmp_path, legs, "plane", "cone")).time) == 1000


def test_swinging_scanner_runs_and_windows_paths_are_read(tmp_path: Path) -> None:
    file = written(tmp_path, LEG, "tripod", "swing")
    file.write_text(file.read_text().replace("scene.xml#s", ".\\scene.xml#s"))
    with pytest.raises(SpecError, match="202"):  # 1 kHz of pulses and 10 swings a second
        sent(file)


def test_materials_say_ground_reflectance_and_spectrum(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text(
        "newmtl a\nhelios_reflectance 0.2\nhelios_spectra rock\nnewmtl b c\nhelios_spectra rock\n"
        "helios_isGround True\nnewmtl d\nKd 1 1 1\n"
    )
    spectra = tmp_path / "data/spectra"
    spectra.mkdir(parents=True)
    (spectra / "rock.txt").write_text("Name: Rock\n" * 26 + "1.0\t10.0\n2.0\t30.0\n")
    known = read_materials(tmp_path / "m.mtl")
    assert known["b c"].ground
    near = tmp_path / "survey.xml"
    assert known["a"].reflects(1550, near) == 0.2
    assert known["b c"].reflects(1550, near) == pytest.approx(0.21)
    assert known["d"].reflects(1550, near) == 0.5
    assert Material(spectrum="../rock").reflects(1550, near) == 0.5


def test_terrain_lies_where_a_geotiff_says(tmp_path: Path) -> None:
    height = np.array([[1, 2, 3], [4, -9999, 6], [7, 8, 9], [1, 1, 1]], dtype=np.float32)
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550], tags.tagtype[33550] = (2.0, 2.0, 0.0), 12
    tags[33922], tags.tagtype[33922] = (0.0, 0.0, 0.0, 474500.0, 5474500.0, 0.0), 12
    tags[42113] = "-9999"
    Image.fromarray(height).save(tmp_path / "dem.tif", tiffinfo=tags)
    ground = read_terrain(tmp_path / "dem.tif", Material(ground=True))
    assert ground.ground.all()
    assert (
        len(ground.triangles) == 6 + 2 - 2
    )  # of two gaps in each row beside the hole one half is left
    lowest = ground.vertices[np.argmin(ground.vertices[:, 0] + 1e3 * ground.vertices[:, 1])]
    np.testing.assert_allclose(lowest, [474501.0, 5474500 - 7, 1])
    assert not (ground.vertices[:, 2] == -9999).any()


def test_points_become_voxels(tmp_path: Path) -> None:
    (tmp_path / "p.xyz").write_text("# x y z\n0 0 0\n0.2 0.1 0\n2 2 2\n")
    boxes = read_points(tmp_path / "p.xyz", " ", 1.0, Material())
    assert len(boxes.triangles) == 2 * 12
    a, b, c = np.moveaxis(boxes.vertices[boxes.triangles], 1, 0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(2.0)  # closed, and outwards
    assert len(read_points(tmp_path / "p.xyz", " ", 1.0, Material(), 2).triangles) == 12
    with pytest.raises(SpecError, match="3 points"):
        read_points(tmp_path / "p.xyz", " ", 1.0, Material(), 3)


def test_scene_far_away_is_computed_near_the_origin(tmp_path: Path) -> None:
    file = written(tmp_path, LEG.replace('x="0" y="0"', 'x="500000" y="0"'))
    scene = (tmp_path / "scene.xml").read_text()
    scene = scene.replace('value="0;0;2"', 'value="500000;0;2"')
    (tmp_path / "scene.xml").write_text(scene.replace('value="10;0;50"', 'value="500010;0;50"'))
    survey = read_survey(file)
    np.testing.assert_allclose(survey.offset, [500000, 0, 0])
    np.testing.assert_allclose(survey.legs[0].start, [0, 0, 2])


def peaks(place: np.ndarray, energy: np.ndarray, shape: np.ndarray, window: int) -> list[int]:
    """Bins of echoes, one bin after the other."""
    wave = np.zeros(place.max() + len(shape))
    for at, light in zip(place, energy, strict=True):
        wave[at : at + len(shape)] += light * shape
    found = []
    for i in range(len(wave)):
        near = [*range(max(0, i - window) + 1, i)]
        near += [*range(i + 1, min(len(wave), i + window))]
        if wave[i] > 0 and all(0 < wave[j] < wave[i] for j in near):
            found.append(i)
    return found


@pytest.mark.parametrize(("pulse_ns", "most"), [(4.0, 4), (2.0, 1)])
def test_digitised_echoes_are_the_maxima_of_the_binned_waveform(pulse_ns: float, most: int) -> None:
    rng = np.random.default_rng(3)
    digitiser = Digitiser(3, 0.25, 1.0)
    bins = bins_of(pulse_ns, digitiser)
    shape = bins.shape
    bin_m = 0.25 * 0.299792458
    pulse, distance, energy, expected = [], [], [], []
    for number in range(200):
        count = int(rng.integers(1, 20))
        at = 30 + np.sort(rng.choice([0.3, 2.0, 20.0]) * rng.random(count))
        light = rng.random(count) + 0.05
        pulse += [number] * count
        distance += at.tolist()
        energy += light.tolist()
        place = ((at - at.min()) / bin_m + 1e-9).astype(int)
        expected.append(len(peaks(place, light, shape, 4)))
    shuffled = rng.permutation(len(pulse))
    ray = np.array(pulse)[shuffled] * 19 + np.arange(len(pulse))[shuffled] % 19
    given = np.array(distance)[shuffled], np.array(energy)[shuffled]
    echoes = find_echoes(ray, 19, *given, 0.1, bins=bins)
    assert np.bincount(echoes.pulse, minlength=200).tolist() == expected
    assert max(expected) >= most
    assert echoes.energy.sum() == pytest.approx(sum(energy))
    assert (np.diff(echoes.pulse) >= 0).all()
    assert (echoes.pulse == np.array(pulse)[shuffled][echoes.contact]).all()


VOXELS = """VOXEL SPACE
#min_corner: 0.0 0.0 0.0
#max_corner: 1.0 0.5 0.5
#split: 2 1 1
#res: 0.5 #MAX_PAD: 4.0 #max_pad: 4.0
i j k PadBVTotal nbSampling transmittance
0 0 0 1.0 9 0.5
1 0 0 4.0 9 0.0
1 0 0 0.0 9 1.0
"""


@pytest.mark.parametrize(("mode", "edges"), [("fixed", [0.5, 0.5]), ("scaled", [0.25, 0.5])])
def test_voxels_of_amapvox_are_boxes(tmp_path: Path, mode: str, edges: list[float]) -> None:
    file = tmp_path / "crown.vox"
    file.write_text(VOXELS)
    boxes = read_voxels(file, Material(), mode).vertices.reshape(2, 8, 3)
    np.testing.assert_allclose(np.ptp(boxes, axis=1), np.repeat(edges, 3).reshape(2, 3))
    np.testing.assert_allclose(boxes.mean(axis=1), [[0.25, 0.25, 0.25], [0.75, 0.25, 0.25]])
    shifted = read_voxels(file, Material(), mode, shifted=True).vertices
    assert shifted.reshape(2, 8, 3).min() >= 0
    assert shifted[:, 1:].max() <= 0.5


def test_broken_voxels_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "crown.vox"
    file.write_text(VOXELS.replace("transmittance", "nothing"))
    with pytest.raises(SpecError, match="no column transmittance"):
        read_voxels(file, Material(), "fixed")
    file.write_text(VOXELS.replace("#res", "#size"))
    with pytest.raises(SpecError, match="does not say #res"):
        read_voxels(file, Material(), "fixed")


def test_a_leg_may_say_how_its_echoes_are_found(tmp_path: Path) -> None:
    own = LEG.replace("/></leg>", '><FWFSettings beamSampleQuality="1"/></scannerSettings></leg>')
    survey = read_survey(written(tmp_path, LEG + own))
    assert [leg.digitiser.rings for leg in survey.legs] == [3, 1]


@pytest.mark.medium
@pytest.mark.parametrize("rings", [1, 2])
@pytest.mark.parametrize("engine", ["embree", "bvhtree"])
def test_light_passes_transmittive_voxels_by_chance(
    tmp_path: Path, rings: int, engine: str
) -> None:
    """A slab of 0.6 m² a m³, 1 m deep, seen along its axis: exp(-0.6) of the pulses pass; a correct
    program fails in one of a million seeds."""
    text = "#min_corner: -50 1 -50\n#res: 1.0\n"
    cells = [f"{i} 0 {k} 0.6 9 0.5" for i in range(100) for k in range(100)]
    head = "i j k PadBVTotal nbSampling transmittance"
    (tmp_path / "slab.vox").write_text("VOXEL SPACE\n" + text + "\n".join([head, *cells]) + "\n")
    slab = """</part><part id="slab"><filter type="detailedvoxels">
      <param type="string" key="filepath" value="slab.vox"/></filter>"""
    path = written(tmp_path, extra=slab)
    survey = read_survey(path)
    (leg,) = survey.legs
    leg = replace(leg, digitiser=replace(leg.digitiser, rings=rings))
    count = 20_000
    x = np.linspace(-0.3, 0.3, count)
    way = np.stack([x, np.ones(count), np.zeros(count)], axis=1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)

    class Ahead:
        """Pulses from one point, 3 m above the ground, to the slab."""

        def __init__(self) -> None:
            self.count = count

        def pulses(self, number: np.ndarray) -> Pulses:
            """Pulses of these numbers."""
            origin = np.tile([0.0, 0.0, 5.0], (len(number), 1))
            across = np.tile([0.0, 0.0, 1.0], (len(number), 1))
            return Pulses(origin, way[number], across, number * 1e-5, number * 0.0)

    caster = casters_of(survey, engine)(0)
    sensor = sensor_of_survey(survey, leg, "leg000")
    scan = CountedScan(sensor, caster, 4, pattern=Ahead()).among(hazes_of(survey))
    cloud = scan.look_at(np.arange(count))
    in_slab = cloud.position[:, 1] > 0.99
    assert in_slab.all()
    if rings == 1:
        thick = 1 / way[:, 1]
        passed = count - len(cloud.pulse)
        expected = np.exp(-0.6 * thick)
        spread = np.sqrt((expected * (1 - expected)).sum())
        assert abs(passed - expected.sum()) < 4.9 * spread
        gone = cloud.true_range - thick[cloud.pulse]
        share = -np.expm1(-0.6 * gone) / -np.expm1(-0.6 * thick[cloud.pulse])
        assert stats.kstest(share, "uniform").pvalue > 1e-6
        np.testing.assert_allclose(cloud.returns.cos_incidence, 1.0)
    again = CountedScan(sensor, caster, 4, pattern=Ahead()).among(hazes_of(survey))
    np.testing.assert_array_equal(
        again.look_at(np.arange(7, 99)).position[:5],
        cloud.position[np.searchsorted(cloud.pulse, 7) :][:5],
    )


def test_voxels_that_light_passes_by_chance_do_not_move(tmp_path: Path) -> None:
    (tmp_path / "crown.vox").write_text(VOXELS)
    crown = """</part><part id="crown"><filter type="detailedvoxels">
      <param type="string" key="filepath" value="crown.vox"/></filter>
      <dmotion id="a" loop="1"><motion type="translation" vec="1;0;0"/></dmotion>"""
    with pytest.raises(SpecError, match="part crown: moves"):
        read_survey(written(tmp_path, extra=crown))


@pytest.mark.parametrize("rings", [4, 5, 9])
def test_every_quality_of_the_beam_has_all_its_rays(tmp_path: Path, rings: int) -> None:
    """Rings of int(2πk) rays: 1 + 6 + 12 + 18 are 37, but the fourth ring has 25, not 24."""
    survey = read_survey(written(tmp_path))
    leg = replace(survey.legs[0], digitiser=replace(survey.legs[0].digitiser, rings=rings))
    sensor = sensor_of_survey(survey, leg, "leg000")
    assert sensor.beam.subrays == 1 + sum(int(2 * np.pi * k) for k in range(1, rings))
    caster = casters_of(survey, "embree")(0)
    pattern = SurveyLeg(survey, leg)
    scan = CountedScan(sensor, caster, 4, pattern=pattern).sampled(leg.digitiser)
    cloud = scan.look_at(np.arange(pattern.count))
    down = pattern.pulses(np.arange(pattern.count)).direction[:, 2] < -0.1
    assert set(np.flatnonzero(down)) <= set(cloud.pulse)


@pytest.mark.parametrize("name", ["(a+)+b", "(x|a*)*b", ".*.*.*.*.*b"])
def test_a_pattern_of_files_that_may_take_for_ever_is_refused(tmp_path, name):
    (tmp_path / ("a" * 200)).touch()
    with pytest.raises(SpecError, match="may take for ever"):
        find_files(f"{tmp_path}/{name}", tmp_path / "survey.xml")
    (tmp_path / "tree_1_22.obj").touch()
    assert (
        len(find_files(rf"{tmp_path.as_posix()}/tree_\d+_\d+\.obj", tmp_path / "survey.xml")) == 1
    )


# ---------------------------------------------------------------------------------- survey platforms
# Surveys of HELIOS++ whose platforms forces drive, and whose parts are swapped, against closed forms.

COPTER = '<platform type="multicopter" drag="0.01"/>'  # 0.1/0.01: 10 m/s at most
TRACTOR = '<platform type="groundvehicle" drag="0.005"/>'  # 0.02/0.005: 4 m/s at most
RATE = 5000.0


def flown(
    platform: str, places: list[tuple[float, float, float]], settings: str
) -> tuple[list[SurveyTrack], list[str]]:
    """Tracks of legs between places, all with the same settings."""
    points = [np.array(place, dtype=float) for place in places]
    legs = [
        DrivenLeg(a, b, c, fromstring(f"<platformSettings {settings}/>"), RATE)
        for a, b, c in zip(points, points[1:], [*points[2:], None], strict=False)
    ]
    return drive(fromstring(platform), legs, Path("library.xml"))


@pytest.mark.medium
def test_copter_gains_speed_by_a_factor_and_then_flies_at_its_most() -> None:
    (track,), notes = flown(COPTER, [(0, 0, 20), (0, 80, 20)], 'slowdownEnabled="false"')
    # the force grows from 1e-4 to 0.1 by exp(2 t): ln(1000)/2 s and (10 - 0.01)/2 m
    seconds = np.log(1000) / 2 + (80 - (10 - 0.01) / 2) / 10
    assert track.time[-1] == pytest.approx(seconds, abs=0.03)  # the drag's lag is 0.02 s here
    assert not notes
    np.testing.assert_allclose(track.place[-1], [0, 80, 20], atol=0.01)
    assert np.abs(track.place[:, 2] - 20).max() < 0.05
    assert track.angles is not None
    np.testing.assert_array_equal(track.angles[:, 2], 0.0)


@pytest.mark.medium
def test_copter_turns_smoothly_at_its_rate_and_looks_along_the_next_leg() -> None:
    setting = 'smoothTurn="true" slowdownEnabled="false" movePerSec_m="8"'
    tracks, _ = flown(COPTER, [(0, 0, 9), (0, 60, 9), (60, 60, 9)], setting)
    yaw = tracks[0].angles
    assert yaw is not None
    turns = np.flatnonzero(np.diff(yaw[:, 2]))
    took = tracks[0].time[turns[-1] + 1] - tracks[0].time[turns[0]]
    assert took == pytest.approx(90 / 85.94, abs=0.005)
    assert yaw[-1, 2] == pytest.approx(-np.pi / 2, abs=0.001)
    rest = np.hypot(*(tracks[0].place[-1] - tracks[1].place[0])[:2])
    assert rest == 0.0  # a leg begins where the one before ended


@pytest.mark.medium
@pytest.mark.parametrize(
    ("platform", "places", "speed", "words"),
    [
        (COPTER, [(0, 0, 20), (0, 80, 20)], 5, r"leg 0 never arrives.*slowdownEnabled"),
        (
            TRACTOR,
            [(0, 0, 0), (0, 12, 0), (7, 15, 0)],
            3,
            r"leg 1 never arrives.*round and round.*wider curves",
        ),
    ],
    ids=["copter that stops before", "tractor that turns round and round"],
)
def test_who_never_arrives_is_refused(monkeypatch, platform, places, speed, words) -> None:
    monkeypatch.setattr(platforms, "STEPS_A_SECOND", 500)
    with pytest.raises(SpecError, match=words):
        flown(platform, places, f'movePerSec_m="{speed}"')


@pytest.mark.medium
def test_tractor_drives_at_its_speed_and_backs_to_turn() -> None:
    tracks, notes = flown(TRACTOR, [(0, 0, 0), (0, 30, 0), (20, 30, 0)], 'movePerSec_m="3"')
    assert tracks[0].time[-1] == pytest.approx(10, abs=0.1)
    assert not notes
    np.testing.assert_allclose(tracks[0].place[-1], [0, 30, 0], atol=0.01)
    np.testing.assert_allclose(tracks[1].place[-1], [20, 30, 0], atol=0.1)
    way = np.diff(tracks[1].place[:, :2], axis=0)
    yaw = tracks[1].angles
    assert yaw is not None
    ahead = -np.sin(yaw[1:, 2]) * way[:, 0] + np.cos(yaw[1:, 2]) * way[:, 1]
    assert (ahead < 0).any()  # 90 degrees are too narrow to steer by forwards
    gone = np.abs(ahead[ahead < 0]).sum()
    turned = np.abs(yaw[-1, 2])
    assert turned == pytest.approx(np.pi / 2, abs=0.15)
    assert gone == pytest.approx((turned - np.pi / 5) / 0.25, rel=0.5)


@pytest.mark.medium
@pytest.mark.parametrize("platform", [COPTER, TRACTOR])
def test_steps_of_many_pulses_go_where_single_ones_go(
    platform: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    setting = 'movePerSec_m="3" smoothTurn="true" slowdownEnabled="false"'
    places = [(0.0, 0.0, 5.0), (0.0, 12.0, 5.0), (12.0, 30.0, 5.0)]
    exact, _ = flown(platform, places, setting)  # a step is one pulse at 5 kHz
    monkeypatch.setattr(platforms, "STEPS_A_SECOND", 500)
    coarse, _ = flown(platform, places, setting)
    for one, other in zip(exact, coarse, strict=True):
        assert other.time[-1] == pytest.approx(one.time[-1], abs=0.05)
        time = np.linspace(0, min(one.time[-1], other.time[-1]), 200)
        away = one.at(time)[0] - other.at(time)[0]
        assert np.linalg.norm(away, axis=1).max() < 0.1


def test_survey_with_a_copter_is_read(tmp_path: Path) -> None:
    legs = """<leg><platformSettings x="0" y="0" z="9" movePerSec_m="3" slowdownEnabled="false"/>
    <scannerSettings template="t" scanAngle_deg="20"/></leg>
    <leg><platformSettings x="0" y="0.4" z="9"/><scannerSettings active="false"/></leg>"""
    (leg,) = read_survey(written(tmp_path, legs, "copter")).legs
    assert leg.track is not None
    assert leg.seconds[1] == leg.track.time[-1] > 4  # drag 1: 0.1 m/s at most


SWAPS = """<swap swapStep="2"><filter type="scale"><param key="scale" value="6"/></filter>
<filter type="rotate"><param key="rotation"><rot axis="z" angle_deg="90"/></param></filter></swap>
<swap force_null="true"/>"""


INDEXED = """<swap swapIndices="[4]" force_null="true"/>
<swap swapIndices="[2, 3]"><filter type="scale"><param key="scale" value="6"/></filter></swap>"""


@pytest.mark.parametrize(
    ("swaps", "low"),
    [
        # 3 m turned by 90 degrees is -3..0, 0..3 about (10, 0); 6 m turned by 180 is -6..0, -6..0
        (SWAPS, [[7, 0, 2], [4, -6, 2], [4, -6, 2]]),
        # 6 m turned by 90 degrees; the baseline stands in play 1 too, which none names
        (INDEXED, [[7, 0, 2], [7, 0, 2], [4, 0, 2], [4, 0, 2]]),
    ],
    ids=["in turn", "by number"],
)
def test_swapped_parts_stand_for_their_plays(tmp_path: Path, swaps: str, low: list) -> None:
    *shown, last = read_survey(written(tmp_path, extra=swaps)).plays
    assert [len(play.parts) for play in shown] == [len(play.reflectance) for play in shown]
    assert len(last.parts) == len(last.reflectance) == 1
    found = [play.parts[1].corners.min(axis=(0, 1)) for play in shown]
    np.testing.assert_allclose(found, low, atol=1e-12)


def test_each_play_goes_to_files_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    legs = scan_survey(written(tmp_path, LEG, extra=SWAPS), tmp_path / "out/c.npz")
    assert [leg.name for leg in legs] == [f"play{k}-leg000" for k in range(4)]
    assert (tmp_path / "out/c-play3-leg000.npz").is_file()
    assert "played 4 times" in capsys.readouterr().err
