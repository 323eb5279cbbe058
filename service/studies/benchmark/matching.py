"""One match of two stored shapes, both ways in every embedding, against functional maps of the meshes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from time import perf_counter
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from core.matching.match_records import match_record, score_match_records
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.coarse_ranking import coarse_ranking, coarse_samples
from core.ranking.quantised_points import quantised_points
from core.ranking.reranking import rerank
from core.serialization import embedding_from_bytes, embedding_to_bytes
from service.studies.benchmark.archive import shaken
from service.studies.benchmark.functional_maps import Peer
from service.studies.benchmark.meshes import Source, resized
from service.studies.benchmark.timing import Spread

VERTICES, PAIRS, REPEATS, MATCHES = 2800, 3, 5, 40
MANY = 64
"""Shapes that one is matched with in one call: the other of the pair, with other noise each."""

PARTS = ("decode", "pack", "match")

T = TypeVar("T")


@dataclass(frozen=True)
class PeerTimes:
    """Times of the peer on the same two meshes, in seconds.

    Attributes
    ----------
    match, spectra : Spread
        Times of the peer: one match in one direction, and the spectra of both meshes.
    stages : dict of str to Spread
        The peer's match by stage.
    embeddings : Spread
        Our time for the embeddings of both meshes.
    many, records, meshes : Spread
        Ratios of the peer's time to ours in each turn: to one match of many, to a match from records, and of
        the whole way from two meshes in memory.
    """

    match: Spread
    spectra: Spread
    stages: dict[str, Spread]
    embeddings: Spread
    many: Spread
    records: Spread
    meshes: Spread


@dataclass(frozen=True)
class MatchRow:
    """Times of one pair of meshes, in seconds.

    Attributes
    ----------
    first, second : str
    vertices : tuple of int
        Numbers of vertices.
    many, reranked, coarse : Spread
        One of `MANY` in a query: the match, re-ranking and coarse ranking.
    score : Spread
        One match by `Pipeline.score`, which hashes both embeddings to look up its caches.
    records : Spread
        From the bytes of two records to the scores, without any cache.
    parts : dict of str to Spread
        Parts of `records`, for both shapes together.
    peer : PeerTimes or None
    """

    first: str
    second: str
    vertices: tuple[int, int]
    many: Spread
    reranked: Spread
    coarse: Spread
    score: Spread
    records: Spread
    parts: dict[str, Spread]
    peer: PeerTimes | None


@dataclass(frozen=True)
class _Turn:
    """Seconds by name: several measurements of ours, then one of the peer and of our embedding, if any."""

    ours: list[dict[str, float]] = field(default_factory=list)
    theirs: dict[str, float] = field(default_factory=dict)
    stages: dict[str, float] = field(default_factory=dict)


class _Pair:
    """Two meshes, their embeddings and their match records."""

    def __init__(self, first: tuple[str, Mesh], second: tuple[str, Mesh], method: Pipeline) -> None:
        self._names = first[0], second[0]
        self._meshes = first[1], second[1]
        self._method = method
        self._embeddings = [method.embed(mesh) for mesh in self._meshes]
        query, candidate = self._embeddings
        copies = [candidate, *(shaken(candidate, number) for number in range(1, MANY))]
        self._match_record = match_record(query, DEFAULT)
        self._match_records = [match_record(copy, DEFAULT) for copy in copies]
        self._points = [quantised_points(copy) for copy in copies]
        self._coarse_samples = np.stack([coarse_samples(copy) for copy in copies])
        self._records = [embedding_to_bytes(embedding) for embedding in self._embeddings]

    def ours(self) -> dict[str, float]:
        """Seconds of one match among many, by `score`, and by part from records."""
        query, candidate = self._embeddings
        _, many = _seconds(lambda: score_match_records(self._match_record, self._match_records, DEFAULT))
        _, reranked = _seconds(lambda: rerank(self._match_record, self._points, DEFAULT))
        _, coarse = _seconds(lambda: coarse_ranking(self._match_record, self._coarse_samples, DEFAULT))
        _, score = _seconds(lambda: self._method.score(query, [candidate]))
        embeddings, decode = _seconds(lambda: [embedding_from_bytes(record) for record in self._records])
        shapes, packing = _seconds(lambda: [match_record(embedding, DEFAULT) for embedding in embeddings])
        _, match = _seconds(lambda: score_match_records(shapes[0], shapes[1:], DEFAULT))
        return {
            "many": many / MANY,
            "reranked": reranked / MANY,
            "coarse": coarse / MANY,
            "score": score,
            "decode": decode,
            "pack": packing,
            "match": match,
        }

    def turn(self, ours: list[dict[str, float]], peer: Peer | None) -> _Turn:
        """Several measurements of our match, then one of the peer's."""
        if peer is None:
            return _Turn(ours)
        spectra, spent = _seconds(lambda: [peer.spectrum(mesh) for mesh in self._meshes])
        stages = peer.match(*spectra)
        _, embedded = _seconds(lambda: [self._method.embed(mesh) for mesh in self._meshes])
        return _Turn(ours, {"match": sum(stages.values()), "spectra": spent, "embeddings": embedded}, stages)

    def row(self, turns: Sequence[_Turn]) -> MatchRow:
        """Summarise all turns."""
        first, second = (len(mesh.vertices) for mesh in self._meshes)

        def spread(*names: str) -> Spread:
            return Spread.of([sum(one[name] for name in names) for turn in turns for one in turn.ours])

        return MatchRow(
            *self._names,
            vertices=(first, second),
            many=spread("many"),
            reranked=spread("reranked"),
            coarse=spread("coarse"),
            score=spread("score"),
            records=spread(*PARTS),
            parts={part: spread(part) for part in PARTS},
            peer=_peer_times(turns) if turns[0].stages else None,
        )


def _seconds(work: Callable[[], T]) -> tuple[T, float]:
    start = perf_counter()
    result = work()
    return result, perf_counter() - start


def _peer_times(turns: Sequence[_Turn]) -> PeerTimes:
    def ours(turn: _Turn, *names: str) -> float:
        return median(sum(one[name] for name in names) for one in turn.ours)

    def spread(name: str) -> Spread:
        return Spread.of([turn.theirs[name] for turn in turns])

    return PeerTimes(
        match=spread("match"),
        spectra=spread("spectra"),
        stages={stage: Spread.of([turn.stages[stage] for turn in turns]) for stage in turns[0].stages},
        embeddings=spread("embeddings"),
        many=Spread.of([turn.theirs["match"] / ours(turn, "many") for turn in turns]),
        records=Spread.of([turn.theirs["match"] / ours(turn, *PARTS) for turn in turns]),
        meshes=Spread.of(
            [
                (turn.theirs["spectra"] + turn.theirs["match"])
                / (turn.theirs["embeddings"] + ours(turn, "pack", "match"))
                for turn in turns
            ]
        ),
    )


def chain(source: Source, vertices: int, count: int) -> list[tuple[str, Mesh]]:
    """At most `count` meshes with about a number of vertices: two of a class, two of another, and so on.

    Neighbours are alternately of one class and of two. Classes whose second mesh is nearest in size come
    first.
    """
    twos = [Source({label: meshes}).nearest(vertices, 2) for label, meshes in source.classes.items()]
    twos = [two for two in twos if len(two) == 2]
    twos.sort(key=lambda two: abs(len(two[1][1].vertices) - vertices))
    found = [entry for two in twos for entry in two][:count]
    return [(name, resized(mesh, vertices)) for name, mesh in found]


def matching_rows(
    source: Source,
    peer: Peer | None,
    *,
    vertices: int = VERTICES,
    pairs: int = PAIRS,
    repeats: int = REPEATS,
    matches: int = MATCHES,
) -> list[MatchRow]:
    """Measure neighbours of the `chain`: each turn measures our matches of every pair, then the peer's.

    The first turn is a warm-up. A source without two meshes of a class gives no row.
    """
    method = Pipeline(DEFAULT)
    turns: list[list[_Turn]] = []
    with threadpool_limits(limits=1):
        measured = [_Pair(*two, method) for two in pairwise(chain(source, vertices, pairs + 1))]
        for _ in range(repeats + 1):
            ours = [[pair.ours() for pair in measured] for _ in range(matches)]
            turns.append(
                [
                    pair.turn(list(mine), peer)
                    for pair, mine in zip(measured, zip(*ours, strict=True), strict=True)
                ]
            )
    return [pair.row(of_pair) for pair, of_pair in zip(measured, zip(*turns[1:], strict=True), strict=True)]
