// A register of sets of entities, each with one number, whatever the order of its making.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace semmap::fields {

// Sets are found by the xor of a key an entity (Zobrist), and compared before they are taken for
// equal. Number 0 is the empty set. Numbers of freed sets are given again.
class Register {
  public:
    Register();

    // The set with `entity` put in if it lacks it, or taken out if it holds it.
    std::int32_t toggled(std::int32_t set, std::int32_t entity);
    // The set with the given members, ascending.
    std::int32_t number(const std::vector<std::int32_t>& members);
    const std::vector<std::int32_t>& members(std::int32_t set) const {
        return sets_[static_cast<std::size_t>(set)].members;
    }
    // All numbers lie below.
    std::int32_t end() const { return static_cast<std::int32_t>(sets_.size()); }
    // How many sets there are, the empty one left out.
    std::int64_t size() const { return static_cast<std::int64_t>(used_); }
    // How many voxels a set has; kept by the caller.
    std::int64_t& count(std::int32_t set) { return counts_[static_cast<std::size_t>(set)]; }
    std::int64_t count(std::int32_t set) const { return counts_[static_cast<std::size_t>(set)]; }
    void free_if_unused(std::int32_t set);
    // Gives a set the number that it had. False, and nothing changed, where the set or the number
    // is there already or can be none. `finish_restoring` ends the first use of it.
    bool restore(std::int32_t set, const std::vector<std::int32_t>& members);
    void finish_restoring();
    std::size_t bytes() const;

  private:
    struct Set {
        std::uint64_t hash = 0;
        std::vector<std::int32_t> members;
    };

    std::int32_t number(std::uint64_t hash, const std::vector<std::int32_t>& members);
    void put(std::int32_t set);
    void grow();

    std::vector<Set> sets_;
    std::vector<std::int64_t> counts_;
    std::vector<std::int32_t> free_;
    std::vector<std::int32_t> slots_;  // open addressing by hash; 0: none
    std::size_t used_ = 0;
    std::vector<std::int32_t> scratch_;
};

// Puts `entity` into ascending members, or takes it out.
void toggle(std::vector<std::int32_t>& members, std::int32_t entity);

}  // namespace semmap::fields
