"""Scores as text."""

import pytest

from service.search.score_words import score_in_words


@pytest.mark.parametrize(
    ("score", "text"),
    [
        (0.5, "0.5000"),
        (-0.25, "-0.2500"),
        (0.97123, "0.9712"),
        (0.99612, "0.9961"),
        (0.999612, "0.99961"),
        (0.99998765, "0.999988"),
        (0.9999999, "0.9999999"),
        (0.99999999, "1.0000"),
        (1.0, "1.0000"),
        (1.0 + 1e-12, "1.0000"),
    ],
)
def test_near_one_a_score_has_as_many_digits_as_tell(score: float, text: str) -> None:
    assert score_in_words(score) == text


def test_different_scores_near_one_are_told_apart() -> None:
    scores = [1.0 - 10.0**-power for power in range(1, 8)]
    assert len({score_in_words(score) for score in scores}) == len(scores)
