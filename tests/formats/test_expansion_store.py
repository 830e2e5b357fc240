"""Expansions on disk: the same sums, keys kept apart, damage survived, two writers at once."""

from __future__ import annotations

import multiprocessing
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np
import pytest

from forest_addon.formats.expansion_store import ExpansionStore
from forest_addon.sensing.reverb import fast_scattering
from forest_addon.sensing.reverb.expansion import Key, Layer, expand
from forest_addon.sensing.reverb.fast_scattering import Expansions
from forest_addon.sensing.reverb.scattering import TrunkPaths
from forest_addon.spec import Air

KEY = Key(8000.0, 0.2, 0.2, 343.0, 1e-3)
AIR = Air(sound_speed=343.0)


def paths() -> TrunkPaths:
    rng = np.random.default_rng(1)
    return TrunkPaths(
        rng.uniform(10, 90, 100),
        np.ones(100),
        rng.uniform(0, np.pi, 100),
        np.full(100, 0.2),
        np.zeros(100, bool),
    )


def same(one: tuple[Layer, ...] | None, other: tuple[Layer, ...]) -> bool:
    return one is not None and all(
        a.step == b.step
        and all(
            (s.low, s.high, s.lead) == (t.low, t.high, t.lead)
            and np.array_equal(s.filters, t.filters)
            and np.array_equal(s.series, t.series)
            for s, t in zip(a.sectors, b.sectors, strict=True)
        )
        for a, b in zip(one, other, strict=True)
    )


def test_what_is_kept_comes_back(tmp_path: Path) -> None:
    store = ExpansionStore(tmp_path / "cache" / "deep")
    assert store.load(KEY) is None
    layers = expand(KEY)
    store.save(KEY, layers)
    assert same(store.load(KEY), layers)
    for other in (KEY._replace(tolerance=1e-4), KEY._replace(version=KEY.version + 1)):
        assert store.load(other) is None
    assert [path.suffix for path in (tmp_path / "cache" / "deep").iterdir()] == [".npz"]


def test_a_range_of_radii(tmp_path: Path) -> None:
    key = Key(2000.0, 0.1, 0.3, 343.0, 1e-3)
    store = ExpansionStore(tmp_path)
    store.save(key, expand(key))
    assert same(store.load(key), expand(key))


def test_set_up_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = Expansions(ExpansionStore(tmp_path)).sum(paths(), 8000.0, 3000, AIR, 1e-3)
    monkeypatch.setattr(fast_scattering, "expand", None)
    again = Expansions(ExpansionStore(tmp_path)).sum(paths(), 8000.0, 3000, AIR, 1e-3)
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "other", "text"])
def test_damaged_files_are_computed_anew(tmp_path: Path, damage: str) -> None:
    store = ExpansionStore(tmp_path)
    layers = expand(KEY)
    store.save(KEY, layers)
    path = store.path(KEY)
    whole = path.read_bytes()
    if damage == "flipped":
        middle = len(whole) // 2
        path.write_bytes(whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :])
    elif damage == "other":
        store.save(KEY._replace(rate=9000.0), layers)
        store.path(KEY._replace(rate=9000.0)).replace(path)
    else:
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 3], "text": b"hello"}[damage])
    assert store.load(KEY) is None
    found = Expansions(store).sum(paths(), 8000.0, 3000, AIR, 1e-3)
    assert np.isfinite(found).all()
    assert same(store.load(KEY), layers)


def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = ExpansionStore(tmp_path / "file" / "cache")
    store.save(KEY, expand(KEY))
    assert store.load(KEY) is None


def _write(folder: str, enough: Event) -> None:
    store, layers = ExpansionStore(folder), expand(KEY)
    while not enough.is_set():
        store.save(KEY, layers)


@pytest.mark.slow
def test_two_processes_write_the_same(tmp_path: Path) -> None:
    """A reader between them finds a whole file or none."""
    context = multiprocessing.get_context("spawn")
    enough = context.Event()
    writers = [context.Process(target=_write, args=(str(tmp_path), enough)) for _ in range(2)]
    for writer in writers:
        writer.start()
    store, layers, seen = ExpansionStore(tmp_path), expand(KEY), 0
    try:
        while seen < 30:
            assert not any(writer.exitcode for writer in writers)
            found = store.load(KEY)
            if store.path(KEY).exists() and found is not None:
                seen += 1
                assert same(found, layers)
    finally:
        enough.set()
        for writer in writers:
            writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert same(store.load(KEY), layers)
