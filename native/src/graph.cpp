#include "semmap/graph.hpp"

#include <algorithm>
#include <limits>
#include <queue>
#include <utility>

#include "routes/adjacency.hpp"
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

// A search that is returned to the pool when the query ends.
class Graph::Borrowed {
  public:
    explicit Borrowed(const Graph& graph) : graph_(graph) {
        const std::lock_guard lock(graph.idle_mutex_);
        if (!graph.idle_.empty()) {
            search_ = std::move(graph.idle_.back());
            graph.idle_.pop_back();
        } else {
            graph.idle_.reserve(graph.searches_ + 1);  // room for all to come back
            search_ = std::make_unique<Search>(graph.nodes_);
            ++graph.searches_;
        }
    }
    Borrowed(const Borrowed&) = delete;
    Borrowed& operator=(const Borrowed&) = delete;
    ~Borrowed() {
        const std::lock_guard lock(graph_.idle_mutex_);
        graph_.idle_.push_back(std::move(search_));
    }

    Search& operator*() const { return *search_; }

  private:
    const Graph& graph_;
    std::unique_ptr<Search> search_;
};

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

void Graph::distances(const std::vector<std::uint32_t>& sources,
                      const std::vector<std::uint32_t>& targets, unsigned threads,
                      double* costs) const {
    if (sources.empty() || targets.empty()) return;
    const std::shared_lock reading(mutex_);
    const bool backwards = targets.size() < sources.size();  // the fewer searches
    const auto& from = backwards ? targets : sources;
    const auto& to = backwards ? sources : targets;
    threads = static_cast<unsigned>(std::min<std::size_t>(threads, from.size()));
    Team(threads).share(threads, 1, [&](unsigned, std::size_t part, std::size_t) {
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
