"""Workers that are killed, hang or cannot be opened: every task has one outcome, and nothing waits
for ever.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections import Counter, deque
from pathlib import Path

import pytest

from physic_batch.workers import WorkerSettings, free_memory_mb, run_in_workers
from physic_core.errors import BackendError, ConfigError, OutputError

from .conftest import STANDIN

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")


@pytest.fixture
def standin(monkeypatch):
    """The module of the workers, which imports little; their processes find it on the same path."""
    monkeypatch.syspath_prepend(STANDIN)
    import worker_standin

    return worker_standin


def outcomes(standin, *tasks, **settings):
    found = list(run_in_workers(tasks, standin.open_worker, WorkerSettings(**settings)))
    assert Counter(outcome.task for outcome in found) == Counter(tasks)
    return {outcome.task: outcome for outcome in found}


def test_two_workers_share_the_tasks_and_are_opened_once(standin, tmp_path):
    tasks = [str(tmp_path / f"meet{i}") for i in range(12)]
    found = list(run_in_workers(tasks, standin.open_worker, WorkerSettings(2)))
    assert sorted(outcome.task for outcome in found) == sorted(tasks)
    assert len({outcome.value.rpartition(" ")[2] for outcome in found}) == 2
    assert all((outcome.failure, outcome.attempts) == ("", 1) for outcome in found)
    assert all(outcome.peak_mb > 5 for outcome in found)


def test_a_task_that_takes_its_worker_down_is_tried_twice_and_stops_no_other(standin, tmp_path):
    ends = {"abort": "SIGABRT", "killed": "memory is too small", "exit": "code 7"}
    found = outcomes(standin, "a", *ends, "b", "c", count=1, logs=tmp_path)
    for number, (task, how) in enumerate(ends.items()):
        bad = found.pop(task)
        assert (bad.failure, bad.attempts) == ("WorkerDied", 2)
        assert how in bad.message
        assert str(tmp_path / f"worker-{2 * number + 1}.txt") in bad.message
    assert all(outcome.failure == "" for outcome in found.values())
    assert "Fatal Python error: Aborted" in (tmp_path / "worker-1.txt").read_text()


def test_a_worker_that_was_killed_for_another_reason_costs_no_photo(standin, tmp_path):
    task = str(tmp_path / "once")
    found = outcomes(standin, "a", task, "b", count=2)
    assert (found[task].failure, found[task].attempts) == ("", 2)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_time_limit_counts_work_and_not_what_other_programs_take(standin):
    found = outcomes(standin, "spin", "slow", "hang", timeout=1.0)
    assert {name: outcome.failure for name, outcome in found.items()} == {
        "spin": "Timeout",
        "slow": "",
        "hang": "Timeout",
    }
    assert "s of work" in found["spin"].message
    assert "no work" in found["hang"].message
    assert all("--retry failed" in found[name].message for name in ("spin", "hang"))


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("refuse", ConfigError, "preset mock: 1 error"),
        ("refuse_oddly", BackendError, "KeyError: 'weights'"),
        ("crash", BackendError, "SIGABRT"),
    ],
)
def test_workers_that_cannot_start_end_the_batch_at_once(standin, name, kind, message):
    with pytest.raises(kind, match=message):
        list(run_in_workers(["a", "b", "c"], getattr(standin, name), WorkerSettings(3)))


def test_the_number_of_workers_may_depend_on_the_memory_of_the_first(standin, tmp_path):
    asked = []

    def count(peak_mb):
        asked.append(peak_mb)
        return 2

    tasks = ["alone", *(str(tmp_path / f"meet{i}") for i in range(4))]
    found = list(run_in_workers(tasks, standin.open_worker, WorkerSettings(count)))
    assert len(asked) == 1
    assert asked[0] > 5
    assert len({outcome.value.rpartition(" ")[2] for outcome in found}) == 2


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script = (
        "import os, sys\n"
        "from functools import partial\n"
        f"sys.path.insert(0, {str(STANDIN)!r})\n"
        "import worker_standin\n"
        "from physic_batch.workers import *\n"
        "if __name__ == '__main__':\n"
        "    for outcome in run_in_workers(['a', 'b', 'hang', 'hang'], worker_standin.open_worker, "
        "WorkerSettings(2)):\n"
        "        print(outcome.value, flush=True)\n"
    )
    (tmp_path / "parent.py").write_text(script)
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py")], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        pids = {int(parent.stdout.readline().rpartition(" ")[2]) for _ in range(2)}
        parent.kill()
    for _ in range(300):
        if not any(alive(pid) for pid in pids):
            return
        time.sleep(0.1)
    raise AssertionError(f"still running: {pids}")


def alive(pid):
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (OSError, IndexError):
        return False


def test_tasks_may_be_given_one_after_the_other_to_a_worker_that_stays_open(standin):
    waiting = deque()
    outcomes = run_in_workers(
        iter(waiting.popleft, None), standin.open_worker, WorkerSettings(timeout=20.0)
    )
    found = []
    for task in ("a", "b", "abort", "c"):
        waiting.append(task)
        found.append(next(outcomes))
    first, second, bad, again = found
    assert [one.value.split()[0] for one in (first, second, again)] == ["a", "b", "c"]
    assert first.value.split()[-1] == second.value.split()[-1] != again.value.split()[-1]
    assert (bad.failure, bad.attempts) == ("WorkerDied", 2)
    waiting.append("full")
    with pytest.raises(OutputError):
        next(outcomes)


@pytest.mark.parametrize(
    ("groups", "files", "free_mb"),
    [
        ("0::/\n", {}, 8000),
        ("0::/a/b\n", {"a/b/memory.max": "max", "a/memory.max": "3000000000"}, 2600),
        ("0::/a/b\n", {"a/b/memory.max": "2000000000", "a/memory.max": "3000000000"}, 1600),
        ("4:cpu:/\n3:memory:/a\n0::/\n", {"memory/a/memory.limit_in_bytes": "1500000000"}, 1100),
        ("3:memory:/seen/outside\n", {"memory/memory.limit_in_bytes": "1500000000"}, 1100),
    ],
    ids=["no limit", "limit above", "own limit", "version 1", "inside a container"],
)
def test_free_memory_is_that_of_machine_and_control_groups(tmp_path, groups, files, free_mb):
    (tmp_path / "proc" / "self").mkdir(parents=True)
    (tmp_path / "proc" / "meminfo").write_text("MemTotal: 9 kB\nMemAvailable:    8000000 kB\n")
    (tmp_path / "proc" / "self" / "cgroup").write_text(groups)
    for name, limit in files.items():
        path = tmp_path / "sys" / "fs" / "cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(limit)
        usage = "memory.usage_in_bytes" if "limit_in" in name else "memory.current"
        (path.parent / usage).write_text("500000000")
        (path.parent / "memory.stat").write_text(
            "anon 1\ninactive_file 100000000\ntotal_inactive_file 100000000\n"
        )
    assert free_memory_mb(tmp_path) == pytest.approx(free_mb)
