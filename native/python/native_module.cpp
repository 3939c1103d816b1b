// The Python face of semmap_native. Arguments are checked here, so that no call can crash; navgrid
// and planner check them first, in the words of their callers.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "checks.hpp"
#include "semmap/collisions.hpp"
#include "semmap/graph.hpp"
#include "semmap/inflation.hpp"
#include "semmap/occupancy.hpp"
#include "semmap/ways.hpp"

namespace py = pybind11;

void define_shapes(py::module_& module);  // in shapes_binding.cpp

namespace {

using namespace semmap::checks;

using Solids = std::optional<Array<std::int32_t>>;
using Marks = std::optional<Array<bool>>;
using Ends = std::vector<std::pair<double, double>>;

// One result has no more numbers than that: 2 GB of doubles.
constexpr double kMostResults = 268435456.0;

template <typename Index>
semmap::MeshView<Index> view(const Array<double>& vertices, const Array<Index>& faces,
                             const Solids& solids, std::int64_t solid_count) {
    expect_shape(vertices, "vertices", {kAny, 3}, "an (V, 3) array");
    expect_shape(faces, "faces", {kAny, 3}, "an (F, 3) array");
    // A byte a solid, interval and thread.
    within(solid_count, solids ? 0 : 1, 1 << 24, "solid_count");
    if (solids) {
        expect_shape(*solids, "solids", {faces.shape(0)}, "an (F,) array, one number a face");
        expect_indices(*solids, "solids", solid_count);
    }
    return {vertices.data(), length(vertices, 0), faces.data(), length(faces, 0),
            solids ? solids->data() : nullptr};
}

semmap::Fill filling(bool any, const Marks& filled, std::int64_t solid_count) {
    if (filled) expect_shape(*filled, "filled", {solid_count}, "an (S,) array, one a solid");
    return {any, filled ? bytes(*filled) : nullptr, static_cast<std::size_t>(solid_count)};
}

std::vector<semmap::Interval> intervals_of(const Ends& ends) {
    std::vector<semmap::Interval> intervals;
    for (const auto& [low, high] : ends) {
        finite(low, "intervals");
        finite(high, "intervals");
        expect(low <= high, "intervals: an interval ends below its lower end: turn it round");
        intervals.push_back({low, high});
    }
    return intervals;
}

semmap::GridFrame frame(double origin_x, double origin_y, double resolution, std::int64_t rows,
                        std::int64_t columns, std::size_t layers) {
    finite(origin_x, "origin_x");
    finite(origin_y, "origin_y");
    positive(resolution, "resolution");
    within(rows, 0, 1 << 24, "rows");
    within(columns, 0, 1 << 24, "columns");
    const double cells = static_cast<double>(rows) * static_cast<double>(columns);
    expect(cells * static_cast<double>(std::max<std::size_t>(layers, 1)) <= kMostNumbers,
           "rows, columns and intervals make more than 2^34 cells: take a coarser resolution");
    return {origin_x, origin_y, resolution, static_cast<std::int32_t>(rows),
            static_cast<std::int32_t>(columns)};
}

template <typename Index>
Array<bool> occupancy(const Array<double>& vertices, const Array<Index>& faces, const Ends& ends,
                      double origin_x, double origin_y, double resolution, std::int64_t rows,
                      std::int64_t columns, const Solids& solids, std::int64_t solid_count,
                      bool fill, const Marks& filled, std::int64_t thread_count) {
    const std::vector<semmap::Interval> intervals = intervals_of(ends);
    const auto grid = frame(origin_x, origin_y, resolution, rows, columns, intervals.size());
    const auto mesh = view(vertices, faces, solids, solid_count);
    const semmap::Fill inside = filling(fill, filled, solid_count);
    const unsigned team = threads(thread_count);
    Array<bool> cells({static_cast<py::ssize_t>(intervals.size()), py::ssize_t{grid.rows},
                       py::ssize_t{grid.columns}});
    auto* data = reinterpret_cast<std::uint8_t*>(cells.mutable_data());
    const py::gil_scoped_release release;
    for (std::size_t i = 0; i < intervals.size(); i += semmap::kMostIntervals) {
        const auto first = intervals.begin() + static_cast<std::ptrdiff_t>(i);
        const std::size_t count = std::min(semmap::kMostIntervals, intervals.size() - i);
        semmap::occupancy(mesh, {first, first + static_cast<std::ptrdiff_t>(count)}, grid, inside,
                          team, data + i * grid.cells());
    }
    return cells;
}

template <typename Index>
Array<bool> closed_solids(const Array<double>& vertices, const Array<Index>& faces,
                          const Solids& solids, std::int64_t solid_count,
                          std::int64_t thread_count) {
    const auto mesh = view(vertices, faces, solids, solid_count);
    const unsigned team = threads(thread_count);
    Array<bool> closed(static_cast<py::ssize_t>(solid_count));
    auto* data = reinterpret_cast<std::uint8_t*>(closed.mutable_data());
    const py::gil_scoped_release release;
    semmap::closed_solids(mesh, static_cast<std::size_t>(solid_count), team, data);
    return closed;
}

Array<std::uint8_t> inflate(const Array<bool>& occupied, std::int64_t radius,
                            const Array<std::uint8_t>& costs,
                            const std::optional<std::string>& variant) {
    const semmap::Family family =
        variant ? semmap::family_named(*variant) : semmap::families().back();
    expect_shape(occupied, "occupied", {kAny, kAny}, "a (rows, columns) array");
    within(radius, 0, 8192, "radius");
    expect_shape(costs, "costs", {radius * radius + 1},
                 "a cost for each squared distance from 0 to radius^2");
    Array<std::uint8_t> inflated({occupied.shape(0), occupied.shape(1)});
    const semmap::CostsByDistance table{static_cast<int>(radius), costs.data()};
    std::uint8_t* target = inflated.mutable_data();
    const py::gil_scoped_release release;
    semmap::inflate(bytes(occupied), length(occupied, 0), length(occupied, 1), table, family,
                    target);
    return inflated;
}

semmap::Terrain terrain(const Array<std::uint8_t>& costs, double resolution, double slow) {
    expect_shape(costs, "costs", {kAny, kAny}, "a (rows, columns) array");
    positive(resolution, "resolution");
    expect(slow >= 0 && slow <= 1e6, "slow is " + std::to_string(slow) + ": give 0 to 1e6");
    // Cells and a margin of two are numbered in 32 bits.
    expect(static_cast<double>(costs.shape(0) + 4) * static_cast<double>(costs.shape(1) + 4) < 4e9,
           "costs has too many cells: take a coarser resolution");
    return {costs.data(), length(costs, 0), length(costs, 1), resolution, slow};
}

std::vector<semmap::Cell> cells_of(const Array<std::int64_t>& array, const char* name,
                                   const semmap::Terrain& ground) {
    expect_shape(array, name, {kAny, 2}, "rows and columns, an (N, 2) array");
    std::vector<semmap::Cell> cells;
    for (py::ssize_t i = 0; i < array.shape(0); ++i) {
        const semmap::Cell cell{array.at(i, 0), array.at(i, 1)};
        // Numbers below 0 are large without a sign.
        if (static_cast<std::size_t>(cell.row) >= ground.rows ||
            static_cast<std::size_t>(cell.column) >= ground.columns) {
            throw py::value_error(std::string(name) + ": (" + std::to_string(cell.row) + ", " +
                                  std::to_string(cell.column) +
                                  ") is outside of costs: leave it out");
        }
        cells.push_back(cell);
    }
    return cells;
}

void expect_few_pairs(double count, const char* what) {
    expect(count <= kMostResults,
           std::string(what) + " make more than 2^28 pairs: ask for parts of them");
}

// What `compute` writes for each pair of starts and goals: prices and lengths of ways.
template <typename Compute>
std::pair<Array<double>, Array<double>> all_ways(std::size_t starts, std::size_t goals,
                                                 Compute&& compute) {
    expect_few_pairs(static_cast<double>(starts) * static_cast<double>(goals), "cells and targets");
    const auto k = static_cast<py::ssize_t>(starts), m = static_cast<py::ssize_t>(goals);
    Array<double> prices({k, m}), metres({k, m});
    double* price = prices.mutable_data();
    double* metre = metres.mutable_data();
    unlocked([&] { compute(price, metre); });
    return {prices, metres};
}

// The cells of a way that `find` finds between two, with `width` numbers each: row, column,
// heading.
template <typename Find>
Array<std::int64_t> one_way(const Array<std::int64_t>& ends, const semmap::Terrain& ground,
                            py::ssize_t width, Find&& find) {
    expect_shape(ends, "ends", {2, 2}, "the cells of both ends, a (2, 2) array");
    const std::vector<semmap::Cell> cells = cells_of(ends, "ends", ground);
    const auto found = unlocked([&] { return find(cells[0], cells[1]); });
    Array<std::int64_t> array({static_cast<py::ssize_t>(found.size()), width});
    std::int64_t* data = array.mutable_data();
    for (const auto& [cell, heading] : found) {
        *data++ = cell.row;
        *data++ = cell.column;
        if (width == 3) *data++ = heading;
    }
    return array;
}

std::pair<Array<double>, Array<double>> travel(const Array<std::uint8_t>& costs, double resolution,
                                               const Array<std::int64_t>& cells, double slow,
                                               const std::optional<Array<std::int64_t>>& targets,
                                               std::int64_t thread_count) {
    const semmap::Terrain ground = terrain(costs, resolution, slow);
    const auto starts = cells_of(cells, "cells", ground);
    const auto goals = targets ? cells_of(*targets, "targets", ground) : starts;
    const unsigned team = threads(thread_count);
    return all_ways(starts.size(), goals.size(), [&](double* prices, double* metres) {
        semmap::travel(ground, starts, goals, !targets, team, prices, metres);
    });
}

Array<std::int64_t> way(const Array<std::uint8_t>& costs, double resolution,
                        const Array<std::int64_t>& ends, double slow) {
    const semmap::Terrain ground = terrain(costs, resolution, slow);
    return one_way(ends, ground, 2, [&](semmap::Cell start, semmap::Cell goal) {
        return semmap::way(ground, start, goal);
    });
}

Array<std::uint16_t> collisions(const Array<bool>& occupied, const Array<std::int32_t>& runs) {
    expect_shape(occupied, "occupied", {kAny, kAny}, "a (rows, columns) array");
    expect_shape(runs, "runs", {kAny, 4}, "shape, row, first and last column, an (N, 4) array");
    std::vector<semmap::Run> found;
    for (py::ssize_t i = 0; i < runs.shape(0); ++i) {
        const semmap::Run run{runs.at(i, 0), runs.at(i, 1), runs.at(i, 2), runs.at(i, 3)};
        const bool fits = run.shape >= 0 && run.shape < semmap::kShapes &&
                          std::abs(std::int64_t{run.row}) <= semmap::kLongestRun &&
                          run.first >= -semmap::kLongestRun / 2 && run.first <= run.last &&
                          run.last <= semmap::kLongestRun / 2;
        if (!fits) throw py::value_error("run " + std::to_string(i) + " is too long or no run");
        found.push_back(run);
    }
    Array<std::uint16_t> bits({occupied.shape(0), occupied.shape(1)});
    std::uint16_t* target = bits.mutable_data();
    const py::gil_scoped_release release;
    semmap::collisions(bytes(occupied), length(occupied, 0), length(occupied, 1), found, target);
    return bits;
}

using Bits = Array<std::uint16_t>;

semmap::Space space(const Array<std::uint8_t>& costs, const Bits& fits, const Bits& steps,
                    const Bits& turns, double resolution, double slow) {
    const semmap::Terrain ground = terrain(costs, resolution, slow);
    const auto check = [&](const Bits& bits, const char* name) {
        expect_shape(bits, name, {costs.shape(0), costs.shape(1)}, "an array as large as costs");
    };
    check(fits, "fits");
    check(steps, "steps");
    check(turns, "turns");
    return {ground, fits.data(), steps.data(), turns.data()};
}

std::pair<Array<double>, Array<double>> drive(const Array<std::uint8_t>& costs, const Bits& fits,
                                              const Bits& steps, const Bits& turns,
                                              double resolution, const Array<std::int64_t>& cells,
                                              const std::optional<Array<std::int64_t>>& targets,
                                              double slow, std::int64_t thread_count) {
    const semmap::Space where = space(costs, fits, steps, turns, resolution, slow);
    const auto starts = cells_of(cells, "cells", where.terrain);
    const auto goals = targets ? cells_of(*targets, "targets", where.terrain) : starts;
    const unsigned team = threads(thread_count);
    return all_ways(starts.size(), goals.size(), [&](double* prices, double* metres) {
        semmap::drive(where, starts, goals, !targets, team, prices, metres);
    });
}

Array<std::int64_t> drive_way(const Array<std::uint8_t>& costs, const Bits& fits, const Bits& steps,
                              const Bits& turns, double resolution, const Array<std::int64_t>& ends,
                              double slow) {
    const semmap::Space where = space(costs, fits, steps, turns, resolution, slow);
    return one_way(ends, where.terrain, 3, [&](semmap::Cell start, semmap::Cell goal) {
        return semmap::drive_way(where, start, goal);
    });
}

using Ids = std::vector<std::uint32_t>;
using EndList = std::vector<std::pair<std::int64_t, double>>;

Ids ids_of(const Array<std::int64_t>& array, const char* name, std::int64_t count) {
    expect_shape(array, name, {kAny}, "a list of numbers");
    expect_indices(array, name, count);
    return {array.data(), array.data() + array.size()};
}

// One for each edge.
std::vector<double> weights_of(const Array<double>& array, const char* name, py::ssize_t edges) {
    expect_shape(array, name, {edges}, "one number per edge");
    std::vector<double> weights(array.data(), array.data() + array.size());
    for (const double weight : weights) {
        if (!(weight >= 0)) {
            throw py::value_error(std::string(name) + " holds " + std::to_string(weight) +
                                  ": give numbers of at least 0");
        }
    }
    return weights;
}

std::vector<semmap::End> ends_of(const semmap::Graph& graph, const EndList& list,
                                 const char* name) {
    std::vector<semmap::End> ends;
    for (const auto& [node, cost] : list) {
        if (node < 0 || node >= graph.nodes()) {
            throw py::value_error(std::string(name) + ": there is no node " + std::to_string(node) +
                                  "; nodes are 0 to " + std::to_string(graph.nodes() - 1));
        }
        if (!(cost >= 0)) {
            throw py::value_error(std::string(name) + ": the cost at node " + std::to_string(node) +
                                  " is not negative, and a number");
        }
        ends.push_back({static_cast<std::uint32_t>(node), cost});
    }
    return ends;
}

py::tuple answer(const semmap::Route& route) {
    Array<std::int64_t> edges(static_cast<py::ssize_t>(route.edges.size()));
    std::copy(route.edges.begin(), route.edges.end(), edges.mutable_data());
    return py::make_tuple(route.cost, edges);
}

void define_graph(py::module_& module) {
    using semmap::Graph;
    using Unlocked = py::call_guard<py::gil_scoped_release>;
    py::class_<Graph>(module, "Graph")
        .def(py::init([](const Array<std::int64_t>& tails, const Array<std::int64_t>& heads,
                         const Array<double>& weights, const Array<double>& least,
                         std::int64_t nodes) {
                 within(nodes, 0, 1 << 22, "nodes");
                 semmap::Edges edges{ids_of(tails, "tails", nodes), ids_of(heads, "heads", nodes),
                                     weights_of(weights, "weights", tails.size())};
                 expect(tails.size() == heads.size(), "tails and heads differ in length");
                 return std::make_unique<Graph>(std::move(edges),
                                                weights_of(least, "least", tails.size()),
                                                static_cast<std::uint32_t>(nodes));
             }),
             exact("tails"), exact("heads"), exact("weights"), exact("least"), py::arg("nodes"))
        .def("prepare", &Graph::prepare, Unlocked())
        .def("weights",
             [](const Graph& graph) {
                 const std::vector<double> weights = unlocked([&] { return graph.weights(); });
                 return Array<double>(static_cast<py::ssize_t>(weights.size()), weights.data());
             })
        .def(
            "set_weights",
            [](Graph& graph, const Array<std::int64_t>& edges, const Array<double>& weights) {
                const Ids ids = ids_of(edges, "edges", graph.edges());
                const std::vector<double> numbers = weights_of(weights, "weights", edges.size());
                const py::gil_scoped_release release;
                graph.set_weights(ids, numbers);
            },
            exact("edges"), exact("weights"))
        .def(
            "shortest",
            [](const Graph& graph, const EndList& sources,
               const EndList& targets) -> std::optional<py::tuple> {
                const auto from = ends_of(graph, sources, "sources");
                const auto to = ends_of(graph, targets, "targets");
                const auto route = unlocked([&] { return graph.shortest(from, to); });
                if (!route) return std::nullopt;
                return answer(*route);
            },
            py::arg("sources"), py::arg("targets"))
        .def(
            "alternatives",
            [](const Graph& graph, const EndList& sources, const EndList& targets,
               std::int64_t count) {
                within(count, 0, 1 << 20, "count");
                const auto from = ends_of(graph, sources, "sources");
                const auto to = ends_of(graph, targets, "targets");
                const auto most = static_cast<std::size_t>(count);
                py::list answers;
                for (const auto& route :
                     unlocked([&] { return graph.alternatives(from, to, most); })) {
                    answers.append(answer(route));
                }
                return answers;
            },
            py::arg("sources"), py::arg("targets"), py::arg("count"))
        .def(
            "distances",
            [](const Graph& graph, const Array<std::int64_t>& sources,
               const Array<std::int64_t>& targets, std::int64_t thread_count) {
                const Ids from = ids_of(sources, "sources", graph.nodes());
                const Ids to = ids_of(targets, "targets", graph.nodes());
                const unsigned team = threads(thread_count);
                expect_few_pairs(static_cast<double>(from.size()) * static_cast<double>(to.size()),
                                 "sources and targets");
                Array<double> costs({sources.size(), targets.size()});
                double* data = costs.mutable_data();
                unlocked([&] { graph.distances(from, to, team, data); });
                return costs;
            },
            exact("sources"), exact("targets"), py::arg("threads"));
}

template <typename Index>
void define_for(py::module_& module) {
    using py::arg;
    module.def("occupancy", &occupancy<Index>, exact("vertices"), exact("faces"), arg("intervals"),
               arg("origin_x"), arg("origin_y"), arg("resolution"), arg("rows"), arg("columns"),
               arg("solids").none(true), arg("solid_count"), arg("fill"), arg("filled").none(true),
               arg("threads"));
    module.def("closed_solids", &closed_solids<Index>, exact("vertices"), exact("faces"),
               arg("solids").none(true), arg("solid_count"), arg("threads"));
}

}  // namespace

PYBIND11_MODULE(semmap_native, module) {
    module.doc() =
        "Meshes on grids, costs around what is occupied, ways over them, routes; shapes of points.";
    define_for<std::int32_t>(module);
    define_for<std::int64_t>(module);
    module.def("inflate", &inflate, exact("occupied"), py::arg("radius"), exact("costs"),
               py::arg("variant").none(true) = py::none());
    module.def("inflation_variants", &semmap::family_names);
    define_graph(module);
    module.def("travel", &travel, exact("costs"), py::arg("resolution"), exact("cells"),
               py::arg("slow"), py::arg("targets").none(true), py::arg("threads"));
    module.def("collisions", &collisions, exact("occupied"), exact("runs"));
    module.def("drive", &drive, exact("costs"), exact("fits"), exact("steps"), exact("turns"),
               py::arg("resolution"), exact("cells"), exact("targets").none(true), py::arg("slow"),
               py::arg("threads"));
    module.def("drive_way", &drive_way, exact("costs"), exact("fits"), exact("steps"),
               exact("turns"), py::arg("resolution"), exact("ends"), py::arg("slow"));
    module.def("way", &way, exact("costs"), py::arg("resolution"), exact("ends"), py::arg("slow"));
    define_shapes(module);
}
