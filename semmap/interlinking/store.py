"""Links in the database: stored, listed, taken back; both data sets as one."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import psycopg
from psycopg.rows import dict_row
from psycopg.types.json import Jsonb
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from semmap.interlinking.interlink import Interlinking
from semmap.interlinking.records import InterlinkingError, Records

Session = psycopg.Connection[Any]
Row = dict[str, Any]


def store_links(session: Session, found: Interlinking) -> int:
    """Store links, and the data sets that are not stored yet; return the number of the link set."""
    with session.transaction():
        left, right = (_store_data_set(session, s) for s in (found.left, found.right))
        row = session.execute(
            "INSERT INTO semmap.link_set (left_id, right_id, pattern, correspondences, labels) "
            "VALUES (%s, %s, %s, %s, %s) RETURNING id",
            (
                left,
                right,
                found.pattern,
                Jsonb([vars(c) for c in found.correspondences]),
                len(found.labels),
            ),
        ).fetchone()
        assert row is not None
        resources = _resources(found)
        copy = (
            "COPY semmap.record_link (link_set_id, left_key, right_key, confidence, resource) "
            "FROM STDIN"
        )
        with session.cursor() as cursor, cursor.copy(copy) as rows:
            for (links, confidence), resource in zip(
                found.links().items(), resources.tolist(), strict=True
            ):
                rows.write_row((row[0], *links, confidence, resource))
        return int(row[0])


def _store_data_set(session: Session, records: Records) -> int:
    values = (records.name, records.digest)
    row = session.execute(
        "INSERT INTO semmap.data_set (name, digest) VALUES (%s, %s) "
        "ON CONFLICT (digest) DO NOTHING RETURNING id",
        values,
    ).fetchone()
    if row is None:
        known = session.execute(
            "SELECT id FROM semmap.data_set WHERE digest = %s", (records.digest,)
        ).fetchone()
        assert known is not None
        return int(known[0])
    copy = "COPY semmap.data_record (data_set_id, key, properties) FROM STDIN"
    with session.cursor() as cursor, cursor.copy(copy) as rows:
        for number, key in enumerate(records.keys):
            rows.write_row((row[0], key, json.dumps(records.record(number))))
    return int(row[0])


def _resources(found: Interlinking) -> np.ndarray[Any, np.dtype[np.int64]]:
    """The number of the resource of each link: links that share a record have the same."""
    left, right = found.pairs.T
    size = len(found.left) + len(found.right)
    graph = coo_matrix(
        (np.ones(len(left), bool), (left, right + len(found.left))), shape=(size, size)
    )
    _, component = connected_components(graph, directed=False)
    return 1 + np.unique(component[left], return_inverse=True)[1]


def link_sets(session: Session) -> list[Row]:
    """Return the stored link sets, the newest first, with the names of their data sets."""
    with session.cursor(row_factory=dict_row) as cursor:
        return cursor.execute(
            'SELECT s.id, a.name AS "left", b.name AS "right", s.labels, s.pattern, s.by, s.at, '
            "(SELECT count(*) FROM semmap.record_link l WHERE l.link_set_id = s.id) AS links "
            "FROM semmap.link_set s JOIN semmap.data_set a ON a.id = s.left_id "
            "JOIN semmap.data_set b ON b.id = s.right_id ORDER BY s.id DESC"
        ).fetchall()


def merged_records(session: Session, link_set: int) -> list[Row]:
    """Return the resources of both data sets, as the SQL function of this name; or LookupError.

    `resource` is None without links, `confidence` that of the least sure link, `properties` lists
    of the different values, by the names of the left data set.
    """
    _check_known(session, link_set)
    with session.cursor(row_factory=dict_row) as cursor:
        return cursor.execute("SELECT * FROM semmap.merged_records(%s)", (link_set,)).fetchall()


def undo_links(session: Session, link_set: int) -> int:
    """Take a link set back, and its data sets that no other uses; return how many links it had."""
    _check_known(session, link_set)
    try:
        with session.transaction():
            count = session.execute(
                "SELECT count(*) FROM semmap.record_link WHERE link_set_id = %s", (link_set,)
            ).fetchone()
            sets = session.execute(
                "DELETE FROM semmap.link_set WHERE id = %s RETURNING left_id, right_id", (link_set,)
            ).fetchone()
            session.execute(
                "DELETE FROM semmap.data_set d WHERE d.id = ANY (%s) AND NOT EXISTS "
                "(SELECT FROM semmap.link_set s WHERE d.id IN (s.left_id, s.right_id))",
                (list(sets or ()),),
            )
    except psycopg.errors.InsufficientPrivilege as error:
        raise InterlinkingError(
            f"link set {link_set}: this role may not delete it: ask an admin of the database"
        ) from error
    return int(count[0]) if count else 0


def _check_known(session: Session, link_set: int) -> None:
    if not session.execute("SELECT FROM semmap.link_set WHERE id = %s", (link_set,)).rowcount:
        raise LookupError(f"there is no link set {link_set}: semmap interlink ls lists them")
