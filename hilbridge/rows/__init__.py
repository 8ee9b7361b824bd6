"""The rows of a recording: one frozen record a topic, and the one encoder. Live runs and virtual time write the same.

A row is a JSON object; its time is the message's own log time. Units stand at the end of names; every `_ns` is the
monotonic clock, in virtual time the scenario's. A value that was not known is None here, and absent in the JSON.
"""

from hilbridge.rows.bus import SIGNAL_TOPICS, CanRow, DeviceRow, SignalRow, received_row, sent_row
from hilbridge.rows.code import TOPICS, FixedRow, Row, decode, encode, from_fields, is_topic, json_schema, schema_name
from hilbridge.rows.decisions import BeliefRow, GroundTruth, TickRow, belief_row, estimate_of, with_truth
from hilbridge.rows.fields import Direction, Witness
from hilbridge.rows.run import BundleRow, ConfigRow, CountersRow, EventRow, FaultRow, HostRow, LabelRow, MetaRow
from hilbridge.rows.senses import (
    ClockRow,
    FeaturesRow,
    GazeRow,
    HandFound,
    HandsRow,
    ImageRow,
    Look,
    SceneRow,
    SensorsRow,
    SourceAccount,
    Stamp,
    feature_vector,
    features_row,
    gaze_row,
    gaze_sample,
    hand_tracks,
    hands_row,
    image_stamp,
)
from hilbridge.rows.shift import shifted

__all__ = [
    "SIGNAL_TOPICS",
    "TOPICS",
    "BeliefRow",
    "BundleRow",
    "CanRow",
    "ClockRow",
    "ConfigRow",
    "CountersRow",
    "DeviceRow",
    "Direction",
    "EventRow",
    "FaultRow",
    "FeaturesRow",
    "FixedRow",
    "GazeRow",
    "GroundTruth",
    "HandFound",
    "HandsRow",
    "HostRow",
    "ImageRow",
    "LabelRow",
    "Look",
    "MetaRow",
    "Row",
    "SceneRow",
    "SensorsRow",
    "SignalRow",
    "SourceAccount",
    "Stamp",
    "TickRow",
    "Witness",
    "belief_row",
    "decode",
    "encode",
    "estimate_of",
    "feature_vector",
    "features_row",
    "from_fields",
    "gaze_row",
    "gaze_sample",
    "hand_tracks",
    "hands_row",
    "image_stamp",
    "is_topic",
    "json_schema",
    "received_row",
    "schema_name",
    "sent_row",
    "shifted",
    "with_truth",
]
