"""Imported by the server that live runs fork their processes from: what every one of them would import and read again."""

from __future__ import annotations

import typer  # noqa: F401

import firmware_sim.node
from scenarios.live.bridge import codec
from scenarios.world.intent import bundle

assert firmware_sim.node
bundle()
codec()
