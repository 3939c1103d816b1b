"""The embedded server's settings: fit for this machine, durable, reached by its owner alone."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from semmap.database.programs import Programs

SUPERUSER = "semmap"
"""The database role that the cluster's owner has."""

READER = "semmap_read"
"""The login of those who only read: a member of ``semmap_reader`` and of no other role."""

MB = 1 << 20
ALLOCATOR = {
    "MALLOC_TRIM_THRESHOLD_": str(32 * MB),
    "MALLOC_TOP_PAD_": str(MB),
    "MALLOC_MMAP_THRESHOLD_": str(8 * MB),
}
"""The server's environment: what glibc keeps of freed memory, in bytes.

It would give back what each plan took, a megabyte for Figure 3, and fault it in again for the next.
"""

ROOMY_SHM = 1024 * MB
"""Below this /dev/shm (64 MB in a container) parallel queries would run out of it."""


def server_settings(programs: Programs, socket_folder: Path, home: Path) -> dict[str, str]:
    """Settings for ``postgresql.conf``; `home` has the files that say who may log in."""
    memory = _memory()
    shm = Path("/dev/shm")
    small_shm = not shm.is_dir() or shutil.disk_usage(shm).total < ROOMY_SHM
    compression = "lz4" if programs.lz4 else "pglz"
    return {
        # only the owner, only on this machine
        "listen_addresses": "",
        "port": "5432",
        "unix_socket_directories": str(socket_folder),
        "unix_socket_permissions": "0700",
        "hba_file": str(home / "hba.conf"),
        "ident_file": str(home / "ident.conf"),
        "authentication_timeout": "5s",  # of a session that never says who it is
        # what is committed stays
        "fsync": "on",
        "synchronous_commit": "on",
        "full_page_writes": "on",
        # sized for this machine
        "shared_buffers": _megabytes(memory / 8, 32, 512),
        "effective_cache_size": _megabytes(memory / 2, 64, 1 << 20),
        "work_mem": _megabytes(memory / 256, 4, 32),
        "maintenance_work_mem": _megabytes(memory / 32, 16, 256),
        "dynamic_shared_memory_type": "mmap" if small_shm else "posix",
        "max_wal_size": "4GB",
        "checkpoint_timeout": "15min",
        "wal_compression": compression if programs.version >= 15 else "on",
        "default_toast_compression": compression,
        "random_page_cost": "1.1",
        "jit": "off",
        "autovacuum": "on",
        "timezone": "UTC",
        "log_timezone": "UTC",
    }


def as_file(settings: Mapping[str, str]) -> str:
    """Settings as the text of a configuration file."""
    quoted = {name: value.replace("'", "''") for name, value in settings.items()}
    return "".join(f"{name} = '{value}'\n" for name, value in quoted.items())


def access_rules() -> str:
    """``pg_hba.conf``: the Unix socket, and the kernel's word for who it is that calls."""
    return "local all all peer map=semmap\n"


def user_map(owner: str, logins: Sequence[str] = (SUPERUSER, READER)) -> str:
    """``pg_ident.conf``: the cluster's owner, and root, log in as each of `logins`."""
    users = dict.fromkeys((owner, "root"))
    quoted = (login.replace('"', '""') for login in logins if login.isprintable())
    return "".join(f'semmap "{user}" "{role}"\n' for role in quoted for user in users)


def _memory() -> float:
    """Bytes of memory that this process may have: the machine's, or its control group's."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    for limit in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            return min(machine, int(Path(limit).read_text()))
        except (OSError, ValueError):
            continue
    return machine


def _megabytes(size: float, least: int, most: int) -> str:
    return f"{min(max(int(size / MB), least), most)}MB"
