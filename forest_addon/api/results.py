"""Results of sensors, with names: arrays to compute with, ``save`` to a file, ``plot`` to look at.

A result holds what the sensor's own code returned (``found``: a ``Cloud``, an ``Echo``, ...) and adds what
a script wants of it. The ending of a file's name chooses its format; it is written under another name and
then renamed, so that nothing is left half written.

Tables of pandas and datasets of xarray have units as attributes. Both libraries are the extra ``analysis``;
they are imported when a table is asked for. Positions are in the scene's own coordinates, as everywhere
within a session; the attributes say the offset and the coordinate system of a written file.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..formats.foreign import library
from ..formats.table import write_npz
from ..results.coordinates import NO_OFFSET, Offset
from ..results.kinds import figures_of, labelled_of, results_of, write_as
from ..results.points import ENDINGS, ending_of, write_points
from ..results.sonar import heard_columns, received_arrays
from ..sensing.audit import Audit
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.tractor import TractorScan, to_cloud
from ..sensing.reverb.channels import ImpulseResponse, channels_of
from ..sensing.reverb.metrics import RoomMetrics, room_metrics
from ..sensing.sonar.echo import Echo, PingSeries
from ..spec import Choice, Sensor, SpecError
from .given import file_to_write, path_of, points_of

if TYPE_CHECKING:  # a sensor's physics is imported when it runs
    from ..sensing.trajectory import Trajectory

BAG = ".mcap"


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Result of a sensor.

    sensor : its settings. found : what its own code returned. seconds : that it took.
    audit : a random sample of it, computed again by the exact way; None where that is switched off.
    offset : (3,) metres that are added to positions when they are written, the scene's, with its
    coordinate system.
    chosen : what was left to "auto", with its bound and why; ``sensor`` has the values.
    warnings : sentences about what is hardly meant, as a sensor inside of a trunk.
    way : where it went, of a sensor that follows a trajectory.
    """

    sensor: Sensor
    found: Any
    seconds: float
    audit: Audit | None = None
    offset: Offset = NO_OFFSET
    chosen: tuple[Choice, ...] = ()
    warnings: tuple[str, ...] = ()
    way: Trajectory | None = None

    def __repr__(self) -> str:
        figures = ", ".join(f"{name} {text}" for name, text in list(self.summary().items())[:2])
        return f"{type(self).__name__}({self.sensor.name!r}: {figures})"

    def to_xarray(self) -> Any:
        """An ``xarray.Dataset``; units are attributes of its variables.

        Raises
        ------
        SpecError : xarray is not installed (extra ``analysis``); a result without arrays.
        """
        xarray = library("xarray", "analysis", "xarray")
        variables, coordinates = (
            {
                name: (dims, values, {"units": unit} if unit else {})
                for name, (dims, values, unit) in part.items()
            }
            for part in labelled_of(self.sensor, self.found)
        )
        return xarray.Dataset(variables, coordinates, self._facts())

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``, a row a point or sample; ``attrs["units"]`` has the units by column.

        A result of several dimensions has its coordinates as columns.

        Raises
        ------
        SpecError : pandas is not installed (extra ``analysis``), or xarray, for a result of several
            dimensions; a result without arrays.
        """
        pandas = library("pandas", "analysis", "pandas")
        variables, coordinates = labelled_of(self.sensor, self.found)
        every = {**variables, **coordinates}
        if len({dims for dims, *_ in every.values()}) == 1 and not coordinates:
            made = pandas.DataFrame({name: values for name, (_, values, _) in every.items()})
        else:
            made = self.to_xarray().to_dataframe().reset_index()
        units = {name: unit for name, (_, _, unit) in every.items() if unit and name in made}
        made.attrs = {"units": units, **self._facts()}
        return made

    def _facts(self) -> dict[str, Any]:
        return {
            "sensor": self.sensor.name,
            "kind": self.sensor.kind,
            "offset_m": list(self.offset),
            "crs": self.offset.crs,
            "seconds": self.seconds,
        }

    def save(self, path: str | Path) -> Path:
        """Write it to a file, in the format that the ending of its name says; returns its path.

        Raises
        ------
        SpecError : the ending is of no format that holds such a result; the folder is not there.
        OSError : it cannot be written; what had its name before stays as it was.
        """
        path = path_of("save", path)
        ending = ending_of(path)
        if ending not in self.endings:
            raise SpecError(
                str(path), f"cannot be written; end its name in {', '.join(self.endings)}"
            )
        self._write(file_to_write(path), ending)
        return path

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of the names of files that it can be saved to, the usual one first."""
        return results_of(self.sensor).endings

    def plot(self) -> Any:
        """A matplotlib figure of it.

        Raises
        ------
        SpecError : matplotlib is not installed; there is nothing to draw.
        """
        figures = _figures()
        from ..drawing.echoes import figure_of

        figure = figure_of(self.sensor, self.found)
        if figure is not None:
            return figure
        plot = results_of(self.sensor).plot(self.sensor, self.found)
        if plot is None:
            raise SpecError("plot", "is not known of this result")
        return figures.draw_strips(plot)

    def _write(self, path: Path, ending: str) -> None:
        write_as(path, self.sensor, self.found, self.offset)

    def summary(self) -> dict[str, str]:
        """Figures of this result in words, those of report and panel."""
        figures = {
            each.name or each.short: each.text for each in figures_of(self.sensor, self.found)
        }
        return figures | {"time": f"{self.seconds:.2f} s"}

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what was chosen for it and what it warns of."""
        return (*map(str, self.chosen), *(f"{warning}." for warning in self.warnings))

    def record(self) -> dict[str, Any]:
        """Checks and choices of it, as run.json has them."""
        record: dict[str, Any] = {}
        if self.audit is not None:
            record["audit"] = self.audit.record()
        if self.chosen:
            record["chosen"] = [choice.record() for choice in self.chosen]
        return record

    def _repr_html_(self) -> str:
        """Figures, picture and sound of this result, as notebooks show it."""
        said = self.summary() | ({"audit": str(self.audit)} if self.audit else {})
        said |= {"warning": "; ".join(self.warnings)} if self.warnings else {}
        rows = "".join(f"<tr><td>{k}</td><td>{v}</td></tr>" for k, v in said.items())
        return f"<table>{rows}</table>" + _as_html(self) + _player(self)


def _figures() -> Any:
    """The module that draws results by matplotlib; a sentence where that is not there."""
    try:
        import matplotlib  # noqa: F401

        from ..drawing import figures
    except ImportError:
        from ..blender.packages import to_install

        raise SpecError(
            "plot", f"needs matplotlib; type once: {to_install('matplotlib')}"
        ) from None
    return figures


def _as_html(result: Result) -> str:
    """A result's figure as an image in HTML; nothing where there is no matplotlib."""
    try:
        figure = result.plot()
    except SpecError:
        return ""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=80)
    return f'<img src="data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}">'


def _player(result: Result) -> str:
    """A result's sound, its first two channels, to be played in HTML; nothing where it has none."""
    play = results_of(result.sensor).sound
    if play is None:
        return ""
    from scipy.io import wavfile

    samples, rate = play(result.sensor, result.found)
    sound = io.BytesIO()
    channels = samples.reshape(len(samples), -1)[:, :2]
    wavfile.write(sound, round(rate), channels.astype(np.float32))
    coded = base64.b64encode(sound.getvalue()).decode()
    return f'<br><audio controls src="data:audio/wav;base64,{coded}"></audio>'


class PointCloud(Result):
    """The returns of a scan.

    ``found`` is a ``Cloud``: its arrays have their shapes and units there.
    """

    found: Cloud

    def __len__(self) -> int:
        return len(self.found)

    @property
    def points(self) -> np.ndarray:
        """(P, 3) metres, in Blender's coordinates, without the scene's offset."""
        return self.found.position

    @property
    def labels(self) -> dict[str, np.ndarray]:
        """(P,) each: tree, species, leaf and object, -1 where there is none; organ, 0 other, 1 wood, 2
        leaf, 3 ground.
        """
        returns = self.found.returns
        named = {name: getattr(returns, name) for name in ("tree", "species", "leaf", "organ")}
        return named | {"object": returns.instance}

    @property
    def motion(self) -> dict[str, np.ndarray]:
        """Motion of what was met, (P, 3) each: ``velocity``, m/s, and ``rest``, metres, where that point is
        when the scene stands as at the present frame; empty for a still scene."""
        scanned = self.found
        if scanned.velocity is None or scanned.rest is None:
            return {}
        return {"velocity": scanned.velocity, "rest": scanned.rest}

    @property
    def endings(self) -> tuple[str, ...]:
        return (*ENDINGS, BAG)

    def _write(self, path: Path, ending: str) -> None:
        if ending == BAG:
            from ..results.bag import write_scan_bag

            write_scan_bag(path, self.sensor, self.found, self.way)
        else:
            write_points(path, self.found, self.offset)


LAYER, BRANCH = 0.1, 1.0  # m, of height; wider than the stem, which is a crown
NARROW, CLEAR = 1.3, 11  # m, and number of the first layer that may be above what grows at the foot


def crowns(
    points: np.ndarray, tree: np.ndarray, trees: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Measure trees in labelled points, of one scan or of several that are joined.

    points : (P, 3) metres. tree : (P,) the tree of each, as ``labels`` has it. trees : which trees to
    measure, with their feet and stems, as ``World.trees``.

    Returns (N,) each: ``tree``; ``height_m``, of the highest point above the foot, or that of 99.9 % of the
    points where the highest is more than a metre above; ``crown_base_m``, the lowest layer of 0.1 m that is
    wider than the stem by a metre, above the lowest narrow one; ``crown_diameter_m``, the mean of the largest
    width above the base and of the longest chord across it; ``points``. NaN where a tree has fewer than four
    points, or they lie in a line. These are the measures of Weiser et al. (2022), of a convex outline.

    Raises
    ------
    SpecError : points that are none, or not one label for each; trees without these columns.

    >>> import numpy as np
    >>> from forest_addon import api as forest
    >>> one = {"tree": [4], "x_m": [0.0], "y_m": [0.0], "z_m": [1.0], "dbh_m": [0.2]}
    >>> corners = np.array([(-3, 0, 5), (3, 0, 5), (0, 2, 5), (0, -2, 5), (0, 0, 8)])
    >>> found = forest.crowns(corners, np.full(5, 4), one)
    >>> [round(float(found[key][0]), 2) for key in ("height_m", "crown_base_m", "crown_diameter_m")]
    [7.0, 4.05, 5.0]
    """
    points, tree = points_of("points", points), np.asarray(tree)
    if tree.shape != (len(points),):
        raise SpecError("tree", f"takes a label for each of {len(points):,} points")
    try:
        columns = [np.atleast_1d(trees[name]) for name in ("x_m", "y_m", "z_m", "dbh_m", "tree")]
        foot, stems = np.column_stack(columns[:3]), np.column_stack(columns)[:, 3]
    except (KeyError, TypeError, IndexError, ValueError):
        said = "takes columns tree, x_m, y_m, z_m and dbh_m of one length, as World.trees"
        raise SpecError("trees", said) from None
    order = np.argsort(tree, kind="stable")
    first, stop = (np.searchsorted(tree[order], columns[-1], side) for side in ("left", "right"))
    rows = [
        _crown(points[order[a:b]] - place, stem)
        for a, b, place, stem in zip(first, stop, foot, stems, strict=True)
    ]
    height, base, diameter = np.reshape(rows, (-1, 3)).T
    return {
        "tree": columns[-1],
        "height_m": height,
        "crown_base_m": base,
        "crown_diameter_m": diameter,
        "points": stop - first,
    }


def _crown(points: np.ndarray, stem: float) -> tuple[float, float, float]:
    """Height, base and diameter, m, of the crown in points (P, 3) from the foot of a tree."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 4:
        return np.nan, np.nan, np.nan
    points = points[np.argsort(points[:, 2])]
    height, flat = points[:, 2], points[:, :2]
    most = float(np.quantile(height, 0.999))
    top = float(height[-1]) if height[-1] <= most + 1.0 else most
    layer = np.maximum(height / LAYER, 0).astype(int)
    number, begin, many = np.unique(layer, return_index=True, return_counts=True)
    side = np.pi * np.arange(36) / 36
    across = flat @ np.stack([np.cos(side), np.sin(side)])
    spans = np.maximum.reduceat(across, begin) - np.minimum.reduceat(across, begin)
    wide = np.bincount(number, spans.max(axis=1) * (many > 2), number[-1] + CLEAR + 2)
    clear = CLEAR + int(np.argmax(wide[CLEAR:] <= NARROW))
    broad = np.flatnonzero((wide[1:] >= BRANCH + stem) & (wide[1:] > wide[:-1])) + 1
    base = float(next(iter((broad[broad > clear] + 0.5) * LAYER), 0.0))
    crown = flat[height >= base] if (height >= base).sum() > 3 else flat
    try:
        ring = crown[ConvexHull(crown).vertices]
    except QhullError:
        return top, base, np.nan
    apart = np.linalg.norm(ring[:, None] - ring, axis=2)
    one, other = np.sort(np.unravel_index(apart.argmax(), apart.shape))
    x, y = (ring[other] - ring[one]) / apart.max()
    along = ring @ np.array([[x, -y], [y, x]])
    halves = along[one : other + 1], np.concatenate([along[other:], along[: one + 1]])[::-1]
    ends = [np.interp(along[:, 0], *half.T) for half in halves]
    return top, base, float(apart.max() + np.abs(ends[1] - ends[0]).max()) / 2


class RowScan(Result):
    """The matrix of a tractor's scan; ``found`` is a ``TractorScan``."""

    found: TractorScan

    @property
    def matrix(self) -> np.ndarray:
        """(N, M) metres, scans by angles; ``inf`` or the escape value where a beam met nothing."""
        return self.found.matrix

    @property
    def cloud(self) -> PointCloud:
        """The beams that met something, as points."""
        made = to_cloud(self.found, self.sensor)
        return PointCloud(self.sensor, made, self.seconds, self.audit, self.offset)

    def _write(self, path: Path, ending: str) -> None:
        if ending == ".npz":  # the matrix, as a run writes it
            record = results_of(self.sensor)
            write_npz(path, record.arrays(self.found), dict(record.units))  # type: ignore[misc]
        else:
            self.cloud.save(path)


class Echoes(Result):
    """The echo of a ping (``found`` is an ``Echo``), or of a flight (a ``PingSeries``)."""

    found: Echo | PingSeries

    @property
    def pings(self) -> tuple[Echo, ...]:
        """The echoes, one a pose."""
        return getattr(self.found, "echoes", (self.found,))

    @property
    def time(self) -> np.ndarray:
        """(N,) seconds after the call, of the longest record."""
        return self.found.time

    @property
    def waveforms(self) -> np.ndarray:
        """(P, E, N) echoes of the call by pose and ear, re the call at 1 m."""
        return PingSeries(self.pings).stacked("waveforms")

    @property
    def received(self) -> dict[str, np.ndarray]:
        """Pings as the sonar's receiver heard them, as its file holds it: ``recorded`` (P, E, N) Pa,
        ``noise_level`` and ``snr_db`` (P, E), ``range`` (R,) m, ``range_snr_db`` (P, E, R), and detections by
        ``detection_ping``, ``detection_ear``, ``detection_time`` s and ``detection_snr_db``; empty without a
        receiver."""
        return received_arrays(PingSeries(self.pings))

    @property
    def motion(self) -> dict[str, np.ndarray]:
        """Motion of what each ping heard, the loudest first: ``pose`` (M,) the ping's
        number, ``position`` (M, 3) m and ``velocity`` (M, 3) m/s at its time, and ``rest`` (M, 3) m, where
        each is as the scene stands still; empty for a still scene."""
        columns = heard_columns(self.found)
        names = ("pose", "position", "velocity", "rest")
        return {name: columns[name] for name in names} if "rest" in columns else {}


class Response(Result):
    """Impulse responses, a channel for each pair of source and receiver; ``found`` is the first."""

    found: ImpulseResponse

    @property
    def samples(self) -> np.ndarray:
        """(N,) of one channel, or (N, C), re the source's impulse at 1 m."""
        return channels_of(self.found)

    @property
    def sample_rate(self) -> float:
        """Hz."""
        return self.found.sample_rate

    @property
    def metrics(self) -> RoomMetrics:
        """Room measures of the first channel, by band."""
        return room_metrics(self.found.samples, self.found.sample_rate, self.found.left_db)


CLASSES: Mapping[str, Callable[..., Result]] = {  # of kinds whose results have arrays with names
    "tractor": RowScan,
    "terrestrial": PointCloud,
    "mobile": PointCloud,
    "airborne": PointCloud,
    "sonar": Echoes,
    "reverb": Response,
}


def is_scanner(sensor: Sensor) -> bool:
    """Return whether these are settings of a sensor whose points go to a file chunk by chunk."""
    return CLASSES.get(getattr(sensor, "kind", "")) is PointCloud
