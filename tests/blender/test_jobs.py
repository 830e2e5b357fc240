"""Jobs: what runs where, what comes back, and what a cancelled job leaves."""

import threading
import time

import pytest

from forest_addon.blender.jobs import Job, Task


def drive(job, seconds=10.0):
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


def test_cancel_stops_the_task_and_runs_nothing_more():
    begun, reached, tidied = threading.Event(), [], []

    def endless(tell):
        while True:
            begun.set()
            tell(0, 1)
            time.sleep(0.001)

    def work():
        try:
            yield Task("endless", endless)
            reached.append("after")
        finally:
            tidied.append(threading.current_thread())

    job = Job("endless", work())
    assert not job.step()
    assert begun.wait(5)
    assert job.busy
    job.cancel()
    assert tidied == [threading.main_thread()]
    end = time.monotonic() + 5
    while job.busy and time.monotonic() < end:
        time.sleep(0.001)
    assert not job.busy
    assert not reached


def test_the_share_is_what_the_task_told():
    gate = threading.Event()

    def half(tell):
        tell(1, 2)
        gate.wait(5)

    def work():
        yield Task("half", half)
        return "done"

    job = Job("half", work())
    job.step()
    end = time.monotonic() + 5
    while job.share != 0.5 and time.monotonic() < end:
        time.sleep(0.001)
    assert (job.label, job.share) == ("half", 0.5)
    gate.set()
    assert drive(job) == "done"
