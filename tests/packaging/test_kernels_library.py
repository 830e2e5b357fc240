"""The library is the one of the sources beside it; without it numpy computes, and it is said why."""

import ctypes
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from references.scripts import ROOT, script

from forest_addon import kernels

builder = script("packaging/build_kernels.py")


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A room of its own, with the sources alone; the library is looked for anew before and after."""
    for source in kernels.ROOM.glob("*.[ch]"):
        shutil.copy(source, tmp_path)
    monkeypatch.setattr(kernels, "ROOM", tmp_path)
    monkeypatch.setattr(builder, "ROOM", tmp_path)
    monkeypatch.delenv(kernels.SWITCH, raising=False)
    kernels._opened.cache_clear()
    yield tmp_path
    kernels._opened.cache_clear()


@pytest.fixture
def built(request):
    """A room with the library that `make` has built."""
    if kernels.library() is None:
        pytest.skip(kernels.engine())
    library = kernels.ROOM / kernels.FILE
    room = request.getfixturevalue("room")
    shutil.copy(library, room)
    return room


def test_the_library_of_these_sources_is_opened(built, monkeypatch):
    assert kernels.engine() == "C"
    assert kernels.library() is not None
    monkeypatch.setenv(kernels.SWITCH, "off")
    assert kernels.library() is None
    assert kernels.engine() == "numpy (FOREST_SENSING_KERNELS=off)"


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda room: (room / kernels.FILE).unlink(), "no library is built"),
        (lambda room: (room / kernels.FILE).write_bytes(b"\x7fELF"), "the library does not load: "),
        (
            lambda room: (room / "kernels.h").write_text("/* later */"),
            "the library is of other sources",
        ),
    ],
)
def test_any_other_library_is_left_alone(built, spoil, why):
    spoil(built)
    assert kernels.engine().startswith(f"numpy ({why}")
    assert kernels.library() is None


def test_without_a_compiler_one_sentence_says_what_to_install(tmp_path):
    """A machine with nothing on its PATH, whose Python has no ziglang."""
    run = subprocess.run(
        [sys._base_executable, "-I", ROOT / "packaging/build_kernels.py", "--out", tmp_path],
        env={"PATH": "/nonexistent"},
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (1, "", 1)
    assert "numpy computes more slowly: install gcc or clang" in run.stderr
    assert not list(tmp_path.iterdir())


def test_sources_that_do_not_compile_leave_the_library_as_it_was(built):
    before = (built / kernels.FILE).read_bytes()
    for source in built.glob("*.c"):
        source.write_text("int unused(void) { int x; return 0; }")  # warnings are errors
    assert builder.main([]) == 1
    assert (built / kernels.FILE).read_bytes() == before


# --------------------------------------------------------------------------------- kernels platforms
# Kernels for other platforms, built here: the files are theirs, and those that can be run say the same. A
# call that the tests of the kernels make is made again by a small program, which ziglang builds for the
# platform and an emulator runs. Libraries of macOS are looked at, not run.

# How a file of the platform begins, but for "?" bytes: format, processor, kind of file.
HEADS = {
    "linux-x64": (0, b"\x7fELF\x02\x01??????????\x03\x00\x3e\x00"),
    "linux-arm64": (0, b"\x7fELF\x02\x01??????????\x03\x00\xb7\x00"),
    "windows-x64": (0x3C, b"PE\x00\x00\x64\x86"),  # where the address at 0x3C points to
    "macos-arm64": (0, b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01????\x06\x00\x00\x00"),
    "macos-x64": (0, b"\xcf\xfa\xed\xfe\x07\x00\x00\x01????\x06\x00\x00\x00"),
}
EMULATORS = {
    "linux-x64": [],
    "linux-arm64": ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"],
    "windows-x64": ["wine"],
}
PROGRAM = """
#include "kernels.h"
#include <stdio.h>
#ifdef _WIN32
#include <windows.h>
#define OPENED(file) LoadLibraryA(file)
#define FOUND(file, name) GetProcAddress(file, name)
#else
#include <dlfcn.h>
#define OPENED(file) dlopen(file, RTLD_NOW)
#define FOUND(file, name) dlsym(file, name)
#endif
%(arrays)s
int main(int count, char **words) {
    void *library = OPENED(words[1]);
    __typeof__(%(name)s) *called = library ? (void *)FOUND(library, "%(name)s") : 0;
    FILE *out = fopen(words[2], "wb");
    if (!called || !out || count != 3) return 1;
    %(call)s
    %(writing)s
    return fclose(out);
}
"""


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """A library for each platform, in folders of their names."""
    pytest.importorskip("ziglang", reason="ziglang builds for other platforms")
    folder = tmp_path_factory.mktemp("libraries")
    assert builder.main(["all", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    """The first call of each function in the kernels' own tests, by the function's name."""
    folder = tmp_path_factory.mktemp("calls")
    words = ["-m", "pytest", "-n0", "-q", "-x", "-p", "no:cacheprovider", "-m", "not slow"]
    subprocess.run(
        [sys.executable, *words, "tests/kernels"],
        env=os.environ | {"KERNELS_KEPT": str(folder)},
        cwd=ROOT,
        check=True,
    )
    return {file.stem: dict(np.load(file)) for file in folder.glob("*.npz")}


@pytest.mark.slow
@pytest.mark.parametrize("platform", HEADS)
def test_a_library_is_of_its_platform(libraries, platform):
    (file,) = (libraries / platform).iterdir()
    content = file.read_bytes()
    pointed, head = HEADS[platform]
    start = int.from_bytes(content[pointed : pointed + 4], "little") if pointed else 0
    found = content[start : start + len(head)]
    assert all(a == b or b == ord("?") for a, b in zip(found, head, strict=True))
    assert not [name for name in kernels.FUNCTIONS if name.encode() not in content]


@pytest.mark.slow
@pytest.mark.parametrize("platform", EMULATORS)
def test_it_computes_the_same_there(libraries, calls, platform, tmp_path):
    emulator = EMULATORS[platform]
    if emulator and not shutil.which(emulator[0]):
        pytest.skip(f"{emulator[0]} is not here")
    (library,) = (libraries / platform).iterdir()
    shutil.copy(library, tmp_path)
    run = 0
    for name, call in calls.items():
        types = kernels.FUNCTIONS[name][0]
        if ctypes.c_void_p in types:  # Embree's, which is this process's
            continue
        (tmp_path / "call.c").write_text(program(name, call, len(types)))
        zig = builder.compiler(platform, fetch=False)
        made = ["call.c", f"-I{kernels.ROOM}", "-w", "-o", "call.exe"]
        subprocess.run([*zig, *made], cwd=tmp_path, check=True)
        subprocess.run(
            [*emulator, "./call.exe", f"./{library.name}", "found"],
            cwd=tmp_path,
            check=True,
            env=os.environ | {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"},
        )
        content, at = (tmp_path / "found").read_bytes(), 0
        for k in range(len(types)):
            expected = call[f"left_{k:02d}"]
            if not expected.ndim:
                continue
            found = np.frombuffer(content, expected.dtype, expected.size, at).reshape(
                expected.shape
            )
            at += expected.nbytes
            scale = np.abs(expected[np.isfinite(expected)]).max(initial=1e-300)
            assert np.allclose(found, expected, rtol=1e-12, atol=1e-12 * scale, equal_nan=True), (
                name
            )
        assert len(content) == at
        run += 1
    assert run


def program(name, call, count):
    """A program in C that makes a call and writes its arrays as they are afterwards."""
    arrays, words, writing = [], [], []
    for k in range(count):
        given = call[f"given_{k:02d}"]
        if given.ndim:
            numbers = ",".join(map(str, given.tobytes())) or "0"
            arrays.append(
                f"static unsigned char a{k}[] __attribute__((aligned(64))) = {{{numbers}}};"
            )
            writing.append(f"fwrite(a{k}, 1, {given.nbytes}, out);")
            words.append(f"(void *)a{k}")
        else:
            value = given.item()
            words.append(value.hex() if isinstance(value, float) else f"{int(value)}LL")
    return PROGRAM % {
        "name": name,
        "arrays": "\n".join(arrays),
        "call": f"called({', '.join(words)});",
        "writing": "\n    ".join(writing),
    }


# ------------------------------------------------------------------------------- kernels sanitizers
# The tests of the kernels once more, with libraries that report what C leaves undefined, and races.

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
