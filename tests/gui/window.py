"""A real Blender with a window and no screen: the user's own, or Debian's in a folder of its own.

``BLENDER=/path/to/blender`` takes that one; Xvfb and xdotool must be installed beside it. Else, as root on
Debian, Debian unstable's Blender is installed into a folder in the user's cache (about 2 GB, once) with
software rendering, and run there with chroot. ``FOREST_BLENDER_ROOT`` names another folder.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path

PACKAGES = (
    "blender xvfb xdotool imagemagick libgl1-mesa-dri python3-numpy python3-requests python3-cattr"
)
SIZE = "1600x1000"
INSIDE = "/exchange"  # where the shared folder is found within the installed one

# Mounts are private to this process and gone with it.
ENTER = """
mount --make-rprivate / 2>/dev/null
for name in proc dev sys; do mount --rbind /$name "$ROOT/$name"; done
mkdir -p "$ROOT/exchange" && mount --bind "$SHARED" "$ROOT/exchange"
exec chroot "$ROOT" "$@"
"""


class ImpossibleError(Exception):
    """Why there is no Blender with a window here, in one sentence."""


@dataclass(frozen=True)
class Blender:
    """How to run commands beside a Blender; ``shared`` is a folder of ours, ``inside`` its name there."""

    program: str
    shared: Path
    inside: str
    enter: tuple[str, ...] = ()

    def run(
        self, *command: str, seconds: float = 600, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        """Run a command where this Blender is; stderr comes with stdout."""
        values = {
            "BLENDER_USER_RESOURCES": f"{self.inside}/user",
            "HOME": self.inside,
        } | environment
        ours = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        line = [*self.enter, "env", *(f"{k}={v}" for k, v in values.items()), *command]
        with subprocess.Popen(
            line,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=ours | {"SHARED": str(self.shared)},
            start_new_session=True,
        ) as running:
            try:
                said, _ = running.communicate(timeout=seconds)
            except BaseException:
                os.killpg(running.pid, signal.SIGKILL)  # with Blender and its screen
                raise
        return subprocess.CompletedProcess(line, running.returncode, said)

    def run_with_window(
        self, script: str, words: str, seconds: float
    ) -> subprocess.CompletedProcess[str]:
        """Run a Python script with its words in Blender's window on a screen that nobody sees."""
        wide, high = SIZE.split("x")
        start = (
            f"Xvfb :$$ -screen 0 {SIZE}x24 >/dev/null 2>&1 & screen=$!; sleep 2; "
            f'DISPLAY=:$$ "{self.program}" -noaudio -p 0 0 {wide} {high} --python-exit-code 1 '
            f'--python "{script}" -- {words}; code=$?; kill $screen; exit $code'
        )
        return self.run("sh", "-c", start, seconds=seconds, LIBGL_ALWAYS_SOFTWARE="1")

    def python_version(self) -> str:
        """The Python of this Blender, as "3.13"."""
        ask = "import sys; print('PYTHON', *sys.version_info[:2])"
        for line in self.run(self.program, "-b", "--python-expr", ask).stdout.splitlines():
            if line.startswith("PYTHON"):
                return ".".join(line.split()[1:])
        raise ImpossibleError(f"{self.program} does not say which Python it has")


def provide(shared: Path) -> Blender:
    """A Blender with a window; installs it where that is allowed and it is not there yet.

    Raises
    ------
    ImpossibleError : there is none and none can be made here.
    """
    shared.mkdir(parents=True, exist_ok=True)
    own = os.environ.get("BLENDER")
    if own:
        lacking = [name for name in ("Xvfb", "xdotool", own) if not shutil.which(name)]
        if lacking:
            raise ImpossibleError(f"{' and '.join(lacking)} cannot be found")
        return Blender(own, shared, str(shared))
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        raise ImpossibleError("give BLENDER=/path/to/blender, or run it as root on Debian")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "forest-sensing"
    root = Path(os.environ.get("FOREST_BLENDER_ROOT") or cache / "blender-window")
    if not (root / "ready").exists():
        _install(root)
    enter = ("unshare", "--mount", "env", f"ROOT={root}", "sh", "-c", ENTER, "sh")
    blender = Blender("blender", shared, INSIDE, enter)
    if blender.run("true").returncode:
        raise ImpossibleError("this machine does not let us mount folders for a chroot")
    return blender


def _install(root: Path) -> None:
    """Debian unstable with Blender, in a folder; what fails is removed."""
    print(f"installing a Blender with a window in {root}, once", flush=True)
    if not shutil.which("debootstrap"):
        _must(
            "apt-get",
            "-o",
            "DPkg::Lock::Timeout=300",
            "install",
            "-y",
            "-qq",
            "--no-install-recommends",
            "debootstrap",
        )
    root.parent.mkdir(parents=True, exist_ok=True)
    try:
        _must("debootstrap", "--variant=minbase", "unstable", str(root))
        install = f"apt-get install -y -qq --no-install-recommends {PACKAGES} && apt-get clean"
        _must("chroot", str(root), "sh", "-c", f"DEBIAN_FRONTEND=noninteractive {install}")
        (root / "ready").touch()
    except BaseException:
        shutil.rmtree(root, ignore_errors=True)
        raise


def _must(*command: str) -> None:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        last = (done.stdout.strip().splitlines() or ["no reason given"])[-1]
        raise ImpossibleError(f"{command[0]} failed: {last}")
