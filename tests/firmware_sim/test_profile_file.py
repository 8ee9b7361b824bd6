"""profiles.toml: today's numbers, one hash in Python and C, and everything that is not known to be safe refused in a line."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import frames
from firmware_sim.assist_profile import NONE, Guidance, Profile, Profiles
from firmware_sim.c import binding
from firmware_sim.profile_file import (
    CODES,
    MOST_BYTES,
    NUMBERS,
    SHIPPED,
    VERBS,
    ProfilesUnusable,
    kinds_in,
    main,
    profiles_of,
    read,
    read_own,
    refuse_wider,
    said,
)
from firmware_sim.profiles import shipped
from hilbridge.wire.codec import Codec

TEXT = SHIPPED.read_text(encoding="utf-8")
HASH = 0xA6127E08
TAKE, MOVE, POUR = 1, 5, 10


def changed(old: str, new: str) -> str:
    """The shipped file with the first `old` as `new`."""
    assert old in TEXT
    return TEXT.replace(old, new, 1)


def written(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(folder: Path, text: str) -> str:
    path = written(folder, text)
    with pytest.raises(ProfilesUnusable) as caught:
        read_own(path)
    told = str(caught.value)
    assert told.startswith(f"{path}: ")
    assert "\n" not in told
    assert len(told) < 500 + len(str(path))
    return told.removeprefix(f"{path}: ")


def test_verbs_are_those_of_the_bus() -> None:
    codes = Codec().messages["ACT_CMD"].signals[1].codes
    assert codes is not None
    assert {verb: codes[verb] for verb in VERBS} == {verb: code for code, verb in enumerate(VERBS, 1)}
    assert {*codes} - {*VERBS} == {"None", "Other"}
    assert frames.FIELDS[frames.ACT_CMD][1].highest == CODES - 1 == len(read().by_code) - 1


def test_the_shipped_file_has_a_hash_that_does_not_change_by_itself() -> None:
    assert shipped() is shipped()
    assert shipped() == read()
    assert shipped().hash32 == HASH
    assert len(shipped().digest) == 64
    assert said(shipped()) == "A6127E08, 20 verbs assisted"
    assert [kind.name for kind in kinds_in()] == ["reach", "open", "pour", "cut", "mix", "inspect", "operate"]


@pytest.mark.skipif(not binding.available(), reason="the C controller is not built")
def test_the_c_has_the_same_profiles() -> None:
    assert binding._native.PROFILES_HASH == HASH


def test_a_c_with_other_profiles_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    other = type("Other", (), {"DIGEST": binding.sources_digest(), "PROFILES_HASH": HASH + 1})
    monkeypatch.setattr(binding, "_native", other)
    assert "python -m firmware_sim.c.generate" in (binding.why_not() or "")
    other.PROFILES_HASH = HASH  # type: ignore[attr-defined]  # made above
    assert binding.why_not() is None


def test_the_hash_is_of_what_a_file_says_not_of_how(tmp_path: Path) -> None:
    reordered = changed('verbs = ["Take", "Put", "Transfer"]', 'verbs = ["Transfer", "Take", "Put"] # another order')
    reordered = reordered.replace("[profile.reach]", "[profile.other-name]")
    assert read(written(tmp_path, reordered)) == shipped()
    assert read(written(tmp_path, "\ufeff" + TEXT)) == shipped()
    tighter = read_own(written(tmp_path, changed("cap_mnm = 2000", "cap_mnm = 1999")))
    assert tighter.digest != shipped().digest
    assert tighter.of(TAKE).cap_unm == 1_999_000


def test_every_number_is_in_the_hash() -> None:
    kinds = kinds_in()
    seen = {profiles_of(kinds).digest}
    for field in Profile._fields:
        other = kinds[0].profile._replace(**{field: Guidance.NEVER if field == "guidance" else 7})
        seen.add(profiles_of([kinds[0]._replace(profile=other), *kinds[1:]]).digest)
    seen.add(profiles_of([kinds[0]._replace(verbs=("Take", "Put")), *kinds[1:]]).digest)
    assert len(seen) == 2 + len(Profile._fields)


@pytest.mark.parametrize("code", [0, MOVE, 22, 31, 32, -1, 255])
def test_h1_a_verb_that_no_file_names_is_never_assisted(code: int) -> None:
    assert shipped().of(code) == NONE


def test_each_code_has_its_own_profile_from_the_first_to_the_last() -> None:
    first, last = (Profile(1, 1, 1, 100, 1, Guidance.NEVER, cap, 300, 200) for cap in (1, 2))
    made = Profiles((first, last), "")
    assert [made.of(code) for code in (-1, 0, 1, 2)] == [NONE, first, last, NONE]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("never =", "nevr =", "unknown key `nevr` = ['Move Around']; did you mean `never`?"),
        ("cap_mnm = 2000", "cap_nm = 2", "unknown key `profile.reach.cap_nm` = 2; did you mean `cap_mnm`?"),
        (
            "cap_mnm = 2000",
            "zz = 2",
            "unknown key `profile.reach.zz` = 2; known here: verbs, guidance, damping_mnms_rad",
        ),
        ("cap_mnm = 2000\n", "", "`profile.reach.cap_mnm` is missing; the file that ships says what is usual"),
        ('verbs = ["Pour"]\n', "", "`profile.pour.verbs` is missing"),
        ('guidance = "minimum-jerk"\n', "", "`profile.reach.guidance` is missing"),
        (
            '"minimum-jerk"',
            '"push"',
            "`profile.reach.guidance` = 'push': give one of never, minimum-jerk, until-contact",
        ),
        ('"minimum-jerk"', "1", "`profile.reach.guidance` = 1: give one of"),
        ('"minimum-jerk"', "[]", "`profile.reach.guidance` = []: give one of"),
        ('["Move Around"]', "[]", "'Move Around' is missing; add it to the verbs of a profile or to `never`"),
        ('"Put", ', "", "'Put' is missing"),
        ('"Put", ', '"Putt", ', "`profile.reach.verbs` has 'Putt', which is no verb; did you mean `Put`?"),
        ('"Put", ', '"Put", "Other", ', "`profile.reach.verbs` has 'Other', which is no verb"),
        ('"Put", ', '"Put", 7, ', "`profile.reach.verbs` has 7, which is no verb; known here: Take, Put"),
        ('"Put", ', '"Put", [], ', "`profile.reach.verbs` has [], which is no verb"),
        ('["Pour"]', '["Pour", "Take"]', "`profile.pour` has 'Take', as `profile.reach` has; name each verb once"),
        ('["Pour"]', '["Pour", "Pour"]', "`profile.pour` has 'Pour', as `profile.pour` has; name each verb once"),
        ('["Move Around"]', '["Move Around", "Pour"]', "`profile.pour` has 'Pour', as `never` has"),
        ('["Pour"]', '"Pour"', "`profile.pour.verbs` = 'Pour': give a list of verbs"),
        ('["Move Around"]', '"Move Around"', "`never` = 'Move Around': give a list of verbs"),
        ("never =", "profile.x = 1\nnever =", "`profile.x` = 1: write it as a section [profile.x]"),
    ],
)
def test_what_is_not_a_whole_file_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert refusal(tmp_path, changed(old, new)).startswith(told)


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("value", ["nan", "inf", "30.0", "true", '"30"', "[30]", "1979-05-27", "{}"])
def test_what_is_no_whole_number_is_refused(tmp_path: Path, key: str, value: str) -> None:
    told = refusal(tmp_path, re.sub(rf"\n{key} = \d+", f"\n{key} = {value}", TEXT, count=1))
    assert told.startswith(f"`profile.reach.{key}` = ")
    assert told.endswith(": give a whole number")


@pytest.mark.parametrize("key", NUMBERS)
def test_h4_no_file_goes_beyond_the_contract_not_even_the_one_that_ships(tmp_path: Path, key: str) -> None:
    number = NUMBERS[key]
    for value in (number.lowest - 1, number.highest + 1, -number.highest - 1, 10**30):
        path = written(tmp_path, re.sub(rf"\n{key} = \d+", f"\n{key} = {value}", TEXT, count=1))
        with pytest.raises(
            ProfilesUnusable, match=rf"`profile.reach.{key}` = {value}: beyond the contract; give \d+ to \d+"
        ):
            read(path)
    for value in (number.lowest, number.highest):
        path = written(tmp_path, re.sub(rf"\n{key} = \d+", f"\n{key} = {value}", TEXT, count=1))
        assert getattr(read(path).of(TAKE), number.field) == value * number.scale


def test_the_limits_are_the_contracts() -> None:
    allowed = {key: (number.lowest, number.highest) for key, number in NUMBERS.items()}
    assert allowed == {
        "damping_mnms_rad": (0, 5000),
        "damping_near_mnms_rad": (0, 5000),
        "drag_mnm": (0, 30),
        "half_wave_ms": (40, 180),
        "gravity_per_mille": (0, 40),
        "cap_mnm": (1, 2000),
        "ramp_in_ms": (300, 500),
        "ramp_out_ms": (150, 500),
    }


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "`profile` = None: write sections [profile.NAME] as the file that ships has"),
        ("profile = 3", "`profile` = 3: write sections"),
        ("profile = {}", "'Take' is missing"),
        ("a = [", "not readable as TOML ("),
        ("a = " + "[" * 50_000, "not readable as TOML ("),
        ("a = " + "9" * 10_000, "not readable as TOML ("),
        ("never = 0x" + "f" * 10_000, "`profile` = None"),
        ("profile = 0x" + "f" * 10_000, "`profile` = more than can be shown: write sections"),
        ('"new\\nline" = 1', "unknown key `new line` = 1; known here: never, profile"),
        ("x = '" + "y" * 10_000 + "'", f"unknown key `x` = '{'y' * 59}...; known here: never, profile"),
        ("profile = '" + "y" * 58 + "'", f"`profile` = '{'y' * 58}': write sections"),
        ("profile = '" + "y" * 59 + "'", f"`profile` = '{'y' * 59}...: write sections"),
        ("#" * (MOST_BYTES + 1), f"more than {MOST_BYTES} bytes, larger than any profiles"),
    ],
)
def test_rubbish_is_one_line(tmp_path: Path, text: str, told: str) -> None:
    assert refusal(tmp_path, text).startswith(told)


def test_a_file_as_large_as_allowed_is_read(tmp_path: Path) -> None:
    path = written(tmp_path, TEXT + "#" * (MOST_BYTES - len(TEXT.encode())))
    assert read(path) == shipped()


def test_no_utf_8_and_no_file_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    with pytest.raises(
        ProfilesUnusable, match=r"own.toml: cannot be read \(No such file or directory\); name a profiles.toml"
    ):
        read(path)
    path.write_bytes(b"never = '\xff'")
    with pytest.raises(ProfilesUnusable, match=r"own.toml: not readable as TOML \(.*; start from the file that ships"):
        read(path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("damping_mnms_rad = 3000", "damping_mnms_rad = 3001", "`damping_mnms_rad` = 3001: at most 3000 for 'Take'"),
        (
            "damping_near_mnms_rad = 3000",
            "damping_near_mnms_rad = 3001",
            "`damping_near_mnms_rad` = 3001: at most 3000",
        ),
        ("drag_mnm = 0", "drag_mnm = 1", "`drag_mnm` = 1: at most 0 for 'Cut'"),
        ("half_wave_ms = 143", "half_wave_ms = 144", "`half_wave_ms` = 144: at most 143 for 'Cut'"),
        ("gravity_per_mille = 20", "gravity_per_mille = 21", "`gravity_per_mille` = 21: at most 20 for 'Take'"),
        ("cap_mnm = 1500", "cap_mnm = 1501", "`cap_mnm` = 1501: at most 1500 for 'Open'"),
        ("ramp_in_ms = 400", "ramp_in_ms = 399", "`ramp_in_ms` = 399: at least 400 for 'Pour'"),
        ("ramp_out_ms = 200", "ramp_out_ms = 201", "`ramp_out_ms` = 201: 200 and nothing else for 'Take'"),
        ("ramp_out_ms = 200", "ramp_out_ms = 199", "`ramp_out_ms` = 199: 200 and nothing else for 'Take'"),
        ('"minimum-jerk"', '"until-contact"', "`guidance` = 'until-contact': 'minimum-jerk' or 'never' for 'Take'"),
        (
            '"never"\ncap_mnm = 2000',
            '"minimum-jerk"\ncap_mnm = 2000',
            "`guidance` = 'minimum-jerk': 'never' or 'never'",
        ),
    ],
)
def test_h4_a_file_of_ones_own_that_widens_anything_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    found = refusal(tmp_path, changed(old, new))
    assert found.startswith(told)
    assert found.endswith("a file of one's own may only be tighter")


def test_h1_what_is_never_assisted_stays_so(tmp_path: Path) -> None:
    more = changed('never = ["Move Around"]', "never = []").replace('["Pour"]', '["Pour", "Move Around"]')
    assert refusal(tmp_path, more) == ("'Move Around' is never assisted in the profiles that ship; move it to `never`")
    less = changed('"Move Around"]', '"Move Around", "Take"]').replace('["Take", ', "[")
    assert read_own(written(tmp_path, less)).of(TAKE) == NONE


def test_tighter_is_taken(tmp_path: Path) -> None:
    text = changed('"minimum-jerk"', '"never"').replace("ramp_in_ms = 300", "ramp_in_ms = 500")
    text = text.replace("gravity_per_mille = 40", "gravity_per_mille = 0").replace(
        "half_wave_ms = 180", "half_wave_ms = 90"
    )
    found = read_own(written(tmp_path, text))
    assert found.of(TAKE) == Profile(3000, 5000, 30_000, 90, 20, Guidance.NEVER, 2_000_000, 500, 200)
    assert found.of(POUR).gravity_per_mille == 0


FIELDS = {number.field: number for number in NUMBERS.values()}


@given(st.data())
def test_h4_whatever_passes_is_within_every_limit_of_what_ships(data: Any) -> None:
    limit = shipped().of(TAKE)
    own = Profile(
        guidance=data.draw(st.sampled_from(Guidance)),
        **{
            name: data.draw(
                st.integers(number.lowest, number.highest)
                | st.sampled_from([int(getattr(limit, name)) // number.scale + by for by in (-1, 0, 1)])
            )
            * number.scale
            for name, number in FIELDS.items()
        },
    )
    found = replace(shipped(), by_code=(NONE, own, *shipped().by_code[2:]))
    is_within = (
        all(
            getattr(own, name) <= getattr(limit, name)
            for name in ("damping", "damping_near", "drag_unm", "half_wave_ms", "gravity_per_mille", "cap_unm")
        )
        and own.ramp_in_ms >= limit.ramp_in_ms
        and own.ramp_out_ms == limit.ramp_out_ms
        and own.guidance in (Guidance.NEVER, limit.guidance)
    )
    try:
        refuse_wider(found, shipped(), "own.toml")
    except ProfilesUnusable:
        assert not is_within
    else:
        assert is_within


def test_the_program_says_whether_a_file_can_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    assert capsys.readouterr().out == "A6127E08, 20 verbs assisted\n"
    assert main(["--text"]) == 0
    assert capsys.readouterr().out == TEXT
    path = written(tmp_path, changed("cap_mnm = 2000", "cap_mnm = 100"))
    assert main([str(path)]) == 0
    assert re.fullmatch(r"[0-9A-F]{8}, 20 verbs assisted\n", capsys.readouterr().out)
    path = written(tmp_path, changed("cap_mnm = 2000", "cap_mnm = 3000"))
    assert main([str(path)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert "cap_mnm" in told.err


def test_it_is_a_program(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "firmware_sim.profile_file", str(tmp_path / "absent")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


def test_a_hash_is_shown_with_all_its_digits() -> None:
    assert said(Profiles((NONE,), "00000abc" + "0" * 56)) == "00000ABC, 0 verbs assisted"
