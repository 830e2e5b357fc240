"""Scenes and clouds of this dataset by number, as arrays. Clouds that are LAZ need laspy, all else numpy."""

import csv
import json
import pathlib
import sys

import numpy as np

COLUMNS = ("organ", "tree", "treeID", "classification")  # labels of points, where a cloud has them


class Scenes:
    """Scenes of a split: records, trees by column, arrays of npz files by name."""

    def __init__(self, root, split="train"):
        names = (pathlib.Path(root) / "splits" / f"{split}.txt").read_text().split()
        self.folders = [pathlib.Path(root) / "scenes" / name for name in names]

    def __len__(self):
        return len(self.folders)

    def __getitem__(self, index):
        folder = self.folders[index]
        arrays = {file.stem: dict(np.load(file)) for file in sorted(folder.glob("*.npz"))}
        record = json.loads((folder / "scene.json").read_text())
        return {"record": record, "trees": table(folder / "trees.csv"), **arrays}


def collate(clouds):
    """A batch of ragged clouds: all points one after the other, ``batch`` the cloud of each, ``offset``
    where each begins and, last, their number. Tensors where torch was imported, else arrays."""
    count = [len(cloud["xyz"]) for cloud in clouds]
    keys = [key for key in clouds[0] if key != "origin" and all(key in one for one in clouds)]
    told = {key: np.concatenate([cloud[key] for cloud in clouds]) for key in keys}
    told["batch"] = np.repeat(np.arange(len(clouds)), count)
    told["offset"] = np.cumsum([0, *count])
    told["origin"] = np.stack([cloud["origin"] for cloud in clouds])
    torch = sys.modules.get("torch")
    return {k: torch.from_numpy(v) for k, v in told.items()} if torch else told


class Clouds:
    """Clouds of a split: xyz (P, 3) float32 about the cloud's ``origin`` (3,), labels (P,) int64."""

    collate = staticmethod(collate)

    def __init__(self, root, split="train"):
        folders = Scenes(root, split).folders
        laz = sorted(file for folder in folders for file in folder.glob("*-forinstance.laz"))
        laz = laz or sorted(file for folder in folders for file in folder.glob("*.laz"))
        self.files = laz or sorted(f for folder in folders for f in folder.glob("*-points.npz"))

    def __len__(self):
        return len(self.files)

    def __getitem__(self, index):
        file = self.files[index]
        if file.suffix == ".npz":
            cloud = np.load(file)
            names, place = cloud.files, np.stack([cloud[axis] for axis in "xyz"], axis=1)
        else:
            import laspy

            cloud = laspy.read(file)
            names, place = list(cloud.point_format.dimension_names), np.array(cloud.xyz)
        origin = place.mean(axis=0).round() if len(place) else np.zeros(3)
        labels = {n: np.array(cloud[n], dtype=np.int64) for n in COLUMNS if n in names}
        return {"xyz": (place - origin).astype(np.float32), "origin": origin, **labels}


def table(path):
    """A CSV file by column: float64 where all of it are numbers (empty: nan), else text."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return {name: numbers(column) for name, *column in zip(*rows, strict=True)}


def numbers(column):
    """A column as float64; texts where one is no number, without the "'" that keeps a formula a text."""
    try:
        return np.array([float(value or "nan") for value in column])
    except ValueError:
        formula = ("=", "+", "@")
        return np.array([v[v[:1] == "'" and v.lstrip("'").startswith(formula) :] for v in column])


def rows(root, split="train"):
    """Trees of a split one by one, as dictionaries: for ``datasets.Dataset.from_generator``. No sound is
    opened, so that no audio codec is needed."""
    for folder in Scenes(root, split).folders:
        columns = table(folder / "trees.csv")
        for number in range(len(columns["tree"])):
            values = {key: column[number] for key, column in columns.items()}
            yield {"scene": folder.name} | {
                key: str(value) if isinstance(value, str) else float(value)
                for key, value in values.items()
            }
