"""Functions, triggers, views and roles: all that is code, so that it can be replaced as a whole."""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import run_sql_files

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

DROP_CODE = """
DO $$
DECLARE
    statement text;
BEGIN
    FOR statement IN
        SELECT format('DROP POLICY %I ON %s', polname, polrelid::regclass)
        FROM pg_policy p JOIN pg_class c ON c.oid = p.polrelid
        WHERE c.relnamespace = 'semmap'::regnamespace
        UNION ALL
        SELECT format('ALTER TABLE %s DISABLE ROW LEVEL SECURITY', oid::regclass)
        FROM pg_class WHERE relnamespace = 'semmap'::regnamespace AND relrowsecurity
        UNION ALL
        SELECT format('DROP VIEW IF EXISTS %s CASCADE', oid::regclass)
        FROM pg_class WHERE relnamespace = 'semmap'::regnamespace AND relkind = 'v'
        UNION ALL
        SELECT format('DROP %s IF EXISTS %s CASCADE',
                      CASE prokind WHEN 'a' THEN 'AGGREGATE' ELSE 'FUNCTION' END, oid::regprocedure)
        FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace
    LOOP
        EXECUTE statement;
    END LOOP;
    REVOKE ALL ON ALL TABLES IN SCHEMA semmap FROM semmap_reader, semmap_robot, semmap_admin;
    REVOKE ALL ON ALL SEQUENCES IN SCHEMA semmap FROM semmap_reader, semmap_robot, semmap_admin;
    REVOKE ALL ON SCHEMA semmap FROM semmap_reader, semmap_robot, semmap_admin;
END $$
"""


def upgrade() -> None:
    """Run the files in the order of their names."""
    op.execute("SET LOCAL search_path = semmap, public")
    run_sql_files(op, "functions/*.sql", "views/*.sql", "roles.sql")


def downgrade() -> None:
    """Drop all code of the schema; the tables and their rows stay."""
    op.execute("SET LOCAL search_path = semmap, public")
    op.execute(DROP_CODE)
