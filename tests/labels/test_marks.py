import pytest

from hilbridge.errors import InputError
from hilbridge.labels.marks import Marks, keys_of
from hilbridge.rows import LabelRow


def test_a_verb_lasts_until_the_next_mark():
    marks = Marks("key")
    assert marks.mark("Pour", 10) is None
    assert marks.verb == "Pour"
    assert marks.mark("cut", 20) == LabelRow(10, 20, "Pour", "key")
    assert marks.mark("Cut", 30) == LabelRow(20, 30, "Cut", "key")
    assert marks.verb is None
    assert marks.finish(40) is None


@pytest.mark.parametrize("word", ["stop", " END ", ""])
def test_a_word_ends_it(word):
    marks = Marks("lsl:x")
    marks.mark("none", 10)
    assert marks.mark(word, 20) == LabelRow(10, 20, "none", "lsl:x")


def test_the_end_of_a_run_ends_it_and_nothing_has_no_length():
    marks = Marks("key")
    marks.mark("Take", 10)
    assert marks.finish(10) is None
    marks.mark("Take", 10)
    assert marks.finish(11) == LabelRow(10, 11, "Take", "key")


def test_a_word_that_is_no_verb_leaves_the_mark_as_it_was():
    marks = Marks("lsl:x")
    marks.mark("Pour", 10)
    with pytest.raises(InputError, match="did you mean `Put`"):
        marks.mark("Putt", 15)
    assert marks.mark("stop", 20) == LabelRow(10, 20, "Pour", "lsl:x")


def test_keys():
    assert keys_of(["p=pour", "x=none"]) == {"p": "Pour", "x": "none"}
    for wrong, said in (
        (["pp=Pour"], "one key"),
        (["p"], "one key"),
        (["p=Fly"], "no verb"),
        (["p=Put", "p=Cut"], "already"),
    ):
        with pytest.raises(InputError, match=said):
            keys_of(wrong)
