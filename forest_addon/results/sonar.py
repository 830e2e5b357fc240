"""Record of what a sonar gives: the echo of a ping, or of one from every pose of its route."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.words import keep
from ..drawing.strips import Plot, sound_plot
from ..formats.table import write_csv
from ..sensing.kind import Seen
from ..sensing.sonar.echo import Echo, PingSeries
from ..spec import Sonar, SonarReceiver
from .echo_files import (
    received_arrays,
    recorded_unit,
    sound_of,
    write_echo,
    write_echo_arrays,
    write_echo_sound,
)
from .kind import Figure, Finding, ResultKind, Variables, numbers, sound_columns, words

if TYPE_CHECKING:
    from ..sensing.sonar.receiver import Reception

REFERENCE = 20e-6  # Pa, of levels of pressure


def _echoes(found: Finding) -> tuple[Echo, ...]:
    """Return the echoes of a flight, or the only one."""
    return getattr(found, "echoes", (found,))


def _is_flight(found: Finding) -> bool:
    return hasattr(found, "echoes")


def loudest(flight: PingSeries) -> Echo:
    """The ping of a flight whose echo has the highest peak."""
    return max(flight.echoes, key=lambda echo: float(echo.envelope.max(initial=0.0)))


def strongest(echo: Echo) -> tuple[float, float] | None:
    """Distance of the loudest echo, m, and its level, dB re call at 1 m; None: silence."""
    if not np.any(echo.envelope):
        return None
    peak = int(np.argmax(echo.envelope))
    distance = float(echo.time[peak] * echo.sound_speed / 2)
    return distance, float(20 * np.log10(echo.envelope[peak]))


def _figures(sonar: Sonar, found: Finding, _seen: Seen | None) -> list[Figure]:
    """Return the figures of an echo, of a flight those of its loudest ping."""
    if not _is_flight(found):
        return _of_echo(sonar, found)
    return [numbers("", "Pings", f"{len(found):,}"), *_of_echo(sonar, loudest(found), found.echoes)]


def _of_echo(sonar: Sonar, echo: Echo, echoes: Sequence[Echo] = ()) -> list[Figure]:
    """Figures of an echo; its error is the largest of all ``echoes`` that it stands for."""
    heard = {kind: int(np.count_nonzero(echo.heard.kind == kind)) for kind in ("wood", "facet")}
    figures = [
        numbers("leaves in the scene", "Leaves", f"{echo.leaves:,}"),
        numbers("leaves heard", "Leaves Heard", f"{echo.leaves_heard:,}"),
        numbers("pieces of wood heard", "Wood Heard", f"{heard['wood']:,}"),
        numbers("glints and rims heard", "Glints Heard", f"{heard['facet']:,}"),
        numbers("hidden by wood", "Behind Wood", f"{echo.hidden:,}"),
    ]
    figures += _of_motion(echo)
    peak = strongest(echo)
    if peak is None:
        figures.append(words("strongest echo from", "", "nothing"))
        figures.append(words("level", "Level", "silence"))
    else:
        figures.append(numbers("strongest echo from", "Strongest", f"{peak[0]:.2f} m"))
        figures.append(words("level", "Level", "{level:.1f} dB re call at 1 m", level=peak[1]))
    some = (
        ("later than the record", "Too Late", echo.late),
        ("leaves nearer than ka²/2", "Near Leaves", echo.close),
        ("discs of ka > 120 beyond 60°", "Doubtful Discs", echo.doubtful),
    )
    figures += [numbers(name, short, f"{count:,}") for name, short, count in some if count]
    figures += _of_receiver(sonar.receiver, echo.received)
    most = max(each.error_bound + each.table_error for each in (echo, *echoes))
    figures += [
        words("error of the sum at most", "", "{share:.1e} of all amplitudes", share=most),
        numbers("", "Error at Most", f"{100 * most:.2g} %"),
    ]
    return figures


def _of_receiver(receiver: SonarReceiver | None, received: Reception | None) -> list[Figure]:
    """Figures of what a receiver made of an echo; none without one."""
    if receiver is None or received is None:
        return []
    figures = []
    if receiver.noisy:
        level = 20 * np.log10(received.noise_level / REFERENCE)
        figures.append(numbers("noise in the band", "Noise", f"{level.max():.1f} dB re 20 µPa"))
        over = float(received.snr_db.max())
        said = f"{over:.1f} dB" if np.isfinite(over) else "no echo"
        figures.append(numbers("peak of the echo over the noise", "Over Noise", said))
        above = received.range[(received.range_snr_db >= 0.0).any(axis=0)]
        if len(above):
            far = f"{above.max():.1f} m"
            figures.append(numbers("echo above the noise up to", "Above Noise", far))
    if receiver.threshold_db is not None:
        figures.append(numbers("detections", "Detections", f"{len(received.detection_ear):,}"))
    if received.clipped:
        figures.append(numbers("samples that were clipped", "Clipped", f"{received.clipped:,}"))
    return figures


def _of_motion(echo: Echo) -> list[Figure]:
    """Figures of a ping in a scene that moves: how much of what is heard does, and how fast; none of a still
    one."""
    velocity = echo.heard.velocity
    if velocity is None or not len(velocity):
        return []
    speed, loud = np.linalg.norm(velocity, axis=1), echo.heard.amplitude
    moving = float(loud[speed > 0].sum() / max(loud.sum(), 1e-300))
    figures = [numbers("of all amplitudes, by what moves", "Heard Moving", f"{moving:.1%}")]
    if not speed.any():
        return figures
    mean = float((loud @ speed) / loud.sum())
    said = f"{mean:.2g} m/s (mean by amplitude), at most {speed.max():.2g} m/s"
    return [*figures, numbers("speed of what is heard", "Speed Heard", said)]


def _sentence(found: Finding) -> str:
    if _is_flight(found):
        return keep(
            "{count:,} pings, the loudest: {found}",
            count=len(found),
            found=_sentence(loudest(found)),
        )
    peak = strongest(found)
    if peak is None:
        return keep("silence: nothing in the beam")
    if not found.leaves_heard:
        return keep("strongest echo from {distance:.2f} m", distance=peak[0])
    return keep("{count:,} leaves heard", count=found.leaves_heard)


def _story(sonar: Sonar, found: Finding) -> str:
    if _is_flight(found):
        return f"{len(found)} pings of {_call_in_words(sonar)}; what follows is of the loudest."
    return f"One ping of {_call_in_words(sonar)}."


def _call_in_words(sonar: Sonar) -> str:
    beam = {"horseshoe": "a horseshoe bat's", "file": "a measured", "omni": "an even"}
    model = {"piston": "hard discs (physical optics)", "paper": "the fit of Tanveer et al. 2020a"}
    return (
        f"{sonar.band[0] / 1e3:g} to {sonar.band[1] / 1e3:g} kHz with "
        f"{beam.get(sonar.beam, f'a {sonar.beam_width_deg[0]:g}°')} beam, at {sonar.ears} "
        f"ear{'s' if sonar.ears > 1 else ''}; leaves scatter as "
        f"{model.get(sonar.leaf_model, 'hard discs (exact)')}"
    )


def _notes(sonar: Sonar, found: Finding) -> tuple[str, ...]:
    return tuple(_echo_notes(sonar, _echoes(found)))


def _doubts(sonar: Sonar, found: Finding) -> tuple[str, ...]:
    """Return that a tolerance was not reached, and what to do, and that leaves are too dense."""
    return (*_doubts_about_sum(sonar, found), *_doubts_about_density(found))


def _doubts_about_density(found: Finding) -> tuple[str, ...]:
    """Return that leaves near the beam's axis are too dense for echoes of single leaves."""
    from ..sensing.sonar.rescattering import DENSE, LEAVES, density_of, nearest_leaves

    leaves = nearest_leaves((loudest(found) if _is_flight(found) else found).groups)
    if leaves is None or len(leaves) < LEAVES or density_of(leaves) < DENSE:
        return ()
    return (
        f"leaves near the beam's axis are dense, {density_of(leaves):.0f} m² a m³: echoes from leaf to leaf, "
        "which are left out, change the waveform by a third or more, its mean energy by 1 to 2 dB. Trust the "
        "energy and its spread rather than single peaks.",
    )


def _doubts_about_sum(sonar: Sonar, found: Finding) -> tuple[str, ...]:
    """Silent where the sum has at most two thirds of all bounds, with what is left out as too weak and the
    tables: then a finer sum makes the result no surer. The notes give all three."""
    echoes = _echoes(found)
    error = max(echo.error_bound for echo in echoes)
    others = max(echo.cull_bound + echo.table_error for echo in echoes)
    if not error > max(sonar.tolerance, 2.0 * others) or not sonar.tolerance:
        return ()
    enough = 10.0 ** np.ceil(np.log10(error))
    return (
        f"the sum may be {error:.1e} of all amplitudes off, where {sonar.tolerance:.0e} was asked for: what "
        f"is looked up is not smooth enough. Set tolerance to {enough:.0e}, or to 0 for the direct sum.",
    )


def _echo_notes(sonar: Sonar, echoes: Sequence[Echo]) -> Iterator[str]:
    bound, error, table = (
        max(getattr(echo, name) for echo in echoes)
        for name in ("cull_bound", "error_bound", "table_error")
    )
    kind = "Fast sum" if sonar.tolerance else "Direct sum over every scatterer and frequency"
    summed = f"{kind}, error at most {error:.1e} of all amplitudes"
    if error > sonar.tolerance > 0:
        summed += f" ({sonar.tolerance:.0e} was asked for)"
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
    receiver = sonar.receiver
    if receiver is not None and receiver.ambient != "none":
        sources = {
            "wind": "wind in vegetation by Boersma 1997, measured over grassland up to 20 kHz",
            "insects": "insects of a tropical night by Schmidt & Römer 2011, up to 80 kHz",
            "rain": "rain at the level that is given, up to 20 kHz",
        }
        yield (
            f"Noise of {sources[receiver.ambient]}; above, 6 dB less an octave is an assumption."
        )
    yield f"{summed}; what is left out as too weak adds at most {bound:.1e} of them."
    yield shade.get(sonar.shading, both)


def _columns(found: Finding) -> dict[str, list[Any]]:
    """Time and channels of a sound; of a flight one ping after the other."""
    rate = float(_echoes(found)[0].sample_rate)
    if not _is_flight(found):
        return sound_columns(found.heard_waveforms, rate)
    stacked = found.stacked("heard_waveforms")
    return sound_columns(np.moveaxis(stacked, 1, 0).reshape(stacked.shape[1], -1), rate)


def _plot(_sonar: Sonar, found: Finding) -> Plot:
    if _is_flight(found):
        pings = found.stacked("heard_waveforms")[:, 0].ravel()
        return sound_plot(pings, found.echoes[0].sample_rate)
    return sound_plot(found.heard_waveforms[0], found.sample_rate)


def _labelled(found: Finding) -> tuple[Variables, Variables]:
    pings, dims = PingSeries(_echoes(found)), ("ping", "ear", "time")
    unit = "re the call at 1 m"
    place, _ = pings.poses()
    received: Variables = {}
    if made := received_arrays(pings):
        received = {
            "recorded": (dims, made["recorded"], recorded_unit(made)),
            "noise_level": (dims[:2], made["noise_level"], recorded_unit(made)),
            "snr_db": (dims[:2], made["snr_db"], "dB"),
        }
    return {
        "waveform": (dims, pings.stacked("waveforms"), unit),
        "envelope": (dims, pings.stacked("envelopes"), unit),
        **received,
    }, {
        "time": (("time",), pings.time, "s"),
        **{name: (("ping",), place[:, k], "m") for k, name in enumerate("xyz")},
    }


SONAR = ResultKind(
    figures=_figures,
    labelled=_labelled,
    sentence=_sentence,
    story=_story,
    notes=_notes,
    doubts=_doubts,
    files=(".npz", ".wav", "-heard.npz"),
    write=write_echo,
    saves={
        ".wav": lambda path, sonar, found, *_: write_echo_sound(path, found, sonar.time_expansion),
        ".npz": lambda path, _sonar, found, offset, _labels: write_echo_arrays(path, found, offset),
        ".csv": lambda path, _sonar, found, *_: write_csv(path, _columns(found)),
    },
    plot=_plot,
    marks=lambda found: None if _is_flight(found) else found.heard,
    sound=lambda sonar, found: sound_of(found, sonar.time_expansion),
)
