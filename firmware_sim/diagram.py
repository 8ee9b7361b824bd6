"""The transition table drawn: `python -m firmware_sim.diagram` prints the diagram of docs/controller-states.md."""

from __future__ import annotations

from firmware_sim.states import TABLE, State


def diagram() -> str:
    """The table as a Mermaid state diagram; self-loops are left out."""
    lines = ["stateDiagram-v2", "    [*] --> BOOT"]
    for state, row in TABLE.items():
        for target in State:
            events = [event.name for event, to in row.items() if to == target and target != state]
            if events:
                lines.append(f"    {state.name} --> {target.name}: {', '.join(events)}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(diagram(), end="")  # noqa: T201
