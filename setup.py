"""Builds the C controller beside its sources. Optional: where there is no C compiler, the installation goes on without it."""

import hashlib
from pathlib import Path

from setuptools import Extension, setup

HOME = Path("firmware_sim/c")
SOURCES = sorted(str(path) for path in HOME.glob("*.c"))
HEADERS = sorted(str(path) for path in HOME.glob("*.h"))
# Baked in, so that a build of yesterday's sources is told from one of today's (firmware_sim/c/binding.py).
DIGEST = hashlib.sha256(b"".join(Path(name).read_bytes() for name in sorted(SOURCES + HEADERS))).hexdigest()

setup(
    ext_modules=[
        Extension(
            "firmware_sim.c._native",
            SOURCES,
            depends=HEADERS,
            define_macros=[("CTL_DIGEST", f'"{DIGEST}"')],
            # The elbow's sums are those of Python: sine and cosine come from the same library, one by one.
            extra_compile_args=["-std=c11", "-O2", "-fno-builtin-sin", "-fno-builtin-cos"],
            optional=True,
        )
    ]
)
