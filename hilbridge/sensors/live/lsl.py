"""Lab Streaming Layer streams, found by name, type or source id; their channels as the configuration says."""

from __future__ import annotations

import contextlib
import ctypes
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from hilbridge.errors import InputError, needs_extra
from hilbridge.records import BodySample, GazeSample, StampSource
from hilbridge.sensors.clock import FEWEST_PROBES, DeviceClock, Probe
from hilbridge.sensors.live.base import RETRY_FIRST_S, LiveDevice, RawBody, RawGaze

_FIND_S = 5.0
_PULL_S = 0.05
_SILENT_NS = 500_000_000
_CORRECTION_EVERY_NS = 200_000_000
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LslChannels:
    """Which channel holds what, by number or label. x is divided by `width`, y by `height`; `y_up`: y counts from below.

    Gaze is valid where the channel `valid` is at least `valid_from`, worn where `worn` is above 0; None: not said.
    """

    x: int | str = 0
    y: int | str = 1
    width: float = 1.0
    height: float = 1.0
    y_up: bool = False
    valid: int | str | None = None
    valid_from: float = 0.5
    worn: int | str | None = None


class LslStream(LiveDevice[T]):
    """One stream of `what` (gaze, inertial, skeleton).

    A stream that goes away is looked for again, also when its program was started anew.

    Raises InputError when no such stream is there, or its channels are not those that the configuration names.
    """

    def __init__(
        self,
        what: str,
        spec: str,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(f"{what} lsl:{spec}", DeviceClock(), stamp=StampSource.HARDWARE, clock_ns=clock_ns)
        with needs_extra("lsl"):
            import pylsl
            from pylsl.util import LostError
            from pylsl.util import TimeoutError as LslTimeoutError
        self._pylsl: Any = pylsl
        self._lost = (LostError, LslTimeoutError)
        self._by, equals, self._value = spec.partition("=")
        if not equals:
            self._by, self._value = "name", spec
        if self._by not in ("name", "type", "source_id") or not self._value:
            raise InputError(f"{self.name}: write lsl:NAME, lsl:type=TYPE or lsl:source_id=ID")
        found = self._find(_FIND_S)
        if found is None:
            raise InputError(f"{self.name}: no such stream within {_FIND_S:g} s; is its program running?")
        self._inlet: Any = None
        try:
            self._open(found)
        except self._lost:
            raise InputError(f"{self.name}: the stream does not answer; is a firewall in its way?") from None

    def _find(self, seconds: float) -> Any | None:
        found = self._pylsl.resolve_byprop(self._by, self._value, 1, seconds)
        return found[0] if found else None

    def _open(self, found: Any) -> None:
        """An inlet of the stream, channels checked. `recover` is left to this class: it has to know of every gap."""
        inlet = self._pylsl.StreamInlet(found, max_buflen=1, recover=False)
        self._bind(_labels(inlet.info(_FIND_S)))
        inlet.open_stream(_FIND_S)
        self._inlet = inlet

    @abstractmethod
    def _bind(self, labels: list[str]) -> None:
        """Find the channels that are wanted among those of the stream. Raises InputError."""

    @abstractmethod
    def _take(self, sample: list[float], remote_ns: int) -> None:
        """Hand on one sample of the stream."""

    def _index(self, channel: int | str | None, key: str, labels: list[str]) -> int:
        """A channel's place, -1 for none."""
        if channel is None:
            return -1
        if isinstance(channel, int) and 0 <= channel < len(labels):
            return channel
        if isinstance(channel, str) and labels.count(channel) == 1:
            return labels.index(channel)
        named = ", ".join(label or f"({index})" for index, label in enumerate(labels))
        raise InputError(f"{self.name}: no channel {channel!r} for {key}; set [sensors.lsl] {key} to one of {named}")

    def _read_all(self) -> None:
        while not self._stopping.is_set():
            if self._inlet is None and not self._find_again():
                continue
            try:
                self._pull()
            except self._lost as error:
                self.lose(f"the stream is lost ({error})" if str(error) else "the stream is lost")
            self._drop()
        self._drop()

    def _find_again(self) -> bool:
        """Look for the stream once more; a short while, so that the source can be stopped."""
        with contextlib.suppress(InputError, *self._lost):
            found = self._find(RETRY_FIRST_S)
            if found is not None:
                assert self.clock is not None
                self.clock.forget()
                self._open(found)
                return True
        self._stopping.wait(RETRY_FIRST_S)
        return False

    def _drop(self) -> None:
        inlet, self._inlet = self._inlet, None
        if inlet is not None:
            with contextlib.suppress(Exception):  # of a stream that is lost
                inlet.close_stream()

    def _pull(self) -> None:
        heard_ns, corrected_ns = self._clock_ns(), 0
        while not self._stopping.is_set():
            now_ns = self._clock_ns()
            if now_ns - corrected_ns > _CORRECTION_EVERY_NS:
                corrected_ns = now_ns
                self._correct()
            sample, stamp_s = self._inlet.pull_sample(_PULL_S)
            now_ns = self._clock_ns()
            if sample is None:
                if now_ns - heard_ns > _SILENT_NS:
                    self.lose("nothing comes")
                    return
                continue
            heard_ns = now_ns
            self._take(sample, round(stamp_s * 1e9))

    def _correct(self) -> None:
        """LSL has made its own probes; their outcome and its uncertainty stand for one probe of ours."""
        offset_s, uncertainty_s = time_correction(self._pylsl, self._inlet)
        now_ns = self._clock_ns()
        lsl_minus_here_ns = round(self._pylsl.local_clock() * 1e9) - now_ns
        half_ns = round(max(uncertainty_s, 0.0) * 1e9 / 2)
        # offset: what is added to a remote stamp for LSL's local clock.
        remote_ns = now_ns + lsl_minus_here_ns - round(offset_s * 1e9)
        fit = None if self.clock is None else self.clock.fit
        for _ in range(1 if fit is not None else FEWEST_PROBES):  # its first answer rests on several already
            self.take_probe(Probe(now_ns - half_ns, remote_ns, now_ns + half_ns))


class LslGaze(LslStream[GazeSample]):
    """A stream of points of regard."""

    def __init__(self, spec: str, channels: LslChannels, *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._channels = channels
        super().__init__("gaze", spec, clock_ns=clock_ns)

    def _bind(self, labels: list[str]) -> None:
        channels = self._channels
        self._x, self._y = self._index(channels.x, "x", labels), self._index(channels.y, "y", labels)
        self._valid = self._index(channels.valid, "valid", labels)
        self._worn = self._index(channels.worn, "worn", labels)

    def _take(self, sample: list[float], remote_ns: int) -> None:
        channels = self._channels
        try:
            x, y = float(sample[self._x]) / channels.width, float(sample[self._y]) / channels.height
            valid = self._valid < 0 or float(sample[self._valid]) >= channels.valid_from
            worn = self._worn < 0 or float(sample[self._worn]) > 0.0
        except (TypeError, ValueError):
            self.cell.fail()
            return
        self.take_raw(RawGaze(x, 1.0 - y if channels.y_up else y, valid, worn, remote_ns))


class LslBody(LslStream[BodySample]):
    """A stream of one or more sensors on the body: three channels each, x, y, z.

    Channels with labels that end in x, y, z belong together by what stands before (`HAND_R_x`); those of a stream without
    such labels are taken three by three, and a stream of one sensor gives it the name `default`.
    """

    def __init__(self, what: str, spec: str, default: str, *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._default = default
        super().__init__(what, spec, clock_ns=clock_ns)

    def _bind(self, labels: list[str]) -> None:
        self._triples = triples(labels, self._default)
        if not self._triples:
            raise InputError(
                f"{self.name}: {len(labels)} channels are no x, y, z of sensors; label them SENSOR_x, SENSOR_y, SENSOR_z"
            )

    def _take(self, sample: list[float], remote_ns: int) -> None:
        for sensor, (x, y, z) in self._triples.items():
            try:
                raw = RawBody(sensor, float(sample[x]), float(sample[y]), float(sample[z]), remote_ns)
            except (TypeError, ValueError):
                self.cell.fail()
                continue
            self.take_raw(raw)


def triples(labels: list[str], default: str) -> dict[str, tuple[int, int, int]]:
    """Which channels are x, y, z of which sensor; empty where that cannot be told."""
    named: dict[str, dict[str, int]] = {}
    for index, label in enumerate(labels):
        if label[-1:].lower() in ("x", "y", "z"):
            named.setdefault(label[:-1].rstrip("_-. "), {})[label[-1].lower()] = index
    whole = {name or default: (of["x"], of["y"], of["z"]) for name, of in named.items() if len(of) == 3}
    if whole or len(labels) % 3:
        return whole
    count = len(labels) // 3
    return {default if count == 1 else f"{default} {n + 1}": (3 * n, 3 * n + 1, 3 * n + 2) for n in range(count)}


def time_correction(pylsl: Any, inlet: Any) -> tuple[float, float]:
    """A stream's clock offset and its uncertainty, in seconds (pylsl itself hands on the first only).

    Raises what pylsl raises for a stream that is lost or does not answer.
    """
    function = pylsl.lib.lib.lsl_time_correction_ex
    function.restype = ctypes.c_double
    code, remote, uncertainty = ctypes.c_int(), ctypes.c_double(), ctypes.c_double()
    offset = function(
        inlet.obj, ctypes.byref(remote), ctypes.byref(uncertainty), ctypes.c_double(1.0), ctypes.byref(code)
    )
    pylsl.util.handle_error(code)
    return float(offset), float(uncertainty.value)


def _labels(info: Any) -> list[str]:
    """The labels of a stream's channels, empty where it names none."""
    labels = [""] * int(info.channel_count())
    channel = info.desc().child("channels").child("channel")
    for index in range(len(labels)):
        if channel.empty():
            break
        labels[index] = str(channel.child_value("label"))
        channel = channel.next_sibling()
    return labels
