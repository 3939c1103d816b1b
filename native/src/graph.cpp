#include "semmap/graph.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>

#include "team.hpp"

namespace semmap {
namespace {

constexpr double kClosed = std::numeric_limits<double>::infinity();
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t kLandmarks = 16;
constexpr std::uint32_t kFewNodes = 200;  // a plain search is as fast
constexpr double kLeastShare = 0.7;
constexpr double kRounding = 1.0 / (1 << 20);  // of bounds in single precision, generously

double no_bound(std::uint32_t) { return 0.0; }

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

struct Entry {
    double key;
    std::uint32_t node;
};

// A heap with four children a node, the least on top.
class Heap {
  public:
    bool empty() const { return entries_.empty(); }
    void clear() { entries_.clear(); }
    const Entry& top() const { return entries_.front(); }

    void push(Entry entry) {
        std::size_t at = entries_.size();
        entries_.push_back(entry);
        while (at > 0) {
            const std::size_t parent = (at - 1) / 4;
            if (entries_[parent].key <= entry.key) break;
            entries_[at] = entries_[parent];
            at = parent;
        }
        entries_[at] = entry;
    }

    void pop() {
        const Entry last = entries_.back();
        entries_.pop_back();
        const std::size_t count = entries_.size();
        if (count == 0) return;
        std::size_t at = 0;
        for (std::size_t child = 1; child < count; child = 4 * at + 1) {
            const std::size_t end = std::min(child + 4, count);
            std::size_t least = child;
            for (std::size_t i = child + 1; i < end; ++i) {
                if (entries_[i].key < entries_[least].key) least = i;
            }
            if (entries_[least].key >= last.key) break;
            entries_[at] = entries_[least];
            at = least;
        }
        entries_[at] = last;
    }

  private:
    std::vector<Entry> entries_;
};

}  // namespace

struct Graph::Arc {
    double weight;
    std::uint32_t node;  // to which it leads
    std::uint32_t edge;
};

// The arcs of each node, one after the other.
struct Graph::Adjacency {
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

// Distances from and to a few far nodes: differences of them bound other distances from below
// (Goldberg and Harrelson, Computing the shortest path: A* search meets graph theory, 2005).
struct Graph::Landmarks {
    struct Row {
        float from[kLandmarks];  // each landmark to the node
        float to[kLandmarks];    // the node to each landmark
    };

    std::vector<Row> rows;
    double farthest = 0.0;

    // What is left to the nearest target is at least this.
    struct Bound {
        Bound(const Landmarks& landmarks, const std::vector<End>& targets, double share)
            : rows(landmarks.rows.data()), share(share) {
            double dearest = 0.0;
            std::fill_n(from, kLandmarks, std::numeric_limits<float>::infinity());
            std::fill_n(to, kLandmarks, -std::numeric_limits<float>::infinity());
            for (const auto& [node, cost] : targets) {
                dearest = std::max(dearest, cost);
                for (std::size_t i = 0; i < kLandmarks; ++i) {
                    const double least = rows[node].from[i] + cost;
                    const double most = rows[node].to[i] - cost;
                    from[i] = std::min(from[i], static_cast<float>(least));
                    to[i] = std::max(to[i], static_cast<float>(most));
                }
            }
            slack = (landmarks.farthest + dearest) * kRounding;
        }

        double operator()(std::uint32_t node) const {
            const Row& row = rows[node];
            float bounds[kLandmarks] = {};
            // Differences of infinities are not numbers, which are never more than a bound.
            for (std::size_t i = 0; i < kLandmarks; ++i) {
                const float far = from[i] - row.from[i];
                bounds[i] = far > bounds[i] ? far : bounds[i];
            }
            for (std::size_t i = 0; i < kLandmarks; ++i) {
                const float far = row.to[i] - to[i];
                bounds[i] = far > bounds[i] ? far : bounds[i];
            }
            for (std::size_t half = kLandmarks / 2; half > 0; half /= 2) {
                for (std::size_t i = 0; i < half; ++i) {
                    bounds[i] = bounds[i + half] > bounds[i] ? bounds[i + half] : bounds[i];
                }
            }
            return std::max(0.0, share * bounds[0] - slack);
        }

        const Row* rows;
        double share;
        double slack;
        alignas(64) float from[kLandmarks];
        alignas(64) float to[kLandmarks];
    };
};

// What one search at a time needs. Labels of former searches are known by their number.
class Graph::Search {
  public:
    explicit Search(std::uint32_t nodes) : labels_(nodes) {}

    void begin() {
        if (++number_ == 0) {
            for (Label& label : labels_) label.number = 0;
            number_ = 1;
        }
        heap_.clear();
    }

    // False where it was one already.
    bool add_target(const End& target) {
        Label& label = fresh(target.node);
        const bool first = label.end == kClosed;
        label.end = std::min(label.end, target.cost);
        return first;
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
            const double cost = label.cost;
            for (const Arc* arc = adjacency.begin(node); arc != adjacency.end(node); ++arc) {
                reach(arc->node, cost + arc->weight, arc->edge, bound);
            }
        }
        return last;
    }

    // Plain Dijkstra until that many targets have their costs.
    void settle(const Adjacency& adjacency, std::size_t targets) {
        while (!heap_.empty() && targets > 0) {
            const auto [key, node] = heap_.top();
            heap_.pop();
            Label& label = labels_[node];
            if (key != label.cost) continue;
            if (label.end == 0.0) {
                label.end = kClosed;
                --targets;
            }
            for (const Arc* arc = adjacency.begin(node); arc != adjacency.end(node); ++arc) {
                reach(arc->node, key + arc->weight, arc->edge, no_bound);
            }
        }
    }

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
};

// A search that goes back to the others when it is done with.
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
        landmarks_.reset();
    }
}

void Graph::prepare() const { prepared(); }

// The lock of one who reads, and there are landmarks.
std::shared_lock<std::shared_mutex> Graph::prepared() const {
    for (;;) {
        std::shared_lock reading(mutex_);
        if (landmarks_ || nodes_ < kFewNodes) return reading;
        reading.unlock();
        const std::unique_lock writing(mutex_);
        if (landmarks_) continue;
        landmarks_ = computed();
    }
}

std::unique_ptr<Graph::Landmarks> Graph::computed() const {
    auto made = std::make_unique<Landmarks>();
    made->rows.resize(nodes_);
    const Adjacency leaving(edges_.tails, edges_.heads, least_, nodes_);
    const Adjacency entering(edges_.heads, edges_.tails, least_, nodes_);
    const std::vector<std::uint32_t> part = largest_part(edges_, least_, nodes_);
    const Borrowed borrowed(*this);
    Search& search = *borrowed;
    const auto distances = [&](std::uint32_t landmark, const Adjacency& adjacency) {
        search.begin();
        search.reach(landmark, 0.0, kNone, no_bound);
        search.settle(adjacency, nodes_);
    };
    const auto keep = [&](std::uint32_t node, float& kept) {
        const double cost = search.cost(node);
        kept = static_cast<float>(cost);
        if (cost < kClosed) made->farthest = std::max(made->farthest, cost);
    };
    // Each landmark is as far as can be from those before it; the first from any node.
    std::vector<double> nearest(nodes_, kClosed);
    const auto farthest = [&]() {
        return *std::max_element(part.begin(), part.end(), [&](std::uint32_t a, std::uint32_t b) {
            return nearest[a] < nearest[b];
        });
    };
    distances(part.front(), leaving);
    for (const std::uint32_t node : part) nearest[node] = search.cost(node);
    std::uint32_t landmark = farthest();
    std::fill(nearest.begin(), nearest.end(), kClosed);
    for (std::size_t i = 0; i < kLandmarks; ++i) {
        distances(landmark, entering);
        for (std::uint32_t node = 0; node < nodes_; ++node) keep(node, made->rows[node].to[i]);
        distances(landmark, leaving);
        for (std::uint32_t node = 0; node < nodes_; ++node) {
            keep(node, made->rows[node].from[i]);
            nearest[node] = std::min(nearest[node], search.cost(node));
        }
        landmark = farthest();
    }
    return made;
}

std::optional<Route> Graph::shortest(const std::vector<End>& sources,
                                     const std::vector<End>& targets) const {
    const auto reading = prepared();
    const Borrowed borrowed(*this);
    Search& search = *borrowed;
    const auto found = [&](const auto& bound) {
        search.begin();
        for (const End& target : targets) search.add_target(target);
        for (const auto& [node, cost] : sources) search.reach(node, cost, kNone, bound);
        return search.run(*leaving_, bound);
    };
    std::uint32_t node =
        landmarks_ ? found(Landmarks::Bound(*landmarks_, targets, share_)) : found(no_bound);
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
        std::vector<std::uint32_t>
            closed;  // edges by which none goes on, kNone: to end; or sources
    };
    constexpr std::size_t kAny = std::numeric_limits<std::size_t>::max();
    const auto dearer = [](const Branch& a, const Branch& b) { return a.cost > b.cost; };
    const std::shared_lock reading(mutex_);
    const Borrowed borrowed(*this), borrowed_back(*this);
    Search& search = *borrowed;
    Search& back = *borrowed_back;
    back.begin();
    for (const auto& [node, cost] : targets) back.reach(node, cost, kNone, no_bound);
    back.settle(*entering_, nodes_);
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

bool Graph::distances(const std::vector<std::uint32_t>& sources,
                      const std::vector<std::uint32_t>& targets, unsigned threads,
                      double* costs) const {
    const std::shared_lock reading(mutex_);
    const bool backwards = targets.size() < sources.size();  // the fewer searches
    const auto& from = backwards ? targets : sources;
    const auto& to = backwards ? sources : targets;
    const Adjacency& adjacency = backwards ? *entering_ : *leaving_;
    return Team(threads).share(from.size(), 1, [&](unsigned, std::size_t i, std::size_t) {
        const Borrowed borrowed(*this);
        Search& search = *borrowed;
        search.begin();
        std::size_t count = 0;
        for (const std::uint32_t node : to) {
            count += search.add_target({node, 0.0});
        }
        search.reach(from[i], 0.0, kNone, no_bound);
        search.settle(adjacency, count);
        for (std::size_t j = 0; j < to.size(); ++j) {
            costs[backwards ? j * from.size() + i : i * to.size() + j] = search.cost(to[j]);
        }
    });
}

}  // namespace semmap
