"""The files of a cluster with failover: a monitor and servers in containers of Docker."""

from __future__ import annotations

import shutil
from ipaddress import IPv4Network
from pathlib import Path
from secrets import randbelow, token_hex
from shlex import quote
from typing import NamedTuple

from semmap.database.error import DatabaseError
from semmap.database.files import image_folder

PROMISES = (
    "A write is acknowledged when two servers have it on disk. Whichever one server is lost or cut "
    "off, none of them is lost; unless the one other server was still copying the database.",
    "When the primary fails, writes wait about ten seconds for the next one. semmap finds it, and "
    "writes again what was not written; another client connects again and repeats what was not "
    "acknowledged.",
    "When two servers are lost, or the monitor and the primary, writes wait until one of them is "
    "back.",
    "A client must not cancel a commit that waits, nor set synchronous_commit: the server then "
    "reports success for what one server has. A notice says so.",
)


class WrittenCluster(NamedTuple):
    """What `write_cluster` wrote, and the commands that use it."""

    folder: str
    start: str  # a command
    state: str  # a command that shows which server is the primary
    url: str  # of all servers; a client uses the one that takes writes
    promises: tuple[str, ...]


def write_cluster(
    folder: Path | str, nodes: int = 3, port: int = 5432, subnet: str | None = None
) -> WrittenCluster:
    """Write a compose file, the passwords and the image's source into a new folder.

    Parameters
    ----------
    folder
        It must be absent or empty. Its name is that of the cluster in Docker.
    nodes
        How many servers have the data, three or more.
    port
        The first server's on the loopback address; the others have the next ones.
    subnet
        The network over which servers copy the data, at most a /24; by default a random one of
        10.0.0.0/8.

    Raises
    ------
    DatabaseError
        If the folder has files, or an argument cannot be used; nothing is written.
    """
    folder = Path(folder).absolute()
    if nodes < 3:
        raise DatabaseError(
            f"{nodes} nodes: with fewer than 3 a server that fails cannot be replaced without loss"
        )
    if port + nodes - 1 > 65535:
        raise DatabaseError(f"port {port}: {nodes} nodes need ports up to {port + nodes - 1}")
    network = _network(subnet, nodes)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DatabaseError(f"{folder} is not an empty folder: choose a new one")
    source = image_folder()

    password = token_hex(16)
    folder.mkdir(parents=True, exist_ok=True)
    secrets = folder / ".env"
    secrets.touch(mode=0o600)
    secrets.write_text(f"POSTGRES_PASSWORD={password}\nNODE_PASSWORD={token_hex(16)}\n")
    (folder / "compose.yaml").write_text(_compose(nodes, port, network))
    shutil.copytree(source, folder / "postgis")
    for script in (folder / "postgis").iterdir():
        script.chmod(0o644 if script.name == "Dockerfile" else 0o755)

    compose = f"docker compose --project-directory {quote(str(folder))}"
    hosts = ",".join(f"127.0.0.1:{port + i}" for i in range(nodes))
    return WrittenCluster(
        folder=str(folder),
        start=f"{compose} up -d --build --wait",
        state=f"{compose} exec -u postgres monitor pg_autoctl show state",
        url=f"postgresql://semmap:{password}@{hosts}/semmap?target_session_attrs=read-write",
        promises=PROMISES,
    )


def _network(subnet: str | None, nodes: int) -> IPv4Network:
    """The network of a subnet, or a random one of 256 addresses."""
    if subnet is None:
        subnet = f"10.{16 + randbelow(224)}.{randbelow(256)}.0/24"
    try:
        network = IPv4Network(subnet)
    except ValueError as error:
        raise DatabaseError(f"subnet {subnet}: {error}; write it as 10.20.30.0/24") from error
    if network.num_addresses < 12 + nodes:
        raise DatabaseError(f"subnet {subnet}: {network.num_addresses} addresses are too few")
    return network


def _compose(nodes: int, port: int, network: IPv4Network) -> str:
    """The compose file. Names of servers are fixed, since to look up a lost one takes seconds."""
    addresses = {
        "monitor": network[10],
        **{f"node{i + 1}": network[11 + i] for i in range(nodes)},
    }
    hosts = "\n".join(f'    - "{name}.nodes:{ip}"' for name, ip in addresses.items())
    text = f"""\
# A monitor and {nodes} servers with failover. Clients reach the servers from this machine only;
# the servers reach each other in a network of their own.
#   docker compose up -d --build --wait
#   docker compose exec -u postgres monitor pg_autoctl show state
#   docker compose exec -u postgres monitor pg_autoctl perform switchover
x-database: &database
  image: ${{SEMMAP_IMAGE:-semmap-postgis}}
  build:
    context: postgis
    network: host
  restart: unless-stopped
  extra_hosts:
{hosts}
services:
  monitor:
    <<: *database
    command: monitor
    environment:
      NODE_PASSWORD: $NODE_PASSWORD
    networks:
      nodes:
        ipv4_address: {addresses.pop("monitor")}
    volumes:
      - monitor:/var/lib/postgresql/data
"""
    for i, (name, ip) in enumerate(addresses.items()):
        text += f"""\
  {name}:
    <<: *database
    command: node
    environment:
      NODE_NAME: {name}
      NODE_PASSWORD: $NODE_PASSWORD
      POSTGRES_USER: semmap
      POSTGRES_DB: semmap
      POSTGRES_PASSWORD: $POSTGRES_PASSWORD
    networks:
      clients:
      nodes:
        ipv4_address: {ip}
    ports:
      - "127.0.0.1:{port + i}:5432"
    volumes:
      - {name}:/var/lib/postgresql/data
    shm_size: 1gb
"""
    return (
        text
        + f"""\
networks:
  nodes:
    internal: true
    ipam:
      config:
        - subnet: {network}
  clients:
    driver_opts:
      com.docker.network.bridge.enable_icc: "false"
volumes:
  monitor:
"""
        + "".join(f"  {name}:\n" for name in addresses)
    )
