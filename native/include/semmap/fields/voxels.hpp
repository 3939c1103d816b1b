// Sets of voxels as blocks of 8 x 8 x 8 with one bit per voxel, in the order of OpenVDB's leaves.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

namespace semmap::fields {

constexpr int kBlock = 8;

// The lowest voxel of a block; each coordinate a multiple of 8.
struct Origin {
    std::int32_t x;
    std::int32_t y;
    std::int32_t z;

    friend bool operator==(const Origin& a, const Origin& b) {
        return a.x == b.x && a.y == b.y && a.z == b.z;
    }
    friend bool operator<(const Origin& a, const Origin& b) {
        return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
    }
};

inline std::int32_t block_floor(std::int32_t voxel) { return voxel & ~(kBlock - 1); }

// One word per slice x; bit 8 y + z is voxel (x, y, z).
using Words = std::array<std::uint64_t, 8>;

// Calls each(i) for each voxel (i >> 6, i >> 3 & 7, i & 7) of a block.
template <typename Each>
void each_voxel(const Words& words, Each&& each) {
    for (std::size_t x = 0; x < 8; ++x) {
        for (std::uint64_t w = words[x]; w != 0; w &= w - 1) {
            each(64 * x + static_cast<std::size_t>(__builtin_ctzll(w)));
        }
    }
}

inline bool is_on(const Words& words, std::size_t i) {
    return (words[i / 64] >> (i % 64) & 1) != 0;
}

int count(const Words& words);
bool is_full(const Words& words);
bool is_empty(const Words& words);

// Blocks in ascending order of their origins, none of them empty.
struct Voxels {
    std::vector<Origin> origins;
    std::vector<Words> words;

    std::size_t blocks() const { return origins.size(); }
    std::int64_t size() const;
    std::size_t bytes() const;
    void append(const Origin& origin, const Words& mask) {
        origins.push_back(origin);
        words.push_back(mask);
    }
    // (x, y, z) of each voxel, block by block; `out` has room for 3 * size().
    void write(std::int32_t* out) const;
};

Voxels united(const Voxels& a, const Voxels& b);
Voxels without(const Voxels& a, const Voxels& b);
std::int64_t common(const Voxels& a, const Voxels& b);

// Throws BadRegion if a region of so many blocks is beyond the limit.
void expect_few(std::size_t blocks);

// The index of a block in a list: open addressing by origin.
class OriginIndex {
  public:
    OriginIndex();
    // Returns the number of an origin; numbers are assigned in order of first occurrence.
    std::uint32_t number(const Origin& origin) {
        if (last_ < origins_.size() && origins_[last_] == origin) return last_;
        return last_ = find(origin);
    }
    const std::vector<Origin>& origins() const { return origins_; }

  private:
    std::uint32_t find(const Origin& origin);
    void grow();

    std::vector<std::uint32_t> slots_;
    std::vector<Origin> origins_;
    std::uint32_t last_ = 0;
};

// Collects voxels in any order; throws BadRegion when there are too many.
class VoxelCollector {
  public:
    void add(std::int32_t x, std::int32_t y, std::int32_t z) {
        Words& mask = at({block_floor(x), block_floor(y), block_floor(z)});
        mask[static_cast<std::size_t>(x & 7)] |= std::uint64_t{1} << (8 * (y & 7) + (z & 7));
    }
    void add(const Origin& origin, const Words& mask) {
        Words& here = at(origin);
        for (std::size_t i = 0; i < 8; ++i) here[i] |= mask[i];
    }
    // All voxels of a column from z = low to high.
    void add_column(std::int32_t x, std::int32_t y, std::int32_t low, std::int32_t high);
    Voxels finish() const;

  private:
    // The blocks of a column of blocks, by height: neighbouring columns of voxels share them.
    struct Tower {
        std::int32_t x = 1;  // no block begins there
        std::int32_t y = 1;
        std::int32_t low = 0;
        std::vector<std::uint32_t> blocks;
    };

    std::uint32_t& in_tower(std::int32_t z);

    Words& at(const Origin& origin) {
        const std::uint32_t i = index_.number(origin);
        if (i == words_.size()) {
            expect_few(words_.size());
            words_.push_back(Words{});
        }
        return words_[i];
    }

    OriginIndex index_;
    std::vector<Words> words_;
    Tower tower_;
};

}  // namespace semmap::fields
