"""The words of texts: folding, and where a word ends."""

import unicodedata

import pytest

from service.storage.words import (
    IN_METADATA,
    IN_NAME,
    IN_PATH,
    IN_TAG,
    MOST_PATHS,
    MOST_WORDS,
    Term,
    fold,
    runs,
    terms_of,
    words_of,
)


@pytest.mark.parametrize(
    ("one", "another"),
    [
        ("Gehäuse", "GEHAEUSE"),
        ("Gehäuse", "gehause"),
        ("Straße", "STRASSE"),
        ("rød", "roed"),
        ("Ångström", "angstrom"),
        ("œuf", "oeuf"),
        ("téléphone", unicodedata.normalize("NFD", "telephone\u0301").replace("\u0301", "")),
        ("żółw", "zolw"),
        ("ﬁlter", "filter"),
        ("가방", unicodedata.normalize("NFD", "가방")),
    ],
)
def test_spellings_of_a_word_are_one(one: str, another: str) -> None:
    assert fold(one) == fold(another)
    assert fold(fold(one)) == fold(one)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("PhoneStand_v2.stl", [["phone", "stand"], ["v", "2"], ["stl"]]),
        ("PLAHolder", [["pla", "holder"]]),
        ("M8x40", [["m", "8", "x", "40"]]),
        ("a-b c_d", [["a"], ["b"], ["c"], ["d"]]),
        ("हिन्दी", [["हिन्दी"]]),
        ("箱の蓋", [["箱の蓋"]]),
        ("--- %_!", []),
    ],
)
def test_words_end_at_marks_capitals_and_digits(text: str, expected: list[list[str]]) -> None:
    assert list(runs(text)) == expected
    assert list(runs(unicodedata.normalize("NFD", text))) == expected


def test_the_words_of_a_shape_have_the_weight_of_their_best_field() -> None:
    metadata = {"maker": {"names": ["Lamp Red Blå", 7, True, None]}}
    words = words_of("Lamp M8", ("lamp", "red"), metadata, ["Red lights/Lamp.stl"])
    assert words == {
        "lamp": IN_NAME,
        "m": IN_NAME,
        "8": IN_NAME,
        "m8": IN_NAME,
        "red": IN_TAG,
        "bla": IN_METADATA,
        "7": IN_METADATA,
        "lights": IN_PATH,
        "stl": IN_PATH,
    }
    assert len(words_of("", (), {}, [f"{i}.stl" for i in range(9_999)])) == MOST_PATHS + 1
    assert len(words_of("lamp", (), {"text": " ".join(f"word{i}" for i in range(9_999))})) == MOST_WORDS


def test_the_terms_of_a_query_are_its_words_without_those_that_join() -> None:
    assert terms_of("Halter für M8") == [
        Term("halter", required=True, begins=True),
        Term("m", required=True, begins=False),
        Term("8", required=True, begins=True),
        Term("m8", required=False, begins=True),
    ]
    assert [term.word for term in terms_of("mit der")] == ["mit", "der"]
    assert terms_of(" - ") == []
