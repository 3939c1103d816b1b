#include "semmap/graph.hpp"

#include <algorithm>
#include <utility>

#include "routes/adjacency.hpp"
#include "routes/borrowed.hpp"
#include "routes/landmarks.hpp"
#include "routes/search.hpp"
#include "routes/sweep.hpp"
#include "team.hpp"

namespace semmap {
namespace {

constexpr std::uint32_t kFewNodes = 200;  // a plain search is as fast
constexpr std::size_t kPatience = 8;      // searches of all nodes that take as long as landmarks
constexpr double kLeastShare = 0.7;       // below it bounds are so low that new ones pay

}  // namespace

Graph::Graph(Edges edges, std::vector<double> least, std::uint32_t nodes)
    : nodes_(nodes),
      edges_(std::move(edges)),
      least_(std::move(least)),
      leaving_(std::make_unique<Adjacency>(edges_.tails, edges_.heads, edges_.weights, nodes)),
      entering_(std::make_unique<Adjacency>(edges_.heads, edges_.tails, edges_.weights, nodes)) {
    for (std::size_t i = 0; i < least_.size(); ++i) {
        least_[i] = std::min(least_[i], edges_.weights[i]);
    }
}

Graph::~Graph() = default;

std::vector<double> Graph::weights() const {
    const std::shared_lock lock(mutex_);
    return edges_.weights;
}

void Graph::set_weights(const std::vector<std::uint32_t>& edges,
                        const std::vector<double>& weights) {
    const std::unique_lock lock(mutex_);
    for (std::size_t i = 0; i < edges.size(); ++i) {
        const std::uint32_t edge = edges[i];
        const double weight = weights[i];
        edges_.weights[edge] = weight;
        leaving_->arcs[leaving_->place[edge]].weight = weight;
        entering_->arcs[entering_->place[edge]].weight = weight;
        if (weight < share_ * least_[edge]) share_ = weight / least_[edge];
    }
    if (share_ < kLeastShare) {
        for (std::size_t i = 0; i < least_.size(); ++i) {
            least_[i] = std::min(least_[i], edges_.weights[i]);
        }
        share_ = 1.0;
        ++falls_;
        landmarks_.reset();
        settled_ = 0;
    }
}

void Graph::prepare() const {
    const std::lock_guard computing(computing_);
    compute_landmarks();
}

// Neither queries nor changes of weights wait for it.
void Graph::compute_landmarks() const {
    std::vector<double> least;
    std::size_t falls;
    {
        const std::shared_lock reading(mutex_);
        if (landmarks_ || nodes_ < kFewNodes) return;
        least = least_;
        falls = falls_;
    }
    auto made = std::make_unique<Landmarks>(edges_, least, nodes_);
    const std::unique_lock writing(mutex_);
    if (falls == falls_) landmarks_ = std::move(made);
}

std::optional<Route> Graph::shortest(const std::vector<End>& sources,
                                     const std::vector<End>& targets) const {
    if (settled_ > kPatience * nodes_) {
        const std::unique_lock computing(computing_, std::try_to_lock);
        if (computing) compute_landmarks();
    }
    const std::shared_lock reading(mutex_);
    const Borrowed borrowed(*this);
    Search& search = *borrowed;
    const auto found = [&](const auto& bound) {
        search.begin();
        for (const End& target : targets) search.add_target(target);
        for (const auto& [node, cost] : sources) search.reach(node, cost, kNone, bound);
        return search.run(*leaving_, bound);
    };
    std::uint32_t node;
    if (landmarks_) {
        node = found(Landmarks::Bound(*landmarks_, targets, share_));
    } else {
        node = found([](std::uint32_t) { return 0.0; });
        settled_ += search.settled();
    }
    if (node == kNone) return std::nullopt;
    return Route{search.cost(node) + search.end(node), search.edges_to(node, edges_.tails)};
}

bool Graph::distances(const std::vector<std::uint32_t>& sources,
                      const std::vector<std::uint32_t>& targets, unsigned threads,
                      double* costs) const {
    if (sources.empty() || targets.empty()) return true;
    const std::shared_lock reading(mutex_);
    const bool backwards = targets.size() < sources.size();  // the fewer searches
    const auto& from = backwards ? targets : sources;
    const auto& to = backwards ? sources : targets;
    threads = static_cast<unsigned>(std::min<std::size_t>(threads, from.size()));
    return Team(threads).share(threads, 1, [&](unsigned, std::size_t part, std::size_t) {
        Sweep sweep(backwards ? *entering_ : *leaving_);
        for (std::size_t i = part; i < from.size(); i += threads) {
            sweep.run({{from[i], 0.0}}, to);
            for (std::size_t j = 0; j < to.size(); ++j) {
                costs[backwards ? j * from.size() + i : i * to.size() + j] = sweep.cost(to[j]);
            }
        }
    });
}

}  // namespace semmap
