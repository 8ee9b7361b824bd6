"""python-can, without what it loads only in case a log is MF4: `from firmware_sim.quick_can import can`.

Where asammdf is installed, `import can` loads it with pandas and sympy: seconds before the device is on its bus. No log is
read here. (The bridge has the same for itself: the two share no code.)
"""

from __future__ import annotations

import sys

_UNUSED = "asammdf"

if "can" not in sys.modules and _UNUSED not in sys.modules:
    sys.modules[_UNUSED] = None  # type: ignore[assignment]  # an import of it fails as if it were not installed
    try:
        import can
    finally:
        del sys.modules[_UNUSED]
else:
    import can

__all__ = ["can"]
