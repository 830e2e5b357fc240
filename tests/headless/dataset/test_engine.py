"""What a cluster is asked for, without one: the script of a Slurm job, and words for mistakes."""

import shutil
import subprocess

import pytest

from forest_addon.spec import SpecError
from headless.dataset.engine import slurm_cluster


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
