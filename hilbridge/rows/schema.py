"""JSON schemas as viewers read them: no references, no choices of types, one kind of item in an array."""

from __future__ import annotations

from typing import Any

_SAID = ("title", "description", "default", "$defs")


def viewable(schema: dict[str, Any]) -> dict[str, Any]:
    """The same schema in the few words that Foxglove, Lichtblick and PlotJuggler know."""
    return _plain(schema, schema.get("$defs", {}))


def _plain(part: dict[str, Any], named: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in part:
        return _plain(named[part["$ref"].rpartition("/")[2]], named)
    # What is not known is absent, never null.
    kinds = [kind for kind in part.get("anyOf", ()) if kind != {"type": "null"}]
    if len(kinds) == 1:
        return _plain(kinds[0], named)
    plain = {key: value for key, value in part.items() if key not in _SAID}
    if "prefixItems" in plain:  # tuples here are of one kind
        plain["items"] = plain.pop("prefixItems")[0]
    if isinstance(plain.get("items"), dict):
        plain["items"] = _plain(plain["items"], named)
    if isinstance(plain.get("properties"), dict):
        plain["properties"] = {name: _plain(value, named) for name, value in plain["properties"].items()}
    if isinstance(plain.get("additionalProperties"), dict):
        plain["additionalProperties"] = _plain(plain["additionalProperties"], named)
    return plain
