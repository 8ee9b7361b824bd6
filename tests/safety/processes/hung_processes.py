"""The processes of a hung-bridge trial, forked from a server that has imported everything: starting costs no second."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import sys
from multiprocessing.process import BaseProcess

from firmware_sim import node
from hilbridge.bus.simulated import server
from tests.safety.processes import bridge_process
from tests.safety.rig import codec

codec()  # read the DBC before anybody forks

_FORKS = multiprocessing.get_context("forkserver")
_FORKS.set_forkserver_preload([__name__])


def _quiet() -> None:
    void = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(void, descriptor)


def _device(spec: str, log: str) -> None:
    _quiet()
    sys.exit(node.main(["--bus", spec, "--json-log", log, "--wearer-torque", "sway"]))


def _bridge(spec: str) -> None:
    _quiet()
    asyncio.run(bridge_process.run(spec))


def _bus(name: str) -> None:
    _quiet()
    sys.exit(server.main([name]))


def _started(target: object, *arguments: str) -> BaseProcess:
    process = _FORKS.Process(target=target, args=arguments, daemon=True)  # type: ignore[arg-type]
    process.start()
    return process


def device(spec: str, log: str) -> BaseProcess:
    """`firmware-sim` with a swaying wearer."""
    return _started(_device, spec, log)


def bridge(spec: str) -> BaseProcess:
    """tests/safety/processes/bridge_process.py."""
    return _started(_bridge, spec)


def bus(name: str) -> BaseProcess:
    """The server of a simulated bus."""
    return _started(_bus, name)
