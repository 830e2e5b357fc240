"""Clouds by other hands: coordinates are read in metres, clocks are matched, nonsense is refused."""

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import GeoDoubleParamsVlr, GeoKeyDirectoryVlr, WktCoordinateSystemVlr

pyproj = pytest.importorskip("pyproj")

from forest_addon.formats.las import read_las, write_las
from forest_addon.formats.toml_file import read_settings
from forest_addon.results.points import POINT
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.site import ForestSite
from forest_addon.spec import Mobile, Pose, Scene, SpecError
from forest_addon.stand.files import read_inputs
from headless.surveys import write_like
from studies.validation.own_cloud import read_cloud

CODES = ("PIAB", "FASY", "ABAL", "ACPS")
FOOT, US_FOOT = 0.3048, 1200 / 3937
LOW = np.array([1_980_000.0, 610_000.0, 40.0])  # EPSG:26943, metres
SPEED, START = 60.0, 245_385.0


@pytest.fixture(scope="module")
def flight():
    """Place (N, 3), time (N,), number (N,) and angle (N,) of two returns a pulse of a line at 60 m/s, over a
    plot that it sees to one side."""
    poses = tuple(Pose(time=t, position=(SPEED * t, 0.0, 400.0)) for t in (0.0, 3.0))
    pattern = pattern_of(
        Mobile(
            name="a",
            poses=poses,
            pattern="lines",
            field_deg=(-60.0, 60.0),
            line_rate=40.0,
            pulse_rate=40e3,
        )
    )
    pulses = pattern.pulses(np.arange(pattern.count))
    angle = np.degrees(np.arctan2(-pulses.direction[:, 1], -pulses.direction[:, 2]))
    seen = (angle > 5) & (angle < 17)
    origin, way = pulses.origin[seen], pulses.direction[seen]
    reach = [(origin[:, 2] - level) / -way[:, 2] for level in (14.0, 0.0)]
    place = LOW + np.stack([origin + away[:, None] * way for away in reach], axis=1).reshape(-1, 3)
    time, angle = np.repeat(pulses.time[seen], 2) + START, np.repeat(angle[seen], 2)
    return place, time, np.tile([1, 2], int(seen.sum())), angle


def save(path, flight, unit=(1.0, 1.0), record=None, clock=0.0, said=True):
    place, time, number, angle = flight
    cloud = laspy.create(point_format=6, file_version="1.4")
    flat, up = unit
    stored = place / [flat, flat, up]
    cloud.header.scales, cloud.header.offsets = [1e-4] * 3, np.floor(stored.min(axis=0))
    cloud.x, cloud.y, cloud.z = stored.T
    cloud.gps_time = time + clock
    cloud.return_number, cloud.number_of_returns = number, np.full(len(number), 2)
    cloud.scan_angle = np.rint(angle / 0.006) * said
    cloud.classification = np.where(number == 2, 2, 5)
    if record is not None:
        cloud.header.vlrs.extend(record if isinstance(record, list) else [record])
    cloud.write(path)


def wkt(code):
    return WktCoordinateSystemVlr(pyproj.CRS.from_user_input(code).to_wkt("WKT1_GDAL"))


def geokeys(**codes):
    numbers = {"linear": 3076, "vertical": 4099, "projected": 3072, "height": 4096, "size": 3077}
    record = GeoKeyDirectoryVlr()
    words = [1, 1, 0, len(codes)]
    for key, value in sorted((numbers[name], value) for name, value in codes.items()):
        words += [key, 34736 if key == 3077 else 0, 1, value]
    record.parse_record_data(np.array(words, dtype="<u2").tobytes())
    return record


def own_unit(metres):
    sizes = GeoDoubleParamsVlr()
    sizes.parse_record_data(np.array([metres], dtype="<f8").tobytes())
    return [geokeys(linear=32767, size=0), sizes]


UNITS = {
    "heights of a code alone": ((US_FOOT, 1.0), lambda: geokeys(projected=2227, height=5703)),
    "a unit of its own": ((0.31, 0.31), lambda: own_unit(0.31)),
    "Clarke's foot": ((0.3047972654,) * 2, lambda: geokeys(linear=9005)),
    "feet of the system": ((US_FOOT, US_FOOT), lambda: wkt("EPSG:2227")),
    "feet on the map, metres of height": ((US_FOOT, 1.0), lambda: wkt("EPSG:2227+5703")),
    "metres on the map, feet of height": ((1.0, US_FOOT), lambda: wkt("EPSG:26943+6360")),
    "keys of a system": ((US_FOOT, US_FOOT), lambda: geokeys(projected=2227)),
    "keys of units alone": ((FOOT, US_FOOT), lambda: geokeys(linear=9002, vertical=9003)),
    "metres": ((1.0, 1.0), lambda: wkt("EPSG:26943")),
}


@pytest.mark.parametrize("kind", UNITS)
def test_coordinates_are_read_in_metres(tmp_path, flight, kind):
    unit, record = UNITS[kind]
    save(tmp_path / "a.las", flight, unit, record())
    cloud = read_las(tmp_path / "a.las")
    assert np.asarray(cloud.xyz) == pytest.approx(flight[0], abs=2e-4)
    assert np.asarray(cloud.z) == pytest.approx(flight[0][:, 2], abs=2e-4)
    assert cloud.header.mins == pytest.approx(flight[0].min(axis=0), abs=2e-4)


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (wkt("EPSG:4326"), "in degrees"),
        (geokeys(projected=29999), r"EPSG:29999.*no coordinate system"),
        (geokeys(linear=9999), r"a\.las: has a system .* counts in unit 9999 of EPSG"),
    ],
    ids=["degrees", "no system", "no unit"],
)
def test_degrees_and_systems_that_are_not_there_are_refused(tmp_path, flight, record, said):
    save(tmp_path / "a.las", flight, record=record)
    with pytest.raises(SpecError, match=said):
        read_las(tmp_path / "a.las")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("crs", "said"),
    [
        ("EPSG:2227", r"US survey foot.*take EPSG:26943"),
        ("EPSG:4326", r"in degrees.*EPSG:32632"),
        ("EPSG:99999", "no coordinate system"),
        ("EPSG:32632+8228", "foot"),
        ("EPSG:2056", ""),
        ("EPSG:25832+7837", ""),
    ],
)
def test_metres_are_written_into_systems_of_metres_alone(tmp_path, crs, said):
    doors = (
        lambda: write_las(tmp_path / "a.laz", np.zeros(1, dtype=POINT), crs=crs),
        lambda: read_inputs(Scene(crs=crs), tmp_path),
    )
    for door in doors:
        if said:
            with pytest.raises(SpecError, match=said):
                door()
        else:
            door()


@pytest.mark.medium
def test_a_cloud_in_feet_is_validated_as_one_in_metres(tmp_path, flight):
    save(tmp_path / "m.las", flight)
    save(tmp_path / "ft.las", flight, (US_FOOT, US_FOOT), wkt("EPSG:2227"))
    metres, feet = (read_cloud(tmp_path / name) for name in ("m.las", "ft.las"))
    assert feet.place == pytest.approx(metres.place, abs=2e-4)
    assert feet.heights() == pytest.approx(metres.heights(), abs=1e-3)


def poses(scene):
    """(K, 4) times and places on the map."""
    rows = [[p.time, *p.position] for p in scene.sensors[0].poses]
    return np.array(rows) + np.array([0.0, *scene.offset])


def like(tmp_path, file, **how):
    heard = []
    return write_like(tmp_path / file, tmp_path / "like.toml", say=heard.append, **how), heard


@pytest.mark.medium
def test_a_flight_in_feet_is_flown_in_metres(tmp_path, flight):
    save(tmp_path / "m.las", flight)
    save(tmp_path / "ft.las", flight, (US_FOOT, US_FOOT), wkt("EPSG:2227"))
    metres, heard = like(tmp_path, "m.las")
    feet, _ = like(tmp_path, "ft.las")
    assert np.abs(poses(feet) - poses(metres)).max() < 0.02
    for name in ("field_deg", "line_rate", "pulse_rate", "mount_deg"):
        assert getattr(feet.sensors[0], name) == pytest.approx(
            getattr(metres.sensors[0], name), rel=1e-3, abs=2e-3
        )
    assert "60.0 m/s" in heard[0]
    save(tmp_path / "lost.las", flight, (US_FOOT, US_FOOT))
    with pytest.raises(SpecError, match=r"197 m/s; are its coordinates in metres.*--crs"):
        like(tmp_path, "lost.las")
    named, _ = like(tmp_path, "lost.las", crs="EPSG:2227")
    assert poses(named) == pytest.approx(poses(feet))
    (tmp_path / "trees.csv").write_text("x,y\n1,2\n")
    with pytest.raises(SpecError, match=r"EPSG:2227. does not count in metres, and --trees are"):
        like(tmp_path, "lost.las", crs="EPSG:2227", trees=tmp_path / "trees.csv")


@pytest.mark.medium
@pytest.mark.parametrize(
    ("code", "unit", "named", "crs"),
    [
        (26943, 1.0, "", "EPSG:26943"),
        ("EPSG:26943+5703", 1.0, "", "EPSG:26943+5703"),
        (2227, US_FOOT, "", "EPSG:26943"),
        (2314, 0.3047972654, "", ""),  # has no twin in metres
        (None, 1.0, "EPSG:26943", "EPSG:26943"),
        (None, 1.0, "", ""),
    ],
)
def test_a_flight_is_flown_in_the_system_of_its_cloud(tmp_path, flight, code, unit, named, crs):
    save(tmp_path / "a.las", flight, (unit, unit), code and wkt(code))
    like(tmp_path, "a.las", crs=named)
    scene = read_settings(tmp_path / "like.toml", Scene)
    assert scene.crs == crs
    write_las(tmp_path / "b.laz", np.zeros(1, dtype=POINT), crs=scene.crs)
    found = laspy.read(tmp_path / "b.laz").header.parse_crs()
    assert found == (pyproj.CRS(crs) if crs else None)


def test_a_cloud_that_is_sorted_by_place_is_flown_as_one_by_time(tmp_path, flight):
    order = np.lexsort(np.floor(flight[0] / 5.0).T)
    save(tmp_path / "a.las", flight)
    save(tmp_path / "b.las", tuple(column[order] for column in flight))
    assert like(tmp_path, "a.las") == like(tmp_path, "b.las")


def test_times_that_do_not_run_are_refused(tmp_path, flight):
    place, time, *more = flight
    save(tmp_path / "a.las", (place, np.full_like(time, 7.0), *more))
    with pytest.raises(SpecError, match="GPS times that do not run"):
        like(tmp_path, "a.las")
    save(tmp_path / "b.las", tuple(column[:40] for column in flight))
    with pytest.raises(SpecError, match="tells no flight line"):
        like(tmp_path, "b.las")


@pytest.mark.medium
@pytest.mark.parametrize("adjusted", ["cloud", "trajectory"])
def test_seconds_of_the_week_meet_adjusted_standard_time(tmp_path, flight, adjusted):
    """17 September 2025 is in GPS week 2384."""
    clock = 2384 * 604_800 - 1e9
    save(tmp_path / "a.las", flight, clock=clock if adjusted == "cloud" else 0.0)
    time = START + np.linspace(-1, 5, 61)
    rows = np.column_stack(
        [
            time + (clock if adjusted == "trajectory" else 0.0),
            LOW[0] + SPEED * (time - START),
            np.full((61, 2), [LOW[1], LOW[2] + 400.0]),
            np.zeros((61, 3)),
        ]
    )
    names = "time_s,x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg"
    np.savetxt(tmp_path / "way.csv", rows, delimiter=",", header=names, comments="", fmt="%.9f")
    made, _ = like(tmp_path, "a.las", trajectory=tmp_path / "way.csv")
    assert len(made.sensors) == 1
    found = poses(made)
    assert found[:, 1] - SPEED * found[:, 0] == pytest.approx(
        found[0, 1] - SPEED * found[0, 0], abs=0.01
    )
    assert found[:, 3] == pytest.approx(LOW[2] + 400.0, abs=0.01)


def test_a_plot_gets_a_twin_of_its_own_trees_on_its_own_ground(tmp_path, flight):
    place = flight[0][flight[2] == 2]
    middle = place.mean(axis=0)
    rows = [f"{middle[0] + 2 * k:.2f},{middle[1]:.2f},{code}" for k, code in enumerate(CODES)]
    table = [f"{row},{30 - 5 * k},{20 - 2 * k}" for k, row in enumerate(rows)]
    (tmp_path / "trees.csv").write_text("\n".join(["x,y,species,dbh_cm,height_m", *table]))
    names = ["ACPS=norway-maple", "PIAB=norway-spruce", "FASY=european-beech", "ABAL=silver-fir"]
    words = {"trees": tmp_path / "trees.csv", "species": names}
    save(tmp_path / "cloud.las", flight, record=wkt(26943))
    scene, heard = like(tmp_path, "cloud.las", **words)
    assert '"FASY" is planted as european-beech' in heard
    assert f"making a grid of the ground of cloud.las, {len(flight[0]):,} returns" in heard
    stand = ForestSite.read(scene, tmp_path).plan()
    place = stand.position[stand.species < len(CODES)] + scene.offset  # others are undergrowth
    assert np.sort(place[:, 0]) == pytest.approx(middle[0] + 2 * np.arange(len(CODES)), abs=0.01)
    assert place[:, 2] == pytest.approx(LOW[2], abs=0.05)
    with pytest.raises(
        SpecError, match="ABAL=silver-fir --species ACPS=PRESET --species FASY=europ"
    ):
        like(tmp_path, "cloud.las", trees=tmp_path / "trees.csv")
