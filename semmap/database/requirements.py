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
SELECT current_setting('server_version_num')::int / 10000 AS version, current_user::text AS user,
       current_database()::text AS database, p.extversion AS postgis,
       p.extnamespace::regnamespace::text AS postgis_schema,
       (SELECT default_version FROM pg_available_extensions WHERE name = 'postgis') AS available,
       has_database_privilege(current_database(), 'CREATE') AS may_create,
       has_schema_privilege('public', 'CREATE') AS may_create_in_public,
       r.rolsuper AS superuser, r.rolsuper OR r.rolcreaterole AS may_make_roles,
       (SELECT count(*) FROM pg_roles WHERE rolname = ANY (%s)) AS roles,
       (SELECT pg_get_userbyid(nspowner)::text FROM pg_namespace
        WHERE nspname = 'semmap' AND NOT pg_has_role(nspowner, 'USAGE')) AS foreign_owner
FROM pg_roles r LEFT JOIN pg_extension p ON p.extname = 'postgis' WHERE r.rolname = current_user
"""


def check_requirements(connection: Connection) -> None:
    """See that the schema can be installed or changed here; DatabaseError says what to do."""
    found = connection.exec_driver_sql(STATE, (list(ROLES),)).one()
    if found.version < POSTGRESQL:
        raise DatabaseError(
            f"the server is PostgreSQL {found.version}; semmap needs {POSTGRESQL} or newer"
        )
    offered = found.postgis or found.available
    if offered is None:
        raise DatabaseError(
            "the server has no PostGIS; install it there (Debian, Ubuntu: apt-get install "
            f"postgresql-{found.version}-postgis-3) and call again"
        )
    if _numbers(offered) < POSTGIS:
        raise DatabaseError(
            f"the server's PostGIS is {offered}; semmap needs {POSTGIS[0]}.{POSTGIS[1]} or newer"
            + (
                ". ALTER EXTENSION postgis UPDATE, if a newer one is installed"
                if found.postgis
                else ""
            )
        )
    if found.postgis_schema not in (None, "public"):
        raise DatabaseError(
            f"PostGIS lies in the schema {found.postgis_schema} of {found.database}; "
            "semmap needs it in public"
        )
    if found.foreign_owner is not None:
        raise DatabaseError(
            f"{found.user} may not change the schema of {found.database}, which belongs to "
            f"{found.foreign_owner}; let {found.foreign_owner} bring it up to date: "
            "semmap --db URL db upgrade"
        )
    needs = []
    if not found.may_create:
        needs.append(f'GRANT CREATE ON DATABASE "{found.database}" TO "{found.user}"')
    if not found.may_create_in_public:
        needs.append(f'GRANT CREATE ON SCHEMA public TO "{found.user}"')
    if found.postgis is None and not found.superuser:
        needs.append("CREATE EXTENSION postgis SCHEMA public")
    if found.roles < len(ROLES) and not found.may_make_roles:
        needs.extend(f"CREATE ROLE {role}" for role in ROLES)
    if needs:
        raise DatabaseError(
            f"{found.user} may not install the schema in {found.database}. Let an administrator "
            f"run: {'; '.join(needs)}"
        )


def _numbers(version: str) -> tuple[int, ...]:
    """Of ``3.4.0dev``: (3, 4, 0)."""
    return tuple(int(n) for n in re.findall(r"\d+", version)[:3])
