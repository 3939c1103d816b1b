// Nodes by their keys, the least first.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace semmap {

struct Entry {
    double key;
    std::uint32_t node;

    friend bool operator<(const Entry& a, const Entry& b) { return a.key > b.key; }
};

// A std::priority_queue that keeps its memory when it is cleared.
class Heap {
  public:
    bool empty() const { return entries_.empty(); }
    void clear() { entries_.clear(); }
    const Entry& top() const { return entries_.front(); }

    void push(Entry entry) {
        entries_.push_back(entry);
        std::push_heap(entries_.begin(), entries_.end());
    }

    void pop() {
        std::pop_heap(entries_.begin(), entries_.end());
        entries_.pop_back();
    }

  private:
    std::vector<Entry> entries_;
};

}  // namespace semmap
