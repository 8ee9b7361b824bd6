"""What a recording holds: rows in order of time, as records. `python examples/read_a_recording.py out/demo/recording.mcap`."""

import sys
from collections import Counter
from pathlib import Path

from hilbridge.api import Action, read_recording
from hilbridge.rows import CanRow, TickRow


def main(name: str) -> None:
    rows = read_recording(Path(name))
    topics, acts, frames = Counter[str](), list[float](), Counter[str]()
    for row in rows:
        topics[row.topic] += 1
        match row:
            case TickRow(action=Action.ACT, confidence=confidence):
                acts.append(confidence)
            case CanRow(name=str() as message):
                frames[message] += 1
    for topic, count in sorted(topics.items()):
        print(f"{count:6} {topic}")
    print(f"{len(acts)} ticks of ACT, mean confidence {sum(acts) / max(1, len(acts)):.2f}")
    print("most frames:", ", ".join(f"{message} {count}" for message, count in frames.most_common(3)))
    if rows.missing:
        print(f"missing: {rows.missing}")


if __name__ == "__main__":
    main(sys.argv[1])
