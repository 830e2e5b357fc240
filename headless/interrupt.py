"""Ctrl-C that works at once, also in the middle of a render or while Blender is imported.

Python raises KeyboardInterrupt between two of its own steps. While Blender renders for half a minute nothing
would happen: a watching thread therefore gives the main thread two seconds to stop by itself; after that it
removes the partial files and ends the process. And an exception in the middle of an import comes out as
whatever that module makes of it, from a traceback to a crash: there the process ends at once.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from forest_addon.formats.atomic import remove_partial_files

PATIENCE = 2.0  # seconds
STOPPED = 130  # exit code
BLENDERS = f"{os.sep}scripts{os.sep}"  # in the path of a script that belongs to Blender


def quietly() -> None:
    """End the process in one line on SIGINT from now on: before anything is written, and after."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:  # as in the background of a shell
        signal.signal(signal.SIGINT, lambda *_: _end("nothing was written", 2))


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
    voice = os.dup(2)  # while Blender is hushed nobody hears 2

    def watch() -> None:
        while os.read(ears, 1) != bytes([signal.SIGINT]):
            if finished.is_set():
                return
        if not finished.wait(PATIENCE):
            _end(kept, voice)

    def heard(_: int, frame: FrameType | None) -> None:
        if _unsafe(frame):
            _end(kept, voice)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, heard)
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
        for end in (ears, mouth, voice):
            os.close(end)


def _unsafe(frame: FrameType | None) -> bool:
    """Return whether a step of the program is within an import, or within a script that Blender called: it
    prints what such a script raises, and goes on."""
    while frame is not None:
        file = frame.f_code.co_filename
        if file.startswith("<frozen importlib") or BLENDERS in file:
            return True
        frame = frame.f_back
    return False


def _end(kept: str, voice: int) -> None:
    """End the process now; partial files go, finished ones stay."""
    remove_partial_files()
    os.write(voice, f"\ninterrupted; {kept}\n".encode())
    os._exit(STOPPED)
