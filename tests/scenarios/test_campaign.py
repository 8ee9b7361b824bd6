"""hilscenario.campaign where workers die: on this machine's processes and on a Dask cluster, every sample comes out once."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import joblib
import pytest
from joblib.externals.loky import get_reusable_executor

from hilbridge import cluster as cluster_room
from hilbridge.errors import InputError
from hilscenario import campaign
from hilscenario.campaign import Outcome, Sample, base_scenario, run_campaign, run_sample, samples_of, scenario_for
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.run import run_scenario

MARK = "HILBRIDGE_TEST_DIES_ONCE"


def dying_once(base: Scenario, sample: Sample) -> Outcome:
    """In a worker: the first one to come here is killed in the middle of its sample."""
    try:
        os.close(os.open(os.environ[MARK], os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return run_sample(base, sample)
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("unreachable")


@pytest.mark.parametrize("cluster", [None, "dask"])
def test_a_killed_worker_is_survived_and_every_sample_is_there_once(
    cluster: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if cluster == "dask":
        pytest.importorskip("distributed")
    get_reusable_executor().shutdown(wait=True)  # workers of an earlier test know nothing of the mark
    monkeypatch.setenv(MARK, str(tmp_path / "killed"))
    monkeypatch.setattr(campaign, "run_sample", dying_once)
    monkeypatch.setattr(campaign, "_CHUNK", 3)
    base = base_scenario()
    wanted = samples_of(base, 2, 1, ("bus.cut",))
    done: list[str] = []
    outcomes = run_campaign(base, wanted, tmp_path, jobs=2, cluster=cluster, progress=done.append)
    assert (tmp_path / "killed").exists()
    assert sorted(outcome.sample.key for outcome in outcomes) == sorted(sample.key for sample in wanted)
    assert len(done) == len(wanted)
    rows = [json.loads(line) for line in (tmp_path / "campaign.jsonl").read_text().splitlines()]
    assert sorted(Sample(**row["sample"]).key for row in rows[1:]) == sorted(sample.key for sample in wanted)


def test_what_was_done_before_the_end_came_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base = base_scenario()
    wanted = samples_of(base, 1, 1, ("bus.cut",))
    first = run_campaign(base, wanted[:2], tmp_path, jobs=1)
    ran: list[Sample] = []

    def watched(base: Scenario, sample: Sample) -> Outcome:
        ran.append(sample)
        return run_sample(base, sample)

    monkeypatch.setattr(campaign, "run_sample", watched)
    outcomes = run_campaign(base, wanted, tmp_path, jobs=1)
    assert ran == wanted[2:]
    assert {outcome.sample.key for outcome in outcomes} == {sample.key for sample in wanted}
    assert all(outcome in outcomes for outcome in first)


def test_workers_that_die_again_and_again_end_the_campaign_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(base: Scenario, sample: Sample) -> Outcome:
        raise OSError("the worker has gone")

    monkeypatch.setattr(campaign, "run_sample", broken)
    with pytest.raises(InputError, match=r"workers die again and again \(OSError: the worker has gone\)"):
        run_campaign(base_scenario(), samples_of(base_scenario(), 1, 1, ("bus.cut",)), tmp_path, jobs=1)


def test_what_dask_says_of_a_worker_that_died_too_often_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    tries: list[Sample] = []

    def once(base: Scenario, sample: Sample) -> Outcome:
        tries.append(sample)
        if len(tries) == 1:
            raise distributed.KilledWorker("sample", SimpleNamespace(address="tcp://gone:1"), 3)
        return run_sample(base, sample)

    monkeypatch.setattr(campaign, "run_sample", once)
    wanted = samples_of(base_scenario(), 1, 1, ("bus.cut",))
    assert len(run_campaign(base_scenario(), wanted, tmp_path, jobs=1)) == len(wanted)
    assert len(tries) == len(wanted) + 1


def test_what_ray_says_of_a_worker_that_died_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class RayActorError(Exception): ...

    told = SimpleNamespace(RayActorError=RayActorError, WorkerCrashedError=RayActorError)
    monkeypatch.setitem(sys.modules, "ray.exceptions", told)
    tries: list[Sample] = []

    def once(base: Scenario, sample: Sample) -> Outcome:
        tries.append(sample)
        if len(tries) == 1:
            raise RayActorError("the actor died")
        return run_sample(base, sample)

    monkeypatch.setattr(campaign, "run_sample", once)
    wanted = samples_of(base_scenario(), 1, 1, ("bus.cut",))
    assert len(run_campaign(base_scenario(), wanted, tmp_path, jobs=1)) == len(wanted)


def test_samples_that_do_not_come_back_are_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pools: list[int] = []

    class Forgetful(joblib.Parallel):  # as joblib's own on Ray after the death of a worker
        def __call__(self, iterable: Iterable[Any]) -> list[Any]:
            pools.append(1)
            return [] if len(pools) == 1 else super().__call__(iterable)

    monkeypatch.setattr(joblib, "Parallel", Forgetful)
    wanted = samples_of(base_scenario(), 1, 1, ("bus.cut",))
    assert len(run_campaign(base_scenario(), wanted, tmp_path, jobs=1)) == len(wanted)
    assert len(pools) == 2


@pytest.mark.parametrize(
    ("cluster", "said"),
    [("slurm", "write ray, ray://HOST:PORT, dask or dask://HOST:PORT"), ("dask://127.0.0.1:9", "cannot be reached")],
)
def test_a_cluster_that_cannot_be_had_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cluster: str, said: str
) -> None:
    if cluster.startswith("dask"):
        pytest.importorskip("distributed")
    monkeypatch.setattr(cluster_room, "_CONNECT_S", 1)
    with pytest.raises(InputError) as refused:
        run_campaign(base_scenario(), samples_of(base_scenario(), 1, 1, ("bus.cut",)), tmp_path, cluster=cluster)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_campaign_samples_are_seeded_and_injected_in_the_named_gate_state() -> None:
    base = base_scenario()
    assert samples_of(base, 3, 7, ("bus.cut",)) == samples_of(base, 3, 7, ("bus.cut",))
    assert samples_of(base, 3, 7, ("bus.cut",)) != samples_of(base, 3, 8, ("bus.cut",))
    run = run_scenario(scenario_for(base, Sample("bus.cut", "turning to hold", 0.0, 400.0, 3000, 0)))
    injected = run.trace["fault.bus.cut"].astype(bool)
    assert run.trace["device.state"][injected][0] in ("RampDown", "Ready")
    assert run_sample(base, Sample("bus.cut", "acting", 100.0, 400.0, 3000, 0)).safe
