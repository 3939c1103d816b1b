// A* from some nodes to some others.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "adjacency.hpp"
#include "heap.hpp"
#include "semmap/graph.hpp"

namespace semmap {

// The memory of one search at a time. The number of a search marks its labels as its own.
class Search {
  public:
    explicit Search(std::uint32_t nodes) : labels_(nodes) {}

    void begin() {
        if (++number_ == 0) {
            for (Label& label : labels_) label.number = 0;
            number_ = 1;
        }
        heap_.clear();
        settled_ = 0;
    }

    void add_target(const End& target) {
        Label& label = fresh(target.node);
        label.end = std::min(label.end, target.cost);
    }

    // No way leads through that node.
    void shut(std::uint32_t node) { fresh(node).cost = -kClosed; }

    // A way leads to that node, by that edge.
    template <typename Bound>
    void reach(std::uint32_t node, double cost, std::uint32_t via, const Bound& bound) {
        Label& label = fresh(node);
        if (cost >= label.cost) return;
        if (label.bound < 0.0) label.bound = bound(node);
        label.cost = cost;
        label.via = via;
        if (label.bound < kClosed) heap_.push({cost + label.bound, node});
    }

    // A* that opens a node again where it is reached more cheaply: bounds need not be consistent.
    // The node at which the cheapest way ends, kNone where none is cheaper than `best`.
    template <typename Bound>
    std::uint32_t run(const Adjacency& adjacency, const Bound& bound, double best = kClosed) {
        std::uint32_t last = kNone;
        while (!heap_.empty() && heap_.top().key < best) {
            const auto [key, node] = heap_.top();
            heap_.pop();
            Label& label = labels_[node];
            if (key != label.cost + label.bound) continue;
            if (label.cost + label.end < best) {
                best = label.cost + label.end;
                last = node;
            }
            ++settled_;
            const double cost = label.cost;
            for (const Arc* arc = adjacency.begin(node); arc != adjacency.end(node); ++arc) {
                reach(arc->node, cost + arc->weight, arc->edge, bound);
            }
        }
        return last;
    }

    std::size_t settled() const { return settled_; }

    bool is_shut(std::uint32_t node) const { return cost(node) == -kClosed; }

    double cost(std::uint32_t node) const {
        const Label& label = labels_[node];
        return label.number == number_ ? label.cost : kClosed;
    }

    // The edges by which a node was reached.
    std::vector<std::uint32_t> edges_to(std::uint32_t node,
                                        const std::vector<std::uint32_t>& tails) const {
        std::vector<std::uint32_t> edges;
        for (; labels_[node].via != kNone; node = tails[edges.back()]) {
            edges.push_back(labels_[node].via);
        }
        std::reverse(edges.begin(), edges.end());
        return edges;
    }

    double end(std::uint32_t node) const { return labels_[node].end; }

  private:
    struct Label {
        double cost;
        double end;  // what it costs to end there
        double bound;
        std::uint32_t via;
        std::uint32_t number = 0;
    };

    Label& fresh(std::uint32_t node) {
        Label& label = labels_[node];
        if (label.number != number_) label = {kClosed, kClosed, -1.0, kNone, number_};
        return label;
    }

    std::vector<Label> labels_;
    Heap heap_;
    std::uint32_t number_ = 0;
    std::size_t settled_ = 0;
};

}  // namespace semmap
