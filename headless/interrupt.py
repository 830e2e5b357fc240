"""Ctrl-C that works at once, also in the middle of a render.

Python raises KeyboardInterrupt between two of its own steps, so while Blender renders for half a minute
nothing would happen. A watching thread therefore gives the main thread two seconds to stop by itself;
after that it removes the partial files and ends the process.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from forest_addon.formats.atomic import remove_partial_files

PATIENCE = 2.0  # seconds


@contextmanager
def interruptible(kept: str) -> Iterator[None]:
    """Within the block, SIGINT ends the process with exit code 130 in about two seconds.

    kept : what the closing message says of finished files.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ears, mouth = os.pipe()
    os.set_blocking(mouth, False)
    finished = threading.Event()

    def watch() -> None:
        while os.read(ears, 1) != bytes([signal.SIGINT]):
            if finished.is_set():
                return
        if not finished.wait(PATIENCE):
            remove_partial_files()
            print(f"\ninterrupted; {kept}", file=sys.stderr, flush=True)
            os._exit(130)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    woken = signal.set_wakeup_fd(mouth, warn_on_full_buffer=False)
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        finished.set()
        signal.set_wakeup_fd(woken)
        # None: Blender itself had set it, which Python cannot do again.
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)
        os.write(mouth, b"\0")
        watcher.join(1.0)
        os.close(ears)
        os.close(mouth)
