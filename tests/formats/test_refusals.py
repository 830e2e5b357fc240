"""Files that hold something else than they should: one sentence names the file and says what."""

import struct

import pytest

from forest_addon.formats.glb import read_glb
from forest_addon.formats.helios.parts import read_materials, read_obj
from forest_addon.formats.raster_file import read_raster
from forest_addon.sensing.sonar.equipment_files import read_patterns, read_route
from forest_addon.stand.files import read_tree_list

LISTS = [
    ("x,y,scale\n1,2,-1\n", "row 2: scale is -1"),
    ("x,y,scale\n1,2,big\n", 'row 2: scale is "big"'),
    ("x,z\n1,2\n", "no column y"),
    ("x,y,dbh\n1,2,24\n", "row 2: dbh is 24 m, more than trees have .* as dbh_cm"),
    ("x,y,dbh\n1,2,3.1\n3,4,2.7\n", "a median of 2.9 cm or in would make sense"),
    ("x,y,BHD\n1,2,310\n3,4,270\n", "a median of 290 mm would make sense"),
    ("x,y,h\n1,2,80\n3,4,110\n", "a median of 95 ft or dm would make sense"),
    ("x,y,Height (yd)\n1,2,20\n", r'column "height \(yd\)" is not known; use one of m, cm'),
    ("x,y,dbh\n1,5,2,5,0,24\n", "row 2 has 6 values, its header 3"),
    ("x,y\n1,5,2\n", "row 2 has 3 values, its header 2"),
    ('x,y\n"1,500",2\n', 'row 2: x is "1,500"'),
    ("x,y\n9.0001,48.1\n9.0002,48.10001\n9.0003,48.1002\n", 'degrees; .* as "EPSG:32632"'),
    ("lon,lat\n-70.1,-33.5\n", 'degrees; .* as "EPSG:32719"'),
    ("azimuth,dist\n390,4\n", "azimuths above 360 degrees"),
    ("azimuth,dist,plot\n90,4,1\n80,4,2\n", "trees of several plots"),
    ("x,y\n" + "1,1\n" * 60, "60 rows at one place, as of a plot"),
    ("x;y;h\n567.123;6;30,5\n567.9;6;30,5\n", 'x is "567.123", which may be thousands'),
    ("x;y;h\n567,123;6;30.5\n", 'x is "567,123", which may be thousands'),
    ("azimuth,dist\n30,-4\n", "distances below 0"),
    ("x,y,plot\n1,1,a\n1,1,b\n", "several plots or years at one place"),
    ("x,y,year\n1,1,2010\n1,1,2020\n", "several plots or years at one place"),
    ("x,y,dbh_in,height\n1,2,12,60\n3,4,10,55\n", "times as tall as thick"),
    (
        "x,y,BHD mm,h\n1,2,38,19\n3,4,15.8,11\n5,6,,9\n",
        "598 times as tall as thick, .* 300 times",
    ),
    (
        "azimuth,dist\n0.3,4\n1.2,4\n5.9,3\n3.1,2\n",
        "no azimuth above 6.3; call the column azimuth_rad",
    ),
    ("x,y,dbh\n1,1,.2\n2,2,.2\n1,1,.2\n", "row 4 is row 2 again, cell for cell"),
    ("id,x,y,dbh\n1,1,1,.2\nMean,1.5,1.5,.2\n", 'row 3 begins with "Mean", as a sum of others'),
    ("x;y\n4,57E+05;5,41E+06\n", 'x is "4,57E\\+05", which a spreadsheet has rounded'),
    ("PLOT,SUBP,azimuth,dist\n1,1,90,5\n1,2,80,4\n", "trees of several plots"),
    ("azimuth,dist\n10,512\n20,1204\n", "858 m in the median, .* as distance_cm"),
    ("x,y,rotation\n1,2,120\n", "more than a turn; call the column rotation_deg"),
    ("x,y,scale\n1,2,120\n", "row 2: scale is 120 times; .* scale_%"),
    ("x;y;dbh_mm\n1;2;1,200\n3;4;900\n", 'row 2: dbh is "1,200", which may be thousands'),
    (
        "x;y;dbh_mm\n1;2;1,200\n3;4;1,100\n",
        "a dbh of 1.15 mm or less; .* without marks of thousands",
    ),
    ("x;y;h_cm\n1;2;1.200\n3;4;2.100\n", "a height of 16.5 mm or less"),
    ("x,y,dbh_cm,h\n1,2,28,0.3\n", "row 2: a tree of 0.3 m has no DBH"),
    ("utm_zone,x,y\n32U,5e5,5.4e6\n33U,5e5,5.4e6\n", "several UTM zones"),
    ("x,y,h,hcb\n1,1,10,3\n2,2,10,12\n", "row 3: the crown begins above the top"),
    ('x,y,note\n1,2,"never ends\n3,4,a\n', "cannot be read"),
    ("Baum;BHD\n1;0,3\n", "no column x, only Baum, BHD; call one of them x, another y, or"),
]
TABLES = [
    ("t.xls", "x,y\n1,2\n", "a kind of table that is not read"),
    ("t.json", "{}", "cannot be read as a table of trees"),
    ("t.json", '{"type": "Topology"}', "it has no 'geometry'"),
    (
        "t.json",
        '{"features": [{"geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [2, 2], '
        '[0, 0]]]}, "properties": null}]}',
        "its points lie on one line",
    ),
    ("t.mat", "MATLAB 5.0", "a kind of table that is not read, .mat"),
    (
        "t.json",
        '{"features": [{"geometry": {"type": "MultiPoint", "coordinates": [[1, 2], [3, 4]]}, '
        '"properties": null}]}',
        "has a MultiPoint; give trees as points, each its own",
    ),
    (
        "t.json",
        '{"features": [{"geometry": {"type": "LineString", "coordinates": [[1, 2]]}, '
        '"properties": null}]}',
        "has a LineString; give trees as points",
    ),
]
GROUNDS = [
    (
        "t.asc",
        "ncols 2\nnrows 2\nxllcorner 11\nyllcorner 48\ncellsize 1e-4\n1 2\n3 4\n",
        "degrees",
    ),
    ("t.xyz", "lat lon z\n48 11 1\n48 11.1 2\n48.1 11 3\n", "lies in degrees"),
    ("t.csv", "a,b,c\n1,2,3\n2,1,3\n", "does not name its columns x, y and z"),
    ("t.csv", "x,y,z\n1,5,2,5,3,5\n2,5,1,5,3,5\n2,5,9,5,3,5\n", "or fewer than its 6 columns"),
    ("t.xyz", "1 5 7 300\n2 6 7 300\n3 6 9 300\n", "counts its rows in its first column"),
    ("t.xyz", "1 5 7\n2 6 7\n3 7 7\n", "has 3 points with a height, all on one line"),
    ("t.xyz", "1 5 -9999\n2 6 -9999\n3 9 -9999\n", "has 0 points with a height"),
    ("t.xyz", "nothing here\n", "has no line of numbers"),
    ("t.csv", "x,y,z,class\n1,2,3,5\n2,1,3,1\n", "no points of class 2, ground, only of 1, 5"),
    ("t.asc", "ncols 2\nnrows 1\nxllcorner 9\nyllcorner 9\ncellsize 0\n1 2\n", "2 x 1 of 0 m"),
    ("t.asc", "1 2 3\n4 5 6\n", "if it holds points, end its name in .xyz"),
    ("t.pcd", "# .PCD v.7\n", "save it as PNG, TIFF or npy, a cloud as LAS"),
]
HEADS = [  # over which numpy trips
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4\0), }",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), '",
    b"{'descr': '<f8\x01', 'fortran_order': False, 'shape': (3, 4), }",
    b"{'descr': ('<f8', 'fortran_order': False, 'shape': (3, 4), }",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999, 99999999), }",
    b"(" * 9000,
]
PATTERNS = [
    ("", "is empty"),
    ("angle,60000\n0,0\n", "angle_deg"),
    ("angle_deg,high\n0,0\n9,1\n", "no frequency"),
    ("angle_deg,60000\n5,0\n9,1\n", "rise from 0"),
    ("angle_deg,60000\n0,0\n0,1\n", "rise from 0"),
    ("angle_deg,70000,60000\n0,0,0\n5,1,1\n", "left to right"),
    ("angle_deg,60000\n0,0\n5\n", "row 3 has 1 values"),
    ("angle_deg,60000\n0,0\n5,1,5\n", "its header 2"),
    ("angle_deg,60000\n0,zero\n5,1\n", 'is "zero", not a finite number'),
    ("angle_deg,60000\n0,0\n5,nan\n", "row 3 has no 60000"),
]
WAY = "x_m,y_m,z_m,azimuth_deg,elevation_deg"
ROUTES = [
    (f"{WAY},time_s\n0,0,1,90,0,4\n0,2,1,90,0,4\n", "must rise"),
    ("x_m,y_m\n0,0\n", "needs the columns"),
    (f"{WAY}\n", "no rows below"),
    (f"{WAY},beam_width_deg\n0,0,0,0,0,0\n", "larger than 0"),
    (f"{WAY},speed\n0,0,0,0,0,0\n", "may have"),
]
NO_GLB = [
    b"",
    b"glTF",
    struct.pack("<4sII", b"glTF", 1, 20) + bytes(8),
    struct.pack("<4sII", b"glTF", 2, 20) + struct.pack("<II", 0, 7),
    b"\x89PNG" + bytes(40),
]
OBJ = "v 0 0 0\nv 1 \\\n0 0\nf -1 -2 \\\n-3\n"
REFUSED = {
    read_tree_list: [*(("t.csv", *row) for row in LISTS), *TABLES],
    read_raster: [*GROUNDS, ("text.png", "no image", ""), *(("a.npy", head, "") for head in HEADS)],
    read_patterns: [("beam.csv", *row) for row in PATTERNS],
    read_route: [("way.csv", *row) for row in ROUTES],
    read_glb: [("x.glb", raw, "") for raw in NO_GLB],
    read_obj: [("t.obj", OBJ, "line 5: a face has a corner that is not there")],
    read_materials: [
        (
            "a.mtl",
            f"newmtl bark\nhelios_reflectance {share}\n",
            r"is no share from 0 to 1 of the light; write 45 % as 0\.45",
        )
        for share in ("45", "1.01", "-0.1", "inf")
    ],
}


@pytest.mark.medium
@pytest.mark.parametrize(
    ("read", "name", "content", "words"),
    [(read, *row) for read, rows in REFUSED.items() for row in rows],
)
def test_a_file_that_cannot_be_used_is_one_sentence(tmp_path, read, name, content, words):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match=words) as said:
        read(path, 0.0) if read is read_route else read(path)
    assert name in str(said.value)
    assert "\n" not in str(said.value)
