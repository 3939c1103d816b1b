// A register of sets of entities; each set has one number, whatever the order of insertions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace semmap::fields {

// Sets are found by a hash, the xor of one key per entity (Zobrist), and then compared. Number 0 is
// the empty set. Numbers of freed sets are used again.
class Register {
  public:
    Register() : sets_(1) {}

    // Returns the set with `entity` inserted if it is not a member, else removed.
    std::int32_t toggled(std::int32_t set, std::int32_t entity);
    const std::vector<std::int32_t>& members(std::int32_t set) const {
        return sets_[static_cast<std::size_t>(set)].members;
    }
    // All numbers are below this.
    std::int32_t end() const { return static_cast<std::int32_t>(sets_.size()); }
    // The number of sets, without the empty set.
    std::int64_t size() const { return static_cast<std::int64_t>(by_hash_.size()); }
    // The number of voxels of a set; the caller updates it.
    std::int64_t& count(std::int32_t set) { return sets_[static_cast<std::size_t>(set)].count; }
    void free_if_unused(std::int32_t set);
    // Gives a set the number that it had. Returns false, and changes nothing, if the set or the
    // number exists already or is invalid. Call `finish_restoring` after the last set.
    bool restore(std::int32_t set, const std::vector<std::int32_t>& members);
    void finish_restoring();
    std::size_t bytes() const;

  private:
    struct Set {
        std::uint64_t hash = 0;
        std::int64_t count = 0;  // of voxels
        std::vector<std::int32_t> members;
    };

    // Its number if it is there, else 0.
    std::int32_t find(std::uint64_t hash, const std::vector<std::int32_t>& members) const;

    std::vector<Set> sets_;
    std::vector<std::int32_t> free_;
    std::unordered_multimap<std::uint64_t, std::int32_t> by_hash_;
    std::vector<std::int32_t> scratch_;
};

}  // namespace semmap::fields
