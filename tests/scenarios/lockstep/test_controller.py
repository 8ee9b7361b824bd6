"""Which controller a run in virtual time has."""

from __future__ import annotations

import pytest

from firmware_sim import controllers
from firmware_sim.c import binding
from hilbridge.errors import InputError
from hilscenario.lockstep.controller import VARIABLE, controller_in_use, powered_on


def test_the_variable_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "python")
    assert controller_in_use() == "python"
    assert controllers.name_of(powered_on(bytes(16), 1)) == "python"


def test_the_quickest_there_is_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(binding, "why_not", lambda: "not built: install a C compiler")
    assert controller_in_use() == "python"


def test_one_that_is_not_there_is_refused_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "rust")
    with pytest.raises(InputError, match="'rust': there are python and c"):
        powered_on(bytes(16), 1)
    monkeypatch.setenv(VARIABLE, "c")
    monkeypatch.setattr(binding, "why_not", lambda: "not built: install a C compiler")
    with pytest.raises(InputError, match="install a C compiler"):
        powered_on(bytes(16), 1)


@pytest.mark.skipif(not binding.available(), reason="the C controller is not built")
def test_where_it_is_built_the_c_is_quickest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert controllers.name_of(powered_on(bytes(16), 1)) == "c"
