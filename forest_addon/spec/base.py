"""Parameters, each once: unit, range, default and help; groups of them that check themselves; errors.

Values are made the type that their field says, or refused in one sentence. A whole number is no text, no
truth value is a number, a group of settings is no table: nothing is guessed. What means the same is taken:
arrays and lists as tuples, numpy's numbers as Python's own, a whole number where any number may stand, a path
where a file is named.
"""

from __future__ import annotations

import dataclasses
import difflib
import inspect
import math
import os
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

SAME: dict[str, tuple[str, ...]] = {
    "position": ("poses", "receiver")
}  # a word, and what else its thing is called
CODES = {  # of inventories for a species: Latin, German, numbers of FIA, symbols of USDA
    "douglas-fir": "pseudotsuga-menziesii dgl dougl douglasie 202 psme",
    "european-ash": "fraxinus-excelsior es esche frex",
    "european-beech": "fagus-sylvatica bu rbu buche rotbuche fasy",
    "european-larch": "larix-decidua la lä elä lärche laerche larche lade2",
    "ginkgo": "ginkgo-biloba ginko 561 gibi2",
    "hazelnut": "corylus-avellana hasel haselnuss coav",
    "norway-maple": "acer-platanoides ah sah spitzahorn 320 acpl",
    "norway-spruce": "picea-abies fi fichte rotfichte 91 piab",
    "pedunculate-oak": "quercus-robur ei sei eiche stieleiche quro2",
    "ponderosa-pine": "pinus-ponderosa gelbkiefer 122 pipo",
    "scots-pine": "pinus-sylvestris ki kie kiefer waldkiefer föhre 130 pisy",
    "silver-birch": "betula-pendula bi birke sandbirke hängebirke bepe3",
    "silver-fir": "abies-alba ta tanne weißtanne weisstanne abal3",
}
SAME |= {code: (name,) for name, codes in CODES.items() for code in codes.split()}
LATIN = {codes.split()[0]: name for name, codes in CODES.items() if "-" in codes.split()[0]}
SAME |= {g[:2] + s[:2]: (name,) for (g, s), name in ((k.split("-"), v) for k, v in LATIN.items())}
FINEST_SUM = 1e-9  # of all amplitudes
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


def nearest(name: str, known: Iterable[str]) -> list[str]:
    """Known names that another word or an inventory's code stands for, else the nearest if one is near."""
    names, plain = list(known), name.strip().lower().replace(" ", "-")
    near = [word for word in SAME.get(plain, ()) if word in names]
    near = near or [full for full in names if plain in full.split("-")]  # an "oak"
    genus = plain.partition("-")[0]  # of a Latin name, another species of the same
    near = near or [full for latin, full in LATIN.items() if latin.partition("-")[0] == genus]
    return near or difflib.get_close_matches(name, names, 1)


def stands_for(name: str, known: Sequence[str]) -> str:
    """The known name that a word or a code stands for; itself where it is known, or stands for none."""
    words = name.lower().split()
    same = SAME.get("-".join(words), ()) or SAME.get("-".join(words[:2]), ())  # without its author
    return next((word for word in (name, *same) if word in known), name)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """'did you mean "X"? ' of the nearest known names, or nothing where none is near."""
    quoted = " or ".join(f'"{word}"' for word in nearest(str(name), known))
    return f"did you mean {quoted}? " if quoted else ""


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


def refuse_too_fine(tolerance: float) -> None:
    """Refuse a tolerance of a sum that float64 does not keep.

    Raises
    ------
    SpecError : it is above 0 and below 1e-9.
    """
    if 0 < tolerance < FINEST_SUM:
        raise SpecError(
            "tolerance",
            f"is finer than float64 keeps; use 0 for the exact sum, or {FINEST_SUM:g} and more",
        )


def places_in(span: float, step: float) -> float:
    """Number of places in a span, a step apart, both its ends among them."""
    return math.floor(max(span, 0.0) / step) + 1.0


MOST_BITS = 1000  # of a whole number; a float holds some more
MOST_SHOWN = 200  # characters of a value that is wrong
WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}


@cache
def types_of(cls: Any) -> dict[str, Any]:
    """The type of each field of a dataclass, by its name."""
    return typing.get_type_hints(cls)


def typed(key: str, value: Any, kind: Any) -> Any:
    """A value as the type that it is to have.

    kind : bool, int, float, str, a class of settings, a tuple of them, or a union.

    Raises
    ------
    SpecError : it is of another type; ``key`` says where.
    """
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return _one_of(key, value, typing.get_args(kind))
    if typing.get_origin(kind) is tuple:
        return _tuple(key, value, typing.get_args(kind))
    if kind not in WORDS:
        if isinstance(value, kind):
            return value
        kinds = [known.__name__ for known in getattr(kind, "KINDS", {}).values()] or [kind.__name__]
        raise SpecError(key, f"{shown(value)} is not settings; give {'(...), '.join(kinds)}(...)")
    plain = value.item() if getattr(value, "shape", None) == () else value  # numpy's own number
    if kind is str and isinstance(plain, os.PathLike):
        plain = os.fspath(plain)
    accepted = (int, float) if kind is float else kind
    if not isinstance(plain, accepted) or (isinstance(plain, bool) and kind is not bool):
        raise SpecError(key, f"{shown(value)} is not {WORDS[kind]}")
    if isinstance(plain, int) and plain.bit_length() > MOST_BITS:
        raise SpecError(key, "is a whole number of more than 300 digits; give a smaller one")
    if isinstance(plain, str) and "\0" in plain:
        raise SpecError(key, "has a null character, which no text and no file name has; remove it")
    return plain if type(plain) is kind else kind(plain)


def shown(value: Any) -> str:
    """A value as a sentence shows it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and value.bit_length() > MOST_BITS:
        return "a whole number of more than 300 digits"
    try:
        text = " ".join(str(value).split())
        if isinstance(value, str):
            text = f'"{value}"' if value.isprintable() else ascii(value)
    except Exception:  # tables within tables; digits beyond Python's limit; whatever it is
        text = "a table or list"
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def _one_of(key: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """A value of one of several types; None where that is one of them."""
    left = [kind for kind in kinds if kind is not type(None)]
    if value is None and len(left) < len(kinds):
        return None
    if len(left) == 1:
        return typed(key, value, left[0])
    if isinstance(value, tuple(left)):
        return value
    names = ", ".join(WORDS.get(kind, f"{kind.__name__}(...)") for kind in left)
    raise SpecError(key, f"{shown(value)} is none of {names}; give one of these")


def _tuple(key: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """A tuple, a list or an array as a tuple of a length that is known, or of any."""
    many = len(kinds) == 2 and kinds[1] is Ellipsis
    length = "" if many else f" of {len(kinds)} numbers"
    items = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(items, (tuple, list)):
        raise SpecError(key, f"{shown(value)} is not a list{length}")
    if not many and len(items) != len(kinds):
        raise SpecError(key, f"has {len(items)} values; give {len(kinds)}")
    given = (kinds[0],) * len(items) if many else kinds
    return tuple(
        typed(f"{key}[{k}]", item, kind)
        for k, (item, kind) in enumerate(zip(items, given, strict=True))
    )


T = TypeVar("T", bound="Settings")


MOST_ITEMS = 1_000_000  # of a list, unless it says fewer
AUTO = -1.0  # in place of a number: chosen by what the sensor can tell apart; files say "auto"


@dataclass(frozen=True)
class Param:
    """Unit, range, help and use of one parameter, besides its type and default."""

    help: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    open_minimum: bool = False  # the minimum itself is not allowed
    choices: tuple[str, ...] = ()
    file: bool = (
        False  # it names a file, from the folder of the one that says so, or what is shipped
    )
    required: bool = False
    auto: bool = False  # may be left to "auto"
    most: int = MOST_ITEMS  # of a list

    def allowed(self) -> str:
        """The allowed values in words."""
        return self._range() + (', or "auto"' if self.auto else "")

    def _range(self) -> str:
        if self.choices:
            return "one of " + ", ".join(f'"{c}"' for c in self.choices)
        unit = f" {self.unit}" if self.unit else ""
        low, high = figure(self.minimum), figure(self.maximum)
        above = "larger than" if self.open_minimum else "at least"
        if math.isinf(self.minimum) and math.isinf(self.maximum):
            return "any finite number"
        if math.isinf(self.maximum):
            return f"{above} {low}{unit}"
        if math.isinf(self.minimum):
            return f"at most {high}{unit}"
        if self.open_minimum:
            return f"larger than {low} and at most {high}{unit}"
        return f"from {low} to {high}{unit}"


def param(
    default: Any = dataclasses.MISSING,
    *,
    help: str,
    unit: str = "",
    ge: float = -math.inf,
    gt: float | None = None,
    le: float = math.inf,
    choices: tuple[str, ...] = (),
    file: bool = False,
    auto: bool = False,
    most: int = MOST_ITEMS,
) -> Any:
    """A dataclass field with its unit, range and help; without a default it must be given."""
    known = Param(
        help=help,
        unit=unit,
        minimum=ge if gt is None else gt,
        maximum=le,
        open_minimum=gt is not None,
        choices=choices,
        file=file,
        required=default is dataclasses.MISSING,
        auto=auto,
        most=most,
    )
    return dataclasses.field(default=default, metadata={"param": known})


def param_of(field: dataclasses.Field[Any]) -> Param:
    """The ``Param`` of a dataclass field."""
    return field.metadata["param"]


FORMER = {
    "T20": "tanveer-2020a",
    "A20": "tanveer-2020b",
    "S": "simlidar",
    "t20": "tanveer-2020a",
}
"""Names that choices had in earlier releases, and those that they have now."""


class _Signature:
    """Signature of a group of settings as Python shows it: its fields, by name alone."""

    def __get__(self, _: object, cls: type[Settings]) -> inspect.Signature:
        known = inspect.Parameter
        return inspect.Signature(
            [
                known(
                    field.name,
                    known.KEYWORD_ONLY,
                    default=known.empty if param_of(field).required else field.default,
                    annotation=field.type,
                )
                for field in dataclasses.fields(cls)  # type: ignore[arg-type]
            ],
            return_annotation=None,
        )


class Settings:
    """Base of every group of settings: a frozen keyword dataclass that checks itself."""

    TITLE: ClassVar[str] = ""

    __signature__ = _Signature()

    if TYPE_CHECKING:  # dataclass makes it
        __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        # What dataclass would write for each class is here once: it takes half a millisecond a class.
        dataclass(init=False, repr=False, eq=False, match_args=False)(cls)

    def __init__(self, *unnamed: Any, **values: Any) -> None:
        cls = type(self)
        if unnamed:
            raise SpecError(cls.__name__, f"{shown(unnamed[0])} has no name; give NAME=VALUE")
        kinds, fields = types_of(cls), dataclasses.fields(self)  # type: ignore[arg-type]
        refuse_unknown(values, (field.name for field in fields))
        for field in fields:
            name, known = field.name, param_of(field)
            if known.required and name not in values:
                raise SpecError(name, f"is missing in {cls.__name__}; it has no default")
            value = values.get(name, field.default)
            value = AUTO if known.auto and isinstance(value, str) and value == "auto" else value
            if known.choices and isinstance(value, str) and value not in known.choices:
                value = FORMER.get(value, value)
            refuse_many(name, value, known)
            value = typed(name, value, kinds[name])
            self.__dict__[name] = value
            _check(name, value, known)
        self.check()

    def __setattr__(self, name: str, value: Any) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._values() == other._values()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[Any, ...]:
        return tuple(getattr(self, field.name) for field in dataclasses.fields(self))  # type: ignore[arg-type]

    def __repr__(self) -> str:
        """Settings that are not the default, as Python."""
        given = []
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if field.name != "kind" and value != field.default:
                said = "auto" if param_of(field).auto and value == AUTO else value
                given.append(f"{field.name}={said!r}")
        return f"{type(self).__name__}({', '.join(given)})"

    def check(self) -> None:
        """Rules between fields; raises SpecError."""

    def changed(self: T, **values: Any) -> T:
        """The same settings but for some of them.

        Raises
        ------
        SpecError : a setting that there is not, or a value that is out of range.
        """
        return dataclasses.replace(self, **values)


def with_files(settings: T, rename: Callable[[str], str]) -> T:
    """Settings in which every file that they name, at any depth, is called otherwise."""
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if isinstance(value, Settings):
            changed[field.name] = with_files(value, rename)
        elif isinstance(value, tuple) and value and isinstance(value[0], Settings):
            renamed = tuple(with_files(item, rename) for item in value)
            same = all(a is b for a, b in zip(renamed, value, strict=True))
            changed[field.name] = value if same else renamed
        elif param_of(field).file and value:
            changed[field.name] = rename(value)
    same = all(value is getattr(settings, name) for name, value in changed.items())
    return settings if same else dataclasses.replace(settings, **changed)


def refuse_many(key: str, value: Any, known: Param) -> None:
    """Refuse a list that is longer than anything here could make sense of, before it is looked at."""
    count = len(value) if isinstance(value, (list, tuple)) else 0
    if count > known.most:
        raise SpecError(key, f"has {count:,} entries; give at most {known.most:,}")


def refuse_unknown(keys: Iterable[str], known: Iterable[str], place: str = "") -> None:
    """Refuse the first key that is not among those known, and name the nearest of them."""
    names = list(known)
    for key in keys:
        if key not in names:
            hint = did_you_mean(key, names)
            raise SpecError(f"{place}{key}", f"is not known; {hint}Allowed: {', '.join(names)}")


def _check(key: str, value: Any, known: Param) -> None:
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, str):
        if known.choices and value not in known.choices:
            hint = did_you_mean(value, known.choices)
            raise SpecError(key, f"{shown(value)} is not known; {hint}use {known.allowed()}")
    elif isinstance(value, (int, float)):
        if known.auto and value == AUTO:
            return
        low = value > known.minimum if known.open_minimum else value >= known.minimum
        if not (low and value <= known.maximum and math.isfinite(value)):
            unit = f" {known.unit}" if known.unit else ""
            raise SpecError(key, f"{figure(value)}{unit} is out of range; use {known.allowed()}")
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            _check(f"{key}[{index}]", item, known)


class Normal(Settings):
    """A truncated normal distribution; with sd 0 always the mean."""

    mean: float = param(help="mean before truncation", ge=-1e6, le=1e6)
    sd: float = param(0.0, help="standard deviation before truncation", ge=0, le=1e6)
    low: float | None = param(None, help="nothing smaller; left out: mean - 2 sd")
    high: float | None = param(None, help="nothing larger; left out: mean + 2 sd")

    def bounds(self) -> tuple[float, float]:
        """The smallest and the largest value that can be drawn."""
        if self.sd == 0:
            return self.mean, self.mean
        low = self.mean - 2 * self.sd if self.low is None else self.low
        return low, self.mean + 2 * self.sd if self.high is None else self.high

    def check(self) -> None:
        low = self.mean if self.low is None else self.low
        high = self.mean if self.high is None else self.high
        if not low <= self.mean <= high:
            raise SpecError("mean", f"{self.mean:g} must lie between low and high")


class Discrete(Settings):
    """A distribution over a few whole numbers."""

    values: tuple[int, ...] = param(help="the numbers that may be drawn", ge=0, le=10000)
    weights: tuple[float, ...] = param(
        (), help="how often each, relative to the others; left out: all alike", ge=0, le=1e9
    )

    def check(self) -> None:
        if not self.values:
            raise SpecError("values", "is empty; give at least one number")
        if self.weights and len(self.weights) != len(self.values):
            raise SpecError("weights", f"has {len(self.weights)} values; give {len(self.values)}")
        if self.weights and sum(self.weights) <= 0:
            raise SpecError("weights", "are all zero; make one larger")


def within(key: str, spread: Normal, low: float, high: float, open_low: bool = False) -> None:
    """Refuse a distribution that can draw what its place does not allow."""
    for value in (*spread.bounds(), spread.mean):
        if value < low or value > high or (open_low and value == low):
            above = "larger than" if open_low else "at least"
            raise SpecError(
                key,
                f"can draw {value:g}; keep it {above} {low:g} and at most {high:g} by mean, low and high",
            )
