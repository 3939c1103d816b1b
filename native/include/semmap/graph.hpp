// Routes over a directed graph whose weights change between and during queries.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <vector>

namespace semmap {

struct Adjacency;
struct Landmarks;
class Search;

// Where routes begin or end, and what that costs.
struct End {
    std::uint32_t node;
    double cost;
};

struct Route {
    double cost;  // of its ends, too
    std::vector<std::uint32_t> edges;
};

struct Edges {
    std::vector<std::uint32_t> tails;
    std::vector<std::uint32_t> heads;
    std::vector<double> weights;  // not negative; infinity: closed
};

// Any number of threads may ask while one sets weights: each answer is exact for the weights before
// or after. Members throw std::bad_alloc. Nodes and edges that they are given are there.
class Graph {
  public:
    // `least` bounds the weight of each edge from below; searches compute their bounds with it.
    Graph(Edges edges, std::vector<double> least, std::uint32_t nodes);
    ~Graph();

    std::uint32_t nodes() const { return nodes_; }
    std::int64_t edges() const { return static_cast<std::int64_t>(edges_.tails.size()); }

    void set_weights(const std::vector<std::uint32_t>& edges, const std::vector<double>& weights);
    std::vector<double> weights() const;

    // A cheapest route from one of the sources to one of the targets.
    std::optional<Route> shortest(const std::vector<End>& sources,
                                  const std::vector<End>& targets) const;

    // The `count` cheapest routes that pass no node twice, the cheapest first.
    std::vector<Route> alternatives(const std::vector<End>& sources,
                                    const std::vector<End>& targets, std::size_t count) const;

    // Writes what the cheapest routes cost (sources x targets); infinity where there is none.
    void distances(const std::vector<std::uint32_t>& sources,
                   const std::vector<std::uint32_t>& targets, unsigned threads,
                   double* costs) const;

    // Computes bounds now, where there are none. Routes do it when they have cost as much without.
    void prepare() const;

  private:
    class Borrowed;

    void compute_landmarks() const;

    std::uint32_t nodes_;
    Edges edges_;
    std::vector<double> least_;
    std::unique_ptr<Adjacency> leaving_;
    std::unique_ptr<Adjacency> entering_;
    double share_ = 1.0;  // no weight is below this share of its least
    mutable std::unique_ptr<Landmarks> landmarks_;
    std::size_t falls_ = 0;                        // how often least weights fell
    mutable std::atomic<std::size_t> settled_{0};  // nodes, by searches without landmarks
    mutable std::mutex computing_;
    mutable std::shared_mutex mutex_;
    mutable std::mutex idle_mutex_;
    mutable std::vector<std::unique_ptr<Search>> idle_;
    mutable std::size_t searches_ = 0;
};

}  // namespace semmap
