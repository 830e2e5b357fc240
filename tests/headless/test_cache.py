"""The user's cache folder on each system."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from headless.cache import user_cache


@pytest.mark.parametrize(
    ("system", "environment", "expected"),
    [
        ("linux", {}, ".cache/forest-sensing"),
        ("linux", {"XDG_CACHE_HOME": "relative"}, ".cache/forest-sensing"),
        ("darwin", {}, "Library/Caches/forest-sensing"),
        ("win32", {}, "AppData/Local/forest-sensing/Cache"),
    ],
)
def test_by_system(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    system: str,
    environment: dict[str, str],
    expected: str,
) -> None:
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert user_cache() == tmp_path / expected


def test_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache() == tmp_path / "forest-sensing"
