from __future__ import annotations

import pytest

from hilbridge.errors import InputError, nearest, needs_extra


def test_an_absent_package_is_one_line_with_the_extra_that_brings_it() -> None:
    with (
        pytest.raises(InputError, match=r"^no_such_package is not installed; .*'hilbridge\[train\]'`$"),
        needs_extra("train"),
    ):
        import no_such_package.inside  # type: ignore[import-not-found]  # noqa: F401


def test_an_own_module_that_is_missing_is_a_defect() -> None:
    with pytest.raises(ModuleNotFoundError), needs_extra("train"):
        import hilbridge.no_such_module  # type: ignore[import-not-found]  # noqa: F401


def test_the_nearest_name_or_all_there_are() -> None:
    assert nearest("Tau_On", ["tau_on", "tau_off"]) == "did you mean `tau_on`?"
    assert nearest("zzz", ["b", "a"]) == "known: a, b"
