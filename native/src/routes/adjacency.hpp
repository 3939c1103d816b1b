// A directed graph as each node's arcs, one after the other.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

namespace semmap {

constexpr double kClosed = std::numeric_limits<double>::infinity();
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

struct Arc {
    double weight;
    std::uint32_t node;  // to which it leads
    std::uint32_t edge;
};

struct Adjacency {
    Adjacency(const std::vector<std::uint32_t>& from, const std::vector<std::uint32_t>& to,
              const std::vector<double>& weights, std::uint32_t nodes)
        : first(nodes + 1, 0), arcs(from.size()), place(from.size()) {
        for (const std::uint32_t node : from) ++first[node + 1];
        for (std::uint32_t node = 0; node < nodes; ++node) first[node + 1] += first[node];
        std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
        for (std::uint32_t edge = 0; edge < from.size(); ++edge) {
            place[edge] = next[from[edge]]++;
            arcs[place[edge]] = {weights[edge], to[edge], edge};
        }
    }

    const Arc* begin(std::uint32_t node) const { return arcs.data() + first[node]; }
    const Arc* end(std::uint32_t node) const { return arcs.data() + first[node + 1]; }

    std::vector<std::uint32_t> first;
    std::vector<Arc> arcs;
    std::vector<std::uint32_t> place;  // of each edge among the arcs
};

}  // namespace semmap
