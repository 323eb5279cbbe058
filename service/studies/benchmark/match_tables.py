"""The measurements of `service.studies.benchmark.matching` as tables: a line for each pair."""

from collections.abc import Sequence

from service.studies.benchmark.matching import MANY, PARTS, MatchRow, PeerTimes


def match_table(rows: Sequence[MatchRow]) -> list[list[str]]:
    """Milliseconds."""
    return [
        [
            "pair",
            "vertices",
            f"one of {MANY}, ms",
            "re-ranking, ms",
            "coarse ranking, ms",
            "score, ms",
            "from records, ms",
            *(f"{part}, ms" for part in PARTS),
        ],
        *(
            [
                f"{row.first}, {row.second}",
                f"{row.vertices[0]:,}, {row.vertices[1]:,}",
                *(
                    spread.milliseconds(3)
                    for spread in (
                        row.many,
                        row.reranked,
                        row.coarse,
                        row.score,
                        row.records,
                        *row.parts.values(),
                    )
                ),
            ]
            for row in rows
        ),
    ]


def peer_table(rows: Sequence[MatchRow]) -> list[list[str]]:
    """Milliseconds and ratios, of one or more pairs; those without the peer are left out."""
    peers: list[tuple[MatchRow, PeerTimes]] = [(row, row.peer) for row in rows if row.peer is not None]
    stages = peers[0][1].stages
    table = [
        [
            "pair",
            "pyfmaps, ms",
            *(f"{stage}, ms" for stage in stages),
            "its spectra, ms",
            "our embeddings, ms",
            f"ratio, one of {MANY}",
            "from records",
            "from meshes",
        ]
    ]
    for row, peer in peers:
        times = (peer.match, *peer.stages.values(), peer.spectra, peer.embeddings)
        table.append(
            [
                f"{row.first}, {row.second}",
                *(spread.milliseconds() for spread in times),
                *(ratio.plain(0) for ratio in (peer.many, peer.records)),
                peer.meshes.plain(1),
            ]
        )
    return table
