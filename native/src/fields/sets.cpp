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

std::uint64_t hash_of(const std::vector<std::int32_t>& members) {
    std::uint64_t hash = 0;
    for (const std::int32_t entity : members) hash ^= key(entity);
    return hash;
}

}  // namespace

std::int32_t Register::toggled(std::int32_t set, std::int32_t entity) {
    const std::uint64_t hash = sets_[static_cast<std::size_t>(set)].hash ^ key(entity);
    scratch_ = members(set);
    const auto at = std::lower_bound(scratch_.begin(), scratch_.end(), entity);
    if (at != scratch_.end() && *at == entity) {
        scratch_.erase(at);
    } else {
        scratch_.insert(at, entity);
    }
    if (scratch_.empty()) return 0;
    if (const std::int32_t known = find(hash, scratch_)) return known;
    std::int32_t made;
    if (free_.empty()) {
        made = end();
        sets_.emplace_back();
    } else {
        made = free_.back();
        free_.pop_back();
    }
    sets_[static_cast<std::size_t>(made)] = {hash, 0, scratch_};
    by_hash_.emplace(hash, made);
    return made;
}

std::int32_t Register::find(std::uint64_t hash, const std::vector<std::int32_t>& of) const {
    const auto [first, last] = by_hash_.equal_range(hash);
    const auto found =
        std::find_if(first, last, [&](const auto& each) { return members(each.second) == of; });
    return found == last ? 0 : found->second;
}

void Register::free_if_unused(std::int32_t set) {
    Set& freed = sets_[static_cast<std::size_t>(set)];
    if (freed.count != 0 || freed.members.empty()) return;  // in use, freed already, or set 0
    const auto [first, last] = by_hash_.equal_range(freed.hash);
    by_hash_.erase(std::find_if(first, last, [&](const auto& each) { return each.second == set; }));
    freed = {};
    free_.push_back(set);
}

bool Register::restore(std::int32_t set, const std::vector<std::int32_t>& members) {
    if (set <= 0 || set >= kMostSets || members.empty()) return false;
    if (members.front() < 0 || members.back() >= kMostEntities) return false;
    for (std::size_t i = 1; i < members.size(); ++i) {
        if (members[i - 1] >= members[i]) return false;
    }
    const auto n = static_cast<std::size_t>(set);
    if (n < sets_.size() && !sets_[n].members.empty()) return false;
    const std::uint64_t hash = hash_of(members);
    if (find(hash, members) != 0) return false;
    if (n >= sets_.size()) sets_.resize(n + 1);
    sets_[n] = {hash, 0, members};
    by_hash_.emplace(hash, set);
    return true;
}

void Register::finish_restoring() {
    free_.clear();
    for (std::int32_t set = end() - 1; set > 0; --set) {
        if (members(set).empty()) free_.push_back(set);
    }
}

std::size_t Register::bytes() const {
    std::size_t total = sets_.capacity() * sizeof(Set) + free_.capacity() * sizeof(std::int32_t) +
                        (by_hash_.bucket_count() + by_hash_.size() * 4) * sizeof(std::uint64_t);
    for (const Set& set : sets_) total += set.members.capacity() * sizeof(std::int32_t);
    return total;
}

}  // namespace semmap::fields
