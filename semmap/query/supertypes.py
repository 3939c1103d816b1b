"""What subsumes semantic types: the order in which pictures, plans and sizes look for one."""

from __future__ import annotations

from collections.abc import Iterable

from semmap.query.snapshot import Snapshot


def read_supertypes(
    seen: Snapshot, types: Iterable[str | None] | None = None
) -> dict[str, tuple[str, ...]]:
    """Some types, or all, with their supertypes: itself first, then by how few types they have."""
    rows = seen.session.execute(
        "SELECT c.sub, array_agg(c.super ORDER BY c.sub <> c.super, n.size, c.super) "
        "FROM type_closure c JOIN (SELECT super, count(*) AS size FROM type_closure "
        "GROUP BY super) n ON n.super = c.super "
        "WHERE %(names)s::text[] IS NULL OR c.sub = ANY (%(names)s) GROUP BY c.sub ORDER BY c.sub",
        {"names": None if types is None else [name for name in types if name is not None]},
    )
    return {sub: tuple(above) for sub, above in rows}
