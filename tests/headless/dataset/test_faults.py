"""Datasets and fields in tiles when processes, disks and plans go wrong: nothing is lost."""

import contextlib
import csv
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from references.dataset_runs import FIELD, PLAN, ROOT, bytes_of, children_of, command, here, run
from references.disks import files_up_to

from forest_addon.base.rng import stream
from headless.dataset import engine

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc, and kills processes"),
]
CHILD = "spawn_main"  # in the command line of a process of a pool
ENDLESS = ("--set", "scene.sensors[tls].angle_step_deg=0.004")  # 1.4e9 pulses


def started(*words):
    return subprocess.Popen(
        command(*words), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def kill(pid):
    try:
        os.kill(pid, signal.SIGKILL)
        return True
    except ProcessLookupError:
        return False


def disturbed(out, seed, kills, workers, words=(), work=PLAN):
    """Start the command again and again; kill it or a child at random moments. Returns kills."""
    rng = stream(seed, "kills")
    done = {"command": 0, "child": 0}
    process = started(work, "--out", out, "--workers", str(workers), "--quiet", *words)
    deadline = time.monotonic() + 1500
    while sum(done.values()) < kills:
        assert time.monotonic() < deadline
        time.sleep(float(rng.uniform(0.3, 4.0)))
        if process.poll() is not None:
            if process.returncode == 0:
                break
            process = started(work, "--out", out, "--workers", str(workers), "--quiet", *words)
            continue
        below = children_of(process.pid)
        makers = sorted(pid for pid, line in below.items() if CHILD in line)
        what = ("command", "child", "child")[int(rng.integers(3))]
        chosen = {"command": [process.pid], "child": makers}[what]
        if chosen and kill(chosen[int(rng.integers(len(chosen)))]):
            done[what] += 1
    process.wait(600)
    return done


def manifest(out):
    with open(out / "manifest.csv", newline="") as file:
        return list(csv.DictReader(file))


def finish(out, workers=1, words=(), run=run, work=PLAN, **how):
    """The same command until it ends well; scenes that were set aside are tried again."""
    for _ in range(4):
        ended = run(work, "--out", out, "--workers", str(workers), "--quiet", *words, **how)
        if ended.returncode == 0:
            return
    raise AssertionError(ended.stderr)


@pytest.fixture
def whole(request, tmp_path, warm):
    """Bytes that are to come of a dataset or a field."""
    work = request.param
    if work == PLAN:
        return bytes_of(request.getfixturevalue("undisturbed"))
    finish(tmp_path / "whole", run=warm.run, ends=None, work=FIELD)
    return bytes_of(tmp_path / "whole")


@pytest.mark.parametrize(
    ("whole", "work"),
    [(PLAN, PLAN), (FIELD, FIELD)],
    ids=["scenes", "tiles"],
    indirect=["whole"],
)
def test_a_few_kills_lose_nothing(whole, tmp_path, warm, work):
    disturbed(tmp_path / "data", 1, 3, 2, work=work)
    finish(tmp_path / "data", run=warm.run, ends=None, work=work)
    assert bytes_of(tmp_path / "data") == whole


@pytest.mark.skipif(not os.environ.get("FOREST_LONG_TESTS"), reason="ten minutes of kills")
def test_twenty_five_kills_lose_nothing(tmp_path):
    """With FOREST_LONG_TESTS set: scenes enough that kills meet every stage of the work."""
    words = ("--set", "count=24")
    assert (
        run(PLAN, "--out", tmp_path / "calm", "--workers", "1", "--quiet", *words).returncode == 0
    )
    total, seed = 0, 0
    while total < 25:
        out = tmp_path / f"data-{seed}"
        total += sum(disturbed(out, seed, 25 - total, 2, words).values())
        finish(out, 2, words)
        assert bytes_of(out) == bytes_of(tmp_path / "calm")
        assert not [p for p in (out / "scenes").iterdir() if p.name.startswith(".")]
        seed += 1


def test_a_scene_that_never_ends_is_set_aside_and_the_rest_goes_on(
    undisturbed, tmp_path, warm, monkeypatch
):
    """The grid's second value is the endless scan; the first may need more time on a busy machine."""
    monkeypatch.setattr(engine, "TRIES", 1)  # the second would end as the first does
    usual = min(float(row["seconds"]) for row in manifest(undisturbed))
    words = ("--set", "vary.sensors[tls].angle_step_deg={grid=[3.0,0.004]}", "--set", "count=2")
    words += ("--workers", "1", "--quiet", "--set", "vary.sensors[tls].max_range=20.0")
    for times in (1.5, 6.0, 24.0, 96.0):
        timeout = ("--set", f"run.timeout={1.0 + times * usual}")
        ended = warm.run(PLAN, "--out", tmp_path / "data", *words, *timeout, ends=4)
        rows = manifest(tmp_path / "data")
        if rows[0]["status"] == "done":
            break
    assert "scene 000001 could not be made" in ended.stderr
    assert [row["status"] for row in rows] == ["done", "failed"]
    assert rows[1]["error"] == "timeout: ran past its time"


def test_a_scene_that_needs_too_much_memory_is_set_aside(tmp_path, warm):
    few = ("--workers", "1", "--quiet", "--set", "count=1", "--set", "run.memory_gb=0.3")
    few += ("--set", "vary.sensors[tls].max_range=20.0")
    warm.run(PLAN, "--out", tmp_path / "data", *few, *ENDLESS, ends=4)
    (row,) = manifest(tmp_path / "data")
    assert row["status"] == "failed"
    assert "needs more memory than it may have (0.3 GB)" in row["error"]


def test_a_full_disk_ends_the_command_and_keeps_what_is_done(tmp_path):
    words = ("--workers", "1", "--quiet", "--set", "count=1")
    with files_up_to(20_000):
        ended = here(PLAN, "--out", tmp_path / "data", *words)
    assert ended.returncode == 1
    assert "what is finished is kept" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not list((tmp_path / "data" / "scenes").iterdir())


@contextlib.contextmanager
def scheduler(folder, port=0):
    """A process with a scheduler and a worker, and their address."""
    pytest.importorskip("distributed")
    code = (
        "import distributed, time\n"
        "with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False,\n"
        f"        dashboard_address=None, protocol='tcp', scheduler_port={port}) as cluster:\n"
        "    print(cluster.scheduler_address, flush=True)\n"
        "    time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
        env=dict(os.environ) | {"PYTHONPATH": str(ROOT)},
    ) as cluster:
        try:
            yield cluster, cluster.stdout.readline().strip()
        finally:
            kill(cluster.pid)


@pytest.mark.parametrize("whole", [FIELD], indirect=True)
def test_a_scheduler_that_is_ended_is_said_and_started_again_goes_on(whole, tmp_path):
    out = tmp_path / "data"

    def end(cluster):
        wait_for(lambda: [*out.glob("tiles/*.rows")])
        kill(cluster.pid)

    with scheduler(tmp_path) as (cluster, address):
        words = (FIELD, "--out", out, "--scheduler", address, "--quiet")
        ending = threading.Thread(target=end, args=[cluster])
        ending.start()
        ended = here(*words)
        ending.join()
    assert ended.returncode == 1, ended.stderr
    assert address in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not (out / "als.laz").exists()
    with scheduler(tmp_path, address.rpartition(":")[2]) as (_, again):
        assert again == address
        ended = here(*words)
    assert ended.returncode == 0, ended.stderr
    assert bytes_of(out) == whole


def wait_for(happened, seconds=200):
    deadline = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.1)
