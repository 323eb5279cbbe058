"""The SQL of words: the index of the words of shapes, and the search of it."""

from collections.abc import Iterable, Sequence

from sqlalchemy import ColumnElement, Integer, Subquery, delete, insert, select, text

from service.storage.database import WriteSession, drop_unused_words
from service.storage.tables import ShapeRow, ShapeWordRow, SourceFileRow, TagRow, WordRow
from service.storage.words import IN_PATH, MOST_PATHS, Term, terms_of, words_of

EXACT, BEGINNING, INSIDE, NEAR = 8, 4, 2, 1
"""Points of a word of a shape that is a term, begins with it, contains it, or differs from it by one edit.
The weight of the word multiplies them."""

AT_ONCE = 50
"""Shapes whose words one statement reads: SQLite takes no more than 32,766 values."""

_AFTER = "\U0010ffff"


def index_words(session: WriteSession, numbers: Iterable[int]) -> None:
    """Index the words of shapes whose name, tags, metadata or paths this transaction has written."""
    session.flush()
    every = sorted(set(numbers))
    for start in range(0, len(every), AT_ONCE):
        _index(session, every[start : start + AT_ONCE])


def _index(session: WriteSession, numbers: Sequence[int]) -> None:
    """Write the words of those of some shapes that have others than the index says."""
    indexed: dict[int, dict[str, int]] = {}
    words: dict[int, set[int]] = {}
    rows = (
        select(ShapeWordRow, WordRow.word)
        .join(WordRow, WordRow.number == ShapeWordRow.word_number)
        .where(ShapeWordRow.shape_number.in_(numbers))
    )
    for row, word in session.execute(rows):
        indexed.setdefault(row.shape_number, {})[word] = row.weight
        words.setdefault(row.shape_number, set()).add(row.word_number)
    tags: dict[int, list[str]] = {}
    of_shapes = TagRow.shape_number.in_(numbers)
    for number, tag in session.execute(
        select(TagRow.shape_number, TagRow.tag).where(of_shapes).order_by(TagRow.position)
    ):
        tags.setdefault(number, []).append(tag)
    shapes = select(ShapeRow.number, ShapeRow.name, ShapeRow.meta).where(ShapeRow.number.in_(numbers))
    weights = {
        number: words_of(name, tags.get(number, ()), metadata, _paths_of(session, number))
        for number, name, metadata in session.execute(shapes).all()
    }
    changed = {number: own for number, own in weights.items() if own != indexed.get(number, {})}
    if not changed:
        return
    session.execute(delete(ShapeWordRow).where(ShapeWordRow.shape_number.in_(changed)))
    numbers_of = _numbers_of(session, dict.fromkeys(word for own in changed.values() for word in own))
    written = [
        {"word_number": numbers_of[word], "shape_number": number, "weight": weight}
        for number, own in changed.items()
        for word, weight in own.items()
    ]
    if written:
        session.execute(insert(ShapeWordRow), written)
    left = set().union(*(words.get(number, ()) for number in changed))
    drop_unused_words(session, left - set(numbers_of.values()))


def _paths_of(session: WriteSession, number: int) -> Sequence[str]:
    """Return the paths of the files of a shape, in the order in which `isoshape check` reads them."""
    paths = select(SourceFileRow.path).where(SourceFileRow.shape_number == number)
    order = SourceFileRow.source_number, SourceFileRow.number
    return session.scalars(paths.order_by(*order).limit(MOST_PATHS)).all()


def _numbers_of(session: WriteSession, words: Iterable[str]) -> dict[str, int]:
    """Return the numbers of words, which are stored if they are not."""
    stored = select(WordRow.word, WordRow.number).where(WordRow.word.in_(list(words)))
    numbers = dict(session.execute(stored).all())
    missing = [{"word": word, "backward": word[::-1]} for word in words if word not in numbers]
    if missing:
        added = session.execute(insert(WordRow).returning(WordRow.word, WordRow.number), missing)
        numbers |= dict(added.all())
    return numbers


def having(query: str, *, by_paths: bool) -> ColumnElement[bool]:
    """Return the condition that a shape has all words of a query, `by_paths` also in its files' paths."""
    return ShapeRow.number.in_(select(relevances(query, by_paths=by_paths).c.shape_number))


def relevances(query: str, *, by_paths: bool) -> Subquery:
    """Return the numbers of the shapes that have all words of a query, and their `points`.

    A word of a shape counts as a term if it is the term, begins with it, contains it, or differs from it by
    one edit: a letter more, less or changed, or two neighbours swapped (`Term` tells from which length on).
    Two words count as a term that joins them. The points of a shape are the sum, over the terms, of the most
    points. The statement is text: expressions of SQLAlchemy for it take longer to make than it takes to run.
    """
    values = _Values()
    least = IN_PATH if by_paths else IN_PATH + 1
    terms = terms_of(query)
    common = [term for term in terms if term.required and term.is_common]
    if common and len(common) == sum(term.required for term in terms):
        common.remove(max(common, key=lambda term: len(term.word)))
    gathered = [term for term in terms if term not in common]
    required = sum(term.required for term in gathered)
    of_terms = " UNION ALL ".join(_of_term(term, least, values) for term in gathered)
    statement = f"""
        SELECT shape_number, sum(points) AS points
        FROM ({of_terms or _NOTHING}) AS of_terms
        GROUP BY shape_number HAVING sum(required) = {required}"""
    for term in common:
        statement = _having(statement, term, least, values)
    columns = {"shape_number": Integer, "points": Integer}
    return text(statement).bindparams(**values).columns(**columns).subquery()


_NOTHING = "SELECT 0 AS shape_number, 0 AS points, 1 AS required"


class _Values(dict[str, str]):
    """The values of a statement by the names of its parameters."""

    def name(self, value: str) -> str:
        """Return the parameter of a value."""
        name = f"word_{len(self)}"
        self[name] = value
        return f":{name}"

    def names(self, values: Iterable[str]) -> str:
        """Return the list of the parameters of values."""
        return ", ".join(map(self.name, values))


def _having(shapes: str, term: Term, least: int, values: _Values) -> str:
    """Return a query of those of some shapes that have a common term, with its points added.

    Single letters, numbers and units, as of sizes, are the words that most shapes have: they are looked up
    for the shapes that the other terms leave. SQLite keeps the order of the tables of a CROSS JOIN.
    """
    if term.begins:
        return f"""
            SELECT of_others.shape_number, max(of_others.points + shape_words.weight *
                CASE words.word WHEN {values.name(term.word)} THEN {EXACT} ELSE {BEGINNING} END) AS points
            FROM ({shapes}) AS of_others CROSS JOIN shape_words CROSS JOIN words
            WHERE shape_words.shape_number = of_others.shape_number AND shape_words.weight >= {least}
            AND words.number = shape_words.word_number AND {_begins("words.word", term.word, values)}
            GROUP BY of_others.shape_number"""
    return f"""
        SELECT of_others.shape_number, of_others.points + {EXACT} * shape_words.weight AS points
        FROM ({shapes}) AS of_others CROSS JOIN shape_words
        WHERE shape_words.word_number = (SELECT number FROM words WHERE word = {values.name(term.word)})
        AND shape_words.shape_number = of_others.shape_number AND shape_words.weight >= {least}"""


def _of_term(term: Term, least: int, values: _Values) -> str:
    """Return a query of the shapes that have a term, each with its most points."""
    joined = f"UNION ALL {_joined(term.splits, least, values)}" if term.splits else ""
    return f"""
        SELECT shape_number, max(points) AS points, {int(term.required)} AS required
        FROM (SELECT shape_words.shape_number, shape_words.weight * fitting.points AS points
              FROM ({_fitting(term, values)}) AS fitting
              JOIN shape_words ON shape_words.word_number = fitting.number
              AND shape_words.weight >= {least} {joined}) AS of_words
        GROUP BY shape_number"""


def _fitting(term: Term, values: _Values) -> str:
    """Return a query of the words that count as a term, each with its most points."""
    word = term.word
    conditions = [(EXACT, f"word = {values.name(word)}")]
    if term.begins:
        conditions.append((BEGINNING, f"word <> {values.name(word)} AND {_begins('word', word, values)}"))
    if term.inside:
        # Words that begin with a digit are many, and have no parts.
        conditions.append((INSIDE, f"word >= 'a' AND word LIKE {values.name(f'%{word}%')}"))
    if term.misspelt:
        conditions += [(NEAR, condition) for condition in _near(word, values)]
    fitting = " UNION ALL ".join(
        f"SELECT number, {points} AS points FROM words WHERE {condition}" for points, condition in conditions
    )
    # A word that several conditions hold for has the rows of its shapes read once.
    return f"SELECT number, max(points) AS points FROM ({fitting}) AS conditions GROUP BY number"


def _near(word: str, values: _Values) -> list[str]:
    """Return conditions, each served by an index, one of which holds for a word that differs by one edit.

    An edit leaves the first or the last half of the word. A `_` of a pattern stands for any character.
    """
    half = len(word) // 2
    shorter = [word[:i] + word[i + 1 :] for i in range(len(word))]
    swapped = [word[:i] + word[i + 1] + word[i] + word[i + 2 :] for i in range(len(word) - 1)]
    changed = [(i, f"{word[:i]}_{word[i + 1 :]}") for i in range(len(word))]
    longer = [(i, f"{word[:i]}_{word[i:]}") for i in range(len(word) + 1)]
    first = [pattern for i, pattern in changed + longer if i >= half]
    last = [pattern for i, pattern in changed + longer if i < half]
    return [
        f"word IN ({values.names(dict.fromkeys(shorter + swapped))})",
        f"{_begins('word', word[:half], values)} AND ({_like_one_of(first, values)})",
        f"{_begins('backward', word[half:][::-1], values)} AND ({_like_one_of(last, values)})",
    ]


def _begins(column: str, beginning: str, values: _Values) -> str:
    return f"{column} >= {values.name(beginning)} AND {column} < {values.name(beginning + _AFTER)}"


def _like_one_of(patterns: Iterable[str], values: _Values) -> str:
    return " OR ".join(f"word LIKE {values.name(pattern)}" for pattern in patterns)


def _joined(splits: Sequence[tuple[str, str]], least: int, values: _Values) -> str:
    """Return a query of the shapes that have both words of one of some splits of a term, with points."""
    return f"""
        SELECT of_first.shape_number, of_first.weight * {BEGINNING} AS points
        FROM words AS first JOIN shape_words AS of_first ON of_first.word_number = first.number
        JOIN shape_words AS of_second ON of_second.shape_number = of_first.shape_number
        JOIN words AS second ON second.number = of_second.word_number
        WHERE first.word IN ({values.names(word for word, _ in splits)})
        AND second.word IN ({values.names(word for _, word in splits)})
        AND of_first.weight >= {least} AND of_second.weight >= {least}
        AND length(first.word) + length(second.word) = {sum(map(len, splits[0]))}"""
