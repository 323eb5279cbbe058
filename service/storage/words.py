"""The words of names, tags, metadata and paths as a search compares them, on both databases alike.

Words are folded: upper and lower case, accents, ß and ss, ø and o, and the spellings ä, ae and a are equal.
"Phone-Stand_M8x40" has the words phone, stand, m, 8, x and 40, and the run m8x40.
"""

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

WORD_CHARACTERS = 64
"""Characters of a word; the rest of a longer one is not looked at."""

MOST_WORDS = 512
"""Words of a shape that are searched: of the name first, then of the tags, the metadata and the paths."""

MOST_PATHS = 20
"""Files of a shape whose paths are searched."""

MOST_TERMS = 16
"""Words of a query; the rest is not looked at."""

IN_NAME, IN_TAG, IN_METADATA, IN_PATH = 6, 4, 2, 1
"""Weights of a word by the field that has it. Words of the weight `IN_PATH` are in paths alone."""

_LETTERS = str.maketrans(
    {"ø": "o", "æ": "ae", "œ": "oe", "ł": "l", "đ": "d", "ð": "d", "þ": "th", "ı": "i", "ħ": "h"}
)
_SPELLINGS = ("ae", "a"), ("oe", "o"), ("ue", "u"), ("aa", "a")

# Words that join others, in English, German, French, Spanish and Italian.
_JOINING = """
a an and at by for from in of on or the to with
der die das den dem des ein eine mit und von vom zu zum zur fur aus auf im am bei
de du la le les un une des et avec pour sur dans
el los las una y con para por il lo gli e di da per
"""
_JOINING_WORDS = frozenset(_JOINING.split())


def fold(text: str) -> str:
    """Return a text in the form in which words are compared."""
    parts = unicodedata.normalize("NFKD", text.casefold())
    plain = "".join(part for part in parts if not "\u0300" <= part <= "\u036f").translate(_LETTERS)
    for long, short in _SPELLINGS:
        plain = plain.replace(long, short)
    return unicodedata.normalize("NFC", plain)[:WORD_CHARACTERS]


def runs(text: str) -> Iterator[list[str]]:
    """Yield the runs of letters and digits of a text, each as its folded words.

    A word ends between letters and digits, and where capital letters begin: "PLAHolder" has pla and holder.
    """
    text = unicodedata.normalize("NFC", text)
    start = None
    for end, character in enumerate(f"{text} "):
        if character.isalnum() or (start is not None and unicodedata.category(character).startswith("M")):
            start = end if start is None else start
        elif start is not None:
            words = [word for word in map(fold, _split(text[start:end])) if word]
            if words:
                yield words
            start = None


def _split(run: str) -> Iterator[str]:
    start = 0
    for i in range(1, len(run)):
        last, character, following = run[i - 1], run[i], run[i + 1 : i + 2]
        if (
            last.isdecimal() != character.isdecimal()
            or (last.islower() and character.isupper())
            or (last.isupper() and character.isupper() and following.islower())
        ):
            yield run[start:i]
            start = i
    yield run[start:]


def _run(words: Sequence[str]) -> str | None:
    """Return a run of several words with digits, as of a thread or a bearing; None for another one."""
    whole = "".join(words)[:WORD_CHARACTERS]
    return whole if len(words) > 1 and any(map(str.isdecimal, whole)) else None


def words_of(
    name: str, tags: Sequence[str], metadata: Mapping[str, Any], paths: Sequence[str] = ()
) -> dict[str, int]:
    """Return the words and runs of a shape, each with its largest weight."""
    texts = [(name, IN_NAME), *((tag, IN_TAG) for tag in tags)]
    texts += [(value, IN_METADATA) for value in _values(metadata)]
    texts += [(path, IN_PATH) for path in paths[:MOST_PATHS]]
    weights: dict[str, int] = {}
    for text, weight in texts:
        for words in runs(text):
            for word in (*words, _run(words)):
                if word is not None and len(weights) < MOST_WORDS:
                    weights.setdefault(word, weight)
    return weights


def _values(metadata: Mapping[str, Any]) -> Iterator[str]:
    """Yield the texts and numbers of a JSON object, without its keys."""
    waiting: list[Any] = [metadata]
    while waiting:
        value = waiting.pop(0)
        if isinstance(value, Mapping):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, str | int | float) and not isinstance(value, bool):
            yield str(value)


@dataclass(frozen=True)
class Term:
    """A word of a query. A shape must have it if it is `required`; otherwise it raises the relevance.

    `begins` tells whether it may be the beginning of a word.
    """

    word: str
    required: bool
    begins: bool

    @property
    def is_common(self) -> bool:
        """Whether so many words or shapes may have the term that it is looked up for few shapes only."""
        return not self.begins or len(self.word) <= (1 if self.word.isdecimal() else 2)

    @property
    def inside(self) -> bool:
        """Whether the term is long enough to be looked for within words."""
        return not self.numbered and (
            len(self.word) >= 4 or (len(self.word) > 1 and max(self.word) > "\u0e00")
        )

    @property
    def splits(self) -> list[tuple[str, str]]:
        """The two words that the term may join: "phonestand" for "phone stand"."""
        if self.numbered:
            return []
        return [(self.word[:i], self.word[i:]) for i in range(3, len(self.word) - 2)]

    @property
    def misspelt(self) -> bool:
        """Whether words that differ by one edit are taken for the term."""
        return not self.numbered and len(self.word) >= 5

    @property
    def numbered(self) -> bool:
        """Whether the term has a digit."""
        return any(map(str.isdecimal, self.word))


def terms_of(query: str) -> list[Term]:
    """Return the words that a query asks for; an empty list if it has no letter and no digit.

    The last word may be the beginning of another, and so may each one of two letters or more. Words such as
    "for" and "mit" are left out unless there are no others.
    """
    every = list(runs(query))
    words = list(dict.fromkeys(word for run in every for word in run))
    words = ([word for word in words if word not in _JOINING_WORDS] or words)[:MOST_TERMS]
    whole = [run for run in dict.fromkeys(map(_run, every)) if run is not None and run not in words]
    return [
        *(Term(word, True, word == words[-1] or _begins(word)) for word in words),
        *(Term(run, False, True) for run in whole[:MOST_TERMS]),
    ]


def _begins(word: str) -> bool:
    return len(word) > 1 and not word.isdecimal()
