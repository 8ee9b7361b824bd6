"""`hilbridge run`: its options, what they set, and the run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hilbridge.run import Outcome, RunOptions

Flag = bool | None  # None leaves it to the configuration
Camera = Annotated[str | None, typer.Option(help="device index, video file, rtsp:// URL, or neon:")]
Gaze = Annotated[str | None, typer.Option(help="neon:[HOST], lsl:STREAM, udp:PORT; or Neon folder, BeGaze .txt, .csv")]
Inertial = Annotated[str | None, typer.Option(help="hand acceleration: lsl:STREAM, udp:PORT, or iAssistADL folder")]
Skeleton = Annotated[str | None, typer.Option(help="wrists: lsl:STREAM, udp:PORT, or iAssistADL folder")]
CameraFps = Annotated[
    float | None, typer.Option(help="ask the camera for this rate, or play a file at it; ticks lock to 25")
]
Bus = Annotated[str | None, typer.Option("--bus", help="auto, vcan0, can0, or any python-can interface:channel")]
BusOption = Annotated[
    list[str] | None, typer.Option(metavar="KEY=VALUE", help="for the interface, such as bitrate=500000; many times")
]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="bridge.toml; the command line wins over it")]
BundleFile = Annotated[Path | None, typer.Option("--bundle", help="model bundle; default: the one that ships")]
Seconds = Annotated[float | None, typer.Option(min=0.1, help="stop after so long; default: at the end")]
RunFolder = Annotated[Path | None, typer.Option(help="folder for what it leaves behind; default: a new one in out/")]
Force = Annotated[bool, typer.Option("--force", help="replace the recording that --out holds already")]
Hands = Annotated[Flag, typer.Option("--hands/--no-hands", help="find hands with MediaPipe")]
Loop = Annotated[Flag, typer.Option("--loop", help="start a recording again at its end")]
KeyFile = Annotated[Path | None, typer.Option(help="16-byte key as hex, mode 0600")]
ListenOnly = Annotated[Flag, typer.Option("--listen-only/--send", help="default: listen only on a physical bus")]
Arm = Annotated[Flag, typer.Option("--arm", help="may send ACT on a physical bus")]
Uncertified = Annotated[
    Flag, typer.Option("--uncertified", help="a bench: arm although nobody certified the bundle's threshold")
]
Video = Annotated[Flag, typer.Option("--video/--no-video", help="record the pictures; default: yes")]
RotateMb = Annotated[float | None, typer.Option(help="next part of the recording after so many megabytes")]
RotateMinutes = Annotated[float | None, typer.Option(help="... or after so many minutes")]
Retain = Annotated[
    float | None, typer.Option(metavar="DAYS", help="remove recordings beside this run's that are older")
]
SharePictures = Annotated[
    Flag, typer.Option("--share-pictures", help="show the camera to monitors of this user; default: no")
]
Participant = Annotated[str | None, typer.Option(help="the wearer's pseudonym, such as P-07")]
BlurFaces = Annotated[Flag, typer.Option("--blur-faces", help="blur faces in recorded pictures (extra privacy)")]
Mark = Annotated[
    list[str] | None, typer.Option(metavar="KEY=VERB", help="label the wearer's verbs by keys, such as p=Pour")
]
MarkLsl = Annotated[str | None, typer.Option(metavar="NAME", help="label by an LSL marker stream")]
ClearLatch = Annotated[
    bool, typer.Option("--clear-latch", help="authenticate clearing a latch or STOP; confirm it at the device")
]
Profile = Annotated[bool, typer.Option("--profile", help="say how long each stage took: p50, p99, max")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]


def register(app: typer.Typer) -> None:
    """Add it to the command line."""
    app.command()(run)
    app.command()(check)


def run(
    camera: Camera = None,
    gaze: Gaze = None,
    inertial: Inertial = None,
    skeleton: Skeleton = None,
    camera_fps: CameraFps = None,
    bus: Bus = None,
    bus_option: BusOption = None,
    bundle: BundleFile = None,
    config: ConfigFile = None,
    seconds: Seconds = None,
    out: RunFolder = None,
    force: Force = False,
    hands: Hands = None,
    loop: Loop = None,
    key_file: KeyFile = None,
    listen_only: ListenOnly = None,
    arm: Arm = None,
    uncertified: Uncertified = None,
    video: Video = None,
    rotate_mb: RotateMb = None,
    rotate_minutes: RotateMinutes = None,
    retain: Retain = None,
    participant: Participant = None,
    blur_faces: BlurFaces = None,
    share_pictures: SharePictures = None,
    mark: Mark = None,
    mark_lsl: MarkLsl = None,
    clear_latch: ClearLatch = False,
    profile: Profile = False,
    as_json: Json = False,
) -> None:
    """Run the bridge on a camera and an eye tracker (live or recorded) until they end or Ctrl-C."""
    from hilbridge.config import parse_options
    from hilbridge.labels.live import MarkOptions
    from hilbridge.labels.marks import keys_of
    from hilbridge.run import RunOptions

    given: dict[str, dict[str, object]] = {
        "sensors": {"camera": camera, "gaze": gaze, "inertial": inertial, "skeleton": skeleton}
        | {"camera_fps": camera_fps, "hands": hands, "loop": loop},
        "bus": {"spec": bus, "key_file": _text(key_file), "listen_only": listen_only, "arm": arm}
        | {"uncertified": uncertified}
        | {"options": parse_options(bus_option) if bus_option else None},
        "model": {"bundle": _text(bundle)},
        "recording": {"video": video, "rotate_mb": rotate_mb, "rotate_minutes": rotate_minutes, "retain_days": retain}
        | {"participant": participant, "blur_faces": blur_faces},
        "monitor": {"share_pictures": share_pictures},
    }
    marks = MarkOptions(keys_of(mark or []), mark_lsl)
    asked = RunOptions("", seconds, clear_latch=clear_latch, profile=profile, marks=marks)
    print_or_json(_run(config, given, asked, out, force=force, quiet=as_json), as_json)


def check(
    camera: Camera = None,
    gaze: Gaze = None,
    inertial: Inertial = None,
    skeleton: Skeleton = None,
    camera_fps: CameraFps = None,
    config: ConfigFile = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="how long to look")] = 10.0,
    hands: Hands = None,
    png: Annotated[Path, typer.Option(help="the last picture with gaze and hands")] = Path("check.png"),
    as_json: Json = False,
) -> None:
    """Look through camera, eye tracker and hand detector before a session. Exit code 1 where something is ill."""
    import json

    from hilbridge.check import draw, judge, look
    from hilbridge.config import load_config
    from hilbridge.doctor import Verdict, worst
    from hilbridge.runtime.senses import open_senses
    from hilbridge.terminal import print_findings

    given: dict[str, dict[str, object]] = {
        "sensors": {"camera": camera, "gaze": gaze, "inertial": inertial, "skeleton": skeleton}
        | {"camera_fps": camera_fps, "hands": hands}
    }
    sensors = load_config(config, given).sensors
    seen = look(open_senses(sensors), seconds, lambda line: None if as_json else typer.echo(line))
    findings = judge(seen, with_gaze=sensors.gaze is not None, with_hands=sensors.hands)
    drawn = draw(seen, png)
    if as_json:
        told = [{"subject": f.subject, "verdict": f.verdict, "text": f.text, "cure": f.cure} for f in findings]
        typer.echo(json.dumps({"findings": told, "png": str(png) if drawn else None, "events": seen.events}))
    else:
        for text in seen.events:
            typer.echo(text)
        print_findings(findings)
        typer.echo(f"picture: {png}" if drawn else "no picture to draw")
    if worst(findings) is Verdict.ILL:
        raise typer.Exit(1)


def _run(
    config: Path | None,
    given: dict[str, dict[str, object]],
    asked: RunOptions,
    out: Path | None,
    *,
    force: bool,
    quiet: bool,
) -> Outcome:
    import asyncio
    from dataclasses import replace

    from hilbridge.config import load_config
    from hilbridge.run import run_bridge, run_folder
    from hilbridge.runtime.assemble import read_parts
    from hilbridge.runtime.senses import open_senses
    from hilbridge.terminal import live_line

    settings = load_config(config, given)
    parts = read_parts(settings)
    senses = open_senses(settings.sensors)
    named = replace(asked, title=f"run: camera {settings.sensors.camera}, gaze {settings.sensors.gaze}")
    with run_folder("run", out, force=force) as folder, live_line(asked.seconds, quiet=quiet) as progress:
        return asyncio.run(run_bridge(settings, parts, senses, folder, named, progress))


def print_or_json(outcome: Outcome, as_json: bool) -> None:
    """What a run came to; where it cannot be printed, the error says where it is."""
    import json

    from hilbridge.terminal import print_outcome

    try:
        if as_json:
            typer.echo(json.dumps(outcome.as_json(), sort_keys=True, allow_nan=False))
        else:
            print_outcome(outcome)
        sys.stdout.flush()
    except OSError as error:
        error.add_note(f"saved: {outcome.recording}, {outcome.report}")
        raise


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
