"""Parts of work on processes and clusters: all come back in their order, also where a worker is killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from hilbridge.cluster import run_all, workers
from hilbridge.errors import InputError


def dying_once(mark: str, number: int) -> int:
    """In a worker: the first one to come here is killed."""
    try:
        os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return number * number
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("unreachable")


@pytest.mark.parametrize("cluster", [None, "dask"])
def test_a_lost_workers_part_is_done_again(cluster: str | None, tmp_path: Path) -> None:
    if cluster == "dask":
        pytest.importorskip("distributed")
    parts = [(str(tmp_path / "killed"), number) for number in range(5)]
    told: list[int] = []
    with workers(2, cluster) as pools:
        assert run_all(pools, dying_once, parts, "squares", told.append) == [0, 1, 4, 9, 16]
    assert told == [0, 1, 4, 9, 16]
    assert (tmp_path / "killed").exists()


def gone(number: int) -> int:
    raise OSError("the worker has gone")


def test_what_cannot_work_is_one_line() -> None:
    with workers(1, None) as pools, pytest.raises(InputError, match=r"squares: workers die .* \(OSError: the worker"):
        run_all(pools, gone, [(1,)], "squares")
    for jobs, cluster, said in ((0, None, "jobs 0: somebody"), (1, "slurm", "write ray, ray://HOST:PORT, dask")):
        with pytest.raises(InputError, match=said), workers(jobs, cluster):
            pass


def square(number: int) -> int:
    return number * number


def test_an_error_of_whoever_is_told_is_no_lost_worker() -> None:
    def closed(made: int) -> None:
        raise BrokenPipeError("nobody reads")

    with workers(1, None) as pools, pytest.raises(BrokenPipeError):
        run_all(pools, square, [(1,)], "squares", closed)
