"""What a database must have before the schema goes in: versions, PostGIS, rights."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from semmap.database.error import DatabaseError

if TYPE_CHECKING:
    from sqlalchemy import Connection

POSTGRESQL = 14
"""The oldest major version of PostgreSQL that serves."""

POSTGIS = (3, 2)
"""The oldest version of PostGIS that serves."""

ROLES = ("semmap_reader", "semmap_robot", "semmap_admin")

STATE = """
SELECT current_setting('server_version_num')::int,
       current_user::text,
       current_database()::text,
       (SELECT extversion FROM pg_extension WHERE extname = 'postgis'),
       (SELECT extnamespace::regnamespace::text FROM pg_extension WHERE extname = 'postgis'),
       (SELECT default_version FROM pg_available_extensions WHERE name = 'postgis'),
       has_database_privilege(current_database(), 'CREATE'),
       has_schema_privilege('public', 'CREATE'),
       (SELECT rolsuper FROM pg_roles WHERE rolname = current_user),
       (SELECT rolsuper OR rolcreaterole FROM pg_roles WHERE rolname = current_user),
       (SELECT count(*) FROM pg_roles WHERE rolname = ANY (%s)),
       (SELECT pg_get_userbyid(nspowner)::text FROM pg_namespace
        WHERE nspname = 'semmap' AND NOT pg_has_role(nspowner, 'USAGE'))
"""


def check_requirements(connection: Connection) -> None:
    """See that the schema can be installed or changed here; DatabaseError says what to do."""
    (
        version,
        user,
        database,
        postgis,
        postgis_schema,
        available,
        may_create,
        may_create_in_public,
        superuser,
        may_make_roles,
        roles,
        foreign_owner,
    ) = connection.exec_driver_sql(STATE, (list(ROLES),)).one()
    if version // 10000 < POSTGRESQL:
        raise DatabaseError(
            f"the server is PostgreSQL {version // 10000}; semmap needs {POSTGRESQL} or newer"
        )
    offered = postgis or available
    if offered is None:
        raise DatabaseError(
            "the server has no PostGIS; install it there (Debian, Ubuntu: apt-get install "
            f"postgresql-{version // 10000}-postgis-3) and call again"
        )
    if _numbers(offered) < POSTGIS:
        raise DatabaseError(
            f"the server's PostGIS is {offered}; semmap needs {POSTGIS[0]}.{POSTGIS[1]} or newer"
            + (". ALTER EXTENSION postgis UPDATE, if a newer one is installed" if postgis else "")
        )
    if postgis_schema not in (None, "public"):
        raise DatabaseError(
            f"PostGIS lies in the schema {postgis_schema} of {database}; semmap needs it in public"
        )
    if foreign_owner is not None:
        raise DatabaseError(
            f"{user} may not change the schema of {database}, which belongs to {foreign_owner}; "
            f"let {foreign_owner} bring it up to date: semmap --db URL db upgrade"
        )
    needs = []
    if not may_create:
        needs.append(f'GRANT CREATE ON DATABASE "{database}" TO "{user}"')
    if not may_create_in_public:
        needs.append(f'GRANT CREATE ON SCHEMA public TO "{user}"')
    if postgis is None and not superuser:
        needs.append("CREATE EXTENSION postgis SCHEMA public")
    if roles < len(ROLES) and not may_make_roles:
        needs.extend(f"CREATE ROLE {role}" for role in ROLES)
    if needs:
        raise DatabaseError(
            f"{user} may not install the schema in {database}. Let an administrator run: "
            + "; ".join(needs)
        )


def _numbers(version: str) -> tuple[int, ...]:
    """Of ``3.4.0dev``: (3, 4, 0)."""
    return tuple(int(n) for n in re.findall(r"\d+", version)[:3])
