"""How many inputs a property is tried on: a share of what the run's profile of hypothesis allows.

The profiles are made in ``tests/conftest.py``: ``full`` (the default) takes a test at its word, ``quick``
tries a sixth, ``search`` ten times as many.
"""

from hypothesis import settings

FULL = 100  # examples of the profile `full`


def examples(count: int, **more: object) -> settings:
    """Settings of so many examples in a full run."""
    share = settings.default.max_examples / FULL
    return settings(max_examples=max(1, round(count * share)), **more)


def few() -> bool:
    """True where fewer examples are asked for than in a full run: of listed cases a share will do, too."""
    return settings.default.max_examples < FULL
