#include "semmap/fields/sets.hpp"

#include <algorithm>

#include "semmap/fields/limits.hpp"

namespace semmap::fields {
namespace {

// Splitmix64 (Steele, Lea and Flood, Fast Splittable Pseudorandom Number Generators, 2014).
std::uint64_t key(std::int32_t entity) {
    std::uint64_t z = (static_cast<std::uint64_t>(entity) + 1) * 0x9E3779B97F4A7C15ULL;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
}

}  // namespace

void toggle(std::vector<std::int32_t>& members, std::int32_t entity) {
    const auto at = std::lower_bound(members.begin(), members.end(), entity);
    if (at != members.end() && *at == entity) {
        members.erase(at);
    } else {
        members.insert(at, entity);
    }
}

Register::Register() : sets_(1), counts_(1), slots_(256, 0) {}

std::int32_t Register::toggled(std::int32_t set, std::int32_t entity) {
    const Set& from = sets_[static_cast<std::size_t>(set)];
    scratch_ = from.members;
    toggle(scratch_, entity);
    return number(from.hash ^ key(entity), scratch_);
}

std::int32_t Register::number(const std::vector<std::int32_t>& members) {
    std::uint64_t hash = 0;
    for (const std::int32_t entity : members) hash ^= key(entity);
    return number(hash, members);
}

std::int32_t Register::number(std::uint64_t hash, const std::vector<std::int32_t>& members) {
    if (members.empty()) return 0;
    if (2 * (used_ + 1) >= slots_.size()) grow();
    const std::size_t most = slots_.size() - 1;
    for (std::size_t i = hash & most; slots_[i] != 0; i = (i + 1) & most) {
        const Set& here = sets_[static_cast<std::size_t>(slots_[i])];
        if (here.hash == hash && here.members == members) return slots_[i];
    }
    std::int32_t made;
    if (free_.empty()) {
        made = end();
        sets_.emplace_back();
        counts_.push_back(0);
    } else {
        made = free_.back();
        free_.pop_back();
    }
    Set& set = sets_[static_cast<std::size_t>(made)];
    set.hash = hash;
    set.members = members;
    ++used_;
    put(made);
    return made;
}

void Register::put(std::int32_t set) {
    const std::size_t most = slots_.size() - 1;
    std::size_t i = sets_[static_cast<std::size_t>(set)].hash & most;
    while (slots_[i] != 0) i = (i + 1) & most;
    slots_[i] = set;
}

void Register::grow() {
    const std::vector<std::int32_t> before = slots_;
    slots_.assign(2 * before.size(), 0);
    for (const std::int32_t set : before) {
        if (set != 0) put(set);
    }
}

void Register::free_if_unused(std::int32_t set) {
    if (set == 0 || counts_[static_cast<std::size_t>(set)] != 0) return;
    Set& freed = sets_[static_cast<std::size_t>(set)];
    if (freed.members.empty()) return;  // freed already
    const std::size_t most = slots_.size() - 1;
    std::size_t hole = freed.hash & most;
    while (slots_[hole] != set) hole = (hole + 1) & most;
    // Later entries move up unless they would pass the place where their search begins.
    for (std::size_t i = (hole + 1) & most; slots_[i] != 0; i = (i + 1) & most) {
        const std::size_t home = sets_[static_cast<std::size_t>(slots_[i])].hash & most;
        if (((i - home) & most) >= ((i - hole) & most)) {
            slots_[hole] = slots_[i];
            hole = i;
        }
    }
    slots_[hole] = 0;
    freed.members = {};
    freed.hash = 0;
    free_.push_back(set);
    --used_;
}

bool Register::restore(std::int32_t set, const std::vector<std::int32_t>& members) {
    if (set <= 0 || set >= kMostSets || members.empty()) return false;
    if (members.front() < 0 || members.back() >= kMostEntities) return false;
    for (std::size_t i = 1; i < members.size(); ++i) {
        if (members[i - 1] >= members[i]) return false;
    }
    const auto n = static_cast<std::size_t>(set);
    if (n < sets_.size() && !sets_[n].members.empty()) return false;
    std::uint64_t hash = 0;
    for (const std::int32_t entity : members) hash ^= key(entity);
    const std::size_t most = slots_.size() - 1;
    for (std::size_t i = hash & most; slots_[i] != 0; i = (i + 1) & most) {
        if (sets_[static_cast<std::size_t>(slots_[i])].members == members) return false;
    }
    if (n >= sets_.size()) {
        sets_.resize(n + 1);
        counts_.resize(n + 1);
    }
    sets_[n].hash = hash;
    sets_[n].members = members;
    if (2 * (++used_ + 1) >= slots_.size()) grow();
    put(set);
    return true;
}

void Register::finish_restoring() {
    free_.clear();
    for (std::int32_t set = end() - 1; set > 0; --set) {
        if (members(set).empty()) free_.push_back(set);
    }
}

std::size_t Register::bytes() const {
    std::size_t total = sets_.capacity() * sizeof(Set) + counts_.capacity() * sizeof(std::int64_t) +
                        (free_.capacity() + slots_.capacity()) * sizeof(std::int32_t);
    for (const Set& set : sets_) total += set.members.capacity() * sizeof(std::int32_t);
    return total;
}

}  // namespace semmap::fields
