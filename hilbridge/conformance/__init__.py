"""Does a device keep the contract? Asked of it over the bus alone, before a person puts it on (docs/conformance.md)."""
