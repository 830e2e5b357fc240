"""Error for what cannot be used, in one sentence."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable

SAME = (("position", "poses", "receiver"),)  # a word, and what else its thing is called
MOST_RAYS = 10**12  # of a scan; none that is meant has as many
A_SECOND = 4e5  # rays of Embree on one core, about


class SpecError(ValueError):
    """A setting that cannot be used: ``key`` says where, the text says what and what to do."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(f"{key}: {problem}" if key else problem)
        self.key = key
        self.problem = problem

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return SpecError, (self.key, self.problem)  # ValueError's own would lose the key


def figure(value: float) -> str:
    """A number as a sentence shows it: a large whole one by its digits."""
    whole = math.isfinite(value) and value == int(value) and 1e6 <= abs(value) < 1e20
    return f"{int(value):,}" if whole else f"{value:g}"


def unknown(key: str, name: str, known: Iterable[str], besides: str = "") -> SpecError:
    """The error of a name that is none of those known: the nearest of them, then all.

    besides : what else is taken, as ", or a .toml file".
    """
    names = list(known)
    return SpecError(
        key,
        f'"{name}" is not known; {did_you_mean(name, names)}use one of {", ".join(names)}{besides}',
    )


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """'did you mean "X"? ' of another word for it or the nearest known name, or nothing where none
    is near."""
    names = list(known)
    near = [word for words in SAME if words[0] == name for word in words[1:] if word in names]
    near = near or [full for full in names if str(name).lower() in full.split("-")]  # an "oak"
    near = near or difflib.get_close_matches(str(name), names, 1)
    quoted = " or ".join(f'"{word}"' for word in near)
    return f"did you mean {quoted}? " if near else ""


def quoted_with_hints(names: Iterable[str], known: Iterable[str]) -> str:
    """Names that are not known, quoted, each with the nearest known: '"oka" (did you mean "oak"?), "x"'."""
    every = list(known)
    hints = {name: did_you_mean(name, every).rstrip() for name in names}
    return ", ".join(f'"{name}"' + (f" ({hint})" if hint else "") for name, hint in hints.items())


def refuse_absurd(key: str, pulses: float, rays: int = 1) -> None:
    """Refuse a scan of more rays than any that is meant, as a slip of the keyboard asks for.

    key : the setting that says how many pulses. rays : of a pulse.

    Raises
    ------
    SpecError : says how many pulses, and how long they take.
    """
    if not pulses * rays <= MOST_RAYS:
        each = f" of {rays:,} rays" if rays > 1 else ""
        years = pulses * rays / A_SECOND / 3.156e7
        raise SpecError(
            key,
            f"asks for {pulses:.2g} pulses{each}, some {years:,.2g} years of work; a scan has at most "
            f"{MOST_RAYS:.0e} rays, so give another",
        )


def places_in(span: float, step: float) -> float:
    """Number of places in a span, a step apart, both its ends among them."""
    return math.floor(max(span, 0.0) / step) + 1.0
