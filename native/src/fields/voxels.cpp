#include "semmap/fields/voxels.hpp"

#include <algorithm>
#include <numeric>

#include "semmap/fields/limits.hpp"

namespace semmap::fields {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFF;

std::size_t hash(const Origin& origin) {
    std::uint64_t h = static_cast<std::uint32_t>(origin.x) * 0x9E3779B97F4A7C15ULL;
    h = (h ^ (h >> 29) ^ static_cast<std::uint32_t>(origin.y)) * 0xBF58476D1CE4E5B9ULL;
    h = (h ^ (h >> 32) ^ static_cast<std::uint32_t>(origin.z)) * 0x94D049BB133111EBULL;
    return static_cast<std::size_t>(h ^ (h >> 31));
}

}  // namespace

int count(const Words& words) {
    int total = 0;
    for (const std::uint64_t word : words) total += __builtin_popcountll(word);
    return total;
}

bool is_full(const Words& words) {
    return std::all_of(words.begin(), words.end(), [](std::uint64_t w) { return ~w == 0; });
}

bool is_empty(const Words& words) {
    return std::all_of(words.begin(), words.end(), [](std::uint64_t w) { return w == 0; });
}

std::int64_t Voxels::size() const {
    std::int64_t total = 0;
    for (const Words& mask : words) total += count(mask);
    return total;
}

std::size_t Voxels::bytes() const {
    return origins.capacity() * sizeof(Origin) + words.capacity() * sizeof(Words);
}

void Voxels::write(std::int32_t* out) const {
    for (std::size_t i = 0; i < origins.size(); ++i) {
        each_voxel(words[i], [&](std::size_t voxel) {
            *out++ = origins[i].x + static_cast<std::int32_t>(voxel >> 6);
            *out++ = origins[i].y + static_cast<std::int32_t>(voxel >> 3 & 7);
            *out++ = origins[i].z + static_cast<std::int32_t>(voxel & 7);
        });
    }
}

Voxels united(const Voxels& a, const Voxels& b) {
    Voxels all;
    all.origins.reserve(std::max(a.blocks(), b.blocks()));
    all.words.reserve(std::max(a.blocks(), b.blocks()));
    std::size_t i = 0;
    std::size_t j = 0;
    while (i < a.blocks() || j < b.blocks()) {
        if (j == b.blocks() || (i < a.blocks() && a.origins[i] < b.origins[j])) {
            all.append(a.origins[i], a.words[i]);
            ++i;
        } else if (i == a.blocks() || b.origins[j] < a.origins[i]) {
            all.append(b.origins[j], b.words[j]);
            ++j;
        } else {
            Words both;
            for (std::size_t k = 0; k < 8; ++k) both[k] = a.words[i][k] | b.words[j][k];
            all.append(a.origins[i], both);
            ++i;
            ++j;
        }
    }
    return all;
}

Voxels without(const Voxels& a, const Voxels& b) {
    Voxels rest;
    std::size_t j = 0;
    for (std::size_t i = 0; i < a.blocks(); ++i) {
        while (j < b.blocks() && b.origins[j] < a.origins[i]) ++j;
        Words mask = a.words[i];
        if (j < b.blocks() && b.origins[j] == a.origins[i]) {
            for (std::size_t k = 0; k < 8; ++k) mask[k] &= ~b.words[j][k];
            if (is_empty(mask)) continue;
        }
        rest.append(a.origins[i], mask);
    }
    return rest;
}

std::int64_t common(const Voxels& a, const Voxels& b) {
    std::int64_t total = 0;
    std::size_t j = 0;
    for (std::size_t i = 0; i < a.blocks(); ++i) {
        while (j < b.blocks() && b.origins[j] < a.origins[i]) ++j;
        if (j == b.blocks()) break;
        if (!(b.origins[j] == a.origins[i])) continue;
        for (std::size_t k = 0; k < 8; ++k) {
            total += __builtin_popcountll(a.words[i][k] & b.words[j][k]);
        }
    }
    return total;
}

RegionLimits& region_limits() {
    static RegionLimits limits;
    return limits;
}

void expect_few(std::size_t blocks) {
    constexpr std::int64_t kVoxels = kBlock * kBlock * kBlock;
    const std::int64_t most = region_limits().voxels.load(std::memory_order_relaxed);
    if (static_cast<std::int64_t>(blocks) * kVoxels > most) {
        throw BadRegion("the region has more than " + std::to_string(most) +
                        " voxels: take larger voxels, or a smaller region "
                        "(SEMMAP_MAX_REGION_VOXELS raises the limit)");
    }
}

OriginIndex::OriginIndex() : slots_(64, kNone) {}

std::uint32_t OriginIndex::find(const Origin& origin) {
    if (2 * origins_.size() >= slots_.size()) grow();
    const std::size_t most = slots_.size() - 1;
    std::size_t i = hash(origin) & most;
    for (; slots_[i] != kNone; i = (i + 1) & most) {
        if (origins_[slots_[i]] == origin) return slots_[i];
    }
    slots_[i] = static_cast<std::uint32_t>(origins_.size());
    origins_.push_back(origin);
    return slots_[i];
}

void OriginIndex::grow() {
    slots_.assign(2 * slots_.size(), kNone);
    const std::size_t most = slots_.size() - 1;
    for (std::size_t n = 0; n < origins_.size(); ++n) {
        std::size_t i = hash(origins_[n]) & most;
        while (slots_[i] != kNone) i = (i + 1) & most;
        slots_[i] = static_cast<std::uint32_t>(n);
    }
}

void VoxelCollector::add_column(std::int32_t x, std::int32_t y, std::int32_t low,
                                std::int32_t high) {
    const auto slice = static_cast<std::size_t>(x & 7);
    if (tower_.x != block_floor(x) || tower_.y != block_floor(y)) {
        tower_ = {block_floor(x), block_floor(y), block_floor(low), std::move(tower_.blocks)};
        tower_.blocks.clear();
    }
    for (std::int32_t z = block_floor(low); z <= high; z += kBlock) {
        const int from = std::max(low - z, 0);
        const int to = std::min(high - z, kBlock - 1);
        const std::uint64_t bits = (0xFFULL << from) & (0xFFULL >> (kBlock - 1 - to));
        std::uint32_t& block = in_tower(z);
        if (block == kNone) {
            at({tower_.x, tower_.y, z});
            block = index_.number({tower_.x, tower_.y, z});
        }
        words_[block][slice] |= bits << (8 * (y & 7));
    }
}

std::uint32_t& VoxelCollector::in_tower(std::int32_t z) {
    if (z < tower_.low) {
        const auto more = static_cast<std::size_t>((tower_.low - z) / kBlock);
        tower_.blocks.insert(tower_.blocks.begin(), more, kNone);
        tower_.low = z;
    }
    const auto n = static_cast<std::size_t>((z - tower_.low) / kBlock);
    if (n >= tower_.blocks.size()) tower_.blocks.resize(n + 1, kNone);
    return tower_.blocks[n];
}

Voxels VoxelCollector::finish() const {
    const std::vector<Origin>& origins = index_.origins();
    std::vector<std::uint32_t> order(origins.size());
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return origins[a] < origins[b]; });
    Voxels voxels;
    voxels.origins.reserve(order.size());
    voxels.words.reserve(order.size());
    for (const std::uint32_t i : order) voxels.append(origins[i], words_[i]);
    return voxels;
}

}  // namespace semmap::fields
