"""The page of the scene file: every key with its type, unit, range, default and help, from ``spec``."""

from __future__ import annotations

import dataclasses
import types
import typing
from pathlib import Path
from typing import Any

from forest_addon import spec
from forest_addon.spec.choices import meaning_of

TABLES: list[tuple[str, type[spec.Settings]]] = [
    ("The file's top level", spec.Scene),
    ("[forest]", spec.Forest),
    ("[forest.terrain]", spec.Terrain),
    ("[[forest.distances]]", spec.Distance),
    ("[[plantings]]", spec.Planting),
    ("[[plantings]] gaussians", spec.Gaussian),
    ("[[plantings]] rasters", spec.Raster),
    ("[[plantings]] by_hand", spec.HandTree),
    ("[[plantings]] clearings", spec.Clearing),
    ("[[plantings]] clusters", spec.Clusters),
    ("[[plantings]] strauss", spec.Strauss),
    ("[[plantings]] rows", spec.Rows),
    ("[plantings.targets]", spec.Targets),
    ("[[stems]]", spec.Stems),
    ("[air]", spec.Air),
    ("[wind]", spec.Wind),
    ("[rays]", spec.Rays),
    ('[[sensors]] kind = "tractor"', spec.Tractor),
    ('[[sensors]] kind = "terrestrial"', spec.Terrestrial),
    ('[[sensors]] kind = "mobile"', spec.Mobile),
    ('[[sensors]] kind = "airborne"', spec.Airborne),
    ("[sensors.beam]", spec.Beam),
    ("[sensors.surfaces]", spec.Surfaces),
    ("[sensors.receiver]", spec.Receiver),
    ("[sensors.link]", spec.LinkBudget),
    ("[sensors.noise]", spec.Noise),
    ("[[sensors.poses]]", spec.Pose),
    ('[[sensors]] kind = "sonar"', spec.Sonar),
    ("[sensors.receiver] of a sonar", spec.SonarReceiver),
    ('[[sensors]] kind = "reverb"', spec.Reverb),
    ("[[sensors.sources]], [[sensors.receivers]]", spec.Place),
    ("[flight]", spec.Flight),
    ("[accuracy]", spec.Accuracy),
    ("[output]", spec.Output),
    ("[tiles]", spec.Tiles),
]
SPECIES: list[tuple[str, type[spec.Settings]]] = [
    ("A species file", spec.Species),
    ("[template]", spec.Template),
    ("[siblings]", spec.Siblings),
    ("[grammar]", spec.Grammar),
    ("[rules]", spec.Rules),
    ("[honda]", spec.Honda),
    ("[crown]", spec.Crown),
    ("[targets]", spec.Targets),
    ("[needles]", spec.Needles),
    ("[jitter]", spec.Jitter),
    ("[leaf]", spec.Leaf),
    ("[inclination]", spec.Inclination),
    ("[detail]", spec.Detail),
    ("[look]", spec.Look),
    ("[bark]", spec.Bark),
    ("[architecture]", spec.Architecture),
    ("[architecture.dead]", spec.DeadBranches),
    ("An allometry file", spec.Allometry),
    ("[height], [crown_width], [crown_base], [leaf_area] of an allometry", spec.Law),
    ("A distribution: { mean, sd, low, high }", spec.Normal),
    ("A distribution: { values, weights }", spec.Discrete),
]


def write_reference(path: Path) -> None:
    """Write the page, unless it is as it would be."""
    text = reference()
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def reference() -> str:
    """The page as Markdown."""
    parts = [
        "# The scene file\n",
        "TOML; every key has a default unless it says *needed*. The same names, units and ranges hold in the "
        "[Python API](api.md) and in Blender's panel. A key that is not known, or a value out of range, is "
        "answered by one sentence. `version`, at the top, is that of what wrote the file; exported files "
        "have it. A file of a later minor version is read, and where it holds an unknown key the sentence "
        "says which version to get; one of a later major version is refused.\n",
    ]
    named: set[type[spec.Settings]] = set()  # some groups have two tables
    parts += [_table(title, group, named) for title, group in TABLES]
    parts.append("# The species file\n")
    parts += [_table(title, group, named) for title, group in SPECIES]
    return "\n".join(parts)


def _table(title: str, group: type[spec.Settings], named: set[type[spec.Settings]]) -> str:
    lines = [f"## `{title}`" if title[0] == "[" else f"## {title}", ""]
    if group not in named:  # signatures of the API link here
        lines += [f"```{{py:class}} forest_addon.api.{group.__name__}"]
        lines += [f":canonical: {group.__module__}.{group.__name__}", "```", ""]
        named.add(group)
    lines += [" ".join((group.__doc__ or "").split()), ""]
    lines += ["| key | type | unit | allowed | default | what it is |", "|---|---|---|---|---|---|"]
    hints = typing.get_type_hints(group)
    for field in dataclasses.fields(group):  # type: ignore[arg-type]
        known = spec.param_of(field)
        default = "*needed*" if known.required else _value(field.default)
        cells = (
            f"`{field.name}`",
            _kind(hints[field.name]),
            known.unit,
            "" if _is_group(field.default) else _allowed(known),
            default,
            known.help + _meanings(field.name, known),
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _meanings(name: str, known: spec.Param) -> str:
    """Meaning of each choice, where more than its name says it."""
    said = {choice: meaning_of(name, choice) for choice in known.choices}
    return "".join(f"<br>`{choice}`: {words}" for choice, words in said.items() if words)


def _allowed(known: spec.Param) -> str:
    if known.choices:
        return ", ".join(f"`{choice}`" for choice in known.choices)
    words = known.allowed()
    if words == "any finite number":
        return ""
    return words.removesuffix(f" {known.unit}") if known.unit else words


def _is_group(value: Any) -> bool:
    return isinstance(value, spec.Settings)


def _value(value: Any) -> str:
    if value is None or value == () or value == "":
        return ""
    if _is_group(value):
        return "see its table"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in value)}]`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _kind(hint: Any) -> str:
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        kinds = dict.fromkeys(_kind(kind) for kind in inside if kind is not type(None))
        return " or ".join(kinds)
    if origin is tuple:
        if len(inside) == 2 and inside[1] is Ellipsis:
            return f"list of {_kind(inside[0])}"
        return f"{len(inside)} numbers" if inside[0] in (int, float) else "list"
    names = {str: "text", float: "number", int: "whole number", bool: "true or false"}
    return names.get(hint, "table")
