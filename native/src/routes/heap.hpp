// Nodes by their keys, the least first.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace semmap {

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

}  // namespace semmap
