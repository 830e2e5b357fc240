"""Scenes drawn from the ranges that settings themselves tell: each ends as a run, or in one sentence."""

import json
import math
import os
import types
import typing
import warnings
from dataclasses import MISSING, fields

import pytest

pytest.importorskip("bpy")

import tomli_w
from hypothesis import given, settings, strategies as st

from forest_addon.spec import SENSORS, Forest, Planting, Scene
from forest_addon.spec.base import Settings, param_of, types_of

SPECIES = (
    "apple",
    "maple",
    "hazelnut",
    "honda-birch",
    "silver-birch",
    "scots-pine",
    "whorl-8",
    "fern",
)
KINDS = ("tractor", "terrestrial", "mobile", "airborne", "sonar", "reverb")
DEEPEST = 2  # tables in tables
OFF = dict.fromkeys(("pictures", "goodness", "report", "blend", "glb", "preview"), False)
AT_ONCE = {  # what keeps a run to seconds, unless drawn
    "tractor": {"track": 5.0, "gap": 199},
    "terrestrial": {"angle_step_deg": 4.0},
    "mobile": {"pulse_rate": 1000.0},
    "airborne": {"pulse_rate": 1000.0},
    "sonar": {},
    "reverb": {"source": [2.0, 2.0, 1.5], "receiver": [5.0, 4.0, 1.5]},
}
ASIDE = {  # of a table: files, what the scene has by itself, and what would take long
    "name", "kind", "poses", "engine", "polygon", "holes", "size", "margin", "species", "gaussians", "raster",
    "scale_height", "distances", "origin",
}  # fmt: skip


class UndrawableError(Exception):
    """A setting whose values are not told by its range: a text, a file, a law."""


def numbers(param, default, whole):
    """Numbers of a setting: its ends, its default times some, and what lies between."""
    low = param.minimum if math.isfinite(param.minimum) else -20.0
    high = min(param.maximum, low + 100.0)
    least = low + 1e-3 * max(1.0, abs(low)) if param.open_minimum else low
    near = isinstance(default, int | float) and not isinstance(default, bool) and default
    some = [default * by for by in (0.5, 0.8, 1.3, 2, 3)] if near else [0.1, 1, 5]
    ends = [least, *([param.maximum] if param.maximum < 1e5 else [])]
    found = st.one_of(st.sampled_from([*ends, *some]), st.floats(least, max(high, least)))
    kept = found.map(lambda value: float(f"{min(max(value, least), param.maximum):.4g}"))
    return kept.map(lambda value: round(min(value, 200))) if whole else kept


def values(param, kind, default, depth):
    """Values of one setting by its type and range."""
    parts, form = typing.get_args(kind), typing.get_origin(kind)
    if form in (types.UnionType, typing.Union):
        able = []
        for part in parts:
            if part is not type(None):
                with_part = values_or_none(param, part, default, depth)
                able += [with_part] if with_part is not None else []
        if not able:
            raise UndrawableError
        return st.one_of(able)
    if param.file:
        raise UndrawableError
    if param.choices and (kind is str or form is typing.Literal):
        return st.sampled_from([each for each in param.choices if each])
    if kind is bool:
        return st.booleans()
    if kind in (int, float):
        found = numbers(param, default, kind is int)
        return st.one_of(found, st.just("auto")) if param.auto else found
    if form is tuple and parts[1:] == (Ellipsis,):
        return st.lists(values(param, parts[0], None, depth + 1), min_size=1, max_size=3)
    if form is tuple:
        usual = default if isinstance(default, tuple) and len(default) == len(parts) else None
        usual = usual or (None,) * len(parts)
        each = [values(param, *one, depth + 1) for one in zip(parts, usual, strict=True)]
        return st.tuples(*each).map(list)
    if isinstance(kind, type) and issubclass(kind, Settings) and depth <= DEEPEST:
        return tables(kind, depth + 1, 2)
    raise UndrawableError


def values_or_none(param, kind, default, depth):
    try:
        return values(param, kind, default, depth)
    except UndrawableError:
        return None


@st.composite
def tables(draw, cls, depth=0, most=3):
    """A table of some of the settings of a class, and of all that it cannot be without."""
    able = {each.name: each for each in fields(cls) if each.name not in ASIDE}
    must = [name for name, each in able.items() if param_of(each).required]
    some = draw(st.lists(st.sampled_from(sorted(able)), max_size=most, unique=True)) if able else []
    told = {}
    for name in dict.fromkeys([*must, *some]):
        default = None if able[name].default is MISSING else able[name].default
        found = values_or_none(param_of(able[name]), types_of(cls)[name], default, depth)
        if found is not None:
            told[name] = draw(found)
    return told


@st.composite
def scenes(draw):
    """The tables of a scene of a few small trees and one or two sensors."""
    side = draw(st.sampled_from([4.0, 8.0]))
    planting = {
        "species": draw(st.sampled_from(SPECIES)),
        "expected": draw(st.sampled_from([1, 2])),
    }
    told = {
        "seed": draw(st.integers(0, 10**6)),
        "forest": draw(tables(Forest, most=2)) | {"size": [side, side]},
        "plantings": [draw(tables(Planting, most=2)) | planting | {"variants": 1}],
        "output": OFF,
        "sensors": [],
    }
    rooms = {"air", "wind", "accuracy", "rays"}
    for name, kind in types_of(Scene).items():
        if name in rooms and draw(st.integers(0, 2)) == 0:
            told[name] = draw(tables(kind, most=2))
    for number in range(draw(st.integers(1, 2))):
        kind = draw(st.sampled_from(KINDS))
        sensor = AT_ONCE[kind] | draw(tables(SENSORS[kind], most=4))
        if kind in ("mobile", "airborne"):
            high = 20.0 if kind == "airborne" else 1.5
            way = ((0.0, [0.0, 0.0, high]), (2.0, [8.0, 4.0, high]))
            sensor["poses"] = [{"time": time, "position": place} for time, place in way]
        told["sensors"].append(sensor | {"kind": kind, "name": f"s{number}"})
    return told


@pytest.mark.slow
@settings(max_examples=6)
@given(scene=scenes())
def test_a_drawn_scene_ends_as_a_run_or_in_one_sentence(headless, tmp_path_factory, scene):
    """No traceback, no warning, no audit that calls a right result wrong, nothing half written."""
    folder = tmp_path_factory.mktemp("drawn")
    (folder / "s.toml").write_text(tomli_w.dumps(scene))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        done = headless("run", folder / "s.toml", "--out", folder / "o", "--quiet", ends=None)
    assert done.returncode in (0, 2), done.stderr
    assert not [str(each) for each in heard if issubclass(each.category, RuntimeWarning)]
    if done.returncode == 2:
        assert len([line for line in done.stderr.splitlines() if line.startswith("error: ")]) == 1
        assert not (folder / "o").exists() or not os.listdir(folder / "o")
        return
    told = (folder / "o" / "run.json").read_text()
    json.loads(told, parse_constant=lambda word: pytest.fail(f"run.json holds {word}"))
    assert not [path.name for path in (folder / "o").rglob("*") if "partial" in path.name]
