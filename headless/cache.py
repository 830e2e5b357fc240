"""Where this user's caches lie: a folder that can be deleted at any time."""

from __future__ import annotations

import os
import sys
from pathlib import Path

NAME = "forest-sensing"


def user_cache() -> Path:
    """The cache folder of the user on this system; it need not exist.

    XDG_CACHE_HOME comes first everywhere (a relative one does not count, as its specification says);
    then LOCALAPPDATA on Windows, ~/Library/Caches on macOS, ~/.cache elsewhere.
    """
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(chosen):
        return Path(chosen) / NAME
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA", "")
        return Path(local or Path.home() / "AppData" / "Local") / NAME / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / NAME
    return Path.home() / ".cache" / NAME
