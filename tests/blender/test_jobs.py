"""Jobs: what runs where, what comes back, and what a cancelled job leaves."""

import sys
import threading
import time

import numpy as np
import pytest

from forest_addon.blender.jobs import Job, Task

PATIENCE = 300.0  # seconds, for a machine with much else to do; what is waited for comes at once


def drive(job, seconds=PATIENCE):
    """Step until the job is done, as a window's timer does."""
    end = time.monotonic() + seconds
    while not job.step():
        assert time.monotonic() < end, "the job does not end"
        time.sleep(0.001)
    return job.result


def two_steps(threads):
    def note(value):
        def run(tell):
            threads.append(threading.current_thread())
            for done in range(3):
                tell(done, 2)
            return value

        return run

    first = yield Task("one", note(1))
    threads.append(threading.current_thread())
    second = yield Task("two", note(2))
    return f"{first + second}"


def test_tasks_run_in_threads_and_the_rest_on_the_main_thread():
    threads = []
    assert drive(Job("sum", two_steps(threads))) == "3"
    assert threads[1] is threading.main_thread()
    assert threads[0] is not threading.main_thread()
    assert threads[2] is not threading.main_thread()


def test_without_a_window_all_is_done_here_and_now():
    threads, heard = [], []
    job = Job("sum", two_steps(threads))
    job.finish(lambda done, total: heard.append((done, total)))
    assert job.result == "3"
    assert set(threads) == {threading.main_thread()}
    assert heard == [(0, 2), (1, 2), (2, 2)] * 2


@pytest.mark.parametrize("run", [drive, Job.finish])
def test_a_problem_in_a_task_comes_out_where_it_was_yielded(run):
    def fail(tell):
        raise ValueError("no trees")

    def work():
        try:
            yield Task("failing", fail)
        except ValueError as problem:
            return f"caught {problem}"

    job = Job("failing", work())
    run(job)
    assert job.result == "caught no trees"


def test_an_unhandled_problem_leaves_through_step():
    def work():
        yield Task("failing", lambda tell: 1 / 0)

    with pytest.raises(ZeroDivisionError):
        drive(Job("failing", work()))


@pytest.mark.parametrize("pause", [lambda tell: tell(0, 1), lambda _: sum(range(1000))])
def test_cancel_stops_a_task_and_no_handler_on_the_way_keeps_it(pause):
    """Also one that never tells anything; nothing more is run."""
    begun, reached, tidied = threading.Event(), [], []

    def endless(tell):
        try:
            while True:
                begun.set()
                pause(tell)
        except Exception:
            reached.append("kept")

    def work():
        try:
            yield Task("endless", endless)
            reached.append("after")
        finally:
            tidied.append(threading.current_thread())

    job = Job("endless", work())
    assert not job.step()
    assert begun.wait(PATIENCE)
    assert job.busy
    job.cancel()
    assert tidied == [threading.main_thread()]
    wait_until_idle(job)
    assert not reached


def test_a_cancelled_job_ends_after_an_import_that_is_under_way(tmp_path, monkeypatch):
    """Half a module would stay half, for all that import it later."""
    begun, reached = threading.Event(), []
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "importing", (begun, reached), raising=False)
    (tmp_path / "slow_module.py").write_text(
        "import sys, time\nbegun, reached = sys.importing\nbegun.set()\n"
        "for _ in range(100):\n    time.sleep(0.002)\nreached.append('the end')\n"
    )

    def importing(tell):
        import slow_module  # noqa: F401 what a task loads when it needs it

        while True:
            time.sleep(0.001)

    def work():
        yield Task("importing", importing)

    job = Job("importing", work())
    assert not job.step()
    assert begun.wait(PATIENCE)
    job.cancel()
    wait_until_idle(job)
    assert reached == ["the end"]
    sys.modules.pop("slow_module")


def wait_until_idle(job):
    end = time.monotonic() + PATIENCE
    while job.busy and time.monotonic() < end:
        time.sleep(0.001)
    assert not job.busy


def test_cancel_when_a_task_has_just_ended_harms_nobody(monkeypatch):
    raised = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    for pause in np.linspace(0, 2e-3, 60):
        job = Job("short", (Task("short", lambda tell: tell(1, 1)) for _ in range(1)))
        job.step()
        time.sleep(pause)
        job.cancel()
        wait_until_idle(job)
    assert not raised


def test_threads_change_more_often_while_a_task_runs_and_then_as_before():
    seen, usual = [], sys.getswitchinterval()

    def work():
        yield Task("look", lambda _: seen.append(sys.getswitchinterval()))
        return "done"

    drive(Job("look", work()))
    assert seen[0] < usual / 5
    assert sys.getswitchinterval() == usual


def test_the_share_is_what_the_task_told():
    gate = threading.Event()

    def half(tell):
        tell(1, 2)
        gate.wait(PATIENCE)

    def work():
        yield Task("half", half)
        return "done"

    job = Job("half", work())
    job.step()
    end = time.monotonic() + PATIENCE
    while job.share != 0.5 and time.monotonic() < end:
        time.sleep(0.001)
    assert (job.label, job.share) == ("half", 0.5)
    gate.set()
    assert drive(job) == "done"
