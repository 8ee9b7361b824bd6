import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.errors import InputError
from hilbridge.labels.table import VOCABULARY, Label, as_row, csv_text, from_row, in_order, read_csv, verb_named


@st.composite
def spans(draw):
    times = sorted(draw(st.lists(st.integers(0, 10**9), min_size=2, max_size=20, unique=True)))
    verbs = draw(st.lists(st.sampled_from(VOCABULARY), min_size=10, max_size=10))
    return [Label(a / 16, b / 16, verb, "me") for a, b, verb in zip(times[::2], times[1::2], verbs, strict=False)]


@given(spans())
def test_what_is_written_is_read_again(tmp_path_factory, labels):
    path = tmp_path_factory.mktemp("labels") / "x.csv"
    path.write_text(csv_text(labels), encoding="utf-8")
    assert read_csv(path) == labels


@given(spans(), st.integers(0, 10**15))
def test_a_row_is_its_label(labels, begin_ns):
    for label in labels:
        assert from_row(as_row(label, begin_ns), begin_ns) == label


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0,10,Puor,me", "did you mean `Pour`"),
        ("0,10,Fly,me", "known: "),
        ("10,10,Pour,me", "not after its start"),
        ("-5,10,Pour,me", "--offset-ms"),
        ("nan,10,Pour,me", "no times of a recording"),
        ("1e300,1e301,Pour,me", "no times of a recording"),
        ("soon,10,Pour,me", "'soon' is no number"),
        (",10,Pour,me", "is no number"),
        ("0", "is no number"),
    ],
)
def test_a_wrong_line_is_named_with_its_cure(tmp_path, line, said):
    path = tmp_path / "x.csv"
    path.write_text(f"start_ms,end_ms,verb,source\n0,1,Take,me\n{line}\n")
    with pytest.raises(InputError, match=r"x\.csv:3: ") as caught:
        read_csv(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_spreadsheets_of_all_countries_are_read(tmp_path):
    path = tmp_path / "x.csv"
    path.write_bytes("\ufeffstart_ms;end_ms;verb;source\r\n0,5;1000;pour;\r\n".encode())
    assert read_csv(path) == [Label(0.5, 1000.0, "Pour", "x.csv")]


def test_a_wearer_does_one_thing_at_a_time():
    with pytest.raises(InputError, match="overlap"):
        in_order([Label(0, 10, "Take", ""), Label(9, 20, "Put", "")], "x")


def test_verbs_in_any_case_and_none():
    assert verb_named("  divide/PULL  apart ", "x") == "Divide/Pull Apart"
    assert verb_named("None", "x") == "none"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe\x00",
        b"a,b\n1,2\n",
        b"start_ms,end_ms,verb\n" + b"\x00" * 50,
        b"x" * 200_000,
        b'start_ms,end_ms,verb\n"' + b"x" * 200_000,
    ],
)
def test_what_is_no_label_file_is_one_line(tmp_path, content):
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_csv(path)
    assert str(path) in str(caught.value)
