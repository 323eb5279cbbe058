"""How well, and how fast, words find shapes by their names, on both databases.

    python -m tests.studies.words DIR [--names 2000] [--times 100000] [--engine sqlite postgresql]

`QUERIES` are written by hand as makers look for the names beside them, in English, German and French; the
other names are drawn from the words that makers use. Exits with status 1 if fewer than 95 % of the queries
have their shape among the first five, or if the two databases answer differently.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from sqlalchemy import insert, select, text

from service.collection import DEFAULT_COLLECTION
from service.shapes import repository
from service.shapes.records import ShapeFilter
from service.storage.database import Database, WriteSession, migrate
from service.storage.tables import BlobRow, ShapeRow, ShapeWordRow, TagRow, WordRow
from service.storage.words import words_of
from tests.service import engines
from tests.studies.common import run, write

FIRST, LEAST = 5, 0.95
AT_ONCE = 2_000
REPEATED = 5

# Each query, and the name that is meant.
QUERIES = {
    "phone stand": "PhoneStand_v3_final.stl",
    "iphone 14 case": "iphone14_case-thin.stl",
    "gridfinity 2x3": "Gridfinity_Bin_2x3x6.stl",
    "m8 hex bolt": "HexBolt-M8x40.step",
    "M8 x 40": "HexBolt-M8x40.step",
    "608 bearing": "608ZZ_Bearing_Holder.stl",
    "keyring": "key_ring_bulldog.stl",
    "cable clip desk": "desk-cable-clip 6mm.stl",
    "raspberry pi 4": "RaspberryPi4_enclosure_top.stl",
    "nema 17 mount": "NEMA17-motor-mount.stl",
    "braket shelf": "shelf_bracket_heavy_duty.stl",
    "drawer handel": "IKEA-Malm drawer handle.stl",
    "hose adaptor 35mm": "Vacuum hose adapter 35mm to 40mm.stl",
    "benchy": "3DBenchy.stl",
    "octopuss": "flexi-octopus-v2-fixed.stl",
    "planter self watering": "Self_Watering_Planter_Large.stl",
    "headphone hook": "HeadphoneHook(wall).stl",
    "gear 20 teeth": "spur_gear_module1_20teeth.stl",
    "gopro mount bike": "BikeHandlebarMount_GoPro.stl",
    "dice tower": "Castle DiceTower (remix).stl",
    "handyhalter": "Handyhalterung_Auto_Lüftung.stl",
    "halterung auto": "Handyhalterung_Auto_Lüftung.stl",
    "gehäuse raspberry": "Raspberry_Gehaeuse_unten.stl",
    "gehaeuse deckel": "Gehäuse Deckel V1.stl",
    "schlüsselanhänger": "Schluesselanhaenger_Hund.stl",
    "kabelfuhrung": "Kabelführung-Schreibtisch.stl",
    "zahnrad 32 zähne": "Zahnrad_M1_32Zaehne.stl",
    "türgriff": "TuerGriff_Oldtimer.stl",
    "strassenschild": "Straßenschild.stl",
    "blumentopf gross": "Blumentopf groß 20cm.stl",
    "lufterabdeckung": "Lüfter-Abdeckung_120mm.stl",
    "lüfter 120": "Lüfter-Abdeckung_120mm.stl",
    "wandhaken für jacken": "Wandhaken_Jacke_stabil.stl",
    "schubladn griff": "Schubladen-Griff_modern.stl",
    "bohrschablone 32mm": "Bohrschablone32mm.stl",
    "eierbecher": "Eier-Becher_Huhn.stl",
    "ersatzrad koffer": "Koffer_Ersatz-Rad.stl",
    "dübel 8": "Duebel_8x50.stl",
    "vogelhaus": "Vogelhäuschen_Dach.stl",
    "küchenrollenhalter": "KuechenrollenHalter.stl",
    "support telephone": "Support_téléphone_bureau.stl",
    "boite piles aa": "Boîte à piles AA x12.stl",
    "engrenage 20 dents": "engrenage_20dents_mod1.stl",
    "crochet mural": "Crochet-mural_vélo.stl",
    "velo crochet": "Crochet-mural_vélo.stl",
    "poignée porte": "poignee_porte_fenetre.stl",
    "pot de fleurs": "PotDeFleurs_geometrique.stl",
    "equerre etagere": "Équerre étagère renforcée.stl",
    "porte clé chat": "porte-clés_chat_mignon.stl",
    "bouchon bouteille": "Bouchon_bouteille-d'eau.stl",
    "œuf": "coquetier-oeuf.stl",
    "entonoir": "entonnoir_80mm.stl",
    "couvercle boitier": "Boitier_ESP32_couvercle.stl",
    "esp32 boîtier": "Boitier_ESP32_couvercle.stl",
    "rondelle 5mm": "rondelle M5 epaisseur 5mm.stl",
    "charnière": "charniere_coffre.stl",
    "dragon articulé": "DragonArticule_sans_support.stl",
    "presse ail": "PresseAil.stl",
    "cle allen": "Rangement clés Allen.stl",
    "lunettes support mural": "support-lunettes_mural.stl",
}

WORDS = """
phone stand holder mount bracket clip hook box lid case cover knob handle gear wheel spacer washer
adapter hose cable desk wall shelf drawer key ring planter vase lamp dragon octopus cat dog dice tower
tray bin bolt nut screw bearing motor fan duct camera bike bottle opener tool rack pen cup coaster toy
car boat plane halter halterung deckel kasten griff rad zahnrad schraube mutter scheibe lüfter gehäuse
kabel wand haken schublade topf blume vogel haus schlüssel anhänger tür fenster fuß größe klammer schiene
winkel düse becher support boîte couvercle poignée roue engrenage vis écrou rondelle ventilateur boîtier
câble mur crochet tiroir pot fleur oiseau maison clé porte fenêtre pied équerre étagère bouchon bouteille
charnière tube serre
"""
ENDINGS = (
    "",
    "_v2",
    "-final",
    " (1)",
    "_fixed",
    "_REMIX",
    " neu",
    "_top",
    "_bottom",
    "_links",
    "_rechts",
    "_petit",
)


def made_names(count: int, seed: int = 0) -> list[str]:
    """Return names of two to four words, some with a size, a number or an ending, as makers write."""
    draw = np.random.default_rng(seed)
    names = []
    for _ in range(count):
        words = [str(word) for word in draw.choice(WORDS.split(), int(draw.integers(2, 5)), replace=False)]
        style = int(draw.integers(4))
        name = "".join(map(str.capitalize, words)) if style == 0 else "_- "[style - 1].join(words)
        size = draw.integers(4)
        if size == 0:
            name += f"_M{draw.integers(2, 20)}x{draw.integers(5, 90)}"
        elif size == 1:
            name += f" {draw.integers(3, 300)}mm"
        elif size == 2:
            name += f"_{draw.integers(10**6, 10**7)}"
        names.append(f"{name}{draw.choice(ENDINGS)}.stl")
    return names


@contextmanager
def archive_of(names: Sequence[str], url: str) -> Iterator[Database]:
    """A database with shapes that have names, and nothing else: one file, and no embedding."""
    database = Database(url, lock_seconds=60)
    try:
        migrate(database)
        with database.write() as session:
            _fill(session, names)
            # A server does so by itself, a little later.
            session.execute(text("ANALYZE"))
        yield database
    finally:
        database.close()


def _fill(session: WriteSession, names: Sequence[str]) -> None:
    """Store rows by thousands, as the service stores them one by one."""
    now = datetime.now(UTC)
    blob = session.insert(BlobRow, {"sha256": "0" * 64, "size": 1, "data": b"0"})
    row = {
        "collection_number": DEFAULT_COLLECTION.number,
        "blob_number": blob,
        "format": "stl",
        "meta": {},
        "facts": {},
        "created_at": now,
        "updated_at": now,
        "revision": 0,
        "checksum": "",
    }
    weights = [words_of(name, ("made",), {}) for name in names]
    every = sorted({word for each in weights for word in each})
    inserted = [{"word": word, "backward": word[::-1]} for word in every]
    for start in range(0, len(every), AT_ONCE):
        session.execute(insert(WordRow), inserted[start : start + AT_ONCE])
    numbers = dict(session.execute(select(WordRow.word, WordRow.number)).all())
    for start in range(0, len(names), AT_ONCE):
        some = range(start, min(start + AT_ONCE, len(names)))
        session.execute(
            insert(ShapeRow),
            [
                {**row, "number": i + 1, "id": str(i), "name": f"{i} {names[i]}", "folded_name": names[i]}
                for i in some
            ],
        )
        session.execute(insert(TagRow), [{"shape_number": i + 1, "tag": "made", "position": 0} for i in some])
        of_shapes = [
            {"word_number": numbers[word], "shape_number": i + 1, "weight": weight}
            for i in some
            for word, weight in weights[i].items()
        ]
        session.execute(insert(ShapeWordRow), of_shapes)


def found(database: Database, query: str, limit: int = FIRST) -> list[str]:
    """Return the names that a query finds first, without the numbers that make them distinct."""
    wanted = ShapeFilter(DEFAULT_COLLECTION.number, words=query)
    with database.read() as session:
        rows, _ = repository.page(session, wanted, after=None, limit=limit, sort="relevance")
    return [record.name.partition(" ")[2] for _, record in rows]


def recall(database: Database) -> dict[str, bool]:
    """Return whether each query has its shape among the first."""
    return {query: name in found(database, query) for query, name in QUERIES.items()}


def milliseconds(database: Database) -> list[float]:
    """Return the time of a page of 50 with its total, for each query several times."""
    times = []
    for query in [*QUERIES] * REPEATED:
        wanted = ShapeFilter(DEFAULT_COLLECTION.number, words=query)
        begun = time.perf_counter()
        with database.read() as session:
            repository.page(session, wanted, after=None, limit=50, sort="relevance")
        times.append(1e3 * (time.perf_counter() - begun))
    return times


def main(folder: Path, *, names: int, times: int, engine: Sequence[str]) -> bool:
    """Write the recall and the times of each database; return whether the answers are good, and alike."""
    rows: list[dict[str, object]] = []
    answers = []
    for name in engine:
        for count in dict.fromkeys((names, times)):
            made = [*QUERIES.values(), *made_names(count - len(QUERIES))]
            file = folder / f"words_{count}.sqlite3"
            file.unlink(missing_ok=True)
            url = f"sqlite:///{file}" if name == engines.SQLITE else engines.empty_database()
            with archive_of(made, url) as database:
                hits = recall(database)
                spent = milliseconds(database)
                if count == names:
                    answers.append([found(database, query, 50) for query in QUERIES])
            median, p95 = np.percentile(spent, (50, 95))
            share = sum(hits.values()) / len(hits)
            rows.append(
                {"database": name, "shapes": count, "recall": share, "median_ms": median, "p95_ms": p95}
            )
            for query in (query for query, hit in hits.items() if not hit):
                print(f"{name}, {count} shapes: {query!r} does not find {QUERIES[query]!r}")
    write(folder / "words.csv", rows)
    good = all(float(str(row["recall"])) >= LEAST for row in rows if row["shapes"] == names)
    return good and all(answer == answers[0] for answer in answers)


if __name__ == "__main__":
    try:
        run(main, __doc__, names=2_000, times=100_000, engine=engines.ENGINES)
    finally:
        engines.stop()
