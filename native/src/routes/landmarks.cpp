#include "landmarks.hpp"

#include <numeric>

#include "sweep.hpp"

namespace semmap {
namespace {

// The largest set of nodes that edges join, whatever their direction.
std::vector<std::uint32_t> largest_part(const Edges& edges, const std::vector<double>& weights,
                                        std::uint32_t nodes) {
    std::vector<std::uint32_t> parents(nodes);
    std::iota(parents.begin(), parents.end(), 0u);
    const auto root = [&](std::uint32_t node) {
        while (parents[node] != node) node = parents[node] = parents[parents[node]];
        return node;
    };
    for (std::size_t i = 0; i < edges.tails.size(); ++i) {
        if (weights[i] < kClosed) parents[root(edges.tails[i])] = root(edges.heads[i]);
    }
    std::vector<std::uint32_t> sizes(nodes, 0);
    for (std::uint32_t node = 0; node < nodes; ++node) ++sizes[root(node)];
    const auto largest =
        static_cast<std::uint32_t>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
    std::vector<std::uint32_t> part;
    for (std::uint32_t node = 0; node < nodes; ++node) {
        if (root(node) == largest) part.push_back(node);
    }
    return part;
}

}  // namespace

Landmarks::Landmarks(const Edges& edges, const std::vector<double>& weights, std::uint32_t nodes)
    : rows(nodes) {
    const Adjacency leaving(edges.tails, edges.heads, weights, nodes);
    const Adjacency entering(edges.heads, edges.tails, weights, nodes);
    Sweep from(leaving), to(entering);
    const std::vector<std::uint32_t> part = largest_part(edges, weights, nodes);
    const auto keep = [&](double cost, float& kept) {
        kept = single(cost);
        if (cost < kClosed) span = std::max(span, cost);
    };
    // Each landmark is as far as can be from those before it; the first from any node.
    std::vector<double> nearest(nodes, kClosed);
    const auto farthest = [&]() {
        return *std::max_element(part.begin(), part.end(), [&](std::uint32_t a, std::uint32_t b) {
            return nearest[a] < nearest[b];
        });
    };
    from.run({{part.front(), 0.0}});
    for (const std::uint32_t node : part) nearest[node] = from.cost(node);
    std::uint32_t landmark = farthest();
    std::fill(nearest.begin(), nearest.end(), kClosed);
    for (std::size_t i = 0; i < kLandmarks; ++i) {
        to.run({{landmark, 0.0}});
        for (std::uint32_t node = 0; node < nodes; ++node) keep(to.cost(node), rows[node].to[i]);
        from.run({{landmark, 0.0}});
        for (std::uint32_t node = 0; node < nodes; ++node) {
            keep(from.cost(node), rows[node].from[i]);
            nearest[node] = std::min(nearest[node], from.cost(node));
        }
        landmark = farthest();
    }
}

}  // namespace semmap
