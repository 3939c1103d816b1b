"""INSERT and DELETE on a region map ("VDB-based Spatially Grounded Semantics")."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
import rdflib
from numpy.typing import NDArray
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.fields.queries.columns import (
    ALL,
    Catalogue,
    Demand,
    Entities,
    StatementRelation,
    Statements,
    UnknownError,
    VoxelColumn,
)
from semmap.fields.queries.evaluate import evaluate
from semmap.fields.queries.expressions import Context
from semmap.fields.queries.query_result import UpdateResult
from semmap.fields.queries.table import UNIT, LimitError, Table
from semmap.fields.queries.voxel_functions import VOXEL_FUNCTIONS, centres
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.regions.region_text import read_region
from semmap.fields.regions.shaped_region import Region, shape_of
from semmap.geometry.voxel_keys import keys_of, sorted_unique
from semmap.language.checker import Checker
from semmap.language.error import TOO_DEEP
from semmap.language.parser import ParsedText, parse_update
from semmap.language.schema import Function, Property, ValueKind, with_article
from semmap.language.terms import PAPER_NAMESPACE, name_of, position_of
from semmap_vdb import BoolGrid

Keys = NDArray[np.int64]

OCCUPIES = Property(
    PAPER_NAMESPACE + "occupies",
    "occupies",
    domain=None,
    range=None,
    subject="entity",
    object="voxel",
    same_as=("urn:semmap:ontology#occupies",),
)
"""The property of region maps: an entity has a voxel."""


def update(regions: RegionMap, text: str, catalogue: Catalogue | None = None) -> UpdateResult:
    """Carry out the requests of a SPARQL update, one after another; all of them or none.

    Subjects are entities, named by `str`; the property is :occupies; objects are regions as text
    (``"SPHERE(0 0 1 0.5)"^^:region``), or variables that WHERE binds to voxels. In INSERT, each
    label of a blank node gets a new name. WHERE may read the properties of `catalogue`, too.

    Raises
    ------
    QueryError
        The text is wrong or a region too large, with the place in the text. All is as before, but
        another thread may have read what was undone.
    ValueError
        The catalogue has another voxel size.
    """
    parsed = parse_update(text)
    if catalogue is not None and catalogue.voxel_size != regions.voxel_size:
        raise ValueError(
            f"the catalogue has voxels of {catalogue.voxel_size} m, the region map of "
            f"{regions.voxel_size} m: use one voxel size for both"
        )
    run = _UpdateRun(parsed, regions, catalogue)
    try:
        for request in parsed.requests:
            run.carry_out(request)
    except BaseException as error:
        run.undo()
        if isinstance(error, RecursionError):
            raise parsed.error(TOO_DEEP, 0) from None
        raise
    return UpdateResult(run.new, frozenset(run.before))


class _UpdateRun:
    """The requests of one text, and the former voxels of all entities that they changed."""

    def __init__(self, parsed: ParsedText, regions: RegionMap, catalogue: Catalogue | None) -> None:
        self.parsed = parsed
        self.regions = regions
        self.new: dict[str, str] = {}
        self.before: dict[str, NDArray[np.int32]] = {}
        self._catalogue = RegionCatalogue(regions, catalogue)
        self._unlabelled: dict[str, str] = {}

    def carry_out(self, request: CompValue) -> None:
        """Carry out one request: first evaluate it, then delete, then insert."""
        checker = Checker(self.parsed, self._catalogue)
        context = Context(self._catalogue)
        table = UNIT
        match request.name:
            case "InsertData":
                deleted, inserted = [], request.triples
            case "DeleteData":
                deleted, inserted = request.triples, []
            case "DeleteWhere":
                deleted, inserted = request.triples, []
                where = CompValue("BGP", triples=request.triples)
                table = self._solutions(checker, context, where)
            case _:
                deleted = request.delete.triples if request.delete else []
                inserted = request.insert.triples if request.insert else []
                table = self._solutions(checker, context, request.where)
        template = _Template(self.parsed, checker, context, table, self._name_of_node)
        deletions = [(t, template.regions(*t)) for t in _in_order(deleted)]
        insertions = [(t, template.regions(*t)) for t in _in_order(inserted)]
        for change, changes in ((self._delete, deletions), (self._insert, insertions)):
            for triple, pairs in changes:
                for name, region in pairs:
                    try:
                        change(name, region)
                    except ValueError as error:
                        raise self.parsed.error(str(error), triple[2]) from error

    def undo(self) -> None:
        """Give all entities the voxels that they had."""
        for name, voxels in self.before.items():
            self._replace(name, voxels)

    def _solutions(self, checker: Checker, context: Context, where: Any) -> Table:
        pattern = checker.check(where)
        try:
            return evaluate(pattern, context)
        except (LimitError, UnknownError) as error:
            raise self.parsed.error(str(error), 0) from None

    def _entity(self, name: str) -> Hashable:
        return next((e for e in self.regions.entities() if str(e) == name), name)

    def _insert(self, name: str, region: Region) -> None:
        entity = self._entity(name)
        self.before.setdefault(name, self.regions.voxels(entity))
        self.regions.insert(entity, region)

    def _delete(self, name: str, region: Region) -> None:
        voxels = self.regions.voxels(self._entity(name))
        deleted = BoolGrid(self.regions.voxel_size, False)
        deleted.fill(shape_of(region), True)
        centres = (voxels.astype(np.float64) + 0.5) * self.regions.voxel_size
        kept = voxels[~deleted.at(centres)]
        if len(kept) < len(voxels):
            self.before.setdefault(name, voxels)
            self._replace(name, kept)

    def _replace(self, name: str, voxels: NDArray[np.int32]) -> None:
        entity = self._entity(name)
        if len(voxels):
            self.regions.move(entity, (voxels + 0.5) * self.regions.voxel_size)
        else:
            self.regions.remove(entity)

    def _name_of_node(self, node: rdflib.BNode, labelled: bool) -> str:
        """Return the name of a blank node: an unused one at the first call."""
        label = str(node)
        if not labelled:
            label = self._unlabelled.setdefault(label, f"[{len(self._unlabelled) + 1}]")
        if label not in self.new:
            number = 1
            while self._is_used(f"region{number}"):
                number += 1
            self.new[label] = f"region{number}"
        return self.new[label]

    def _is_used(self, name: str) -> bool:
        if name in self.new.values():
            return True
        try:
            self._catalogue.find_entities(name, None)
        except LookupError:
            return False
        return True


def _in_order(triples: Sequence[Any]) -> list[Any]:
    """Return triples in the order of the text."""
    return sorted(triples, key=lambda triple: position_of(triple[0]) or 0)


@dataclass
class _Template:
    """Makes entities and regions of the triples of INSERT and DELETE."""

    parsed: ParsedText
    checker: Checker
    context: Context
    table: Table
    name_of_node: Callable[[rdflib.BNode, bool], str]

    def regions(self, subject: Any, verb: Any, object_: Any) -> list[tuple[str, Region]]:
        """Return the entities of a triple, each with a region."""
        error = self.parsed.error
        if not is_occupies(str(verb)):
            raise error("only :occupies can be inserted and deleted", verb)
        region = None if isinstance(object_, rdflib.Variable) else self._region(object_)
        self._check_kind(subject, "entity")
        self._check_kind(object_, "voxel")
        if not isinstance(subject, rdflib.Variable):
            name = self._name(subject)
            if self.table.rows == 0:
                return []
            return [(name, self._points(self._values(object_)[1]) if region is None else region)]
        names = self.context.names.names
        rows, codes = self._values(subject)
        if region is not None:
            return [(names[code], region) for code in np.unique(codes).tolist()]
        both, keys = self._values(object_)
        every = np.intersect1d(rows, both, assume_unique=True)
        codes = codes[np.searchsorted(rows, every)]
        keys = keys[np.searchsorted(both, every)]
        return [(names[c], self._points(keys[codes == c])) for c in np.unique(codes).tolist()]

    def _points(self, keys: Keys) -> Region:
        return centres(sorted_unique(keys), self.context.voxel_size)

    def _check_kind(self, term: Any, kind: ValueKind) -> None:
        if not isinstance(term, rdflib.Variable):
            return
        known = self.checker.kinds.get(str(term))
        if known is None:
            raise self.parsed.error(f"?{term} is not bound by any pattern", term)
        if known[0] != kind:
            raise self.parsed.error(
                f"this has to be {with_article(kind)}, and ?{term} is {with_article(known[0])}",
                term,
            )

    def _values(self, variable: Any) -> tuple[NDArray[np.intp], Keys]:
        """Return the rows that bind a variable, and its values."""
        column = self.table.columns.get(str(variable))
        if column is None:
            return np.zeros(0, np.intp), np.zeros(0, np.int64)
        rows = np.flatnonzero(column.is_bound)
        return rows, column.values[rows]

    def _name(self, subject: Any) -> str:
        if isinstance(subject, rdflib.BNode):
            labelled = self.parsed.text.sparql.startswith("_:", position_of(subject) or 0)
            return self.name_of_node(subject, labelled)
        name = name_of(subject)
        if name is None:
            raise self.parsed.error("this is not an entity: write an IRI or a plain name", subject)
        return name

    def _region(self, literal: Any) -> Region:
        datatype = getattr(literal, "datatype", None)
        if datatype is None or name_of(datatype) != "region":
            raise self.parsed.error(
                'this is not a region: write "SPHERE(x y z radius)"^^:region, or a variable of '
                "WHERE",
                literal,
            )
        try:
            return read_region(str(literal))
        except ValueError as error:
            raise self.parsed.error(str(error), literal) from error


def is_occupies(iri: str) -> bool:
    """Return whether an IRI is that of :occupies."""
    return iri in (OCCUPIES.iri, *OCCUPIES.same_as)


class RegionCatalogue:
    """A region map, and the properties of another catalogue of the same voxel size."""

    functions: Mapping[str, Function] = VOXEL_FUNCTIONS

    def __init__(self, regions: RegionMap, catalogue: Catalogue | None = None) -> None:
        self.voxel_size = regions.voxel_size
        self._regions = regions
        self._catalogue = catalogue

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI."""
        if is_occupies(iri):
            return OCCUPIES
        if self._catalogue is None:
            raise LookupError(f"there is no property {iri}: a region map has :occupies only")
        return self._catalogue.find_property(iri)

    def properties(self) -> Iterator[Property]:
        """Yield all properties."""
        yield OCCUPIES
        if self._catalogue is not None:
            yield from self._catalogue.properties()

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return what a constant stands for, entities of the region map included."""
        is_known = any(str(each) == name for each in self._regions.entities())
        own = frozenset({name} if is_known and range_ is None else ())
        if self._catalogue is None:
            if not own:
                raise LookupError(f"the region map has no entity {name}")
            return own
        try:
            return own | self._catalogue.find_entities(name, range_)
        except LookupError:
            if own:
                return own
            raise

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation that states a property."""
        if property == OCCUPIES:
            return _OccupiesRelation(self._regions)
        assert self._catalogue is not None
        return self._catalogue.relation(property)

    def during(self, begin: datetime, end: datetime) -> Catalogue:
        """Raise LookupError: a region map has no history."""
        raise LookupError("a region map has no history: leave out the time")


class _OccupiesRelation:
    """States `entity :occupies voxel`, from a region map."""

    property = OCCUPIES

    def __init__(self, regions: RegionMap) -> None:
        self._regions = regions

    def statements(self, wanted: Demand = ALL) -> Statements:
        there, subjects = self._regions.entities(), wanted.subjects
        entities = [each for each in there if subjects is None or str(each) in subjects]
        keys = [keys_of(self._regions.voxels(each)) for each in entities]
        codes = np.repeat(np.arange(len(keys), dtype=np.int32), [len(each) for each in keys])
        return Statements(
            Entities(codes, tuple(map(str, entities))),
            VoxelColumn(np.concatenate([*keys, np.zeros(0, np.int64)])),
        )
