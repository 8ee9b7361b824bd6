"""hilbridge: a hardware-in-loop CAN bridge and controller simulator for assistive devices."""

__version__ = "0.1.0"
