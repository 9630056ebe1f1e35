"""Jobs in processes: what they tell, how they fail, and that nothing of them is left."""

import multiprocessing
import os
import signal
import time

import pytest

from aoro_gym.execution.workers import THREADS, Failure, _Worker, spread


def note(tell, path, amount):
    """Tell ``amount``, and write what this process is to ``path``."""
    tell(amount)
    path.write_text(" ".join([str(os.getpid()), *(os.environ.get(name, "") for name in THREADS)]))


def act(tell, what):
    match what:
        case "raise":
            raise LookupError("no such spool")
        case "die":
            os._exit(7)
        case "sleep":
            time.sleep(600.0)


def test_jobs_are_shared_by_processes_of_one_thread(tmp_path):
    told = []
    jobs = {name: (tmp_path / name, number) for number, name in enumerate("abcdef", start=1)}
    ended = dict(spread(note, jobs, workers=2, tell=told.append))
    assert ended == dict.fromkeys("abcdef")
    assert sorted(told) == [1, 2, 3, 4, 5, 6]
    written = [(tmp_path / name).read_text().split() for name in "abcdef"]
    assert {tuple(threads) for _, *threads in written} == {("1",) * len(THREADS)}
    processes = {int(process) for process, *_ in written}
    assert len(processes) <= 2 and os.getpid() not in processes


def test_one_that_fails_takes_no_other_with_it():
    jobs = {name: (name,) for name in ("raise", "well", "die", "fine")}
    ended = dict(spread(act, jobs, workers=1))
    assert list(ended) == list(jobs), "one process keeps the order"
    assert ended["well"] is None and ended["fine"] is None
    raised, died = ended["raise"], ended["die"]
    assert isinstance(raised, Failure) and raised.reason == "LookupError: no such spool"
    assert 'raise LookupError("no such spool")' in raised.trace
    assert isinstance(died, Failure) and "exit code 7" in died.reason


def test_whoever_stops_listening_ends_them():
    before = dict(os.environ)
    ended = spread(act, {"well": ("well",), "long": ("sleep",), "longer": ("sleep",)}, workers=2)
    assert next(ended) == ("well", None)
    assert multiprocessing.active_children()
    begun = time.monotonic()
    ended.close()  # as Ctrl-C does
    assert time.monotonic() - begun < 60.0
    assert not multiprocessing.active_children()
    assert dict(os.environ) == before


def test_ctrl_c_does_not_reach_a_worker_that_begins(tmp_path, capfd):
    """Pressed before its first line of code, when it would end in a traceback."""
    worker = _Worker(note)
    assert worker.process.pid is not None
    os.kill(worker.process.pid, signal.SIGINT)
    worker.begin("a", (tmp_path / "a", 1))
    assert [worker.hear(), worker.hear()][-1] is None
    worker.end()
    assert (tmp_path / "a").exists()
    assert "KeyboardInterrupt" not in capfd.readouterr().err
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


def test_no_worker_is_refused():
    with pytest.raises(ValueError, match="workers is 0, but must be a positive integer"):
        next(spread(act, {"well": ("well",)}, workers=0))
    assert list(spread(act, {}, workers=1)) == []
