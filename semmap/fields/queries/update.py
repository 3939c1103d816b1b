"""INSERT and DELETE on a region map: what occupies which voxels.

Source: "VDB-based Spatially Grounded Semantics for Interactive Robots", which puts regions in and
takes them out, by SPARQL.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
import rdflib
from numpy.typing import NDArray
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.checker import KB, Checker
from semmap.fields.queries.evaluate import evaluate
from semmap.language.expressions import centres, thing_named, word
from semmap.language.grammar import TOO_DEEP, Parsed, parse_update, place
from semmap.language.plan import Context
from semmap.fields.regions.region_text import read_region
from semmap.fields.queries.table import UNIT, LimitError, Table
from semmap.language.property import Property
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.regions.shapes import Region, shape_of
from semmap.fields.queries.statements import (
    Catalogue,
    Relation,
    Statements,
    Things,
    Voxels,
    keys_of,
)
from semmap_vdb import BoolGrid

__all__ = ["OCCUPIES", "Updated", "update"]

OCCUPIES = Property(
    KB + "occupies", "occupies", None, None, "thing", "voxel",
    same_as=("urn:semmap:ontology#occupies",),
)  # fmt: skip
"""The property of region maps: a thing has a voxel."""

Keys = NDArray[np.int64]


@dataclass(frozen=True)
class Updated:
    """What an update did.

    Attributes
    ----------
    new : the names that blank nodes got, by label; those without are [1], [2], ...
    changed : things whose voxels it wrote
    """

    new: Mapping[str, str]
    changed: frozenset[str]


def update(regions: RegionMap, text: str, catalogue: Catalogue | None = None) -> Updated:
    """Carry out the requests of a SPARQL update, one after another; all of them or none.

    Subjects are things, and those of INSERT may be blank nodes: each gets a name of its own, the
    same wherever the text has its label. The property is :occupies. Objects are texts of regions,
    ``"SPHERE(0 0 1 0.5)"^^:region``, or variables that WHERE binds to voxels.

    Parameters
    ----------
    regions : RegionMap
        Its entities are named by `str`.
    catalogue : Catalogue, optional
        What WHERE may ask besides :occupies; of the same voxel size.

    Raises
    ------
    QueryError
        With the place in the text; nothing was changed. Readers may have seen what was taken back.
    """
    parsed = parse_update(text)
    if catalogue is not None and catalogue.voxel_size != regions.voxel_size:
        raise ValueError(
            f"the catalogue has voxels of {catalogue.voxel_size} m, the region map of "
            f"{regions.voxel_size} m: they have to be the same"
        )
    work = _Work(parsed, regions, catalogue)
    try:
        for request in parsed.requests:
            work.carry_out(request)
    except RecursionError:
        work.take_back()
        raise parsed.error(TOO_DEEP, 0) from None
    except BaseException:
        work.take_back()
        raise
    return Updated(work.new, frozenset(work.before))


class _Occupancy:
    """:occupies, as a region map has it."""

    property = OCCUPIES

    def __init__(self, regions: RegionMap) -> None:
        self._regions = regions

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: Keys | None = None,
    ) -> Statements:
        """The voxels of things."""
        entities = [
            each for each in self._regions.entities() if subjects is None or str(each) in subjects
        ]
        keys = [keys_of(self._regions.voxels(each)) for each in entities]
        codes = np.repeat(np.arange(len(keys), dtype=np.int32), [len(each) for each in keys])
        return Statements(
            Things(codes, tuple(map(str, entities))),
            Voxels(np.concatenate([*keys, np.zeros(0, np.int64)])),
        )


class _Here:
    """A catalogue, and a region map besides."""

    def __init__(self, regions: RegionMap, catalogue: Catalogue | None) -> None:
        self.voxel_size = regions.voxel_size
        self._regions = regions
        self._catalogue = catalogue

    def relation(self, iri: str) -> Relation:
        """Of a property."""
        if iri in (OCCUPIES.iri, *OCCUPIES.same_as):
            return _Occupancy(self._regions)
        if self._catalogue is None:
            raise LookupError(f"there is no property {iri}: a region map has :occupies")
        return self._catalogue.relation(iri)

    def relations(self) -> Iterator[Relation]:
        """All."""
        yield _Occupancy(self._regions)
        if self._catalogue is not None:
            yield from self._catalogue.relations()

    def things(self, name: str, range_: str | None) -> frozenset[str]:
        """What a constant names: an entity of the region map, too."""
        entity = any(str(each) == name for each in self._regions.entities())
        own = frozenset({name} if entity and range_ is None else ())
        if self._catalogue is None:
            if not own:
                raise LookupError(f"nothing in the region map is called {name}")
            return own
        try:
            return own | self._catalogue.things(name, range_)
        except LookupError:
            if own:
                return own
            raise

    def at(self, moment: datetime) -> Catalogue:
        """A region map has no past."""
        raise LookupError("a region map does not know what it was")

    def during(self, begin: datetime, end: datetime) -> Catalogue:
        """A region map has no past."""
        raise LookupError("a region map does not know what it was")


class _Work:
    """The requests of one text, and what takes them back."""

    def __init__(self, parsed: Parsed, regions: RegionMap, catalogue: Catalogue | None) -> None:
        self.parsed = parsed
        self.regions = regions
        self.new: dict[str, str] = {}
        self.before: dict[str, NDArray[np.int32]] = {}
        self._here = _Here(regions, catalogue)
        self._anonymous: dict[str, str] = {}

    def carry_out(self, request: CompValue) -> None:
        """Do one request."""
        checker = Checker(self.parsed, self._here)
        context = Context(self.regions.voxel_size)
        table = UNIT
        match request.name:
            case "InsertData":
                removed, added = [], request.triples
            case "DeleteData":
                removed, added = request.triples, []
            case "DeleteWhere":
                removed, added = request.triples, []
                table = self._solutions(checker, context, CompValue("BGP", triples=request.triples))
            case _:
                removed = request.delete.triples if request.delete else []
                added = request.insert.triples if request.insert else []
                table = self._solutions(checker, context, request.where)
        find = _Template(self.parsed, checker, context, table, self._named)
        gone = [(triple, find(*triple)) for triple in _in_order(removed)]
        come = [(triple, find(*triple, fresh=True)) for triple in _in_order(added)]
        for change, made in ((self._delete, gone), (self._insert, come)):
            for triple, pairs in made:
                for thing, region in pairs:
                    try:
                        change(thing, region)
                    except ValueError as error:
                        raise self.parsed.error(str(error), triple[2]) from error

    def _solutions(self, checker: Checker, context: Context, where: Any) -> Table:
        plan = checker.plan(where)
        try:
            return evaluate(plan, context)
        except LimitError as error:
            raise self.parsed.error(str(error), 0) from None

    def take_back(self) -> None:
        """Give everything the voxels that it had."""
        for thing, voxels in self.before.items():
            self._put(thing, voxels)

    def _entity(self, thing: str) -> Hashable:
        return next((e for e in self.regions.entities() if str(e) == thing), thing)

    def _insert(self, thing: str, region: Region) -> None:
        entity = self._entity(thing)
        self.before.setdefault(thing, self.regions.voxels(entity))
        self.regions.insert(entity, region)

    def _delete(self, thing: str, region: Region) -> None:
        voxels = self.regions.voxels(self._entity(thing))
        gone = BoolGrid(self.regions.voxel_size, False)
        gone.fill(shape_of(region), True)
        kept = voxels[~gone.at(centres(keys_of(voxels), self.regions.voxel_size))]
        if len(kept) < len(voxels):
            self.before.setdefault(thing, voxels)
            self._put(thing, kept)

    def _put(self, thing: str, voxels: NDArray[np.int32]) -> None:
        entity = self._entity(thing)
        if len(voxels):
            self.regions.move(entity, (voxels + 0.5) * self.regions.voxel_size)
        else:
            self.regions.remove(entity)

    def _named(self, node: rdflib.BNode, labelled: bool) -> str:
        """The name of a blank node; a new one the first time."""
        label = str(node)
        if not labelled:
            label = self._anonymous.setdefault(label, f"[{len(self._anonymous) + 1}]")
        if label not in self.new:
            number = 1
            while self._in_use(f"region{number}"):
                number += 1
            self.new[label] = f"region{number}"
        return self.new[label]

    def _in_use(self, name: str) -> bool:
        if name in self.new.values():
            return True
        try:
            self._here.things(name, None)
        except LookupError:
            return False
        return True


def _in_order(triples: Sequence[Any]) -> list[Any]:
    """As they stand in the text."""
    return sorted(triples, key=lambda triple: place(triple[0]) or 0)


@dataclass
class _Template:
    """Makes things and voxels of a triple of INSERT or DELETE."""

    parsed: Parsed
    checker: Checker
    context: Context
    table: Table
    named: Callable[[rdflib.BNode, bool], str]

    def __call__(
        self, subject: Any, verb: Any, object_: Any, *, fresh: bool = False
    ) -> list[tuple[str, Region]]:
        """What it says of each thing."""
        error = self.parsed.error
        if str(verb) not in (OCCUPIES.iri, *OCCUPIES.same_as):
            raise error("only :occupies can be inserted and deleted", verb)
        if isinstance(subject, rdflib.BNode) and not fresh:
            raise error("a blank node stands in INSERT only: name the thing", subject)
        region = None if isinstance(object_, rdflib.Variable) else self._region(object_)
        self._check(subject, "thing")
        self._check(object_, "voxel")
        if not isinstance(subject, rdflib.Variable):
            thing = self._thing(subject)
            if self.table.rows == 0:
                return []
            return [(thing, self._points(self._values(object_)[1]) if region is None else region)]
        names = self.context.names.names
        rows, codes = self._values(subject)
        if region is not None:
            return [(names[code], region) for code in np.unique(codes).tolist()]
        both, keys = self._values(object_)
        every = np.intersect1d(rows, both)
        codes = codes[np.searchsorted(rows, every)]
        keys = keys[np.searchsorted(both, every)]
        return [(names[c], self._points(keys[codes == c])) for c in np.unique(codes).tolist()]

    def _points(self, keys: Keys) -> Region:
        return centres(np.unique(keys), self.context.voxel_size)

    def _check(self, term: Any, kind: str) -> None:
        if not isinstance(term, rdflib.Variable):
            return
        known = self.checker.kinds.get(str(term))
        if known is None:
            raise self.parsed.error(f"?{term} is not bound by any pattern", term)
        if known[0] != kind:
            raise self.parsed.error(
                f"this has to be a {kind}, and ?{term} is {word(known[0])}", term
            )

    def _values(self, variable: Any) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
        """The rows that bind a variable, and what to."""
        column = self.table.columns.get(str(variable))
        if column is None:
            return np.zeros(0, np.intp), np.zeros(0, np.int64)
        rows = np.flatnonzero(column.there)
        return rows, column.values[rows]

    def _thing(self, subject: Any) -> str:
        if isinstance(subject, rdflib.BNode):
            text = self.parsed.source.text
            at = place(subject) or 0
            return self.named(subject, text.startswith("_:", at))
        name = thing_named(subject)
        if name is None:
            raise self.parsed.error("this is no thing: write an IRI or a plain name", subject)
        return name

    def _region(self, literal: Any) -> Region:
        datatype = getattr(literal, "datatype", None)
        if datatype is None or thing_named(datatype) != "region":
            raise self.parsed.error(
                'no region: write "SPHERE(x y z radius)"^^:region, or a variable of WHERE', literal
            )
        try:
            return read_region(str(literal))
        except ValueError as error:
            raise self.parsed.error(str(error), literal) from error
