"""Data sets like OAEI's Person1, Person2 and Restaurants, corrupted as they are; with the truth."""

from __future__ import annotations

import random
import string
from dataclasses import dataclass
from xml.sax.saxutils import escape

from semmap.interlinking.interlink import Interlinking, Workbench
from semmap.interlinking.records import Records


def words(text: str) -> list[str]:
    return text.split()


GIVEN = words("""
    anna ben carla david emma felix greta hannah ivan jana karl lena marco nina oscar paula
    quentin rosa simon tessa ulrich vera walter xenia yann zoe thomas sarah joshua emily
    nicholas chloe lachlan isabella jack mia samuel olivia
""")
FAMILY = words("""
    adler brown clarke dietrich evans fischer green hughes ibsen jansen keller lehmann
    morrison nguyen oconnor petersen quinn richter schmidt taylor ullmann vogel white xu
    young ziegler ryan campbell webb coleman stephenson matthews
""")
STREETS = words("""
    acacia station church mill park victoria river high king queen garden forest hill meadow
    lake orchard harbour castle bridge market
""")
KINDS = words("""
    street road avenue crescent place drive close lane
""")
SUBURBS = words("""
    northfield eastgate westbrook southport riverside lakeview hillcrest oakwood pinewood
    elmhurst brighton kingston ashford redhill
""")
STATES = words("""
    nsw vic qld wa sa tas
""")
FOODS = words("""
    french italian american chinese mexican indian japanese seafood steakhouses delis
    coffeebar thai
""")
PLACES = [
    "los angeles",
    "new york",
    "san francisco",
    "atlanta",
    "las vegas",
    "santa monica",
    "brooklyn",
]


@dataclass
class Case:
    left: Records
    right: Records
    links: set[tuple[str, str]]


def typo(text: str, rng: random.Random) -> str:
    """Insert, delete, replace or exchange a letter."""
    i = rng.randrange(len(text))
    letter = rng.choice(string.digits if text[i].isdigit() else string.ascii_lowercase)
    kind = rng.randrange(4)
    if kind == 0:
        return text[:i] + letter + text[i:]
    if kind == 1 and len(text) > 1:
        return text[:i] + text[i + 1 :]
    if kind == 2 and i + 1 < len(text):
        return text[:i] + text[i + 1] + text[i] + text[i + 2 :]
    return text[:i] + letter + text[i + 1 :]


def person(rng: random.Random) -> dict[str, str]:
    birth = f"{rng.randrange(1920, 2005)}{rng.randrange(1, 13):02d}{rng.randrange(1, 29):02d}"
    return {
        "given_name": rng.choice(GIVEN),
        "surname": rng.choice(FAMILY),
        "date_of_birth": birth,
        "soc_sec_id": str(rng.randrange(10**6, 10**7)),
        "phone_number": f"{rng.randrange(1, 9):02d} {rng.randrange(10**7, 10**8)}",
        "age": str(2006 - int(birth[:4])),
        "has_address/house_number": str(rng.randrange(1, 250)),
        "has_address/street": f"{rng.choice(STREETS)} {rng.choice(KINDS)}",
        "has_address/postcode": str(rng.randrange(1000, 9999)),
        "has_address/is_in_suburb": rng.choice(SUBURBS),
        "has_address/state": rng.choice(STATES),
    }


def corrupted(
    record: dict[str, str], changes: int, rng: random.Random, missing: float
) -> dict[str, str]:
    """Change fields: typos, an exchange of two fields, missing values."""
    found = dict(record)
    for _ in range(changes):
        field = rng.choice(list(found))
        chance = rng.random()
        if chance < 0.1:
            a, b = rng.choice(
                [("given_name", "surname"), ("has_address/street", "has_address/is_in_suburb")]
            )
            found[a], found[b] = found[b], found[a]
        elif found[field]:
            found[field] = typo(found[field], rng)
    for field in found:
        if rng.random() < missing:
            found[field] = ""
    return found


NAMES_OF_SECOND = {
    "surname": "family_name",
    "date_of_birth": "born",
    "soc_sec_id": "social_security",
    "phone_number": "telephone",
    "has_address/postcode": "lives_at/zip",
    "has_address/street": "lives_at/road",
    "has_address/is_in_suburb": "lives_at/town",
    "has_address/house_number": "lives_at/number",
    "has_address/state": "lives_at/region",
    "given_name": "first_name",
}


def records(name: str, rows: dict[str, dict[str, str]], names: dict[str, str]) -> Records:
    fields = list(next(iter(rows.values())))
    return Records(
        name,
        list(rows),
        {names.get(f, f): [(r[f],) if r[f] else () for r in rows.values()] for f in fields},
    )


def person1(n: int = 500, seed: int = 1, names=NAMES_OF_SECOND) -> Case:
    """One to one, at most one change an attribute."""
    rng = random.Random(seed)
    left = {f"http://a/Person{i:05d}": person(rng) for i in range(n)}
    order = list(range(n))
    rng.shuffle(order)
    keys = list(left)
    right = {
        f"http://b/P{j:05d}": corrupted(left[keys[i]], rng.randrange(1, 5), rng, 0.02)
        for j, i in enumerate(order)
    }
    return Case(
        records("left", left, {}),
        records("right", right, names),
        {(keys[i], f"http://b/P{j:05d}") for j, i in enumerate(order)},
    )


def person2(
    originals: int = 400, right: int = 400, extra: int = 200, seed: int = 2, names=NAMES_OF_SECOND
) -> Case:
    """n to 1: up to 3 records of a person, up to 10 changes each; left also has strangers."""
    rng = random.Random(seed)
    one = {f"http://b/P{i:05d}": person(rng) for i in range(right)}
    many, links = {}, set()
    keys = list(one)
    i = 0
    while len(links) < originals:
        source = rng.choice(keys)
        for _ in range(rng.randrange(1, 4)):
            if len(links) == originals:
                break
            key = f"http://a/Person{i:05d}"
            many[key] = corrupted(one[source], rng.randrange(3, 11), rng, 0.08)
            links.add((key, source))
            i += 1
    for _ in range(extra):
        many[f"http://a/Person{i:05d}"] = corrupted(person(rng), 3, rng, 0.08)
        i += 1
    return Case(records("left", many, {}), records("right", one, names), links)


def restaurants(left: int = 113, right: int = 752, seed: int = 3) -> Case:
    """Few beside many; formats, categories and abbreviations differ."""
    rng = random.Random(seed)

    def restaurant() -> dict[str, str]:
        number = f"{rng.randrange(200, 999)}/{rng.randrange(200, 999)}-{rng.randrange(1000, 9999)}"
        street = f"{rng.randrange(1, 9999)} {rng.choice(STREETS)} {rng.choice(KINDS)}"
        name = rng.choice(
            [
                f"{rng.choice(FAMILY)}'s",
                f"cafe {rng.choice(GIVEN)}",
                f"{rng.choice(STREETS)} {rng.choice(['grill', 'bistro', 'room', 'diner'])}",
                f"chez {rng.choice(FAMILY)}",
                f"the {rng.choice(SUBURBS)} {rng.choice(['grill', 'cafe'])}",
            ]
        )
        return {
            "name": name,
            "has_address/street": street,
            "has_address/is_in_city": rng.choice(PLACES),
            "phone_number": number,
            "category": rng.choice(FOODS),
        }

    b = {f"http://b/R{j:04d}": restaurant() for j in range(right)}
    a, links = {}, set()
    for i, key in enumerate(rng.sample(list(b), left)):
        r = dict(b[key])
        if i == 0:
            a[f"http://a/R{i:04d}"] = restaurant()
            continue
        r["phone_number"] = r["phone_number"].replace("/", "-")
        if rng.random() < 0.15:
            r["phone_number"] = restaurant()["phone_number"]
        if rng.random() < 0.6:
            r["category"] = rng.choice(FOODS)
        if rng.random() < 0.4:
            r["name"] = r["name"].replace("the ", "").replace("cafe", "caffe") + rng.choice(
                ["", " restaurant", " bar"]
            )
        if rng.random() < 0.5:
            s = r["has_address/street"]
            for long, short in (
                ("street", "st."),
                ("avenue", "ave."),
                ("road", "rd."),
                ("drive", "dr."),
            ):
                s = s.replace(long, short)
            r["has_address/street"] = s + rng.choice(["", " between 1st and 2nd"])
        if rng.random() < 0.2:
            r["has_address/is_in_city"] = rng.choice(PLACES)
        a[f"http://a/R{i:04d}"] = r
        links.add((f"http://a/R{i:04d}", key))
    return Case(
        records("left", a, {}),
        records(
            "right",
            b,
            {
                "has_address/street": "location/street",
                "has_address/is_in_city": "location/city",
                "phone_number": "phone",
            },
        ),
        links,
    )


def rdf_xml(data: Records, kind: str) -> str:
    """A data set as RDF/XML; ``has_address/street`` is the street of a resource of another type."""
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:o="http://o#">',
    ]
    for number, key in enumerate(data.keys):
        own, parts = [], {}
        for path, values in data.record(number).items():
            first, _, rest = path.partition("/")
            for value in values:
                text = f"<o:{rest or first}>{escape(value)}</o:{rest or first}>"
                (parts.setdefault(first, []) if rest else own).append(text)
        for name, texts in parts.items():
            own.append(f'<o:{name} rdf:resource="{key}-part"/>')
            lines.append(f'<o:Address rdf:about="{key}-part">{"".join(texts)}</o:Address>')
        lines.append(f'<o:{kind} rdf:about="{key}">{"".join(own)}</o:{kind}>')
    return "\n".join([*lines, "</rdf:RDF>"])


def alignment_xml(links: set[tuple[str, str]]) -> str:
    """Links in the Alignment format."""
    cells = "".join(
        f'<map><Cell><entity1 rdf:resource="{a}"/><entity2 rdf:resource="{b}"/>'
        "<relation>=</relation><measure>1.0</measure></Cell></map>"
        for a, b in sorted(links)
    )
    return (
        '<?xml version="1.0" encoding="utf-8"?>'
        '<rdf:RDF xmlns="http://knowledgeweb.semanticweb.org/heterogeneity/alignment" '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f"<Alignment>{cells}</Alignment></rdf:RDF>"
    )


def interlink(left, right, labels, ask=None, questions=0) -> Interlinking:
    """The links of two data sets, after so many questions."""
    work = Workbench(left, right, labels)
    if ask is not None:
        work.ask(ask, questions)
    return work.interlink()
