// Nodes by their keys, the least first.
#pragma once

#include <cstdint>
#include <queue>

namespace semmap {

struct Entry {
    double key;
    std::uint32_t node;

    friend bool operator<(const Entry& a, const Entry& b) { return a.key > b.key; }
};

// Keeps its memory when it is cleared.
struct Heap : std::priority_queue<Entry> {
    void clear() { c.clear(); }
};

}  // namespace semmap
