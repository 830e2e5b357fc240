"""What a cluster is asked for, without one: the script of a Slurm job, and words for mistakes."""

import shutil
import subprocess

import pytest

from forest_addon.spec import SpecError
from headless.dataset import engine
from headless.dataset.engine import Cluster, make_all, slurm_cluster


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


@pytest.mark.slow
def test_a_scheduler_by_tls_lets_in_who_has_a_certificate_of_its_authority(tmp_path, monkeypatch):
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    if not shutil.which("openssl"):
        pytest.skip("no openssl")
    ours, other = certificate(tmp_path / "ours", "ours"), certificate(tmp_path / "other", "other")
    monkeypatch.setattr(
        engine, "work", lambda job: {"result": "done", "scene": job["recipe"]["number"]}
    )
    monkeypatch.setattr(engine, "CAN_START_IN", 2)
    jobs = [{"recipe": {"number": number}} for number in range(3)]
    settings = ours | {"distributed.comm.require-encryption": True}
    with dask.config.set(settings):
        secure = distributed.Security()
        here = {"n_workers": 1, "threads_per_worker": 1, "processes": False}
        cluster = distributed.LocalCluster(
            **here, dashboard_address=None, security=secure, protocol="tls://"
        )
    with cluster:
        address = Cluster(scheduler=cluster.scheduler_address)
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
    assert sorted(one["scene"] for one in done) == [0, 1, 2]
