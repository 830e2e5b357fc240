"""The panel and its operators."""

from __future__ import annotations


def register() -> None:
    """Register every class, all or none."""


def unregister() -> None:
    """Unregister in reverse order."""
