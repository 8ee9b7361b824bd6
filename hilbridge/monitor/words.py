"""What the device's states and reasons mean to whoever looks after the wearer, and what to do about each."""

from __future__ import annotations

from typing import NamedTuple


class Kind:
    """How the page shows a state: a colour, a shape and a word, so that none of them is needed alone."""

    FOLLOW = "follow"
    ASSIST = "assist"
    WAIT = "wait"
    FAULT = "fault"
    SILENT = "silent"


class Said(NamedTuple):
    """A sentence, and the cure; the cure is empty where there is nothing to do."""

    text: str
    cure: str = ""


# State of the DBC -> the large word, how it is shown.
STATES: dict[str, tuple[str, str]] = {
    "Boot": ("STARTING", Kind.WAIT),
    "SelfTest": ("SELF-TEST", Kind.WAIT),
    "Follow": ("FOLLOW", Kind.FOLLOW),
    "Ready": ("READY", Kind.FOLLOW),
    "Assist": ("ASSIST", Kind.ASSIST),
    "RampDown": ("RAMP DOWN", Kind.WAIT),
    "Passive": ("PASSIVE", Kind.FAULT),
    "Latched": ("LATCHED", Kind.FAULT),
    "EStop": ("STOPPED", Kind.FAULT),
}

_CLEAR = "Remove the cause, run `hilbridge run --clear-latch`, and confirm at the device."

# Reason of the DBC -> what it means while the device follows or is latched.
REASONS: dict[str, Said] = {
    "None": Said("Nothing is wrong."),
    "Hold": Said("The bridge holds."),
    "VerbChange": Said("The verb changed; assist ramps down first."),
    "CommandTimeout": Said("No command came for 100 ms.", "Check that the bridge runs and its bus is up."),
    "E2EInvalid": Said("Commands arrive damaged.", "Check wiring, termination and bit rate (`hilbridge doctor`)."),
    "AuthMissing": Said("An ACT came without its authorisation.", "Check for a second bridge on the bus."),
    "EchoStale": Said("The bridge answers to old status.", "Check the load of bus and computer."),
    "SensingStale": Said("What the bridge sees is too old.", "Check camera and eye tracker (`hilbridge check`)."),
    "HeartbeatTimeout": Said("The bridge fell silent.", "Start the bridge again."),
    "AssistDwell": Said("The assist reached its 10 s limit."),
    "BusOff": Said("The device was off the bus.", "Check wiring and termination."),
    "NotArmed": Said("No session stands.", "Wait for the bridge to arm, or check its key (`hilbridge doctor`)."),
    "Disarmed": Said("The session has ended.", "Wait for the bridge to arm again."),
    "SensorImplausible": Said("The device does not believe its own sensors.", "Check them; it gives no torque."),
    "StopReceived": Said("STOP was received.", _CLEAR),
    "TickOverrun": Said("The device's control loop was late.", _CLEAR),
    "TorqueTracking": Said("Torque did not follow its command.", _CLEAR),
    "JointSpeed": Said("The joint was too fast.", _CLEAR),
    "RangeOfMotion": Said("The joint left its range.", _CLEAR),
    "RepeatedTrips": Said("Three trips within 60 s.", _CLEAR),
    "MacFailures": Said("Three wrong authorisations: keys differ.", "Give both ends one key. " + _CLEAR),
    "RepeatedBusOff": Said("Off the bus twice within 10 s.", "Check wiring and termination. " + _CLEAR),
    "OwnIdSeen": Said("Another node sends as the device.", "Take the second device off the bus. " + _CLEAR),
    "SelfTestFailed": Said("The self-test failed.", "Switch the device off and on; if it fails again, do not use it."),
    "VerbUnassisted": Said("This verb is never assisted."),
    "Cleared": Said("The latch is cleared."),
    "Neutral": Said("The device waits for commands to hold."),
    "Authorised": Said("The assist is authorised."),
}

NO_LINK = Said("The bus is not there.", "Check adapter and interface (`hilbridge doctor --bus ...`).")
NO_DEVICE = Said("The device is silent.", "Check its power and its bus; then start it again.")
NO_BRIDGE = Said("The bridge is silent; the device follows by itself.", "Start the bridge again.")
OLD_SENSING = Said("What the bridge sees is too old.", "Check camera and eye tracker (`hilbridge check`).")
SENSORS: dict[str, Said] = {
    "gaze": Said("Gaze is missing.", "Check that the eye tracker is worn, connected and calibrated."),
    "hands": Said("No hand is seen.", "Bring the hands into the camera's view."),
    "scene": Said("The camera is missing.", "Check the camera and its cable."),
}
NO_SENSING = Said("Sensing is not whole: camera or eye tracker fails.", "Check both (`hilbridge check`).")
STARTING = Said("The bridge is starting.")


def state_word(state: str) -> tuple[str, str]:
    """The large word and the kind of a state; one that a site's DBC added is shown as it is, as a fault."""
    return STATES.get(state, (state.upper(), Kind.FAULT))


def reason_words(reason: str) -> Said:
    """What a reason means; one that a site's DBC added is shown as it is."""
    return REASONS.get(reason, Said(f"{reason}."))
