"""Files of a stand: what is written can be read by others and planted again; rasters mean what they say."""

import csv
import gzip
import json
import zipfile
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from forest_addon.formats.raster_file import read_raster
from forest_addon.formats.stl import write_stl
from forest_addon.formats.table import write_csv
from forest_addon.formats.tree_map import COLUMNS as NAMED, NUMBERS, PLACES, read_tree_map
from forest_addon.results.coordinates import note_of
from forest_addon.results.tables import COLUMNS, write_stand
from forest_addon.spec import Forest, Planting, Raster, Scene, SpecError, Terrain
from forest_addon.stand.files import ElsewhereError, read_inputs, read_tree_list
from forest_addon.stand.plan import plan_stand

OFFSET = (499_987.125, 5_400_123.5, 212.25)
PLANTINGS = tuple(
    Planting(species=name, expected=30, variants=3) for name in ("oak", 'el,m "wych"')
)
NAMES = ("oak", 'el,m "wych"')


@pytest.fixture
def stand():
    return plan_stand(3, Forest(), PLANTINGS)


def test_csv_holds_every_digit_with_the_offset_added(stand, tmp_path):
    write_stand(tmp_path / "p.csv", stand, NAMES, OFFSET, "EPSG:32632")
    lines = (tmp_path / "p.csv").read_text().splitlines()
    assert note_of(OFFSET, "EPSG:32632") == (
        "coordinates are metres in EPSG:32632; the offset 499987.125, 5400123.5, 212.25 has been added"
    )
    rows = list(csv.DictReader(lines))
    assert tuple(rows[0]) == COLUMNS
    place = np.array([[float(row[k]) for k in "xyz"] for row in rows])
    assert (place == stand.position + OFFSET).all()
    assert [row["species"] for row in rows] == [NAMES[s] for s in stand.species]
    assert [int(row["variant"]) for row in rows] == stand.variant.tolist()
    assert [float(row["rotation"]) for row in rows] == stand.rotation.tolist()


def test_what_was_written_is_planted_again(stand, tmp_path):
    write_stand(tmp_path / "p.csv", stand, NAMES, OFFSET)
    again = tuple(Planting(species=p.species, layout="list", trees="p.csv") for p in PLANTINGS)
    scene = Scene(plantings=again, offset=OFFSET)
    back = plan_stand(9, scene.forest, again, read_inputs(scene, tmp_path))
    assert back.position == pytest.approx(stand.position, abs=2e-9)  # rounding at 5e6 m
    assert (back.scale == stand.scale).all()
    assert (back.rotation == stand.rotation).all()
    assert (back.species == stand.species).all()


def test_geojson_says_its_coordinate_system(stand, tmp_path):
    write_stand(tmp_path / "p.geojson", stand, NAMES, OFFSET, "EPSG:32632")
    made = json.loads((tmp_path / "p.geojson").read_text())
    assert made["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32632"
    assert "has been added; not longitude and latitude" in made["note"]
    assert len(made["features"]) == len(stand)
    for tree, feature in enumerate(made["features"]):
        assert feature["id"] == tree
        assert feature["geometry"]["type"] == "Point"
        assert feature["geometry"]["coordinates"] == (stand.position[tree] + OFFSET).tolist()
        assert feature["properties"]["species"] == NAMES[stand.species[tree]]


def test_an_empty_stand_is_a_whole_file(tmp_path):
    empty = plan_stand(0, Forest(), [])
    write_stand(tmp_path / "p.csv", empty, [])
    assert (tmp_path / "p.csv").read_text() == ",".join(COLUMNS) + "\n"
    write_stand(tmp_path / "p.geojson", empty, [])
    assert json.loads((tmp_path / "p.geojson").read_text())["features"] == []


# ----------------------------------------------------------------------------------------- rasters


def saved(path, array, mode=None):
    image = Image.fromarray(array)
    (image.convert(mode) if mode else image).save(path)
    return path


def test_arrays_and_float_images_count_as_they_are(tmp_path):
    values = np.array([[0.5, -3.25], [1e4, 7]], dtype=np.float32)
    np.save(tmp_path / "a.npy", values)
    for path in (tmp_path / "a.npy", saved(tmp_path / "a.tif", values)):
        assert read_raster(path).pixels.tolist() == values.tolist()


@pytest.mark.parametrize("name", ["none.png", "text.png", "colour.png", "cube.npy", "object.npy"])
def test_rasters_that_cannot_be_used_are_refused(tmp_path, name):
    (tmp_path / "text.png").write_text("no image")
    saved(tmp_path / "colour.png", np.array([[[9, 0, 0]]], dtype=np.uint8))
    np.save(tmp_path / "cube.npy", np.zeros((2, 2, 2)))
    np.save(tmp_path / "object.npy", np.array([{}]), allow_pickle=True)
    with pytest.raises(SpecError, match=name):
        read_raster(tmp_path / name)


def test_a_scene_reads_its_files_once(tmp_path):
    saved(tmp_path / "d.png", np.full((4, 4), 51, dtype=np.uint8))
    np.save(tmp_path / "hill.npy", np.full((3, 3), 2.0))
    plantings = tuple(
        Planting(species=n, rasters=(Raster(file="d.png", value=0.5),)) for n in ("a", "b")
    )
    ground = Terrain(file="hill.npy", base=100.0, relief=10.0)
    scene = Scene(forest=Forest(terrain=ground), plantings=plantings)
    inputs = read_inputs(scene, tmp_path)
    assert list(inputs.rasters) == ["d.png"]
    stand = plan_stand(1, scene.forest, plantings, inputs)
    assert stand.expected == pytest.approx([90, 90])  # 900 m² of 0.5 times 0.2
    assert set(stand.position[:, 2].tolist()) == {120.0}


def test_a_surface_of_triangles_is_ground(tmp_path):
    corners = np.array([[[0, 0, 1], [30, 0, 1], [30, 30, 4]], [[0, 0, 1], [30, 30, 4], [0, 30, 4]]])
    write_stl(tmp_path / "ground.stl", corners.astype(float))
    scene = Scene(forest=Forest(terrain=Terrain(file="ground.stl")))
    ground = read_inputs(scene, tmp_path).terrain
    assert ground.height(np.array([[15.0, 15.0], [31.0, 5.0]])) == pytest.approx(
        np.array([2.5, np.nan]), nan_ok=True
    )


def test_a_surface_in_centimetres_is_refused(tmp_path):
    corners = np.array([[0, 0, 10_000], [3000, 0, 10_100], [3000, 3000, 10_200]], dtype=float)
    write_stl(tmp_path / "cm.stl", corners[None])
    scene = Scene(forest=Forest(terrain=Terrain(file="cm.stl")))
    with pytest.raises(SpecError, match="heights of 10,000 to 10,200 m; export it in metres"):
        read_inputs(scene, tmp_path)


@pytest.mark.parametrize("name", ["no.png", "no.stl", "bad.stl", "nan.npy"])
def test_a_terrain_that_cannot_be_used_is_refused(tmp_path, name):
    (tmp_path / "bad.stl").write_text("nothing")
    np.save(tmp_path / "nan.npy", np.full((2, 2), np.nan))
    scene = Scene(forest=Forest(terrain=Terrain(file=name)))
    with pytest.raises(SpecError, match=name.replace(".", r"\.")):
        read_inputs(scene, tmp_path)


# ------------------------------------------------------------------------------------------- lists


def test_a_list_may_leave_cells_empty(tmp_path):
    (tmp_path / "t.csv").write_text("# mine\nx_m,y_m,scale,rotation_rad\n1,2,,0.5\n3,4,1.25,\n")
    found = read_tree_list(tmp_path / "t.csv", (1.0, 1.0, 0.0))
    assert found.position.tolist() == [[0, 1], [2, 3]]
    assert found.species is None
    assert found.scale.tolist() == pytest.approx([np.nan, 1.25], nan_ok=True)
    assert found.rotation.tolist() == pytest.approx([0.5, np.nan], nan_ok=True)


# The same two trees of each kind, the second without a height.
FOREIGN = {
    "units": "X (m),Y [m],DBH (cm),height_ft\n5.5,6,24,60\n7,8,31,\n",
    "words of R": '"x","y","dbh_mm","h","plot"\n5.5,6,240,18.288,"a"\n7,8,310,NA,"a"\n',
    "Excel, decimal commas": "sep=;\r\nx;y;DBH cm;Height\r\n5,5;6;24,0;18,288\r\n7;8;31;\r\n",
    "empty rows and columns": "x,y,dbh,height,,\n5.5,6,0.24,18.288,,\n,,,,,\n7,8,0.31,,,\n,,,,,\n",
    "a number before x": "n,e,x,y,dbh,h\n1,0.1,5.5,6,0.24,18.288\n2,0.2,7,8,0.31,\n",
    "map coordinates beside x": "easting,northing,x,y,dbh,h\n9e5,9e6,5.5,6,0.24,18.288\n9e5,9e6,7,8,0.31,\n",
    "names made by R": "x y DBH.cm Height..m.\n5.5 6 24 18.288\n7 8 31 NA\n",
    "rows named by R": '"x" "y" "dbh" "h"\n"1" 5.5 6 0.24 18.288\n"2" 7 8 0.31 NA\n',
    "German": "Baum-Nr;Rechtswert;Hochwert;BHD [cm];Höhe\n1;5,5;6;24;18,288\n2;7;8;31;\n",
    "French": "X_L93\tY_L93\tcirconférence (cm)\tHauteur\n5,5\t6\t75,39822369\t18,288\n7\t8\t97,38937226\t\n",
    "GIS": "OBJECTID|POINT_X|POINT_Y|DBH_cm|HT\n1|5.5|6|24|18.288\n2|7|8|31|\n",
    "FIA": "SPCD,X,Y,STATUSCD,DIA,HT\n316,5.5,6,1,9.448818898,60\n316,7,8,1,12.2047244,\n",
    "NEON": "adjEasting,adjNorthing,easting,stemDiameter,height\n5.5,6,1,24,18.288\n7,8,1,31,\n",
    "ForestGEO": "treeID,sp,gx,gy,dbh_mm,DFstatus,h\n1,a,5.5,6,240,alive,18.288\n2,a,7,8,310,alive,NULL\n",
    "a note of two lines": 'x,y,dbh,h,note\n5.5,6,0.24,18.288,"leans\nmuch"\n7,8,0.31,,x\n',
    "size classes": "x,y,dbh,h,size\n5.5,6,0.24,18.288,3\n7,8,0.31,,1\n",
    "quoted decimal commas": 'x,y,dbh,h\n"5,5",6,"0,24","18,288"\n7,8,"0,31",\n'.replace(
        "18,288", "18,2880"
    ),
    "dead trees and missing places": (
        "x,y,dbh,h,status\n5.5,6,0.24,18.288,1\n1,1,9e-2,3,2\nNA,NA,0.2,,1\n7,8,0.31,,1\n"
    ),
    "stems of one tree": "x,y,dbh,h\n5.5,6,0.144,18.288\n7,8,0.31,\n5.5,6,0.192,17\n",
    "distances and azimuths": (
        "azimuth,dist_m,dbh,h,plot\n42.51044708,8.139410298,0.24,18.288,1\n"
        "41.18592517,10.63014581,0.31,,1\n"
    ),
    "titles of a sheet": "Plot 7, wet\n;;;;\nPlace;;Sizes;\nx;y;BHD (cm);h;n\n5.5;6;24;18.288;\n7;8;31;;\n",
    "a row of units": "n;x;y;DBH;Height\n;m;m;cm;m\n1;5,5;6;24;18,2880\n2;7;8;31;\n",
    "Excel's words": "x;y;dbh;h;lebend\n5,5;6;0,24;18,2880;WAHR\n1;1;0,3;;FALSCH\n7;8;0,31;;WAHR\n",
    "Spanish": "Este;Norte;DAP (cm);Altura (m);Estado\n5,5;6;24;18,2880;vivo\n1;1;9;5;Muerto en pie\n"
    "7;8;31;;vivo\n",
    "Swedish": "Ost\tNord\tDiameter_mm\tHöjd_dm\tdöd\n5,5\t6\t240\t182,88\t0\n7\t8\t310\t\t0\n"
    "1\t1\t9\t9\t1\n",
    "Italian": "X,Y,circonferenza [cm],altezza,stato\n5.5,6,75.39822369,18.288,vivo\n"
    "7,8,97.38937226,n.a.,vivo\n1,1,9,9,morto\n",
    "Dutch": "x;y;diameter_cm;hoogte_m;status\n5,5;6;24;18,2880;levend\n7;8;31;—;levend\n2;2;31;;dood\n",
    "-999 and codes as decimals": "x,y,dbh_cm,h,statuscd\n5.5,6,24,18.288,1.0\n-999,-999,24,9,1.0\n"
    "7,8,31,-9999,1.0\n3,3,10,5,2.0\n",
    "inches and survey feet": "x_usft,y_usft,dbh (inch),h (foot)\n18.04458333,19.685,9.448818898,60\n"
    "22.96583333,26.24666667,12.2047244,\n",
    "distances along the slope as well": (
        "azimuth,distance,hdist,dbh,h\n42.51044708,9,8.139410298,0.24,18.288\n"
        "41.18592517,11,10.63014581,0.31,\n"
    ),
    "gons": "azimuth_gon,dist,dbh,h\n47.23383009,8.139410298,0.24,18.288\n45.76213908,10.63014581,0.31,\n",
}


ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252", "gzip")


@pytest.mark.parametrize(
    ("text", "encoding"),
    [(text, ENCODINGS[k % len(ENCODINGS)]) for k, text in enumerate(FOREIGN.values())]
    + [(FOREIGN["French"], encoding) for encoding in ENCODINGS],
)
def test_lists_of_other_programs_are_read_in_metres(tmp_path, text, encoding):
    path = tmp_path / ("t.csv.gz" if encoding == "gzip" else "t.csv")
    path.write_bytes(gzip.compress(text.encode()) if encoding == "gzip" else text.encode(encoding))
    found = read_tree_list(path)
    assert found.position == pytest.approx(np.array([[5.5, 6], [7, 8]]), rel=1e-7)
    assert found.measures[:, 0] == pytest.approx([0.24, 0.31], rel=1e-7)
    assert found.measures[:, 1] == pytest.approx([18.288, np.nan], rel=1e-12, nan_ok=True)
    assert not np.isfinite(found.scale).any()
    assert " trees of t.csv" in found.said[0]


def test_what_was_taken_and_what_was_left_is_told(tmp_path):
    (tmp_path / "t.csv").write_text(
        "tag,x,y,BHD [cm],size,Status\n1,1,1,20,3,dead\n2,2,2,21,2,alive\n3,NA,2,9,1,alive\n"
        "4,3,3,12,1,alive\n5,3,3,9,1,alive\n"
    )
    said = read_tree_list(tmp_path / "t.csv").said
    assert "dbh = BHD [cm]," in said[0]
    assert "not used: tag, size" in said[0]
    assert said[1:3] == (
        "t.csv: left out 1 row without x or y",
        "t.csv: left out 1 row of dead trees",
    )
    assert "1 tree has several stems" in said[3]


def planted(path, crs="EPSG:32632", **kinds):
    plantings = tuple(Planting(species=name, layout="list", trees=path.name) for name in NAMES)
    scene = Scene(plantings=plantings, offset=OFFSET, crs=crs)
    return plan_stand(9, scene.forest, plantings, read_inputs(scene, path.parent))


@pytest.mark.parametrize(
    "kind",
    [
        "geojson",
        "xlsx",
        "gpkg",
        "shp",
        "zip",
        "folder.zip",
        "csv.zip",
        "degrees.csv",
        "degrees.geojson",
    ],
)
def test_a_stand_in_the_formats_of_maps_and_sheets_is_planted_again(stand, tmp_path, kind):
    path = tmp_path / f"p.{kind}"
    species = [NAMES[k] for k in stand.species]
    place = stand.position[:, :2] + OFFSET[:2]
    if kind == "geojson":
        write_stand(path, stand, NAMES, OFFSET, "EPSG:32632")
    elif kind == "xlsx":
        book = pytest.importorskip("openpyxl").Workbook()
        book.active.append(["Nr", "x", "y", "Art"])
        for row, name in zip(place.tolist(), species, strict=True):
            book.active.append([1, *row, name])
        book.save(path)
    elif kind == "csv.zip":
        write_csv(tmp_path / "p.csv", dict(zip("xy", place.T, strict=True)) | {"species": species})
    elif kind.startswith("degrees"):
        back = pytest.importorskip("pyproj").Transformer.from_crs(32632, 4326, always_xy=True)
        lon, lat = back.transform(*place.T)
        if kind.endswith("csv"):
            write_csv(path, {"X": lon.tolist(), "Y": lat.tolist(), "species": species})
        else:
            points = [{"type": "Point", "coordinates": each} for each in zip(lon, lat, strict=True)]
            features = [
                {"type": "Feature", "geometry": point, "properties": {"species": name}}
                for point, name in zip(points, species, strict=True)
            ]
            path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    else:
        shapely, raw = pytest.importorskip("shapely"), pytest.importorskip("pyogrio.raw")
        shapes = shapely.to_wkb(shapely.points(place))
        raw.write(
            tmp_path / "p.shp" if kind.endswith("zip") else path,
            shapes,
            [np.array(species, object)],
            ["species"],
            geometry_type="Point",
            crs="EPSG:32632",
        )
    if kind.endswith("zip"):
        with zipfile.ZipFile(tmp_path / "packed", "w") as archive:
            for part in tmp_path.glob("p.*"):
                archive.write(part, f"{'plot/' * (kind != 'zip')}{part.name}")
                part.unlink()
            archive.writestr("__MACOSX/plot/._p.csv", "x,y")
        (tmp_path / "packed").rename(path)
    again = planted(path)
    assert again.position[:, :2] == pytest.approx(stand.position[:, :2], abs=1e-6)
    assert (again.species == stand.species).all()


@pytest.mark.parametrize("names", [[], ["a.csv", "b/c.csv"], ["readme.md"]])
def test_an_archive_of_no_table_or_several_is_refused(tmp_path, names):
    with zipfile.ZipFile(tmp_path / "t.zip", "w") as archive:
        for name in names:
            archive.writestr(name, "x,y\n1,2\n")
    with pytest.raises(SpecError, match=r"t\.zip: holds (no table|tables a\.csv, b/c\.csv);"):
        read_tree_list(tmp_path / "t.zip")


@pytest.mark.parametrize("encoding", ["UTF-8", "ISO-8859-1"])
@pytest.mark.parametrize("says", [True, False])
def test_letters_of_a_shapefile_are_read_whether_it_says_how_they_are_stored(
    tmp_path, encoding, says
):
    shapely, raw = pytest.importorskip("shapely"), pytest.importorskip("pyogrio.raw")
    columns = [np.array(["Föhre", "Bäume"], object), np.array([9.0, 8.0])]
    shapes = shapely.to_wkb(shapely.points([[1, 2], [3, 4]]))
    how = {"geometry_type": "Point", "crs": "EPSG:32632", "encoding": encoding}
    raw.write(tmp_path / "t.shp", shapes, columns, ["Art", "Höhe"], **how)
    if says:
        (tmp_path / "t.cpg").write_text(encoding)
    else:
        (tmp_path / "t.cpg").unlink(missing_ok=True)
    found = read_tree_map(tmp_path / "t.shp")
    assert found.species.tolist() == ["Föhre", "Bäume"]
    assert found.numbers[:, NUMBERS.index("height")].tolist() == [9, 8]
    guessed = "t.shp: is not UTF-8; read as ISO-8859-1"
    assert (guessed in found.said) == (encoding != "UTF-8" and not says)


def test_a_shapefile_without_its_table_is_refused(tmp_path):
    shapely, raw = pytest.importorskip("shapely"), pytest.importorskip("pyogrio.raw")
    shapes = shapely.to_wkb(shapely.points([[1, 2], [3, 4]]))
    raw.write(tmp_path / "t.shp", shapes, [np.array([0.2, 0.3])], ["dbh"], geometry_type="Point")
    assert len(read_tree_list(tmp_path / "t.shp")) == 2
    (tmp_path / "t.dbf").unlink()
    with pytest.raises(SpecError, match=r"t\.shp: has no \.dbf beside it"):
        read_tree_list(tmp_path / "t.shp")


def test_of_layers_that_of_points_is_read_and_said(tmp_path):
    shapely, raw = pytest.importorskip("shapely"), pytest.importorskip("pyogrio.raw")
    for name, kind, shapes in (
        ("plot", "Polygon", [shapely.box(4e5, 5e6, 4e5 + 40, 5e6 + 40)]),
        ("trees", "Point", shapely.points([[4e5 + 1, 5e6 + 2], [4e5 + 3, 5e6 + 4]])),
    ):
        dbh = [np.full(len(shapes), 0.3)]
        written = {"layer": name, "geometry_type": kind, "crs": "EPSG:32632"}
        raw.write(tmp_path / "t.gpkg", shapely.to_wkb(shapes), dbh, ["dbh"], **written)
    found = read_tree_list(tmp_path / "t.gpkg")
    assert found.position.tolist() == [[4e5 + 1, 5e6 + 2], [4e5 + 3, 5e6 + 4]]
    assert 't.gpkg: of 2 layers "trees" is read' in found.said


def test_crowns_as_polygons_tell_places_and_widths(tmp_path):
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.column_stack([20 + 3 * np.cos(turn), 9 + 3 * np.sin(turn)]).tolist()
    shapes = [
        {"type": "Polygon", "coordinates": [ring]},
        {"type": "MultiPolygon", "coordinates": [[[[0, 0], [1, 0], [1, 1]]], [ring[:199]]]},
    ]
    features = [{"type": "Feature", "geometry": each, "properties": None} for each in shapes[:1]]
    (tmp_path / "c.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    found = read_tree_list(tmp_path / "c.geojson")
    assert found.position == pytest.approx(np.array([[20, 9]]), abs=1e-6)
    assert found.measures[0, 2] == pytest.approx(6, rel=1e-3)


def test_points_of_maps_in_three_dimensions_or_without_a_place(tmp_path):
    shapes = {"Point": [1, 2, 30], "MultiPoint": [[3, 4]], "": None}
    features = [
        {
            "type": "Feature",
            "geometry": {"type": kind, "coordinates": place} if kind else None,
            "properties": {"X": 9, "dbh": 0.2, "crown_width": 4} if kind == "Point" else None,
        }
        for kind, place in shapes.items()
    ]
    (tmp_path / "t.json").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    found = read_tree_list(tmp_path / "t.json")
    assert found.position.tolist() == [[1, 2], [3, 4]]
    assert found.measures[0, [0, 2]].tolist() == [0.2, 4]
    assert np.isnan(found.measures[1]).all()
    assert "t.json: left out 1 row without x or y" in found.said


def test_species_by_codes_with_decimals_and_by_names_with_their_authors(tmp_path):
    (tmp_path / "t.csv").write_text(
        "x,y,symbol\n1,2,202.0\n3,4,Picea abies (L.) Karst.\n5,6,FASY\n"
    )
    ours = ("european-beech", "norway-spruce", "douglas-fir")
    assert read_tree_list(tmp_path / "t.csv", planted=ours).species == ours[::-1]


def test_other_words_of_a_status_are_said_to_be_living(tmp_path):
    (tmp_path / "t.csv").write_text("x,y,status\n1,2,alive\n3,4,Rotten\n5,6,stump\n")
    found = read_tree_list(tmp_path / "t.csv")
    assert found.position.tolist() == [[1, 2], [3, 4]]
    assert "t.csv: taken for living: status rotten" in found.said


@pytest.mark.parametrize(
    ("place", "said"), [("11.57,48.1", ""), ("48.1,11.57", "far from where EPSG:32632 is used")]
)
def test_degrees_far_from_the_map_are_refused(tmp_path, place, said):
    pytest.importorskip("pyproj")
    east, north = map(float, place.split(","))
    (tmp_path / "t.csv").write_text(f"x,y\n{place}\n{east + 1e-4},{north}\n{east},{north + 1e-4}\n")
    with pytest.raises(SpecError, match=said) if said else nullcontext():
        assert read_tree_list(tmp_path / "t.csv", crs="EPSG:32632").position.min() > 1e5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x,y\n5412345,456789\n5412350,456793\n", "5,412,348 m, is taken for east"),
        ("x,y,plot\n1,1,a\n1,2,b\n", "rows of 2 values of plot are taken together"),
        ("x,y,year\n1,1,2010\n1,2,2020\n", "rows of 2 values of year are taken together"),
        ("x,y,dbh_2010,dbh_2020\n1,1,.2,.3\n", "column dbh_2010 is not used; did you mean dbh?"),
        (
            "x,y,dbh\n1,1,.37\n9,9,.2\n1.02,1,.37\n5,5,.3\n5.3,5,.32\n1.9,1,.3\n",
            "nearer to each other than their trunks are thick, pairs in all 2: rows 2 and 4 (0.02 m), "
            "5 and 6 (0.3 m); did you mean",
        ),
        (
            "distance,azimuth\n1,90\n",
            "distance, taken as horizontal, and azimuth in deg, clockwise from the map's north (not the "
            "magnetic one)",
        ),
    ],
)
def test_what_may_be_meant_otherwise_is_said(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    assert said in " ".join(read_tree_list(tmp_path / "t.csv").said)


def test_east_and_north_exchanged_are_far_from_the_map(tmp_path):
    pytest.importorskip("pyproj")
    (tmp_path / "t.csv").write_text("x,y\n5412345,456789\n5412350,456793\n")
    with pytest.raises(SpecError, match="exchange them if they are north and east"):
        read_tree_list(tmp_path / "t.csv", crs="EPSG:32632")
    (tmp_path / "t.csv").write_text("y,x\n5412345,456789\n5412350,456793\n")
    found = read_tree_list(tmp_path / "t.csv", crs="EPSG:32632")
    assert found.position[0].tolist() == [456789, 5412345]


@pytest.mark.parametrize(
    ("sheets", "said"),
    [
        ({"About": [["A forest"]], "Trees": [["x", "y"], [1, 2]]}, 'of 2 sheets "Trees" is read'),
        ({"About": [["A forest"]], "Sums": [["n"], [1]]}, "its sheets are About, Sums"),
        ({"Trees": [["x", "y"], [1, "=1+1"]]}, 'row 2 of "Trees" has a formula without its result'),
    ],
)
def test_the_sheet_of_a_workbook_with_trees_is_read(tmp_path, sheets, said):
    book = pytest.importorskip("openpyxl").Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    book.save(tmp_path / "t.xlsx")
    if "is read" in said:
        found = read_tree_list(tmp_path / "t.xlsx")
        assert found.position.tolist() == [[1, 2]]
        assert said in found.said[1]
        return
    with pytest.raises(SpecError, match=said):
        read_tree_list(tmp_path / "t.xlsx")


def test_a_list_beside_the_field_is_refused_with_the_offset_that_would_do(tmp_path):
    (tmp_path / "t.csv").write_text("x,y\n432105.5,5612309\n432120,5612325\n")
    scene = Scene(plantings=(Planting(species="oak", layout="list", trees="t.csv"),))
    with pytest.raises(
        ElsewhereError, match=r"offset = \[432098, 5612302, 0\] at the top of the scene would put"
    ) as told:
        read_inputs(scene, tmp_path)
    found = read_inputs(scene.changed(offset=told.value.offset), tmp_path).lists["t.csv"].position
    assert ((found >= 0) & (found <= scene.forest.size)).all()


def test_trees_about_an_empty_middle_are_offered_one_of_them(tmp_path):
    (tmp_path / "t.csv").write_text("x,y\n5000,5000\n9000,5000\n5000,9000\n")
    scene = Scene(plantings=(Planting(species="oak", layout="list", trees="t.csv"),))
    with pytest.raises(ElsewhereError) as told:
        read_inputs(scene, tmp_path)
    read_inputs(scene.changed(offset=told.value.offset), tmp_path)


@pytest.mark.parametrize("kind", ["xlsx", "csv.gz"])
def test_a_file_that_unpacks_to_very_much_is_refused(tmp_path, kind):
    path, much = tmp_path / f"t.{kind}", b"x,y\n" + bytes(30_000_000)
    if kind == "xlsx":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("xl/workbook.xml", much)
    else:
        path.write_bytes(gzip.compress(much))
    with pytest.raises(SpecError, match="unpacks to more than"):
        read_tree_list(path)


def test_the_manual_names_the_columns_that_are_read():
    page = (Path(__file__).parents[2] / "docs/bring-your-data.md").read_text("utf-8")
    for key, names in {"place": ", ".join(PLACES), **NAMED}.items():
        names = names.split(", ") if key == "place" else names.split()
        assert f"| {key} | {', '.join(f'`{name}`' for name in names)} |" in page


@pytest.mark.parametrize(
    "names",
    [
        *("UTM Ost;UTM Nord", "UTM_E;UTM_N", "UTM-Ost [m];UTM-Nord [m]", "Ost_UTM;Nord_UTM"),
        *("Easting (m);Northing (m)", "Easting_UTM;Northing_UTM", "UTM Easting;UTM Northing"),
    ],
)
def test_places_of_utm_are_known_by_many_names(tmp_path, names):
    (tmp_path / "t.csv").write_text(f"{names}\n447253,5;5421349,25\n")
    assert read_tree_list(tmp_path / "t.csv").position.tolist() == [[447253.5, 5421349.25]]
