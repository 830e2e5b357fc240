"""Values that are kept for the next time, so many at most."""

from forest_addon.base.kept import LastAsked


def test_what_was_asked_for_longest_ago_is_dropped_and_made_anew():
    made = []

    def ask(key):
        return kept.once(key, lambda: made.append(key) or -key)

    kept = LastAsked(2)
    assert [ask(key) for key in (1, 2, 1, 3, 1, 2)] == [-1, -2, -1, -3, -1, -2]
    assert made == [1, 2, 3, 2]
    assert len(kept) == 2


def test_what_is_none_is_kept_too():
    made = []
    kept = LastAsked(1)
    for _ in range(2):
        assert kept.once("a", lambda: made.append(1)) is None
    assert len(made) == 1
