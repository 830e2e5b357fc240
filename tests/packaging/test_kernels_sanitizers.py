"""The tests of the kernels once more, with libraries that report what C leaves undefined, and races."""

import os
import shutil
import subprocess
import sys

import pytest
from references.scripts import ROOT, script

builder = script("packaging/build_kernels.py")
PRELOADED = {"address,undefined": "libasan.so", "thread": "libtsan.so"}
OPTIONS = {
    "ASAN_OPTIONS": "detect_leaks=0",  # Python's own leaks
    "TSAN_OPTIONS": "exitcode=66",
    "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "yes",  # what is not imported need not be watched
}
TESTS = ["-m", "pytest", "-q", "--assert=plain", "-x", "-p", "no:cacheprovider", "-m", "not slow"]
# Functions with a fault of each kind, and a call that shows it.
FAULTS = """
#include "kernels.h"
KERNEL int64_t beyond(const int64_t *values, int64_t count);
KERNEL int64_t too_large(int64_t value);
KERNEL void count_up(int64_t *total);
int64_t beyond(const int64_t *values, int64_t count) { return values[count]; }
int64_t too_large(int64_t value) { return value + INT64_MAX; }
void count_up(int64_t *total) {
    static int there; /* both are here before either counts, however busy the machine is */
    __atomic_fetch_add(&there, 1, __ATOMIC_RELAXED);
    while (__atomic_load_n(&there, __ATOMIC_RELAXED) < 2) {}
    for (int i = 0; i < 1000000; i++) ++*(volatile int64_t *)total;
}
"""
CALLS = {
    "found.beyond(np.zeros(1000, np.int64).ctypes, ctypes.c_int64(1000))": (
        "address,undefined",
        "heap-buffer-overflow",
    ),
    "found.too_large(ctypes.c_int64(1))": ("address,undefined", "signed integer overflow"),
    "threads = [threading.Thread(target=found.count_up, args=[total.ctypes]) for _ in range(2)];"
    "[t.start() for t in threads]; [t.join() for t in threads]": ("thread", "data race"),
}


@pytest.fixture
def under(tmp_path):
    """``under(sanitizer, sources, words)``: how Python ends with the library of sources before all others."""
    if sys.platform != "linux" or not shutil.which("gcc"):
        pytest.skip("gcc's sanitizers are asked, on Linux")

    def run(sanitizer, sources, *words):
        library = tmp_path / "_kernels.so"
        gcc = ["gcc", "-g1", f"-fsanitize={sanitizer}", "-fno-sanitize-recover=all"]
        build = builder.compilation([*gcc, f"-I{builder.ROOM}"], sources, library)
        subprocess.run([*build, "-Og"], check=True)
        name = ["gcc", f"-print-file-name={PRELOADED[sanitizer]}"]
        found = subprocess.run(name, capture_output=True, text=True, check=True).stdout.strip()
        if not os.path.isabs(found):
            pytest.skip(f"gcc has no {found} here")
        told = {"LD_PRELOAD": found, "KERNELS_UNDER_TEST": str(library)} | OPTIONS
        if sanitizer == "thread":
            told["KERNELS_TWICE"] = "yes"
        return subprocess.run(
            [sys.executable, *words],
            env=os.environ | told,
            cwd=ROOT,
            capture_output=True,
            text=True,
        )

    return run


@pytest.mark.slow
@pytest.mark.parametrize("sanitizer", PRELOADED)
def test_the_kernels_are_clean(under, sanitizer):
    ended = under(sanitizer, sorted(builder.ROOM.glob("*.c")), *TESTS, "tests/kernels")
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr[-3000:]
    assert " passed" in ended.stdout
    assert " skipped" not in ended.stdout


@pytest.mark.slow
@pytest.mark.parametrize("call", CALLS, ids=["beyond an array", "overflow", "race"])
def test_a_fault_is_found(under, tmp_path, call):
    sanitizer, told = CALLS[call]
    (tmp_path / "faults.c").write_text(FAULTS)
    text = "import ctypes, os, threading; import numpy as np; total = np.zeros(1, np.int64);"
    text += f"found = ctypes.CDLL(os.environ['KERNELS_UNDER_TEST']); {call}"
    ended = under(sanitizer, [tmp_path / "faults.c"], "-c", text)
    assert ended.returncode != 0
    assert told in ended.stderr
