"""python-can, without what it loads only in case a log is MF4: `from hilbridge.bus.quick_can import can`.

Where the extra `mdf` is installed, `import can` would load asammdf, pandas and sympy with it: a second or more, and 100 MB,
before the first command. `load_mf4` makes up for it when a log is one.
"""

from __future__ import annotations

import importlib
import sys

_LATER = "asammdf"

if "can" not in sys.modules and _LATER not in sys.modules:
    sys.modules[_LATER] = None  # type: ignore[assignment]  # an import of it fails as if it were not installed
    try:
        import can
    finally:
        del sys.modules[_LATER]
else:
    import can

__all__ = ["can", "load_mf4"]


def load_mf4() -> None:
    """Give python-can's reader and writer of MF4 what they were made without. Raises ImportError where it is not installed."""
    importlib.import_module(_LATER)
    module = importlib.import_module("can.io.mf4")
    if getattr(module, _LATER, None) is None:
        importlib.reload(module)  # the classes that python-can knows look their names up in this module
