"""Findings of each stage of a run: sentences, figures (``results/figures``), and notes about accuracy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from forest_addon.results.figures import facts, figures_of, of_forest
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.lidar.tractor import TractorScan
from forest_addon.sensing.reverb.response import ImpulseResponse
from forest_addon.sensing.reverb.trunks.slices import Trunks
from forest_addon.sensing.sonar.flight import Flight
from forest_addon.sensing.sonar.ping import Echo
from forest_addon.spec import Reverb, Scanner, Scene, Sonar, Terrestrial, Tractor
from forest_addon.stand.forest import Forest
from forest_addon.stand.targets import Met, facts_of, sentences

from .page import Finding

if TYPE_CHECKING:  # its estimates bring scipy.optimize
    from forest_addon.stand.statistics.goodness import Goodness


def forest_finding(settings: Scene, forest: Forest, picture: Path | None) -> Finding:
    """Trees, leaves and triangles of the forest, and where its trees stand."""
    kinds = {planting.layout for planting in settings.plantings}
    what = {frozenset({"rows"}): "An orchard", frozenset({"list"}): "A forest from a list of trees"}
    return Finding(
        "Forest",
        f"{what.get(frozenset(kinds), 'An inhomogeneous Poisson forest')} on "
        f"{settings.forest.size[0]:g} by {settings.forest.size[1]:g} m, grown from L-systems and STL "
        "branch templates.",
        facts(of_forest(forest)),
        tuple(_stand_notes(settings, forest)),
        picture,
    )


def _stand_notes(settings: Scene, forest: Forest) -> Iterator[str]:
    """Return what was expected, what was taken away and why."""
    stand = forest.stand
    sums = [
        f"{label} {value:,.1f}" + (f" ± {error:.2g}" if error else "")
        for label, value, error in zip(forest.labels, stand.expected, stand.error, strict=True)
    ]
    if sums:
        yield f"Expected: {', '.join(sums)} trees."
    if stand.removed:
        lost = zip(forest.labels, stand.too_near, strict=True)
        rule = {"matern": "Matérn II", "greedy": "greedy removal"}[settings.forest.spacing_rule]
        yield (
            f"{stand.removed:,} trees were removed to keep their distances ({rule}): "
            + ", ".join(f"{label} {count:,}" for label, count in lost if count)
            + "."
        )
    for note in forest.notes:
        yield f"{note}."
    if stand.off_ground.any():
        yield f"{stand.off_ground.sum():,} trees were left out where the terrain has no ground."
    if stand.off_field.any():
        yield f"{stand.off_field.sum():,} places of rows or lists lie beyond the field."
    yield from forest.detail


def targets_finding(met: Sequence[Met]) -> Finding | None:
    """Return what trees were to measure and what they do; None where nobody asked."""
    if not met:
        return None
    told: dict[str, str] = {}
    notes: list[str] = []
    for one in met:
        told |= facts_of(one)
        notes += sentences(one)
    kinds = sorted({one.kind for one in met if one.kind})
    band = (
        f" The band holds nine of ten measured trees of the same diameter ({', '.join(kinds)})."
        if kinds
        else ""
    )
    return Finding(
        "What the trees were to measure",
        "Target and reached; each tree is its variant in the size at which its stem has its diameter 1.3 m "
        "up." + band,
        told,
        tuple(notes) or ("Every target is met.",),
    )


def goodness_finding(found: Goodness, picture: Path | None) -> Finding:
    """Return whether trees stand as their intensity says."""
    bands, quadrats = found.excess, found.quadrats
    return Finding(
        "Where the trees stand",
        "The inhomogeneous L function of the trees and their counts in quadrats, against "
        f"{bands.simulations} other stands of the same settings. L(r) - r is 0 for a Poisson process, below "
        "it where trees keep apart.",
        {
            "trees tested": f"{found.trees:,}",
            "L function": f"p = {bands.p_value:.3f}",
            f"quadrats ({quadrats.classes} classes)": f"p = {found.quadrat_p_value:.3f}",
        },
        (
            "Edge correction by translation, within the region where the intensity is at least a tenth of "
            "its mean over trees. The global envelope is the studentised maximum deviation at 5 %; one "
            "stand in twenty lies beyond it by chance.",
        ),
        picture,
    )


def finding_of(
    sensor: Tractor | Scanner | Sonar,
    found: TractorScan | Cloud | Echo | Flight,
    picture: Path | None,
) -> Finding:
    """Return what a sensor that needs no more than its result has to say."""
    if isinstance(found, TractorScan):
        return scan_finding(sensor, found, picture)
    if isinstance(found, Cloud):
        return cloud_finding(sensor, found, picture)
    if isinstance(found, Echo):
        return echo_finding(sensor, found, picture)
    return flight_finding(sensor, found, picture)


def scan_finding(sensor: Tractor, scan: TractorScan, picture: Path | None) -> Finding:
    """The tractor scan."""
    scans, beams = scan.organ.shape
    return Finding(
        f"Tractor LiDAR: {sensor.name}",
        f"{scans:,} scans of {beams} beams along {sensor.track:g} m (SIMLIDAR's scanner, one ray a beam).",
        facts(figures_of(sensor, scan)),
        (
            f"Rays by {scan.engine} on the evaluated depsgraph; every distance is computed again in "
            "float64 on the triangle that was hit.",
        ),
        picture,
    )


def cloud_finding(sensor: Scanner, cloud: Cloud, picture: Path | None) -> Finding:
    """A scan that gives points: from a tripod, a vehicle, an aircraft."""
    beam = sensor.beam
    spacing = f" every {sensor.angle_step_deg:g}°" if isinstance(sensor, Terrestrial) else ""
    instrument = f" by {sensor.scanner}" if sensor.scanner else ""
    return Finding(
        f"{sensor.kind.title()} LiDAR: {sensor.name}",
        f"{cloud.pulses:,} pulses{spacing}{instrument} gave {len(cloud):,} points.",
        facts(figures_of(sensor, cloud)),
        (
            "One ray a pulse."
            if beam.subrays == 1
            else f"{beam.subrays} rays of equal energy a pulse, over a Gaussian footprint.",
            "LAS coordinates are stored to 0.1 mm; labels and truth (range without noise, normal, angle "
            "of incidence) are extra bytes.",
        ),
        picture,
    )


def echo_finding(sensor: Sonar, echo: Echo, picture: Path | None) -> Finding:
    """The foliage echo."""
    return Finding(
        f"Biosonar: {sensor.name}",
        f"One ping of {_call_in_words(sensor)}.",
        facts(figures_of(sensor, echo)),
        tuple(_echo_notes(sensor, [echo])),
        picture,
    )


def flight_finding(sensor: Sonar, flight: Flight, picture: Path | None) -> Finding:
    """Echoes along a way; the facts are those of the loudest."""
    return Finding(
        f"Biosonar: {sensor.name}",
        f"{len(flight)} pings of {_call_in_words(sensor)}; what follows is of the loudest.",
        facts(figures_of(sensor, flight)),
        tuple(_echo_notes(sensor, flight.echoes)),
        picture,
    )


def _call_in_words(sensor: Sonar) -> str:
    beam = {"horseshoe": "a horseshoe bat's", "file": "a measured", "omni": "an even"}
    model = {"piston": "hard discs (physical optics)", "paper": "the fit of Tanveer et al. 2020a"}
    return (
        f"{sensor.band[0] / 1e3:g} to {sensor.band[1] / 1e3:g} kHz with "
        f"{beam.get(sensor.beam, f'a {sensor.beam_width_deg[0]:g}°')} beam, at {sensor.ears} "
        f"ear{'s' if sensor.ears > 1 else ''}; leaves scatter as "
        f"{model.get(sensor.leaf_model, 'hard discs (exact)')}"
    )


def _echo_notes(sensor: Sonar, echoes: Sequence[Echo]) -> Iterator[str]:
    bound, error, table = (
        max(getattr(echo, name) for echo in echoes)
        for name in ("cull_bound", "error_bound", "table_error")
    )
    kind = "Fast sum" if sensor.tolerance else "Direct sum over every scatterer and frequency"
    summed = f"{kind}, error at most {error:.1e} of all amplitudes"
    if error > sensor.tolerance > 0:
        summed += f" ({sensor.tolerance:.0e} was asked for: what is looked up is not smooth enough)"
    if table:
        summed += f", and {table:.1e} from the tables of discs and cylinders"
    shade = {
        "none": "Nothing shades anything, as in the paper.",
        "trunks": "Leaves do not shade each other; wood hides them as straight rays would.",
        "extinction": "Leaves weaken what lies behind them, large ones hide it; wood hides nothing.",
    }
    both = (
        "Leaves weaken what lies behind them, large ones and wood hide it as straight rays would."
    )
    yield f"{summed}; what is left out as too weak adds at most {bound:.1e} of them."
    yield shade.get(sensor.shading, both)


def reverb_finding(
    sensor: Reverb, response: ImpulseResponse, trunks: Trunks, picture: Path | None
) -> Finding:
    """The impulse response."""
    distance = float(np.linalg.norm(np.subtract(sensor.source, sensor.receiver)))
    channels = response.channels
    peak = float(np.abs([channel.samples for channel in channels]).max())
    notes = [
        (
            "Direct sum over every trunk and frequency in float64."
            if response.exact
            else f"Sum over trunks to a relative error of {sensor.tolerance:.0e}, in every octave."
        )
        + (
            " Single scattering itself is the larger error, and grows with the density of the stand"
            " (rescattering = 100 measures it)."
            if sensor.model == "paper" or sensor.tail == "none"
            else ""
        ),
        "Reverberation time is read from -5 to -35 dB of the energy decay; C50 with the onset at "
        "-20 dB.",
    ]
    notes += [
        f"From {low:g} Hz to {2 * low:g} Hz the error of the sum is {error:.0e}."
        for low, error in sorted(response.errors.items())
        if error > sensor.tolerance
    ]
    if np.isfinite(response.joint):
        notes.append(
            f"From {response.joint:.2f} s on the trunks' sound is noise with the energy of transport: "
            f"{100 * sensor.multiple_share:.0f} % of it was scattered more than once."
        )
    if response.late:
        notes.append(
            f"The record ends before the sound: {response.late:,} trunks come later, with "
            f"{response.left_db[0]:.0f} dB of the energy. Measures that this would change are left out; "
            "duration = 0 records all."
        )
    if len(channels) > 1:
        notes.append(
            f"Figures are of the first of {len(channels)} channels, {response.channel}; "
            f"{sensor.name}.npz has those of all."
        )
    if any(channel.clamped for channel in channels):
        most = max(channel.clamped for channel in channels)
        notes.append(
            f"{most} trunk(s) cover a source or a receiver; their distance is taken as their radius."
        )
    if peak > 1:
        notes.append("The sound exceeds full scale; the WAV is 32-bit float and does not clip.")
    return Finding(
        f"Forest reverb: {sensor.name}",
        f"The impulse response over {distance:.1f} m, "
        + (
            "from single scattering by trunks (Kaneko & Gamper 2021)."
            if sensor.model == "paper"
            else "from scattering by trunks with what a forest takes."
        ),
        facts(figures_of(sensor, response, len(trunks.radius))),
        tuple(notes),
        picture,
    )
