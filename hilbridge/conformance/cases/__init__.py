"""The cases, a file a subject. Each is a claim of docs/protocol.md and what is done and watched to show it."""
