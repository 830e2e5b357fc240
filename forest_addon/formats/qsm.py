"""Trees as quantitative structure models in the MATLAB files of TreeQSM 2.4 (Raumonen et al. 2013).

rTwig, aRchi, ITSMe and TreeQSM's own functions read them. A file holds the struct ``QSM`` with ``cylinder``,
``branch`` and ``treedata``; lengths are metres, volumes litres in ``branch`` and ``treedata`` as there.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from .atomic import replacing

BREAST = 1.3  # metres above the foot


def write_treeqsm(path: str | os.PathLike[str], table: Mapping[str, np.ndarray]) -> None:
    """Write the cylinders of one tree.

    table : columns (C,) as ``stand.forest.cylinder_table`` has them, a parent before its children.

    Raises
    ------
    OSError : it cannot be written; what had its name before stays as it was.
    """
    from scipy.io import savemat

    cylinder = _cylinders(table)
    branch = _branches(cylinder)
    qsm = {
        "cylinder": _columns(cylinder),
        "branch": _columns(branch),
        "treedata": _treedata(cylinder, branch),
        "rundata": {"inputs": {"name": f"tree {int(table['tree'][0])}"}, "version": "2.4.1"},
    }
    with replacing(path) as partial, open(partial, "wb") as file:
        savemat(file, {"QSM": qsm}, do_compression=True, oned_as="column")


def _cylinders(table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of ``QSM.cylinder``; indices count from 1, 0 is none."""
    start, end = (np.column_stack([table[f"{e}{a}"] for a in "XYZ"]) for e in ("start", "end"))
    length = np.asarray(table["length"], np.float64)
    axis = np.divide(
        end - start, length[:, None], where=length[:, None] > 0, out=np.zeros_like(end)
    )
    _, branch = np.unique(table["axis_ID"], return_inverse=True)
    place = np.empty(len(branch), np.int64)
    order = np.argsort(branch, kind="stable")
    first = np.flatnonzero(np.diff(branch[order], prepend=-1))
    place[order] = np.arange(len(branch)) - np.repeat(first, np.diff([*first, len(branch)]))
    radius = np.asarray(table["radius_cyl"], np.float64)
    nothing = np.zeros(len(radius))
    return {
        "radius": radius,
        "length": length,
        "start": start,
        "axis": axis,
        "parent": np.asarray(table["parent_ID"]),
        "extension": np.asarray(table["extension_ID"]),
        "added": nothing.astype(np.uint8),
        "UnmodRadius": radius,
        "branch": branch + 1,
        "SurfCov": nothing + 1.0,  # the whole surface is known
        "mad": nothing,  # and exactly
        "BranchOrder": np.asarray(table["branching_order"]),
        "PositionInBranch": place + 1,
    }


def _branches(cylinder: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of ``QSM.branch``: litres, metres, m², degrees."""
    number = cylinder["branch"] - 1
    count = int(number.max(initial=-1)) + 1
    first = np.flatnonzero(cylinder["PositionInBranch"] == 1)
    first = first[np.argsort(number[first])]
    parent = cylinder["parent"][first]
    bearer = np.where(parent > 0, parent - 1, 0)
    axis, radius = cylinder["axis"], cylinder["radius"]
    volume = 1e3 * np.pi * radius**2 * cylinder["length"]
    area = 2 * np.pi * radius * cylinder["length"]
    lean = np.clip((axis[first] * axis[bearer]).sum(axis=1), -1.0, 1.0)
    return {
        "order": cylinder["BranchOrder"][first],
        "parent": np.where(parent > 0, cylinder["branch"][bearer], 0),
        "diameter": 2 * radius[first],
        "volume": np.bincount(number, volume, count),
        "area": np.bincount(number, area, count),
        "length": np.bincount(number, cylinder["length"], count),
        "angle": np.where(parent > 0, np.degrees(np.arccos(lean)), 0.0),
        "height": cylinder["start"][first, 2] - cylinder["start"][0, 2],
        "azimuth": np.degrees(np.arctan2(axis[first, 1], axis[first, 0])),
        "zenith": np.degrees(np.arccos(np.clip(axis[first, 2], -1.0, 1.0))),
    }


def _treedata(
    cylinder: Mapping[str, np.ndarray], branch: Mapping[str, np.ndarray]
) -> dict[str, float | np.ndarray]:
    """Return ``QSM.treedata``: litres, metres, m²."""
    trunk = branch["order"] == 0
    start, end = (
        cylinder["start"],
        cylinder["start"] + cylinder["axis"] * cylinder["length"][:, None],
    )
    foot, top = start[0], max(start[:, 2].max(), end[:, 2].max())
    breast = foot[2] + BREAST
    stem = (cylinder["BranchOrder"] == 0) & (start[:, 2] <= breast) & (end[:, 2] > breast)
    return {
        "TotalVolume": float(branch["volume"].sum()),
        "TrunkVolume": float(branch["volume"][trunk].sum()),
        "BranchVolume": float(branch["volume"][~trunk].sum()),
        "TreeHeight": float(top - foot[2]),
        "TrunkLength": float(branch["length"][trunk].sum()),
        "BranchLength": float(branch["length"][~trunk].sum()),
        "TotalLength": float(branch["length"].sum()),
        "NumberBranches": float(np.count_nonzero(~trunk)),
        "MaxBranchOrder": float(branch["order"].max(initial=0)),
        "TrunkArea": float(branch["area"][trunk].sum()),
        "BranchArea": float(branch["area"][~trunk].sum()),
        "TotalArea": float(branch["area"].sum()),
        "DBHqsm": float(2 * np.sqrt((cylinder["radius"][stem] ** 2).sum())),
        "location": foot,
    }


def _columns(table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns as MATLAB has numbers: double, but what fits a byte as it is; (N, 1) or (N, 3)."""
    return {
        name: values if values.dtype == np.uint8 else values.astype(np.float64)
        for name, values in table.items()
    }
