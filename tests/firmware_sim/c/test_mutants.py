"""The list of small wrongs for the C: what it changes, and what it leaves alone."""

from __future__ import annotations

from tests.safety.tools.c.mutants import mutants
from tests.safety.tools.c.mutation import EQUIVALENT, FILES, HOME

SOURCE = """/* a < b */
static const int TABLE[2] = {1, 2};

static int worse(const int *value, int limit) {
    static const char text[] = "a + b";
    int found = *value - 1;
    found++;
    if (found >= limit && !text[0]) {
        return -limit;
    }
    use(&found);
    return found;
}
"""


def test_each_wrong_is_one_and_named_by_function_and_change() -> None:
    whats = {one.key for one in mutants(SOURCE)}
    assert {
        "worse: - -> + #1",
        "worse: 1 -> 2 #1",
        "worse: >= -> > #1",
        "worse: && -> || #1",
        "worse: ! dropped #1",
        "worse: 0 -> 1 #1",
        "worse: dropped found++; #1",
        "worse: dropped use(&found); #1",
    } <= whats
    assert not any("TABLE" in what or "a + b" in what or "a < b" in what for what in whats)


def test_signs_addresses_and_what_a_pointer_points_at_are_no_operators() -> None:
    changed = [one.source for one in mutants(SOURCE)]
    assert not any("return +limit" in source or "|found" in source or "+value" in source for source in changed)


def test_every_mutant_of_the_core_changes_its_file_and_has_a_name_of_its_own() -> None:
    for name in FILES:
        source = (HOME / name).read_text(encoding="utf-8")
        found = list(mutants(source))
        assert found
        assert len({one.key for one in found}) == len(found)
        assert all(one.source != source for one in found)
    assert EQUIVALENT.exists()
