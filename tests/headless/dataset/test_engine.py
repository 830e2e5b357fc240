"""Workers of one machine, and what a cluster is asked for, without one: the script of a Slurm job, and words
for mistakes."""

import json
import os
import shutil
import subprocess
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace
from typing import ClassVar

import pytest

from forest_addon.formats.ownership import Keeper, keeping
from forest_addon.spec import SpecError
from headless.dataset import disk, engine
from headless.dataset.disk import rows_of
from headless.dataset.engine import Cluster, SceneJob, SceneOutcome, Worker, make_all, slurm_cluster
from headless.dataset.plan import PLANS, read_plan, recipes
from headless.dataset.settings import Running
from headless.lock import only_one
from studies.bench.cluster import seconds_of, trial


@pytest.mark.medium
def test_the_script_of_a_slurm_job_asks_for_what_was_said(tmp_path):
    pytest.importorskip("dask_jobqueue")
    said = "partition=cpu,jobs=40,memory=8GB,walltime=04:00:00,account=forest"
    cluster, jobs = slurm_cluster(said)
    with cluster:
        script = cluster.job_script()
    assert jobs == 40
    for line in ("-p cpu", "-A forest", "-n 1", "--cpus-per-task=1", "-t 04:00:00", "--mem=8G"):
        assert f"#SBATCH {line}" in script.splitlines(), script
    (command,) = [line for line in script.splitlines() if "dask" in line and "SBATCH" not in line]
    assert "--nthreads 1 " in command  # a Blender a thread
    (tmp_path / "job.sh").write_text(script)
    if shell := shutil.which("bash"):
        assert subprocess.run([shell, "-n", tmp_path / "job.sh"]).returncode == 0


@pytest.mark.parametrize(
    ("said", "words"), [("cpu", "must be KEY=VALUE"), ("jobs=many", 'jobs is "many"')]
)
def test_what_is_wrong_with_slurm_is_said(said, words):
    pytest.importorskip("dask_jobqueue")
    with pytest.raises(SpecError, match=words):
        slurm_cluster(said)


def certificate(folder, authority):
    """Settings of Dask that name a new authority and a certificate of it."""
    folder.mkdir()

    def openssl(*words):
        subprocess.run(["openssl", *words], check=True, capture_output=True, cwd=folder)

    new = ("-newkey", "rsa:2048", "-nodes")
    itself = ("-subj", f"/CN={authority}")
    openssl("req", "-x509", *new, *itself, "-keyout", "ca-key.pem", "-out", "ca.pem", "-days", "1")
    openssl("req", *new, "-subj", "/CN=forest", "-keyout", "key.pem", "-out", "request.pem")
    signed = ("-CA", "ca.pem", "-CAkey", "ca-key.pem", "-CAcreateserial", "-days", "1")
    openssl("x509", "-req", "-in", "request.pem", *signed, "-out", "cert.pem")
    pair = {"cert": str(folder / "cert.pem"), "key": str(folder / "key.pem")}
    roles = {f"distributed.comm.tls.{role}": pair for role in ("client", "worker", "scheduler")}
    return {"distributed.comm.tls.ca-file": str(folder / "ca.pem"), **roles}


def job_of(number, **more):
    return SimpleNamespace(number=number, **more)


@pytest.mark.slow
def test_a_process_that_is_killed_is_told_with_its_last_words(tmp_path):
    pytest.importorskip("bpy")
    worker = Worker()
    try:
        assert worker.start() == ""
        worker._process.kill()
        found = worker._answer(time.monotonic() + 60, 1e12)
        assert found.kind == "crash"
        assert found.why.startswith("Blender's process was ended by signal 9")
        (tmp_path / "scenes").write_text("no folder")
        recipe = SimpleNamespace(number=3, name="000003")
        found = worker.once(SceneJob(tmp_path, recipe, Running(), 1e12, 1))  # in a new process
        assert found.kind == "fault"
        assert found.scene == 3
        assert found.memory > 0
    finally:
        worker.end()


class Pretended:
    """A worker that makes nothing: odd scenes go on until it is stopped, where the test wants them to."""

    every: ClassVar[list["Pretended"]] = []
    endless = False

    def __init__(self):
        self.stopped, self.ended, self.made = threading.Event(), False, []
        self.every.append(self)

    def make(self, job):
        number = job.number
        if self.endless and number % 2:
            assert self.stopped.wait(20)
            return SceneOutcome("stopped", scene=number)
        self.made.append(number)
        if self.endless:
            return job.result(number)
        time.sleep(0.01)
        return SceneOutcome("done", scene=number)

    def stop(self):
        self.stopped.set()

    def end(self):
        self.ended = True


@pytest.fixture
def pretended(monkeypatch):
    monkeypatch.setattr(Pretended, "every", [])
    monkeypatch.setattr(engine, "Worker", Pretended)
    return Pretended


def test_workers_of_one_machine_share_out_what_there_is_to_do(pretended):
    done = []
    jobs = [job_of(number) for number in range(12)]
    make_all(jobs, Cluster(workers=3), done.append)
    assert sorted(one.scene for one in done) == list(range(12))
    assert len(pretended.every) == 3
    assert all(worker.made and worker.ended for worker in pretended.every)
    make_all(jobs[:1], Cluster(workers=3), done.append)
    assert len(pretended.every) == 4  # no more than there are jobs


def full(number):
    return SceneOutcome("disk", "no space", scene=number)


def broken(number):
    raise RuntimeError("broken")


@pytest.mark.parametrize(
    ("result", "problem", "words"),
    [(full, OSError, "no space; what is finished is kept"), (broken, RuntimeError, "broken")],
)
def test_what_no_scene_survives_stops_every_worker(pretended, monkeypatch, result, problem, words):
    monkeypatch.setattr(pretended, "endless", True)
    jobs = [job_of(number, result=result) for number in (1, 0, 2, 4)]
    with pytest.raises(problem, match=words):
        make_all(jobs, Cluster(workers=2), print)
    assert all(worker.ended for worker in pretended.every)
    assert any(worker.stopped.is_set() for worker in pretended.every)


def told(job):
    """Result of a scene that takes no time."""
    return SceneOutcome("done", scene=job.number)


@pytest.mark.slow
def test_a_scheduler_by_tls_lets_in_who_has_a_certificate_of_its_authority(tmp_path, monkeypatch):
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    if not shutil.which("openssl"):
        pytest.skip("no openssl")
    ours, other = certificate(tmp_path / "ours", "ours"), certificate(tmp_path / "other", "other")
    monkeypatch.setattr(engine, "CAN_START_IN", 2)
    jobs = [job_of(number) for number in range(3)]
    settings = ours | {"distributed.comm.require-encryption": True}
    with dask.config.set(settings):
        secure = distributed.Security()
        here = {"n_workers": 1, "threads_per_worker": 1, "processes": False}
        cluster = distributed.LocalCluster(
            **here, dashboard_address=None, security=secure, protocol="tls://"
        )
    with cluster:
        address = Cluster(scheduler=cluster.scheduler_address, make=told)
        assert address.scheduler.startswith("tls://")
        with pytest.raises(SpecError, match="needs a certificate"):
            make_all(jobs, address, print)
        with (
            dask.config.set(other),
            pytest.raises(OSError, match="reached"),
        ):
            make_all(jobs, address, print)
        done = []
        with dask.config.set(settings):
            make_all(jobs, address, done.append)
    assert sorted(one.scene for one in done) == [0, 1, 2]


@pytest.mark.slow
def test_a_plan_survives_the_loss_of_a_worker_and_of_the_command(tmp_path):
    pytest.importorskip("distributed")
    plan = read_plan(PLANS / "tiny.toml", ["count=24"])
    wanted = recipes(plan)
    found = trial(tmp_path, (plan, wanted), (2, 2), 0.1, loss=True)
    assert [row["status"] for row in found.rows] == ["done"] * 24
    assert [row["settings"] for row in found.rows] == [recipe.digest for recipe in wanted]
    for recipe in wanted:  # each by its own seed, whoever made it, and as often as it was
        said = (tmp_path / "data" / "scenes" / recipe.name / "waited.txt").read_text()
        assert float(said) == pytest.approx(seconds_of(recipe.seed, 0.1), abs=1e-6)
    assert found.twice <= 4  # those that ran when the command ended


@pytest.mark.medium
def test_a_cluster_that_loses_everything_is_given_up(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(engine, "LEAST_AHEAD", 2)

    def lose(job):
        raise RuntimeError("lost")

    here = {"n_workers": 1, "threads_per_worker": 1, "processes": False}
    with distributed.LocalCluster(**here, dashboard_address=None) as cluster:
        place = Cluster(scheduler=cluster.scheduler_address, make=lose)
        jobs = [job_of(number) for number in range(5)]
        with pytest.raises(OSError, match="finished none of 5 jobs"):
            make_all(jobs, place, print)


# --------------------------------------------------------------------------------------------- disk
# A scene's folder is whole or not there; the manifest follows from the folders; a folder has one command.

RECORD = {
    "split": "train",
    "seed": 1,
    "base": "b",
    "settings": "s",
    "trees": 1,
    "points": {"tls": 3},
}


def made(root, number, text="points"):
    partial = disk.begin(root, number)
    (partial / "tls.laz").write_text(text)
    return disk.finish(partial, root, {"scene": number, **RECORD})


def test_a_finished_scene_has_its_name_and_its_digests(tmp_path):
    folder = made(tmp_path, 7)
    assert folder.name == "000007"
    found = disk.read_scene(folder)
    assert found.record["files"]["tls.laz"]["sha256"] == disk.digest_of(folder / "tls.laz")
    assert [one.number for one in disk.scenes_done(tmp_path)] == [7]


def test_who_comes_second_throws_his_away(tmp_path):
    before = (made(tmp_path, 7) / "scene.json").stat().st_ino
    assert (made(tmp_path, 7) / "scene.json").stat().st_ino == before
    assert os.listdir(tmp_path / "scenes") == ["000007"]


@pytest.mark.parametrize(
    ("damage", "ours"),
    [("record", False), ("file", True), ("other", False), ("more", False), ("empty", True)],
)
def test_what_is_not_whole_is_not_done_and_made_anew_where_it_is_ours(tmp_path, damage, ours):
    folder = made(tmp_path, 3)
    if damage == "record":
        (folder / "scene.json").write_text('{"scene": 3')
    elif damage == "file":
        (folder / "tls.laz").unlink()
    elif damage == "other":
        (folder / "tls.laz").write_text("poin")
    elif damage == "more":
        (folder / "tls.laz").unlink()
        (folder / "notes.txt").write_text("mine")
    else:
        for path in folder.iterdir():
            path.unlink()
    disk.begin(tmp_path, 4)
    assert list(disk.scenes_done(tmp_path)) == []
    disk.clean(tmp_path)
    assert os.listdir(tmp_path / "scenes") == ["000003"]
    refused = nullcontext() if ours else pytest.raises(SpecError, match="not what Forest Sensing")
    with keeping(Keeper(tmp_path, "dataset")), refused:
        disk.claim_scene(tmp_path, 3)
    said = []
    with keeping(Keeper(tmp_path, "dataset", force=True, say=said.append)):
        disk.claim_scene(tmp_path, 3)
    assert bool(said) is not ours


def test_the_manifest_is_what_the_folders_say(tmp_path):
    made(tmp_path, 2)
    disk.write_status(tmp_path, 2, {"status": "done", "seconds": 2.5, "cpu": {"sensors": 1.5}})
    disk.write_status(
        tmp_path, 5, {"status": "failed", "kind": "timeout", "why": "ran past its time"}
    )
    (row,) = rows_of(tmp_path, [])
    assert (row["scene"], row["status"], row["points"], row["cpu_seconds"]) == (
        "000002",
        "done",
        3,
        1.5,
    )
    disk.remove_scene(tmp_path, 2)
    assert rows_of(tmp_path, []) == []


def test_a_second_command_says_who_holds_the_folder(tmp_path):
    with only_one(tmp_path), pytest.raises(SpecError, match=f"in use by .*process {os.getpid()}"):
        with only_one(tmp_path):
            pass
    with only_one(tmp_path):  # free again; what an ended command left does not hold it
        assert json.loads((tmp_path / ".lock").read_text())["pid"] == os.getpid()
