#include "semmap/fields/voxels.hpp"

#include <algorithm>
#include <numeric>

#include "semmap/fields/limits.hpp"

namespace semmap::fields {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFF;

std::size_t hash(const Coord& origin) {
    std::uint64_t h = static_cast<std::uint32_t>(origin.x()) * 0x9E3779B97F4A7C15ULL;
    h = (h ^ (h >> 29) ^ static_cast<std::uint32_t>(origin.y())) * 0xBF58476D1CE4E5B9ULL;
    h = (h ^ (h >> 32) ^ static_cast<std::uint32_t>(origin.z())) * 0x94D049BB133111EBULL;
    return static_cast<std::size_t>(h ^ (h >> 31));
}

}  // namespace

CoordBBox box_of(const Coord& block, const Words& words) {
    unsigned slices = 0;
    std::uint64_t rows = 0;
    for (std::size_t x = 0; x < 8; ++x) {
        slices |= static_cast<unsigned>(words[x] != 0) << x;
        rows |= words[x];
    }
    std::uint64_t levels = rows;
    for (int shift = 32; shift >= 8; shift /= 2) levels |= levels >> shift;
    levels &= 0xFF;
    return {block.offsetBy(__builtin_ctz(slices), __builtin_ctzll(rows) / kBlock,
                           __builtin_ctzll(levels)),
            block.offsetBy(31 - __builtin_clz(slices), (63 - __builtin_clzll(rows)) / kBlock,
                           63 - __builtin_clzll(levels))};
}

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
    return origins.capacity() * sizeof(Coord) + words.capacity() * sizeof(Words);
}

void Voxels::write(std::int32_t* out) const {
    for (std::size_t i = 0; i < origins.size(); ++i) {
        each_voxel(words[i], [&](std::size_t number) {
            const Coord voxel = voxel_of(origins[i], number);
            out = std::copy_n(voxel.data(), 3, out);
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
        if (b.origins[j] != a.origins[i]) continue;
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
    const std::int64_t most = region_limits().voxels.load(std::memory_order_relaxed);
    if (static_cast<std::int64_t>(blocks * kVoxels) > most) {
        throw BadRegion("the region has more than " + std::to_string(most) +
                        " voxels: take larger voxels, or a smaller region "
                        "(SEMMAP_MAX_REGION_VOXELS raises the limit)");
    }
}

OriginIndex::OriginIndex() : slots_(64, kNone) {}

std::uint32_t OriginIndex::find(const Coord& origin) {
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
    const Coord column(x, y, 0);
    for (std::int32_t z = block_floor(low); z <= high; z += kBlock) {
        const int from = std::max(low - z, 0);
        const int to = std::min(high - z, kBlock - 1);
        const std::uint64_t bits = (0xFFULL << from) & (0xFFULL >> (kBlock - 1 - to));
        const std::size_t i = in_block(column);
        at(block_floor(column.offsetBy(0, 0, z)))[i / 64] |= bits << (i % 64);
    }
}

Voxels VoxelCollector::finish() const {
    const std::vector<Coord>& origins = index_.origins();
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
