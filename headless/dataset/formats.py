"""Points with the field names and classes of FOR-instance, and a made dataset in the formats that people
train with; ``FORMATS`` names them.

FOR-instance (Puliti et al. 2023, arXiv 2309.01279) has the class of a point in ``classification`` and its
tree in ``treeID``, 0 where it has none. ``organ`` and ``order`` (branching order of wood, 0 the stem, and of
what bears a leaf; -1 where it is not known) are ours: by them other classes can be made. All other formats
take its classes, so clouds need ``keep.for_instance = true``; intensities stand in the
scan's own file, whose points are the same in the same order.

SemanticKITTI (Behley et al. 2019, arXiv 1904.01416), a sequence a scene, a frame a scan::

    sequences/00/velodyne/000000.bin  float32 x, y, z from the scanner, remission 0 to 1
    sequences/00/labels/000000.label    uint32: class in the lower 16 bits, tree in the upper
    sequences/00/poses.txt, calib.txt, times.txt
    semantic-kitti.yaml                 names, colours and sequences of each split, as its tools read them

S3DIS (Armeni et al. 2016), an area a split, a room a scene, a text file an object; scans of a scene are
joined, colours are grey, the strength of the echo::

    Area_1/scene_000000/scene_000000.txt        x y z r g b, all points; 1 train, 2 validation, 3 test
    Area_1/scene_000000/Annotations/stem_12.txt those of tree 12's stem; names end at the first _

COCO panoptic (Kirillov et al. 2019), previews; a segment, red + 256 green + 65536 blue of its PNG, is
tree times 8 plus class::

    images/000000.png  panoptic/000000.png  panoptic_train.json  panoptic_validation.json  panoptic_test.json
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from forest_addon.base.trimesh import DEAD, GROUND, LEAF, WOOD
from forest_addon.formats.atomic import replacing, write_whole
from forest_addon.formats.las import read_las
from forest_addon.formats.raster_file import read_png
from forest_addon.formats.toml_file import read_tables
from forest_addon.sensing.lidar.cloud import Cloud, Returns
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Planting, SpecError, unknown
from forest_addon.stand.forest import GrownForest
from forest_addon.stand.plan import PLANTS

from .disk import SCENES, Done, scenes_done
from .plan import SPLITS

CLASSES = (
    *("unclassified", "low vegetation", "terrain", "out points"),
    *("stem", "live branches", "woody branches"),
)
LOW_VEGETATION, TERRAIN, STEM, LIVE, WOODY = 1, 2, 4, 5, 6
STEP = 0.001  # metres between coordinates of the file
FIELDS = {
    "treeID": ("int32", "tree of trees.csv + 1, 0 none"),
    "organ": ("int8", "0 other wood leaf ground 4 dead"),
    "order": ("int8", "0 stem, 1 branch; -1 unknown"),
}


def orders_of(found: Returns, scene: SceneGeometry, forest: GrownForest) -> np.ndarray:
    """(P,) int8 branching order of what was met, -1 where it is no grown tree or was changed in Blender."""
    order = np.full(len(found.organ), -1, dtype=np.int8)
    stand = forest.stand
    row_of = np.full(int(stand.id.max(initial=-1)) + 2, -1)
    row_of[stand.id] = np.arange(len(stand))
    row = row_of[np.where(found.tree < len(row_of) - 1, found.tree, -1)]
    for number, mesh in enumerate(scene.meshes):
        of_mesh = np.flatnonzero((scene.mesh_index[found.instance] == number) & (row >= 0))
        if not len(of_mesh):
            continue
        standing = row[of_mesh[0]]
        key = int(stand.species[standing]), int(stand.variant[standing])
        grown = forest.variants[key].mesh if key in forest.variants else None
        if grown is None or grown.order is None or not np.array_equal(grown.part, mesh.part):
            continue
        order[of_mesh] = grown.order[found.triangle[of_mesh]]
    return order


def classes_of(
    found: Returns, order: np.ndarray, plantings: Sequence[Planting]
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) uint8 classes of FOR-instance and (P,) int32 trees, 0 where there is none.

    Dead branches are woody branches; leaves and living branches are live branches, as there. Undergrowth,
    lying stems and stumps are low vegetation, young trees are trees. Wood of unknown order, of trees that
    were grafted from templates, is a live branch.
    """
    classes = np.zeros(len(found.organ), dtype=np.uint8)
    classes[found.organ == GROUND] = TERRAIN
    classes[(found.organ == LEAF) | (found.organ == WOOD)] = LIVE
    classes[found.organ == DEAD] = WOODY
    classes[((found.organ == WOOD) | (found.organ == DEAD)) & (order == 0)] = STEM
    low = np.array([*(planting.species in PLANTS for planting in plantings), False])
    is_low = low[np.where(found.species < len(plantings), found.species, -1)] & (found.species >= 0)
    classes[is_low] = LOW_VEGETATION
    tree = np.where((found.tree >= 0) & ~is_low, found.tree + 1, 0)
    return classes, tree.astype(np.int32)


def write_for_instance(
    path: Path,
    cloud: Cloud,
    order: np.ndarray,
    plantings: Sequence[Planting],
    offset: Sequence[float] = (0.0, 0.0, 0.0),
) -> None:
    """Write a cloud as LAZ (format 6 of LAS 1.4) with ``classification``, ``treeID``, ``organ``, ``order``.

    Raises
    ------
    OSError : it cannot be written.
    """
    place = cloud.position + np.asarray(offset)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, STEP)
    header.offsets = np.floor(place.min(axis=0)) if len(place) else np.zeros(3)
    header.creation_date, header.generating_software = date(1980, 1, 1), "Forest Sensing"
    header.add_extra_dims([laspy.ExtraBytesParams(n, k, d) for n, (k, d) in FIELDS.items()])
    las = laspy.LasData(header)
    las.x, las.y, las.z = place.T
    las.return_number, las.number_of_returns = cloud.number, cloud.count
    las.gps_time = cloud.time
    las.classification, las["treeID"] = classes_of(cloud.returns, order, plantings)
    las["organ"], las["order"] = cloud.returns.organ, order
    with replacing(path) as partial, open(partial, "wb") as file:
        las.write(file, do_compress=True)


IMAGE, SEGMENTS = "preview.png", "preview-segments.png"
EIGHT = 8  # a pixel's segment is its tree times so many, and its class


ENDING = "-forinstance.laz"
COLOURS = (  # red, green, blue of each class, for viewers
    *((120, 120, 120), (170, 200, 90), (140, 110, 80), (0, 0, 0)),
    *((110, 70, 40), (40, 140, 50), (190, 150, 110)),
)
LEGEND = "legend.csv"


# A cloud on the map: places (P, 3) m, strength of echoes (P,) 0 to 1, classes (P,) of ``CLASSES``, trees (P,)
# that are 0 where there is none, and where the scanner stood, m; None where it moved.
LabelledScan = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]


def scans_of(one: Done) -> Iterator[LabelledScan]:
    """Clouds of a scene, by name.

    Raises
    ------
    SpecError : it has clouds without classes.
    """
    settings = read_tables(one.folder / "scene.toml")
    sensors = {sensor["name"]: sensor for sensor in settings.get("sensors", [])}
    offset = np.array(settings.get("offset", (0.0, 0.0, 0.0)))
    for name in sorted(name for name, points in one.record["points"].items() if points):
        path = one.folder / f"{name}{ENDING}"
        if not path.is_file():
            raise SpecError(
                str(one.folder),
                f"{name} has no classes: make the dataset with keep.for_instance = true",
            )
        cloud, sensor = read_las(path), sensors[name]
        level = np.ones(len(cloud.points))  # where no file tells
        if (one.folder / f"{name}.laz").is_file():
            level = np.asarray(read_las(one.folder / f"{name}.laz").intensity) / 65535.0
        stands = offset + sensor["position"] if sensor["kind"] == "terrestrial" else None
        classes = np.asarray(cloud.classification, dtype=np.uint8)
        yield np.asarray(cloud.xyz), level, classes, np.asarray(cloud["treeID"], np.int32), stands


MOST_TREES = 2**16 - 1  # that a label's upper half can name
SPLIT_NAMES = {"train": "train", "validation": "valid", "test": "test"}  # as its tools call them
STILL = "1 0 0 0 0 1 0 0 0 0 1 0"


def write_kitti(done: Sequence[Done], out: Path) -> int:
    """Write all scenes; returns how many clouds.

    Raises
    ------
    SpecError : a scene has more trees than a label can name.
    OSError : it cannot be written.
    """
    count = 0
    for one in done:
        folder = out / "sequences" / f"{one.number:02d}"
        for part in ("velodyne", "labels"):
            (folder / part).mkdir(parents=True, exist_ok=True)
        poses = []
        for number, scan in enumerate(scans_of(one)):
            poses.append(_write_frame(scan, folder, number, one.folder.name))
            count += 1
        _write_text(folder / "poses.txt", poses)
        _write_text(folder / "calib.txt", [f"{key}: {STILL}" for key in ("P0", "P1", "Tr")])
        _write_text(folder / "times.txt", [str(float(number)) for number in range(len(poses))])
    numbers = range(len(CLASSES))
    itself = [f"  {k}: {k}" for k in numbers]
    mine = {
        name: [one.number for one in done if one.record["split"] == split]
        for split, name in SPLIT_NAMES.items()
    }
    lines = [
        *("labels:", *(f"  {k}: {CLASSES[k]!r}" for k in numbers)),
        "color_map: # blue, green, red",
        *(f"  {k}: [{blue}, {green}, {red}]" for k, (red, green, blue) in enumerate(COLOURS)),
        *("learning_map:", *itself, "learning_map_inv:", *itself),
        *("learning_ignore:", *(f"  {k}: {str(k in (0, 3)).lower()}" for k in numbers)),
        *("split:", *(f"  {name}: {scenes}" for name, scenes in mine.items())),
    ]
    _write_text(out / "semantic-kitti.yaml", lines)
    return count


def _write_frame(scan: LabelledScan, folder: Path, number: int, scene: str) -> str:
    """Write one cloud about its scanner, of a moving one about its middle; returns the pose."""
    place, level, classes, tree, stands = scan
    if tree.max(initial=0) > MOST_TREES:
        raise SpecError(f"scene {scene}", f"has more than {MOST_TREES} trees; make smaller plots")
    middle = place.mean(axis=0).round() if stands is None else stands
    rows = np.column_stack([place - middle, level]).astype("<f4")
    label = classes.astype("<u4") | (tree.astype("<u4") << 16)
    for part, ending, values in (("velodyne", "bin", rows), ("labels", "label", label)):
        with replacing(folder / part / f"{number:06d}.{ending}") as partial:
            values.tofile(partial)
    x, y, z = middle.tolist()
    return f"1 0 0 {x!r} 0 1 0 {y!r} 0 0 1 {z!r}"


def _write_text(path: Path, lines: Sequence[str]) -> None:
    write_whole(path, "".join(f"{line}\n" for line in lines))


THINGS = (STEM, LIVE, WOODY)  # one of a tree; the rest is stuff


def write_panoptic(done: Sequence[Done], out: Path) -> int:
    """Write all previews with their segments; returns how many.

    Raises
    ------
    SpecError : a scene has no preview.
    OSError : it cannot be written.
    """
    for part in ("images", "panoptic"):
        (out / part).mkdir(parents=True, exist_ok=True)
    told: dict[str, dict[str, Any]] = {
        split: {
            "images": [],
            "annotations": [],
            "categories": [
                {
                    "id": number,
                    "name": name,
                    "supercategory": "tree" if number in THINGS else "ground",
                    "isthing": int(number in THINGS),
                    "color": list(COLOURS[number]),
                }
                for number, name in enumerate(CLASSES)
                if number
            ],
        }
        for split in SPLITS
    }
    for one in done:
        if not (one.folder / SEGMENTS).is_file():
            raise SpecError(
                str(one.folder), "has no preview: make the dataset with keep.preview = true"
            )
        name = f"{one.folder.name}.png"
        for source, part in ((IMAGE, "images"), (SEGMENTS, "panoptic")):
            with replacing(out / part / name) as partial:
                shutil.copyfile(one.folder / source, partial)
        segment = segments_from((one.folder / SEGMENTS).read_bytes())
        high, wide = segment.shape
        listing = told[one.record["split"]]
        listing["images"].append(
            {"id": one.number, "file_name": name, "width": wide, "height": high}
        )
        listing["annotations"].append(
            {"image_id": one.number, "file_name": name, "segments_info": _segments(segment)}
        )
    for split, record in told.items():
        write_whole(out / f"panoptic_{split}.json", json.dumps(record) + "\n")
    return len(done)


def _segments(segment: np.ndarray) -> list[dict[str, Any]]:
    """Segments that an image (H, W) holds: area in pixels, box as x, y, width, height."""
    segments = []
    for number in np.unique(segment[segment > 0]).tolist():
        rows, columns = np.nonzero(segment == number)
        left, top = int(columns.min()), int(rows.min())
        box = [left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1]
        segments.append(
            {
                "id": number,
                "category_id": number % EIGHT,
                "area": len(rows),
                "bbox": box,
                "iscrowd": 0,
            }
        )
    return segments


def segments_from(data: bytes) -> np.ndarray:
    """(H, W) int64 segments of a PNG's bytes.

    Raises
    ------
    ValueError : it is no PNG.
    """
    pixels = read_png(data)[0].astype(np.int64)
    return np.asarray(pixels[..., 0] + 256 * pixels[..., 1] + 65536 * pixels[..., 2])


WORDS = tuple(name.replace(" ", "") for name in CLASSES)


def write_s3dis(done: Sequence[Done], out: Path) -> int:
    """Write all scenes; returns how many.

    Raises
    ------
    OSError : it cannot be written.
    """
    for one in done:
        scans = list(scans_of(one))
        area = f"Area_{1 + SPLITS.index(one.record['split'])}"
        room = out / area / f"scene_{one.folder.name}"
        (room / "Annotations").mkdir(parents=True, exist_ok=True)
        if not scans:
            continue
        place, level, classes, tree = (
            np.concatenate(column) for column in zip(*(scan[:4] for scan in scans), strict=True)
        )
        grey, key = level * 255.0, tree.astype(np.int64) * len(CLASSES) + classes
        turn = np.argsort(key, kind="stable")
        levels = grey[turn].round().astype(int).tolist()
        rows = zip(*place[turn].T.tolist(), levels, strict=True)
        lines = [f"{x:.3f} {y:.3f} {z:.3f} {g} {g} {g}" for x, y, z, g in rows]
        _write_text(room / f"{room.name}.txt", lines)
        keys_found, first = np.unique(key[turn], return_index=True)
        ends = [*first[1:].tolist(), len(key)]
        for what, start, end in zip(keys_found.tolist(), first.tolist(), ends, strict=True):
            name = f"{WORDS[what % len(CLASSES)]}_{what // len(CLASSES)}.txt"
            _write_text(room / "Annotations" / name, lines[start:end])
    return len(done)


FORMATS: dict[str, Callable[[Sequence[Done], Path], int]] = {
    "semantic-kitti": write_kitti,
    "s3dis": write_s3dis,
    "coco-panoptic": write_panoptic,
}


def convert_dataset(root: Path, kind: str, out: Path, say: Callable[[str], None]) -> None:
    """Write a made dataset in another format, with the legend of its classes, to a new folder.

    Raises
    ------
    SpecError : the format is unknown; there is no dataset, or not what it needs; the folder is not empty.
    OSError : it cannot be written.
    """
    if kind not in FORMATS:
        raise unknown("--to", kind, FORMATS)
    done = list(scenes_done(root)) if (root / SCENES).is_dir() else []
    if not done:
        raise SpecError(
            f"--convert {root}", "holds no finished scene; give the folder of a dataset"
        )
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise SpecError(f"--out {out}", "is there already; choose another folder, or empty it")
    out.mkdir(parents=True, exist_ok=True)
    count = FORMATS[kind](done, out)
    rows = [
        f"{number},{name},{r},{g},{b}"
        for number, (name, (r, g, b)) in enumerate(zip(CLASSES, COLOURS, strict=True))
    ]
    write_whole(out / LEGEND, "\n".join(["class,name,red,green,blue", *rows, ""]))
    say(f"{count} items of {len(done)} scenes as {kind} in {out}")
