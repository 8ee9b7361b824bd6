"""Commands for whoever looks at the bus from outside: the DBC, what is on a bus in words, the documents."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hilbridge.errors import InputError
from hilbridge.files import write_whole

if TYPE_CHECKING:
    from hilbridge.records import Frame
    from hilbridge.wire.link import WireLink


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command("dbc")(dbc)
    app.command("candump")(candump)
    app.command("docs")(docs)
    app.command()(conformance)
    app.command()(plant)
    app.command()(monitor)


def dbc(
    out: Annotated[Path | None, typer.Option(help="file to write; default: print it")] = None,
    of_plant: Annotated[bool, typer.Option("--plant", help="the one of the plant bus (hilbridge plant)")] = False,
) -> None:
    """The DBC of bridge and device, for cantools, SavvyCAN, Wireshark and your own firmware."""
    from hilbridge.wire.dbc import default_dbc_path

    path = default_dbc_path()
    text = (path.with_name("plant.dbc") if of_plant else path).read_text(encoding="utf-8")
    if out is None:
        typer.echo(text, nl=False)
    elif out.exists():
        raise InputError(f"{out}: is there already; name another file")
    else:
        write_whole(out, text)


def docs(name: Annotated[str | None, typer.Argument(help="which; without it they are listed")] = None) -> None:
    """Print one of the documents that come with the program."""
    folder = Path(__file__).parent / "docs"
    known = {path.stem: path for path in sorted(folder.glob("*.md"))}
    if name is None:
        for stem, path in known.items():
            typer.echo(f"{stem:<20} {path.read_text(encoding='utf-8').splitlines()[0].lstrip('# ')}")
    elif name not in known:
        raise InputError(f"docs {name}: no such document; there are {', '.join(known)}")
    else:
        typer.echo(known[name].read_text(encoding="utf-8"))


def plant(
    bus: Annotated[
        str, typer.Option("--bus", help="a bus of its own: can1, vcan1, hilsim:NAME, any interface:channel")
    ],
    wearer_torque: Annotated[str, typer.Option(help="still, reach, sway or tremor")] = "reach",
    seconds: Annotated[float | None, typer.Option(min=0.1, help="stop after so long; default: at Ctrl-C")] = None,
    json_log: Annotated[Path | None, typer.Option(metavar="FILE", help="torque every 5 ms, as JSON lines")] = None,
    on_a_bench: Annotated[
        bool, typer.Option("--i-am-on-a-bench", help="nobody wears the device; needed on a physical bus")
    ] = False,
) -> None:
    """Run arm, motor and wearer in real time for a device under test, over a CAN bus of their own (dbc/plant.dbc)."""
    import subprocess

    command = [sys.executable, "-m", "firmware_sim.bench.process", "--bus", bus, "--wearer-torque", wearer_torque]
    command += ["--seconds", str(seconds)] if seconds is not None else []
    command += ["--json-log", str(json_log)] if json_log is not None else []
    command += ["--i-am-on-a-bench"] if on_a_bench else []
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            try:
                process.wait()
            except KeyboardInterrupt:  # the plant has heard it, too, and says what it has counted
                continue
    if process.returncode:
        raise typer.Exit(process.returncode)


def conformance(
    bus: Annotated[str | None, typer.Option("--bus", help="auto, vcan0, can0, any interface:channel")] = None,
    bus_option: Annotated[
        list[str] | None, typer.Option(metavar="KEY=VALUE", help="for the interface, such as bitrate=500000")
    ] = None,
    config: Annotated[Path | None, typer.Option("--config", help="bridge.toml: bus, DBC, key, bundle")] = None,
    key_file: Annotated[Path | None, typer.Option(help="16-byte key as hex, mode 0600")] = None,
    bundle: Annotated[Path | None, typer.Option(help="the bundle that this bench is for, if any")] = None,
    only: Annotated[list[str] | None, typer.Option(metavar="CLAIM", help="this claim alone; many times")] = None,
    phases: Annotated[int, typer.Option(min=1, max=1000, help="of each reaction time")] = 10,
    margin_ms: Annotated[float, typer.Option(min=0.0, max=10.0, help="what this computer and bus may add")] = 5.0,
    clear_command: Annotated[
        str | None, typer.Option(metavar="COMMAND", help="presses the device's button; default: you are asked to")
    ] = None,
    on_a_bench: Annotated[
        bool, typer.Option("--i-am-on-a-bench", help="nobody wears the device; needed on a physical bus")
    ] = False,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="JUnit XML, too")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="one JSON object instead of lines")] = False,
) -> None:
    """Test any device against the contract over its bus, before anybody puts it on. Exit code 1 unless all is kept."""
    from hilbridge.config import load_config, parse_options
    from hilbridge.conformance import report
    from hilbridge.conformance.plan import chosen
    from hilbridge.conformance.run import Asked, run_conformance
    from hilbridge.runtime.assemble import read_parts

    given: dict[str, dict[str, object]] = {
        "bus": {"spec": bus, "key_file": str(key_file) if key_file else None}
        | {"options": parse_options(bus_option) if bus_option else None},
        "model": {"bundle": str(bundle) if bundle else None},
    }
    settings = load_config(config, given)
    asked = Asked(chosen(only or []), phases, margin_ms, clear_command, on_a_bench)

    def say(text: str) -> None:
        typer.echo(text, err=as_json)

    findings = run_conformance(
        settings, read_parts(settings), asked, lambda one: None if as_json else say(report.line_of(one)), say
    )
    if junit is not None:
        report.write_junit(findings, settings.bus.spec, junit)
    typer.echo(json.dumps(report.as_json(findings, settings.bus.spec)) if as_json else report.summary_of(findings))
    if not report.passed(findings):
        raise typer.Exit(1)


def monitor(
    bus: Annotated[str, typer.Option("--bus", help="auto, vcan0, can0, hilsim:NAME, any interface:channel")] = "auto",
    recording: Annotated[Path | None, typer.Option("--recording", help="show this (.mcap or a run's folder)")] = None,
    bundle: Annotated[Path | None, typer.Option(help="the bridge's, for its thresholds; default: the demo's")] = None,
    host: Annotated[str, typer.Option(help="address to serve on; beyond this computer it takes token and TLS")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(min=0, max=65535, help="of the page; 0: any that is free")] = 0,
    token_file: Annotated[Path | None, typer.Option(help="the secret of the address, mode 0600; default: new")] = None,
    certificate: Annotated[Path | None, typer.Option(help="PEM, for TLS")] = None,
    certificate_key: Annotated[Path | None, typer.Option(help="PEM, for TLS")] = None,
    listen_only: Annotated[bool, typer.Option("--listen-only", help="send nothing: the page has no STOP")] = False,
    open_page: Annotated[bool, typer.Option("--open", help="open the page in a browser")] = False,
) -> None:
    """Show bridge and device on a page (extra `monitor`), from the bus or a recording. It can send STOP, nothing else."""
    import asyncio
    import threading

    from hilbridge.cli_shared import open_in_browser
    from hilbridge.intent.bundle import demo_bundle_path
    from hilbridge.monitor.access import access_of
    from hilbridge.monitor.run import watch_bus, watch_recording

    access = access_of(host, port, token_file, certificate, certificate_key)

    def ready(url: str) -> None:
        typer.echo(f"monitor at {url} (Ctrl-C ends)")
        sys.stdout.flush()
        if open_page:  # in a thread: some browsers are waited for, and the page must be served meanwhile
            threading.Thread(target=open_in_browser, args=(url,), daemon=True).start()

    if recording is not None:
        asyncio.run(watch_recording(recording, access, ready))
    else:
        asyncio.run(watch_bus(bus, bundle or demo_bundle_path(), access, ready, listen_only=listen_only))


def candump(
    bus: Annotated[str, typer.Option("--bus", help="auto, vcan0, can0, hilsim:NAME, any interface:channel")] = "auto",
    seconds: Annotated[float | None, typer.Option(min=0.0, help="stop after so long; default: at Ctrl-C")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="one JSON object a frame")] = False,
) -> None:
    """Print every frame of a bus in words, checked as the bridge checks it. Sends nothing."""
    import asyncio

    asyncio.run(_dump(bus, seconds, as_json))


async def _dump(bus: str, seconds: float | None, as_json: bool) -> None:
    import asyncio

    from hilbridge.bus.port.asyncio_port import BusPort
    from hilbridge.wire.codec import Codec
    from hilbridge.wire.link import WireLink

    link = WireLink(Codec(), node="")  # nobody's own messages: all are read
    async with BusPort.open(bus, listen_only=True) as port:
        begin_ns = time.monotonic_ns()
        try:
            async with asyncio.timeout(seconds):
                while True:
                    frame = await port.receive()
                    told = in_words(link, frame, ((frame.received_ns or begin_ns) - begin_ns) / 1e9)
                    typer.echo(json.dumps(told) if as_json else _line(told))
                    sys.stdout.flush()
        except TimeoutError:
            return


def in_words(link: WireLink, frame: Frame, at_s: float) -> dict[str, Any]:
    """One frame: when, what, and what is wrong with it, if anything."""

    from hilbridge.wire.codec import Decoded

    told: dict[str, Any] = {
        "s": round(at_s, 6),
        "id": f"{frame.can_id:0{8 if frame.is_extended else 3}X}",
        "data": frame.data.hex(" ").upper(),
    }
    if frame.is_error:
        return {**told, "name": "error frame"}
    outcome = link.decode(frame)
    if isinstance(outcome, Decoded):
        return {**told, "name": outcome.name, "counter": outcome.counter, "signals": dict(outcome.signals)}
    return {**told, "name": outcome.name, "rejected": outcome.reason.value}


def _line(told: dict[str, Any]) -> str:
    signals = " ".join(f"{name}={value}" for name, value in told.get("signals", {}).items())
    what = f"rejected: {told['rejected']}" if "rejected" in told else signals
    return f"{told['s']:12.6f}  {told['id']:>8}  [{told['data']}]  {told['name'] or 'not ours'}  {what}".rstrip()
