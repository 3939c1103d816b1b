#include "sweep.hpp"

#include <algorithm>

#include "search.hpp"

namespace semmap {
namespace {

constexpr double kMostBuckets = 4096;
constexpr double kWidth = 0.25;  // of the mean weight

}  // namespace

Sweep::Sweep(const Adjacency& adjacency)
    : adjacency_(adjacency),
      costs_(adjacency.first.size() - 1),
      left_(costs_.size()),
      wanted_(costs_.size(), 0) {
    double sum = 0.0;
    std::size_t open = 0;
    for (const Arc& arc : adjacency.arcs) {
        if (arc.weight == kClosed) continue;
        dearest_ = std::max(dearest_, arc.weight);
        sum += arc.weight;
        ++open;
    }
    if (open > 0) width_ = kWidth * sum / static_cast<double>(open);
}

void Sweep::run(const std::vector<End>& starts, const std::vector<std::uint32_t>& wanted) {
    std::fill(costs_.begin(), costs_.end(), kClosed);
    std::fill(left_.begin(), left_.end(), kClosed);
    std::size_t missing = wanted.empty() ? costs_.size() + 1 : 0;  // more than can be found
    for (const std::uint32_t node : wanted) {
        missing += wanted_[node] == 0;
        wanted_[node] = 1;
    }
    double farthest = dearest_;
    for (const auto& [node, cost] : starts) {
        if (cost < kClosed) farthest = std::max(farthest, cost);
    }
    const double buckets = farthest / width_ + 3;
    if (buckets <= kMostBuckets) {
        buckets_.resize(std::max(buckets_.size(), static_cast<std::size_t>(buckets)));
        run_with_buckets(starts, missing);
    } else {
        run_with_heap(starts);
    }
    for (const std::uint32_t node : wanted) wanted_[node] = 0;
}

void Sweep::run_with_buckets(const std::vector<End>& starts, std::size_t missing) {
    std::size_t waiting = 0;
    const auto reach = [&](std::uint32_t node, double cost) {
        if (cost >= costs_[node]) return;
        costs_[node] = cost;
        buckets_[static_cast<std::size_t>(cost / width_) % buckets_.size()].push_back(node);
        ++waiting;
    };
    for (auto& bucket : buckets_) bucket.clear();
    for (const auto& [node, cost] : starts) reach(node, cost);
    for (std::size_t number = 0; waiting > 0 && missing > 0; ++number) {
        auto& bucket = buckets_[number % buckets_.size()];
        for (std::size_t i = 0; i < bucket.size(); ++i) {  // it may grow
            const std::uint32_t node = bucket[i];
            const double cost = costs_[node];
            if (left_[node] == cost) continue;
            left_[node] = cost;
            for (const Arc* arc = adjacency_.begin(node); arc != adjacency_.end(node); ++arc) {
                reach(arc->node, cost + arc->weight);
            }
        }
        waiting -= bucket.size();
        for (const std::uint32_t node : bucket) {
            missing -= wanted_[node];
            wanted_[node] = 0;
        }
        bucket.clear();
    }
}

void Sweep::run_with_heap(const std::vector<End>& starts) {
    const auto no_bound = [](std::uint32_t) { return 0.0; };
    Search search(static_cast<std::uint32_t>(costs_.size()));
    search.begin();
    for (const auto& [node, cost] : starts) search.reach(node, cost, kNone, no_bound);
    search.run(adjacency_, no_bound);
    for (std::uint32_t node = 0; node < costs_.size(); ++node) costs_[node] = search.cost(node);
}

}  // namespace semmap
