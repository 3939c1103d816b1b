"""One route through a building of 25,600 rooms, beside the libraries; costs between many places.

One thread. Answers are compared with scipy's before anything is timed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from sqlalchemy import Connection, text

from benchmarks.bench_map import use_bench_database
from benchmarks.building import Building, building
from benchmarks.timing import Row, median_seconds, medians_in_turn, print_rows
from navgrid.travel import travel
from planner.graph import Graph
from semmap.database import open_engine

__all__ = ["main"]

QUERIES = 200
STANDS = 8
SITES = 36

Cost = Callable[[int, int], float]
"""What a library says that it costs from a node to another."""


def queries(rooms: int) -> list[tuple[int, int]]:
    """Pairs of rooms, the same in each run."""
    pairs = np.random.default_rng(11).integers(0, rooms, (QUERIES, 2))
    return [(start, goal) for start, goal in pairs.tolist()]


def matrix(there: Building) -> csr_array:
    """The building as scipy takes it."""
    tails, heads, weights = there.directed
    return coo_array((weights, (tails, heads)), shape=(len(there.places),) * 2).tocsr()


def graph_of(there: Building) -> Graph:
    """The building as a graph of ours, with its landmarks."""
    graph = Graph(*there.directed, len(there.places))
    graph.prepare()
    return graph


def by_us(there: Building) -> Cost:
    """A* with landmarks."""
    graph = graph_of(there)

    def cost(start: int, goal: int) -> float:
        way = graph.shortest([(start, 0.0)], [(goal, 0.0)])
        assert way is not None
        return way[0]

    return cost


def by_networkit(there: Building) -> Cost:
    """networkit's bidirectional Dijkstra, which crashes where it is not to store predecessors."""
    import networkit

    ends = tuple(map(np.ascontiguousarray, there.edges.T))
    graph = networkit.GraphFromCoo((there.weights, ends), n=len(there.places), weighted=True)

    def cost(start: int, goal: int) -> float:
        search = networkit.distance.BidirectionalDijkstra(graph, start, goal, True)
        search.run()
        return float(search.getDistance())

    return cost


def by_networkx(there: Building) -> Cost:
    """networkx's bidirectional Dijkstra."""
    graph = nx.Graph()
    graph.add_weighted_edges_from(
        (a, b, w) for (a, b), w in zip(there.edges.tolist(), there.weights.tolist(), strict=True)
    )

    def cost(start: int, goal: int) -> float:
        return float(nx.bidirectional_dijkstra(graph, start, goal)[0])

    return cost


def rustworkx_graph(there: Building) -> Any:
    """The building as rustworkx takes it."""
    import rustworkx

    graph = rustworkx.PyDiGraph()
    graph.add_nodes_from(range(len(there.places)))
    graph.add_edges_from([*zip(*(part.tolist() for part in there.directed), strict=True)])
    return graph


def by_rustworkx(there: Building) -> Cost:
    """rustworkx's Dijkstra, which ends at the goal."""
    import rustworkx

    graph = rustworkx_graph(there)

    def cost(start: int, goal: int) -> float:
        found = rustworkx.dijkstra_shortest_path_lengths(graph, start, float, goal=goal)
        return float(found[goal]) if goal != start else 0.0

    return cost


def by_rustworkx_astar(there: Building) -> Cost:
    """rustworkx's A*, bounded by the distance as the crow flies at the largest speed."""
    import rustworkx

    graph, places = rustworkx_graph(there), there.places.tolist()
    metres = np.linalg.norm(np.diff(there.places[there.edges], axis=1)[:, 0], axis=1)
    fastest = float((metres / there.weights).max())

    def cost(start: int, goal: int) -> float:
        end = places[goal]
        way = rustworkx.astar_shortest_path(
            graph,
            start,
            goal.__eq__,
            float,
            lambda node: math.dist(places[node], end) / fastest,
        )
        return float(sum(graph.get_edge_data(a, b) for a, b in pairwise(way)))

    return cost


@contextmanager
def with_pgrouting() -> Iterator[Connection | None]:
    """A transaction that is undone, in which pgRouting is there; None where the server has none."""
    use_bench_database()
    engine = open_engine()
    with engine.connect() as connection:
        known = "SELECT 1 FROM pg_available_extensions WHERE name = 'pgrouting'"
        if connection.execute(text(known)).scalar():
            connection.execute(text("CREATE EXTENSION IF NOT EXISTS pgrouting SCHEMA public"))
            yield connection
        else:
            yield None
        connection.rollback()
    engine.dispose()


def by_pgrouting(there: Building, connection: Connection) -> Cost:
    """pgr_dijkstra over a table of the edges."""
    connection.execute(
        text(
            "CREATE TEMP TABLE building ON COMMIT DROP AS SELECT id, source, target, cost FROM "
            "unnest(CAST(:i AS int[]), CAST(:s AS int[]), CAST(:t AS int[]), CAST(:c AS float8[]))"
            " AS e(id, source, target, cost)"
        ),
        {
            "i": list(range(len(there.edges))),
            "s": there.edges[:, 0].tolist(),
            "t": there.edges[:, 1].tolist(),
            "c": there.weights.tolist(),
        },
    )
    ask = text(
        "SELECT max(agg_cost) FROM public.pgr_dijkstra("
        "'SELECT id, source, target, cost, cost AS reverse_cost FROM building', :a, :b)"
    )

    def cost(start: int, goal: int) -> float:
        return float(connection.execute(ask, {"a": start, "b": goal}).scalar() or 0.0)

    return cost


def seconds_each(
    runs: Sequence[Cost], pairs: list[tuple[int, int]], turns: int
) -> NDArray[np.float64]:
    """(runs, pairs): the median over turns of what each pair takes; runs take turns by passes."""
    taken = np.empty((turns + 1, len(runs), len(pairs)))
    for turn in range(turns + 1):
        for i, run in enumerate(runs):
            for j, (start, goal) in enumerate(pairs):
                began = time.perf_counter()
                run(start, goal)
                taken[turn, i, j] = time.perf_counter() - began
    return np.median(taken[1:], axis=0)


def percentiles(seconds: NDArray[np.float64]) -> str:
    """Median and 95th percentile."""
    return f"{1e3 * np.median(seconds):.3f} ms, p95 {1e3 * np.percentile(seconds, 95):.3f} ms"


def one_route(there: Building) -> list[Row]:
    """200 routes, all equal to scipy's."""
    pairs = queries(len(there.places))
    starts, goals = np.transpose(pairs)
    exact = dijkstra(matrix(there), indices=starts)[np.arange(QUERIES), goals]
    rows = []
    ours, networkit = by_us(there), by_networkit(there)
    taken = seconds_each([ours, networkit], pairs, 5)
    equal = np.allclose([ours(a, b) for a, b in pairs], exact, rtol=1e-12)
    ratio = float(np.median(taken[0]) / np.median(taken[1]))
    rows.append(
        Row(
            "one route",
            percentiles(taken[0]),
            f"networkit, both ways: {percentiles(taken[1])}",
            "at most 1/2 at the median, all equal to scipy's",
            ratio <= 0.5 and bool(equal),
        )
    )
    few = pairs[:50]
    peers: list[tuple[str, Cost]] = [
        ("networkx, both ways", by_networkx(there)),
        ("rustworkx, Dijkstra", by_rustworkx(there)),
        ("rustworkx, A*", by_rustworkx_astar(there)),
    ]
    with with_pgrouting() as connection:
        if connection is not None:
            peers.append(("pgr_dijkstra", by_pgrouting(there, connection)))
        for name, peer in peers:
            theirs = seconds_each([peer], few, 1)[0]
            equal = np.allclose([peer(a, b) for a, b in few], exact[: len(few)], rtol=1e-9)
            faster = float(np.median(theirs) / np.median(taken[0]))
            rows.append(
                Row(
                    "the same",
                    f"1/{faster:,.0f}",
                    f"{name}: {percentiles(theirs)}",
                    "at most 1/5, equal",
                    faster >= 5 and bool(equal),
                )
            )
    return rows


def alternatives(there: Building) -> Row:
    """Five ways."""
    graph = graph_of(there)
    pairs = queries(len(there.places))[:50]

    def five(start: int, goal: int) -> float:
        return graph.alternatives([(start, 0.0)], [(goal, 0.0)], 5)[-1][0]

    return Row("five ways", percentiles(seconds_each([five], pairs, 1)[0]), "", "reported", True)


def changes(there: Building) -> list[Row]:
    """One edge's weight, and what answers cost when a tenth of the doors is shut."""
    graph = graph_of(there)
    random = np.random.default_rng(3)
    count = len(there.edges)
    edges = iter(random.integers(0, 2 * count, 4000).tolist())
    shut = 1e3 * median_seconds(lambda: graph.set_weights([next(edges)], [np.inf]), 1000)
    graph.set_weights(np.arange(2 * count), np.tile(there.weights, 2))
    doors = random.choice(count, count // 10, replace=False)
    graph.set_weights(np.concatenate([doors, doors + count]), np.full(2 * len(doors), np.inf))
    taken = seconds_each(
        [lambda a, b: (graph.shortest([(a, 0.0)], [(b, 0.0)]) or (np.inf,))[0]],
        queries(len(there.places)),
        1,
    )
    return [
        Row("an edge's weight is changed", f"{shut:.4f} ms", "", "< 1 ms", shut < 1),
        Row("one route, a tenth of the doors shut", percentiles(taken[0]), "", "reported", True),
    ]


def building_up() -> list[Row]:
    """From arrays to the first answer."""
    rows = []
    for there, required in ((building(1, 40, 25), 50.0), (building(), None)):
        build, landmarks = medians_in_turn(
            lambda there=there: Graph(*there.directed, len(there.places)),  # type: ignore[misc]
            lambda there=there: graph_of(there),  # type: ignore[misc]
            times=5,
        )
        rows.append(
            Row(
                f"a graph of {len(there.places):,} rooms",
                f"{1e3 * landmarks:.1f} ms",
                f"without landmarks: {1e3 * build:.1f} ms",
                "part of 50 ms" if required else "reported",
                required is None or 1e3 * landmarks < required,
            )
        )
    return rows


def between_many() -> list[Row]:
    """What it costs between sites of a task."""
    import rustworkx

    there = building(8, 40, 32)
    graph, scipy, rust = graph_of(there), matrix(there), rustworkx_graph(there)
    sites = np.random.default_rng(5).choice(len(there.places), SITES, replace=False)
    peers: dict[str, Callable[[], NDArray[np.float64]]] = {
        "scipy": lambda: dijkstra(scipy, indices=sites)[:, sites],
        "rustworkx": lambda: np.array(
            [
                [0.0 if a == b else found[b] for b in sites.tolist()]
                for a in sites.tolist()
                for found in [rustworkx.dijkstra_shortest_path_lengths(rust, a, float)]
            ]
        ),
    }
    rows = []
    for name, peer in peers.items():
        ours, theirs = medians_in_turn(lambda: graph.distances(sites, sites, threads=1), peer)
        rows.append(
            Row(
                f"between {SITES} of {len(there.places):,} rooms",
                f"{1e3 * ours:.1f} ms",
                f"{name}: {1e3 * theirs:.0f} ms",
                "reported, equal",
                bool(np.allclose(graph.distances(sites, sites), peer())),
            )
        )
    return rows


def over_a_room() -> Row:
    """Ways between stands on the costmap of a large room."""
    random = np.random.default_rng(2)
    occupied = np.zeros((122, 142), np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    for _ in range(12):
        row, column = random.integers(8, (100, 120))
        occupied[row : row + 8, column : column + 12] = True
    away = np.asarray(distance_transform_edt(~occupied))
    costs = np.where(away < 4, 254, 252 * np.exp(-0.25 * (away - 4).clip(0))).astype(np.uint8)
    free = np.argwhere(costs < 253)
    stands = free[random.choice(len(free), STANDS, replace=False)]
    taken = median_seconds(lambda: travel(costs, 0.05, stands, threads=1), 15)
    return Row(
        f"ways between {STANDS} stands in {len(free):,} free cells",
        f"{1e3 * taken:.1f} ms",
        "",
        "< 15 ms",
        taken < 15e-3,
    )


def main() -> None:
    """Print the table."""
    there = building()
    rows = [*one_route(there), alternatives(there), *changes(there), *building_up()]
    rows += [*between_many(), over_a_room()]
    title = f"Routes: {len(there.places):,} rooms, {len(there.edges):,} doors and flights"
    print_rows(title, rows)


if __name__ == "__main__":
    main()
