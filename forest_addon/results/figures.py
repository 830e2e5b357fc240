"""The figures of a result in words: each once, for the report, run.json and Blender's panel.

A forest or what a sensor found goes in, ``Figure``s come out. The report shows those with a ``name``, the
narrow panel those with a ``short`` one, which translators know; the value is the same in both. A figure
that one of them says elsewhere, in a sentence or a note, has no name for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.trimesh import DEAD, GROUND, LEAF, WOOD
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.tractor import TractorScan
from ..sensing.reverb.metrics import room_metrics
from ..sensing.reverb.model_error import ModelError
from ..sensing.reverb.response import ImpulseResponse
from ..sensing.reverb.terms import terms_of
from ..sensing.sonar.flight import Flight
from ..sensing.sonar.ping import Echo
from ..spec import Reverb, Scanner, Sensor
from ..stand.forest import Forest

Finding = TractorScan | Cloud | Echo | Flight | ImpulseResponse
SHOWN_CHANNELS = 8  # whose names are listed


@dataclass(frozen=True)
class Figure:
    """One figure: its names, and its value.

    pattern, values : the value, of which the pattern can be translated; numbers and their units are filled
    in already and have no pattern.
    """

    name: str
    short: str
    text: str
    pattern: str = ""
    values: Mapping[str, float | str] = field(default_factory=dict)


def numbers(name: str, short: str, text: str) -> Figure:
    """A figure that reads the same in every language: numbers, their units, a name."""
    return Figure(name, short, text)


def words(name: str, short: str, pattern: str, /, **values: float | str) -> Figure:
    """A figure that is said in words: a pattern of ``str.format`` and what fills it."""
    return Figure(name, short, pattern.format(**values) if values else pattern, pattern, values)


def facts(figures: Sequence[Figure]) -> dict[str, str]:
    """What the report shows of figures."""
    return {each.name: each.text for each in figures if each.name}


def figures_of(sensor: Sensor, found: Finding, trunks: int | None = None) -> list[Figure]:
    """The figures of what a sensor found; of a flight those of its loudest ping.

    trunks : how many were cut from the scene for a reverb, if that is known.
    """
    if isinstance(found, TractorScan):
        return _of_scan(found)
    if isinstance(found, Cloud):
        return _of_cloud(sensor, found)
    if isinstance(found, Echo):
        return _of_echo(found)
    if isinstance(found, Flight):
        pings = numbers("", "Pings", f"{len(found):,}")
        return [pings, *_of_echo(loudest(found), found.echoes)]
    of_model = _of_model(sensor) if isinstance(sensor, Reverb) else []
    return [*_of_response(found, trunks), *of_model]


def of_forest(forest: Forest) -> list[Figure]:
    """Trees, leaves and triangles of a forest."""
    stand = forest.stand
    variants = [forest.variant_of(tree) for tree in range(len(stand))]
    triangles = sum(len(tree.mesh.triangles) for tree in variants)
    unique = sum(len(tree.mesh.triangles) for tree in forest.variants.values())
    leaves = sum(len(tree.leaves) for tree in variants)
    density = float(stand.density().sum() * 1e4)
    found = [numbers("trees", "Trees", f"{len(stand):,}")]
    found += [
        numbers(label, label.title(), f"{count:,}")
        for label, count in zip(forest.labels, stand.counts(), strict=True)
    ]
    found += [
        numbers("leaves", "Leaves", f"{leaves:,}"),
        words(
            *("triangles", "Triangles", "{shown:,} ({unique:,} of them unique)"),
            shown=triangles,
            unique=unique,
        ),
        words("density", "Density", "{density:,.0f} trees/ha", density=density),
    ]
    if stand.removed:
        found.append(words("", "Too Close", "{count:,} taken away", count=int(stand.removed)))
    if stand.off_ground.any():
        lost = int(stand.off_ground.sum())
        found.append(words("", "No Ground", "{count:,} left out", count=lost))
    return found


def loudest(flight: Flight) -> Echo:
    """The ping of a flight whose echo has the highest peak."""
    return max(flight.echoes, key=lambda echo: float(echo.envelope.max(initial=0.0)))


def strongest(echo: Echo) -> tuple[float, float] | None:
    """How far away the loudest echo comes from, m, and its level, dB re call at 1 m; None: silence."""
    if not np.any(echo.envelope):
        return None
    peak = int(np.argmax(echo.envelope))
    distance = float(echo.time[peak] * echo.sound_speed / 2)
    return distance, float(20 * np.log10(echo.envelope[peak]))


def _of_scan(scan: TractorScan) -> list[Figure]:
    organ = scan.organ
    return [
        numbers("beams", "Beams", f"{organ.size:,}"),
        numbers("", "Points", f"{int(np.count_nonzero(organ >= 0)):,}"),
        *_organs(organ),
        numbers("escaped", "Sky", _share(organ < 0)),
        numbers("", "Rays By", scan.engine),
    ]


def _of_cloud(sensor: Sensor, cloud: Cloud) -> list[Figure]:
    tree, organ = cloud.returns.tree, cloud.returns.organ
    found = [
        numbers("", "Beams", f"{cloud.pulses:,}"),
        numbers("points", "Points", f"{len(organ):,}"),
        numbers("trees seen", "Trees Seen", f"{len(np.unique(tree[tree >= 0]))}"),
        *_organs(organ),
    ]
    if isinstance(sensor, Scanner) and sensor.beam.max_returns > 1:
        found.append(numbers("of several returns", "Several Returns", _share(cloud.count > 1)))
    if cloud.lost:
        lost = "; ".join(map(str, cloud.lost))
        found.append(numbers("not measured, by a fault of this program", "Not Measured", lost))
    return [*found, numbers("", "Rays By", cloud.engine)]


def _organs(organ: np.ndarray) -> Iterator[Figure]:
    yield numbers("wood", "Wood", _share(organ == WOOD))
    yield numbers("leaves", "Leaves", _share(organ == LEAF))
    yield numbers("ground", "Ground", _share(organ == GROUND))
    if (organ == DEAD).any():
        yield numbers("dead wood", "Dead Wood", _share(organ == DEAD))


def _share(mask: np.ndarray) -> str:
    return f"{100 * float(np.mean(mask)):.1f} %" if mask.size else "0 %"


def _of_echo(echo: Echo, echoes: Sequence[Echo] = ()) -> list[Figure]:
    """Figures of an echo; its error is the largest of all ``echoes`` that it stands for."""
    heard = {kind: int(np.count_nonzero(echo.heard.kind == kind)) for kind in ("wood", "facet")}
    found = [
        numbers("leaves in the scene", "Leaves", f"{echo.leaves:,}"),
        numbers("leaves heard", "Leaves Heard", f"{echo.leaves_heard:,}"),
        numbers("pieces of wood heard", "Wood Heard", f"{heard['wood']:,}"),
        numbers("glints and rims heard", "Glints Heard", f"{heard['facet']:,}"),
        numbers("hidden by wood", "Behind Wood", f"{echo.hidden:,}"),
    ]
    peak = strongest(echo)
    if peak is None:
        found.append(words("strongest echo from", "", "nothing"))
        found.append(words("level", "Level", "silence"))
    else:
        found.append(numbers("strongest echo from", "Strongest", f"{peak[0]:.2f} m"))
        found.append(words("level", "Level", "{level:.1f} dB re call at 1 m", level=peak[1]))
    some = (
        ("later than the record", "Too Late", echo.late),
        ("leaves nearer than ka²/2", "Near Leaves", echo.close),
        ("discs of ka > 120 beyond 60°", "Doubtful Discs", echo.doubtful),
    )
    found += [numbers(name, short, f"{count:,}") for name, short, count in some if count]
    most = max(each.error_bound + each.table_error for each in (echo, *echoes))
    found.append(
        words(
            "error of the sum at most", "Error At Most", "{share:.1e} of all amplitudes", share=most
        )
    )
    return found


def _of_response(response: ImpulseResponse, trunks: int | None) -> list[Figure]:
    """Measures are those of the first channel."""
    channels = response.channels
    listed = ", ".join(channel.channel for channel in channels[:SHOWN_CHANNELS])
    if len(channels) > SHOWN_CHANNELS:
        listed += f" and {len(channels) - SHOWN_CHANNELS} more"
    measured = room_metrics(response.samples, response.sample_rate, response.left_db)
    seconds, clarity = measured.t30[0], measured.c50[0]
    found = [numbers("channels", "", listed)]
    if trunks is not None:
        found.append(numbers("trunks cut from the scene", "", f"{trunks:,}"))
    return [
        *found,
        numbers("trunks heard", "Trunks Heard", f"{response.trunks:,}"),
        numbers("trunks beyond the field", "Beyond Field", f"{response.continued:,}"),
        numbers("trunks after the record's end", "Too Late", f"{response.late:,}"),
        numbers("reverberation time", "Reverb Time", f"{seconds:.2f} s")
        if np.isfinite(seconds)
        else words("reverberation time", "Reverb Time", "not reached"),
        numbers("reverberation time by octave", "", _octaves(measured.band, measured.t30, "s", 2)),
        numbers("C50", "Clarity C50", f"{clarity:.1f} dB")
        if np.isfinite(clarity)
        else words("C50", "Clarity C50", "no late sound"),
        numbers("C50 by octave", "", _octaves(measured.band, measured.c50, "dB", 1)),
        _passing("direct path", "Direct Path", [channel.direct_clear for channel in channels]),
        _passing("ground path", "Ground Path", [channel.ground_clear for channel in channels]),
        *_multiple_scattering(response.model_error),
    ]


def _of_model(sensor: Reverb) -> list[Figure]:
    """What is in the model, and what is not."""
    held, missing = terms_of(sensor)
    name = {"paper": "single scattering (Kaneko & Gamper 2021)", "forest": "forest"}[sensor.model]
    return [
        numbers("model", "", name),
        numbers("in the model", "", "; ".join(held)),
        numbers("not in the model", "", "; ".join(missing)),
    ]


def _octaves(band: np.ndarray, value: np.ndarray, unit: str, digits: int) -> str:
    """Octaves with their values; those without are left out."""
    shown = [
        f"{middle:g} Hz {number:.{digits}f} {unit}"
        for middle, number in zip(band[1:], value[1:], strict=True)
        if np.isfinite(number)
    ]
    return ", ".join(shown) or "not reached"


def _passing(name: str, short: str, clear: Sequence[bool]) -> Figure:
    """Whether a path is clear, for one channel or several."""
    free = sum(clear)
    if free == len(clear):
        return words(name, short, "clear")
    if not free:
        return words(name, short, "blocked by wood")
    count = len(clear)
    return words(
        name, short, "blocked by wood in {blocked} of {count}", blocked=count - free, count=count
    )


def _multiple_scattering(found: ModelError | None) -> Iterator[Figure]:
    """What single scattering leaves out, if it was measured and there was something to measure."""
    if found is not None and len(found.frequency):
        yield numbers(
            "error of single scattering",
            "",
            f"{100 * found.relative:.0f} % (L2), {found.level_db:+.1f} dB against exact multiple "
            f"scattering by the {len(found.trunks)} trunks with the shortest paths, line source in the "
            f"plane, {found.frequency[0]:.0f} to {found.frequency[-1]:.0f} Hz",
        )
