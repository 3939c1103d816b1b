#include <algorithm>
#include <limits>
#include <queue>
#include <utility>

#include "routes/adjacency.hpp"
#include "routes/borrowed.hpp"
#include "routes/search.hpp"
#include "routes/sweep.hpp"
#include "semmap/graph.hpp"

namespace semmap {

// Lawler, A procedure for computing the k best solutions, 1972: each route found divides the others
// by where they leave it. Such a set is searched only when the least that it may cost is next; what
// is left from a node is known from one search backwards, so that a search hardly strays.
std::vector<Route> Graph::alternatives(const std::vector<End>& sources,
                                       const std::vector<End>& targets, std::size_t count) const {
    // Routes that begin with a source and edges, and do not go on by some; or the cheapest of them.
    struct Branch {
        double cost;
        bool found;
        End source;
        std::size_t fixed;                 // edges with which all begin; kAny: not even the source
        std::vector<std::uint32_t> edges;  // those, or all
        // Edges that no route takes next (kNone: the end), or sources where none begins.
        std::vector<std::uint32_t> closed;
    };
    constexpr std::size_t kAny = std::numeric_limits<std::size_t>::max();
    const auto dearer = [](const Branch& a, const Branch& b) { return a.cost > b.cost; };
    const std::shared_lock reading(mutex_);
    const Borrowed borrowed(*this);
    Search& search = *borrowed;
    Sweep back(*entering_);
    back.run(targets);
    const auto left = [&](std::uint32_t node) { return back.cost(node); };

    const auto closes = [](const Branch& branch, std::uint32_t move) {
        return std::find(branch.closed.begin(), branch.closed.end(), move) != branch.closed.end();
    };
    // Begins a search of a branch: calls `go(node, cost, edge)` for each way on. What it costs to
    // end at once.
    const auto leave = [&](const Branch& branch, auto&& go) {
        search.begin();
        for (const End& target : targets) search.add_target(target);
        if (branch.fixed == kAny) {
            for (const auto& [node, cost] : sources) {
                if (!closes(branch, node)) go(node, cost, kNone);
            }
            return kClosed;
        }
        std::uint32_t node = branch.source.node;
        double cost = branch.source.cost;
        search.shut(node);
        for (std::size_t i = 0; i < branch.fixed; ++i) {
            node = edges_.heads[branch.edges[i]];
            cost += edges_.weights[branch.edges[i]];
            search.shut(node);
        }
        for (const Arc* arc = leaving_->begin(node); arc != leaving_->end(node); ++arc) {
            if (!search.is_shut(arc->node) && !closes(branch, arc->edge)) {
                go(arc->node, cost + arc->weight, arc->edge);
            }
        }
        return closes(branch, kNone) ? kClosed : cost + search.end(node);
    };

    std::priority_queue<Branch, std::vector<Branch>, decltype(dearer)> branches(dearer);
    const auto add = [&](Branch branch) {
        double least = kClosed;
        const double end = leave(branch, [&](std::uint32_t node, double cost, std::uint32_t) {
            least = std::min(least, cost + left(node));
        });
        branch.cost = std::min(least, end);
        if (branch.cost < kClosed) branches.push(std::move(branch));
    };
    const auto find = [&](Branch branch) {
        const double end = leave(branch, [&](std::uint32_t node, double cost, std::uint32_t edge) {
            search.reach(node, cost, edge, left);
        });
        const std::uint32_t last = search.run(*leaving_, left, end);
        if (last != kNone) {
            std::vector<std::uint32_t> edges = search.edges_to(last, edges_.tails);
            if (branch.fixed == kAny) {
                branch.source.node = edges.empty() ? last : edges_.tails[edges.front()];
            }
            branch.edges.insert(branch.edges.end(), edges.begin(), edges.end());
            branch.cost = search.cost(last) + search.end(last);
        } else if (end < kClosed) {
            branch.cost = end;
        } else {
            return;
        }
        if (branch.fixed == kAny) {
            branch.source.cost = kClosed;
            for (const auto& [node, cost] : sources) {
                if (node == branch.source.node) {
                    branch.source.cost = std::min(branch.source.cost, cost);
                }
            }
        }
        branch.found = true;
        branches.push(std::move(branch));
    };

    std::vector<Route> routes;
    add({0.0, false, {0, 0.0}, kAny, {}, {}});
    while (routes.size() < count && !branches.empty()) {
        Branch branch = branches.top();
        branches.pop();
        if (!branch.found) {
            find(std::move(branch));
            continue;
        }
        routes.push_back({branch.cost, branch.edges});
        std::vector<std::uint32_t> closed = branch.closed;
        std::size_t fixed = branch.fixed;
        if (fixed == kAny) {
            closed.push_back(branch.source.node);
            add({0.0, false, branch.source, kAny, {}, closed});
            closed.clear();
            fixed = 0;
        }
        for (; fixed <= branch.edges.size(); ++fixed) {
            const auto first = branch.edges.begin();
            const auto next = first + static_cast<std::ptrdiff_t>(fixed);
            closed.push_back(next == branch.edges.end() ? kNone : *next);
            add({0.0, false, branch.source, fixed, {first, next}, closed});
            closed.clear();
        }
    }
    // Sums of the same weights in another order may differ in their last digit.
    std::stable_sort(routes.begin(), routes.end(),
                     [](const Route& a, const Route& b) { return a.cost < b.cost; });
    return routes;
}

}  // namespace semmap
