"""Imported by the server that live runs fork their processes from: what every one of them would import and read again."""

from __future__ import annotations

import typer  # noqa: F401

import firmware_sim.node
import hilscenario.live.bridge.process
from hilscenario.world.parts import bundle, codec

assert firmware_sim.node
assert hilscenario.live.bridge.process
bundle()
codec()
