"""What is left to "auto": tolerances as fine as a sensor and its model can tell apart, and no finer.

A finer sum than the model of a leaf, or than what is cut off the end of a record, costs time and makes
nothing truer. Each choice comes with a bound on what it may be off by and with its reason; the report and
run.json hold both.
"""

from __future__ import annotations

from typing import TypeVar

from ..spec import AUTO, Choice, Reverb, Settings, Sonar
from .reverb.response import ImpulseResponse

S = TypeVar("S", bound=Settings)

TABLE = 1e-5  # of its value straight on, that the exact disc is looked up within
FORMULA = 1e-4  # far below the per cents that physical optics and the paper's fit are off by
CULLED = 10.0  # times the tolerance: what is left out is known by a bound far above the truth
FINEST = 1e-6  # tolerance that the reverb's fast sum keeps
END = 10 ** (-75 / 20)  # a record ends where that is left of it


def choose(sensor: S) -> tuple[S, tuple[Choice, ...]]:
    """A sensor with nothing left to "auto", and what was chosen."""
    made: tuple[Choice, ...] = ()
    if isinstance(sensor, Sonar):
        made = _of_sonar(sensor)
    elif isinstance(sensor, Reverb) and sensor.tolerance == AUTO:
        why = "of the whole; the record ends where so much is left of it"
        made = (Choice("tolerance", END, END, why),)
    elif isinstance(sensor, Reverb) and 0 < sensor.tolerance < FINEST:
        why = f"by the direct sum over every trunk and frequency; the fast one ends at {FINEST:.0e}"
        asked = sensor.tolerance
        made = (Choice("tolerance", asked, asked, why, asked),)
    return sensor.changed(**{choice.key: choice.value for choice in made}), made


def left_out(found: object) -> tuple[Choice, ...]:
    """What a response left out as too weak."""
    if not isinstance(found, ImpulseResponse) or not found.weak:
        return ()
    why = (
        f"of any octave: {found.weak:,} trunks are left out that add less than the end of a record, "
        "75 dB down, were they all in phase"
    )
    return (Choice("weakest trunks", END, found.weak_bound, why),)


def _of_sonar(sonar: Sonar) -> tuple[Choice, ...]:
    model, fine = f'the "{sonar.leaf_model}" leaf', FORMULA
    if sonar.leaf_model == "exact":
        model, fine = "the exact disc's table", TABLE
    why = f"of all amplitudes; {model} is no truer"
    made = []
    if sonar.tolerance == AUTO:
        made.append(Choice("tolerance", fine, fine, why))
    if sonar.cull == AUTO:
        value = CULLED * (fine if sonar.tolerance == AUTO else max(sonar.tolerance, fine))
        made.append(Choice("cull", value, value, why))
    return tuple(made)
