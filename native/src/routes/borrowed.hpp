// A search that one query uses.
#pragma once

#include <memory>
#include <mutex>
#include <utility>

#include "search.hpp"
#include "semmap/graph.hpp"

namespace semmap {

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

}  // namespace semmap
