// Costs from some nodes to all others, or to those that are wanted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "adjacency.hpp"
#include "semmap/graph.hpp"

namespace semmap {

// Nodes wait in buckets of costs, and one that is reached more cheaply is left again (Meyer and
// Sanders, Delta-stepping, 2003): two to four times as fast as a heap. A heap takes over where the
// dearest edge would need too many buckets. Costs are the same, whatever the order.
class Sweep {
  public:
    explicit Sweep(const Adjacency& adjacency);

    // Until the wanted nodes have their costs; all where none is named.
    void run(const std::vector<End>& starts, const std::vector<std::uint32_t>& wanted = {});

    double cost(std::uint32_t node) const { return costs_[node]; }

  private:
    void run_with_buckets(const std::vector<End>& starts, std::size_t missing);
    void run_with_heap(const std::vector<End>& starts);

    const Adjacency& adjacency_;
    double dearest_ = 0.0;  // of the arcs that are open
    double width_ = 0.0;    // of a bucket
    std::vector<double> costs_;
    std::vector<double> left_;          // the cost with which a node was last left
    std::vector<std::uint8_t> wanted_;  // and without its cost yet
    std::vector<std::vector<std::uint32_t>> buckets_;
};

}  // namespace semmap
