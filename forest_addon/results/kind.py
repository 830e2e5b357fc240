"""Record of what a sensor GIVES: one a kind, filled in by the file of each sensor in this room.

The record turns what a sensor found into figures and sentences for panel and report, files, a picture, a
sound, points. Whoever shows or writes results looks it up by the ``kind`` of the sensor's settings
(``kinds``) and knows no result by its class. What a sensor *is* is the record of the same kind in
``sensing``.

Only figures and arrays are needed; a result that says no more becomes an NPZ, a table, and lines in panel
and report.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..base.labels import Labels
from ..drawing.strips import Plot
from ..sensing.kind import Seen
from ..sensing.lidar.cloud import Cloud
from ..sensing.sonar.echo import Contributions
from .coordinates import Offset
from .figures import Figure

Finding = Any  # what a sensor found: a Cloud, an Echo, ...
Variables = Mapping[str, tuple[tuple[str, ...], np.ndarray, str]]  # dimensions, values, unit


@dataclass(frozen=True)
class ResultKind:
    """Record of a result; its functions take the sensor's settings and what it found.

    figures : its figures; the scene, where it is known, for those that need it. arrays : named arrays of
        what was found, with ``units`` by name; what is written where ``write`` and ``save`` say nothing else.
    labelled : the same for tables: variables and coordinates by name, each its dimensions, values and unit;
        what is known by ``arrays`` alone has dimensions without names.
    sentence : the most telling figure in a few words, ``keep``-ed for translators; empty: the first figure.

    title, story, notes : heading, sentence and remarks in the report.
    doubts : what a user should be warned of, as a tolerance that was not reached.
    files : what a run's files are called after the sensor's name; "": it may be a folder.
    write : the files of a run in a folder, with the offset of the scene; the one of the data first.
    endings, save : formats that a result is exported to, the usual one first, and how; labels are of points.
    plot : a picture of it; None: there is nothing to draw. points : it as points in the scene; None: it has
        none. is_cloud : points are all that it is. marks : what sounded where, to show in the scene.
    sound : samples (N, C) and rate in Hz, as it is played; None: it is silent. is_response : other sounds are
        played through it. wet : a dry sound (M,) of a rate as it is heard, (N, C) and its rate.
    """

    figures: Callable[[Any, Finding, Seen | None], list[Figure]]
    arrays: Callable[[Finding], dict[str, np.ndarray]] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    labelled: Callable[[Finding], tuple[Variables, Variables]] | None = None
    sentence: Callable[[Finding], str] = lambda *_: ""
    title: Callable[[Any], str] = lambda one: f"{one.TITLE or one.kind.title()}: {one.name}"
    story: Callable[[Any, Finding], str] = lambda *_: ""
    notes: Callable[[Any, Finding], tuple[str, ...]] = lambda *_: ()
    doubts: Callable[[Any, Finding], tuple[str, ...]] = lambda *_: ()
    files: tuple[str, ...] = (".npz",)
    write: Callable[[Path, Any, Finding, Offset], list[Path]] | None = None
    endings: tuple[str, ...] = (".npz", ".csv")
    save: Callable[[Path, Any, Finding, Offset, Labels | None], None] | None = None
    plot: Callable[[Any, Finding], Plot | None] = lambda *_: None
    points: Callable[[Any, Finding], Cloud | None] = lambda *_: None
    is_cloud: bool = False
    marks: Callable[[Finding], Contributions | None] = lambda *_: None
    sound: Callable[[Any, Finding], tuple[np.ndarray, float]] | None = None
    is_response: bool = False
    wet: Callable[[Any, Finding, np.ndarray, float], tuple[np.ndarray, float]] | None = None
