"""The scene camera of a played phone: MPEG-4 over interleaved RTP, with sender reports, each late."""

from __future__ import annotations

import asyncio
import itertools
import random
import struct
import time
from collections.abc import Callable, Iterator
from fractions import Fraction

import av
import numpy as np
from aiortsp.rtcp.parser import RTCP, SR

CLOCK_HZ = 90_000
SDP = (
    "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=world\r\nt=0 0\r\n"
    "m=video 0 RTP/AVP 96\r\na=rtpmap:96 MP4V-ES/90000\r\na=control:*\r\n"
)
PERIOD_S = 0.04


def pictures() -> Iterator[bytes]:
    """Encoded pictures that all differ, each a key picture."""
    codec = av.CodecContext.create("mpeg4", "w")
    assert isinstance(codec, av.VideoCodecContext)
    codec.width, codec.height, codec.pix_fmt, codec.gop_size = 128, 96, "yuv420p", 1
    codec.time_base, codec.framerate = Fraction(1, 25), Fraction(25)
    for count in itertools.count():
        grey = np.full((96, 128, 3), 4 * count % 256, np.uint8)
        frame = av.VideoFrame.from_ndarray(grey, format="rgb24")
        frame.pts = count
        for packet in codec.encode(frame):
            yield bytes(packet)


async def world(
    writer: asyncio.StreamWriter, wall_ns: Callable[[], int], silent: Callable[[], bool], taken_ns: list[int]
) -> None:
    """Send until cancelled. `taken_ns`: when each picture was taken, on this computer's clock."""
    late = random.Random(4)
    for count, picture in enumerate(pictures()):
        now_ns = time.monotonic_ns()
        ticks = now_ns * CLOCK_HZ // 1_000_000_000 % 2**32
        report = bytes(RTCP([SR(7, wall_ns() / 1e9, ticks)]))
        await asyncio.sleep(late.uniform(0.0, 0.02))
        if not silent():
            taken_ns.append(now_ns)
            if count % 25 == 0:
                writer.write(struct.pack("!cBH", b"$", 1, len(report)) + report)
            packet = struct.pack("!BBHII", 0x80, 0x80 | 96, count % 2**16, ticks, 7) + picture
            writer.write(struct.pack("!cBH", b"$", 0, len(packet)) + packet)
        await asyncio.sleep(max(0.0, PERIOD_S - (time.monotonic_ns() - now_ns) / 1e9))
