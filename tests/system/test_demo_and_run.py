"""The command line as a newcomer uses it: demo, run, doctor, bench, and what it says to wrong input."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import can
import pytest

from hilbridge import cli

PATIENCE_S = 300.0  # for a machine that is busy with something else
ACT_CMD = 0x060


def hilbridge(*arguments: str, timeout_s: float = PATIENCE_S, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hilbridge.cli", *arguments],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
        env={**os.environ, **environment},
    )


def await_command(bus: str) -> None:
    """Until a bridge speaks on a simulated bus: it ticks then, and listens to signals."""
    interface, _, channel = bus.partition(":")
    end = time.monotonic() + PATIENCE_S
    with can.Bus(interface=interface, channel=channel) as listener:
        while time.monotonic() < end:
            message = listener.recv(1.0)
            if message is not None and message.arbitration_id == ACT_CMD:
                return
    pytest.fail(f"no ACT_CMD on {bus} within {PATIENCE_S:g} s")


def one_object(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert done.returncode == 0, done.stderr
    lines = done.stdout.strip().splitlines()
    assert len(lines) == 1
    value = json.loads(lines[0])
    assert isinstance(value, dict)
    return value


def test_demo_opens_its_live_page_at_once_and_the_report_at_the_end(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp")
    opened = tmp_path / "opened"
    browser = tmp_path / "browser"
    browser.write_text(
        f"#!{sys.executable}\nimport sys, urllib.request\n"
        "page = urllib.request.urlopen(sys.argv[1]).read()\n"
        f"open({str(opened)!r}, 'a').write(f'{{sys.argv[1]}} {{len(page) > 1000}}\\n')\n"
    )
    browser.chmod(0o755)
    done = hilbridge(
        "demo", "--seconds", "5", "--out", str(tmp_path / "demo"), "--open", "--json", BROWSER=str(browser)
    )
    one_object(done)
    first, second = opened.read_text().splitlines()
    assert first.startswith("http://127.0.0.1:")
    assert first.endswith("/ True")
    assert second == f"{(tmp_path / 'demo' / 'report.html').as_uri()} True"
    assert "Traceback" not in done.stderr


def test_demo_acts_and_holds_and_loses_nothing(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    result = one_object(hilbridge("demo", "--seconds", "30", "--out", str(out), "--json"))
    assert result["acts"] >= 1
    assert result["holds"] >= 1
    # The bus loses nothing. On a machine that stands still for 60 ms the device withdraws what it could not send in time.
    assert result["frames_lost"] <= result["counters"]["device.TxDropped"]
    assert 0.0 < result["coverage"] < 1.0
    assert result["act_only_precision"] >= 0.8
    assert result["seconds"] == pytest.approx(30.0, abs=0.5)
    assert result["frames_sent"] >= 2 * result["ticks"]
    assert result["hold_reasons"]["confidence"] > 0
    assert set(result["latency_ms"]) == {"p50", "p99", "max"}
    assert 0.0 < result["latency_ms"]["p50"] <= result["latency_ms"]["p99"] <= result["latency_ms"]["max"]
    assert result["device_states"]["Assist"] > 0
    assert result["assist_s"] > 0.0
    assert Path(result["recording"]).stat().st_size > 10_000
    assert "What happened when" in Path(result["report"]).read_text(encoding="utf-8")
    for source in ("camera", "gaze", "features"):
        row = result["sensors"][source]
        assert row["received"] == row["used"] + row["overwritten"] + row["failed"]
    again = one_object(hilbridge("report", result["recording"], "--json"))
    assert again["acts"] == result["acts"]
    assert again["coverage"] == result["coverage"]


WRONG = [
    (("run",), "no camera is given; add --camera"),
    (("run", "--camera", "absent.mp4"), "camera absent.mp4: no such file"),
    (("run", "--camera", "{text}", "--no-hands"), "text.mp4: cannot be opened"),
    (("run", "--camera", "{video}", "--no-hands", "--gaze", "{empty}"), "empty.txt: the file is empty"),
    (("run", "--camera", "{video}", "--no-hands", "--gaze", "{cut}"), "cut.txt"),
    (("run", "--camera", "{video}", "--no-hands", "--bundle", "{text}"), "text.mp4"),
    (("run", "--camera", "{video}", "--no-hands", "--bundle", "{other}"), "layout"),
    (("run", "--camera", "{video}", "--no-hands", "--bus", "can77"), "can77"),
    (("run", "--camera", "{video}", "--no-hands", "--bus", "nonsense:0"), "nonsense"),
    (("run", "--camera", "{video}", "--config", "{config}"), "unknown key `sensors.camra`; did you mean `camera`?"),
    (("run", "--config", "{dbc_config}", "--camera", "{video}", "--no-hands"), "ACT_AUTH"),
    (("run", "--camera", "{video}", "--no-hands", "--key-file", "{open_key}"), "chmod 600"),
    (("report", "absent.mcap"), "absent.mcap: no such file"),
    (("demo", "--out", "{text}/demo"), "name a folder that can be written"),
    (("demo", "--bus", "can77", "--out", "{folder}/demo"), "demo key"),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Wrong input of every kind, by the name that WRONG uses."""
    import cv2
    import numpy as np

    import hilbridge.sensors.camera  # noqa: F401  # silences FFmpeg, which reads its log level once
    from hilbridge.intent.bundle import demo_bundle_path
    from hilbridge.wire.dbc import default_dbc_path

    folder = tmp_path_factory.mktemp("wrong")
    video = folder / "clip.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for level in range(10):
        writer.write(np.full((48, 64, 3), level * 20, np.uint8))
    writer.release()
    (folder / "text.mp4").write_text("no video, no bundle\n" * 20)
    (folder / "empty.txt").write_text("")
    (folder / "cut.txt").write_text("## [BeGaze]\n## Version:\tBeGaze 3.4\nTime\tType\tTri")
    bundle = demo_bundle_path().read_bytes()
    (folder / "other.safetensors").write_bytes(bundle.replace(b"layout_hash", b"layout_hasX", 1))
    (folder / "bridge.toml").write_text("[sensors]\ncamra = '0'\n")
    dbc = default_dbc_path().read_text()
    begin = dbc.index("BO_ 97 ACT_AUTH")
    (folder / "lacking.dbc").write_text(dbc[:begin] + dbc[dbc.index("BO_ 160 ") :].replace("97 ", "96 "))
    (folder / "dbc.toml").write_text(f"[bus]\ndbc = '{folder / 'lacking.dbc'}'\n")
    key = folder / "open.key"
    key.write_text("00112233445566778899aabbccddeeff\n")
    key.chmod(0o644)
    names = {"text": "text.mp4", "empty": "empty.txt", "cut": "cut.txt", "other": "other.safetensors"}
    names |= {"config": "bridge.toml", "dbc_config": "dbc.toml", "open_key": "open.key"}
    return {"folder": str(folder), "video": str(video), **{k: str(folder / v) for k, v in names.items()}}


@pytest.mark.parametrize(("arguments", "said"), WRONG)
def test_wrong_input_is_one_line_exit_2_and_nothing_half_written(
    files: dict[str, str],
    tmp_path: Path,
    arguments: tuple[str, ...],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    filled = [argument.format(**files) for argument in arguments]
    if filled[0] == "run":
        filled += ["--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", ["hilbridge", *filled])
    with pytest.raises(SystemExit) as left:
        cli.main()
    printed = capfd.readouterr()
    assert left.value.code == 2
    assert said in printed.err
    assert len(printed.err.strip().splitlines()) == 1, printed.err
    assert printed.out == ""
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_an_absent_hand_model_names_the_command_that_fetches_it(files: dict[str, str], tmp_path: Path) -> None:
    done = hilbridge("run", "--camera", files["video"], "--out", str(tmp_path), HILBRIDGE_MODELS=str(tmp_path / "none"))
    assert done.returncode == 2
    assert "hilbridge fetch-models" in done.stderr


def test_running_never_imports_torch() -> None:
    code = "import sys, hilbridge.cli, hilbridge.demo, hilbridge.run, hilbridge.doctor, hilbridge.runtime.senses;"
    done = subprocess.run(
        [sys.executable, "-c", code + "print('torch' in sys.modules)"], capture_output=True, text=True
    )
    assert done.stdout.strip() == "False", done.stderr


def test_doctor_says_what_is_ill_and_how_to_mend_it(files: dict[str, str]) -> None:
    done = hilbridge("doctor", "--camera", "absent.mp4", "--gaze", files["empty"], "--json")
    assert done.returncode == 1
    findings = {row["subject"]: row for row in json.loads(done.stdout)}
    assert findings["camera"]["verdict"] == "ill"
    assert findings["camera"]["cure"]
    assert findings["gaze"]["verdict"] == "ill"
    assert findings["bundle"]["verdict"] == "well"
    assert findings["packages"]["verdict"] == "well"
    assert {"python", "clock", "hand model", "bus", "real time"} <= set(findings)


def test_ctrl_c_ends_a_run_cleanly_with_its_report(files: dict[str, str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "hilbridge.cli", "run", "--camera", files["video"], "--no-hands", "--loop"]
    bus = f"hilsim:ctrl-c-{os.getpid()}"
    process = subprocess.Popen(
        [*command, "--bus", bus, "--out", str(out), "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        await_command(bus)
        process.send_signal(signal.SIGINT)
        said, errors = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    result = json.loads(said)
    assert result["acts"] == 0
    assert sum(result["hold_reasons"].values()) > 0
    assert (out / "report.html").exists()


def test_ctrl_backslash_stops_the_device_until_both_ends_clear_it(files: dict[str, str], tmp_path: Path) -> None:
    bus, out = f"hilsim:stop-{os.getpid()}", tmp_path / "out"
    device = subprocess.Popen(
        [sys.executable, "-m", "firmware_sim.node", "--bus", bus], stdout=subprocess.PIPE, text=True
    )
    assert device.stdout is not None
    assert "ready" in device.stdout.readline()
    command = [sys.executable, "-m", "hilbridge.cli", "run", "--camera", files["video"], "--no-hands", "--loop"]
    process = subprocess.Popen(
        [*command, "--bus", bus, "--seconds", "4", "--out", str(out), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        await_command(bus)
        process.send_signal(signal.SIGQUIT)
        said, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, errors
        stopped = json.loads(said)
        assert stopped["hold_reasons"]["stopped"] > 0
        assert stopped["device_states"]["EStop"] > 0

        process = subprocess.Popen(
            [*command, "--bus", bus, "--seconds", "6", "--out", str(out), "--force", "--json", "--clear-latch"],
            stdout=subprocess.PIPE,
            text=True,
        )
        while process.poll() is None:  # the hand at the device, until the bridge has authenticated
            device.send_signal(signal.SIGUSR1)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(0.25)
        cleared = json.loads(process.communicate()[0])
    finally:
        process.kill()
        device.terminate()
        last, _ = device.communicate(timeout=PATIENCE_S)
    assert cleared["device_states"]["Follow"] > 0
    assert '"state": "EStop"' not in last
