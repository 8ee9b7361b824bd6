"""Plant and device across a bus of the test's own: what each does while the other is late, silent or gone."""

from __future__ import annotations

import pytest

from firmware_sim.bench.mechanics import Elbow
from firmware_sim.bench.plant import LATE_ECHO, SILENT_STEPS, Plant
from firmware_sim.bench.remote import MOST_WAITING, SILENT_TICKS, RemoteDevice
from firmware_sim.bench.wire import Torque, read_torque
from firmware_sim.controllers import power_on
from firmware_sim.memory import Received
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.states import State


class Bench:
    """A plant and a device, a millisecond at a time; frames the one way and the other can be held back."""

    def __init__(self, wearer: str = "sway") -> None:
        self.plant = Plant(Elbow(wearer))
        self.device = RemoteDevice(power_on("python", DEMO_KEY, 1))
        self.to_device = self.to_plant = True

    def run(self, milliseconds: int) -> Bench:
        for _ in range(milliseconds):
            for can_id, data in self.plant.step(late=False):
                if self.to_device:
                    self.device.hear(can_id, data)
            self.device.tick((), 7)
            torque = read_torque(self.device.answer()[1])
            assert torque is not None
            if self.to_plant:
                self.plant.hear(torque)
        return self

    @property
    def state(self) -> State:
        return self.device.state.state


def test_a_device_follows_on_the_plants_readings() -> None:
    bench = Bench().run(2000)
    assert bench.state is State.FOLLOW
    account = bench.plant.account
    assert (account.steps, account.answers, account.late_answers, account.repeated, account.lost) == (
        2000,
        2000,
        0,
        0,
        0,
    )
    assert account.silences == 0
    assert bench.device.missed == 0
    assert 0 < account.peak_unm < 3_000_000


def test_torque_stops_when_the_device_falls_silent_and_comes_back_with_it() -> None:
    bench = Bench().run(500)
    assert bench.plant.torque_unm[0] != 0
    bench.to_plant = False
    bench.run(SILENT_STEPS)
    assert bench.plant.torque_unm[0] != 0
    bench.run(1)
    assert bench.plant.torque_unm == (0, 0)
    assert bench.plant.silent
    assert bench.plant.account.silences == 1
    bench.to_plant = True
    bench.run(2)
    assert not bench.plant.silent
    assert bench.plant.torque_unm[0] != 0


def test_a_repeated_answer_feeds_nothing() -> None:
    plant = Plant(Elbow("still"))
    for _ in range(SILENT_STEPS + 2):
        plant.hear(Torque(1, 0, (500_000, 0)))
        plant.step(late=False)
    assert plant.account.repeated == SILENT_STEPS + 1
    assert plant.silent
    assert plant.torque_unm == (0, 0)


def test_gaps_old_readings_and_late_steps_are_counted() -> None:
    plant = Plant(Elbow("still"))
    for _ in range(10):
        plant.step(late=True)
    plant.hear(Torque(1, 10, (0, 0)))
    plant.hear(Torque(4, 10 - LATE_ECHO, (0, 0)))
    assert (plant.account.lost, plant.account.late_answers, plant.account.late_steps) == (2, 1, 10)


def test_a_device_without_a_plant_has_no_sensors_and_gives_no_torque() -> None:
    bench = Bench().run(500)
    bench.to_device = False
    bench.run(SILENT_TICKS)
    assert bench.state is State.FOLLOW
    bench.run(4)
    assert bench.state is State.PASSIVE
    assert bench.device.state.follow_unm == 0
    bench.to_device = True
    bench.run(1500)
    assert bench.state is State.FOLLOW


def test_readings_that_come_unevenly_are_no_fault() -> None:
    """Two at once every other millisecond, as from a computer that wakes every 2 ms."""
    bench = Bench()
    held: list[tuple[int, bytes]] = []
    for number in range(3000):
        held += bench.plant.step(late=False)
        if number % 2:
            for can_id, data in held:
                bench.device.hear(can_id, data)
            held.clear()
        bench.device.tick((), 7)
        torque = read_torque(bench.device.answer()[1])
        assert torque is not None
        bench.plant.hear(torque)
    assert bench.state is State.FOLLOW
    assert bench.plant.account.late_answers == 0


def test_readings_that_have_gathered_are_no_present() -> None:
    bench = Bench().run(300)
    for _ in range(MOST_WAITING + 5):
        for can_id, data in bench.plant.step(late=False):
            bench.device.hear(can_id, data)
    bench.run(5)
    assert bench.device.dropped > 0
    assert bench.plant.account.late_answers <= MOST_WAITING


def test_the_hand_at_the_plant_is_the_hand_at_the_device() -> None:
    bench = Bench().run(300)
    bench.device.tick((Received(1, b""),), 7)
    assert bench.state is State.ESTOP
    bench.plant.press_steps = 1
    seen = []
    advance = bench.device._advance

    def watched(state: object, inputs: object, now_ms: int) -> None:
        seen.append(inputs.local_clear)  # type: ignore[attr-defined]
        advance(state, inputs, now_ms)  # type: ignore[arg-type]

    bench.device._advance = watched
    bench.run(3)
    assert seen == [True, False, False]


@pytest.mark.parametrize("key", ["assist_nm", "angle_deg", "velocity_deg_s", "state", "accepted_ms"])
def test_its_log_has_what_a_simulated_device_logs(key: str) -> None:
    assert key in Bench().run(10).device.record()
