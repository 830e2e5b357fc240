"""Words of work that takes a while: how far it is, and sentences for whoever waits."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]  # called as progress(done, total)
Say = Callable[[str], None]  # prints or keeps a line
