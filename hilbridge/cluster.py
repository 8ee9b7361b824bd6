"""Work on several processes of this machine, or on a Ray or Dask cluster through their joblib backends.

What a worker that died had not given back is done again; after three times in a row without a result it is said in one line.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import joblib

from hilbridge.errors import InputError
from hilbridge.lease import end_with

_RETRIES = 3
_CONNECT_S = 10
Pools = Callable[[], joblib.Parallel]


@contextmanager
def workers(jobs: int, cluster: str | None) -> Iterator[Pools]:
    """What makes joblib pools on this machine or on a cluster. Raises InputError where that cannot be had."""

    def pool() -> joblib.Parallel:
        return joblib.Parallel(n_jobs=jobs)

    def own_pool() -> joblib.Parallel:  # workers that end with this process; a cluster's are the cluster's own
        return joblib.Parallel(n_jobs=jobs, return_as="generator", initializer=end_with, initargs=(os.getpid(),))

    if jobs == 0:
        raise InputError("jobs 0: somebody has to work; write 1 or more, or -1 for all cores")
    if cluster is None:
        yield own_pool
        return
    kind, _, _ = cluster.partition(":")
    try:
        clusters = {"ray": _on_ray, "dask": _on_dask}[kind]
    except KeyError:
        raise InputError(f"cluster {cluster!r}: write ray, ray://HOST:PORT, dask or dask://HOST:PORT") from None
    with clusters(cluster, jobs), joblib.parallel_config(backend=kind):
        yield pool


def run_all(
    pools: Pools,
    function: Callable[..., Any],
    parts: Sequence[tuple[Any, ...]],
    what: str,
    on_done: Callable[[Any], None] = lambda made: None,
) -> list[Any]:
    """`function` of each part's arguments, in their order. Raises InputError beginning with `what` where workers keep dying.

    on_done: told what each part made, once, in order; on a cluster when all are there.
    """
    made: list[Any] = []
    attempt = 0
    while len(made) < len(parts):
        came = len(made)
        try:
            for one in _results(pools, function, parts[came:]):
                made.append(one)
                on_done(one)
        except _LostWorkerError as lost:
            attempt = attempt + 1 if len(made) == came else 1
            if attempt > _RETRIES:
                raise InputError(f"{what}: workers die again and again ({lost})") from None
    return made


class _LostWorkerError(Exception):
    """A worker died. Of its own, so that an error of whoever is told of a result is not taken for one."""


def _results(pools: Pools, function: Callable[..., Any], parts: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
    """What each part makes, in order, from a new pool: one that lost a worker of Ray's answers its next call with nothing."""
    count = 0
    try:
        for one in pools()(joblib.delayed(function)(*arguments) for arguments in parts):
            count += 1
            yield one
    except _lost_worker() as error:
        raise _LostWorkerError(f"{type(error).__name__}: {error}") from None
    if count != len(parts):
        raise _LostWorkerError(f"{count} of {len(parts)} parts came back")


@contextmanager
def _on_ray(cluster: str, jobs: int) -> Iterator[None]:
    try:
        import ray
        from ray.util.joblib import register_ray
    except ImportError:
        raise InputError(f"cluster {cluster!r} needs the package ray; pip install 'hilbridge[ray]'") from None
    address = None if cluster == "ray" else cluster
    try:
        ray.init(address=address, log_to_driver=False, include_dashboard=False)
    except (ConnectionError, ValueError) as error:
        raise _unreachable(cluster, error) from None
    register_ray()
    try:
        yield
    finally:
        ray.shutdown()


@contextmanager
def _on_dask(cluster: str, jobs: int) -> Iterator[None]:
    """Connects to a Dask scheduler, or starts a local one. A worker does one part at a time: parts only compute."""
    try:
        from dask.distributed import Client, LocalCluster
    except ImportError:
        raise InputError(f"cluster {cluster!r} needs the package distributed; pip install 'hilbridge[dask]'") from None
    _, _, place = cluster.partition("://")
    if place:
        try:
            client = Client(f"tcp://{place}", timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise _unreachable(cluster, error) from None
        with client:
            yield
        return
    count = jobs if jobs > 0 else joblib.cpu_count()
    with LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as own, Client(own):
        yield


def _unreachable(cluster: str, error: Exception) -> InputError:
    return InputError(
        f"cluster {cluster!r}: cannot be reached ({str(error).splitlines()[0]}); is its scheduler running?"
    )


def _lost_worker() -> tuple[type[Exception], ...]:
    """The exceptions by which joblib, Dask and Ray report a dead worker."""
    lost: tuple[type[Exception], ...] = (OSError, RuntimeError)
    if (dask := sys.modules.get("distributed")) is not None:  # only work on Dask has it
        lost += (dask.KilledWorker,)
    if (ray := sys.modules.get("ray.exceptions")) is not None:
        lost += (ray.RayActorError, ray.WorkerCrashedError)
    return lost
