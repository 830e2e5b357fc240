"""Every entry of every menu says what it does, in words of its own."""

import dataclasses

import pytest

from forest_addon import spec
from forest_addon.spec.base import Settings
from forest_addon.spec.choices import CHOICES, meaning_of, title_of

NAMES = {"kind", "allometry"}  # what these name needs no further words


def groups(cls=Settings):
    for sub in cls.__subclasses__():
        if sub.__module__.startswith("forest_addon."):
            yield sub
            yield from groups(sub)


def menus():
    for group in sorted(set(groups()), key=lambda group: group.__name__):
        for field in dataclasses.fields(group):
            known = spec.param_of(field)
            if known.choices and field.name not in NAMES:
                yield pytest.param(field.name, known, id=f"{group.__name__}.{field.name}")


@pytest.mark.parametrize(("name", "known"), list(menus()))
def test_every_choice_has_a_name_and_a_meaning_of_its_own(name, known):
    titles = [title_of(name, choice) for choice in known.choices]
    meanings = [meaning_of(name, choice) for choice in known.choices]
    assert all(meanings), dict(zip(known.choices, meanings, strict=True))
    assert len(set(titles)) == len(set(meanings)) == len(titles)
    assert known.help not in meanings
    assert max(map(len, titles)) <= 20


def test_nothing_is_said_of_what_there_is_not():
    there = {}
    for group in set(groups()):
        for field in dataclasses.fields(group):
            there.setdefault(field.name, set()).update(spec.param_of(field).choices)
    for name, choices in CHOICES.items():
        assert set(choices) <= there.get(name, set()), name
