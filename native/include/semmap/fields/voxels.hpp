// Sets of voxels as blocks of 8 x 8 x 8 with one bit per voxel, in the order of OpenVDB's leaves.
#pragma once

#include <openvdb/math/Coord.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace semmap::fields {

constexpr int kBlock = 8;
constexpr std::size_t kVoxels = 512;  // of a block

using openvdb::math::Coord;
using openvdb::math::CoordBBox;

inline std::int32_t block_floor(std::int32_t voxel) { return voxel & ~(kBlock - 1); }

// The lowest voxel of the block of a voxel.
inline Coord block_floor(const Coord& voxel) { return voxel & ~(kBlock - 1); }

// The number of a voxel in its block, z fastest, and the voxel of a number.
inline std::size_t in_block(const Coord& voxel) {
    const Coord at = voxel & (kBlock - 1);
    return static_cast<std::size_t>(at.x() << 6 | at.y() << 3 | at.z());
}

inline Coord voxel_of(const Coord& block, std::size_t number) {
    const auto i = static_cast<std::int32_t>(number);
    return block.offsetBy(i >> 6, i >> 3 & 7, i & 7);
}

// One word per slice x; bit 8 y + z is voxel (x, y, z).
using Words = std::array<std::uint64_t, 8>;

// Calls each(number) for each voxel of a block.
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

// The lowest and the highest voxel of a block; there is at least one.
CoordBBox box_of(const Coord& block, const Words& words);

int count(const Words& words);
bool is_full(const Words& words);
bool is_empty(const Words& words);

// Blocks in ascending order of their origins, none of them empty.
struct Voxels {
    std::vector<Coord> origins;
    std::vector<Words> words;

    std::size_t blocks() const { return origins.size(); }
    std::int64_t size() const;
    std::size_t bytes() const;
    void append(const Coord& origin, const Words& mask) {
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
    std::uint32_t number(const Coord& origin) {
        std::uint32_t& last = last_[static_cast<std::size_t>(origin.z() / kBlock & 63)];
        if (last < origins_.size() && origins_[last] == origin) return last;
        return last = find(origin);
    }
    const std::vector<Coord>& origins() const { return origins_; }

  private:
    std::uint32_t find(const Coord& origin);
    void grow();

    std::vector<std::uint32_t> slots_;
    std::vector<Coord> origins_;
    std::array<std::uint32_t, 64> last_{};  // found, by height: neighbours come after each other
};

// Collects voxels in any order; throws BadRegion when there are too many.
class VoxelCollector {
  public:
    void add(const Coord& voxel) {
        const std::size_t i = in_block(voxel);
        at(block_floor(voxel))[i / 64] |= std::uint64_t{1} << (i % 64);
    }
    void add(const Coord& origin, const Words& mask) {
        Words& here = at(origin);
        for (std::size_t i = 0; i < 8; ++i) here[i] |= mask[i];
    }
    // All voxels of a column from z = low to high.
    void add_column(std::int32_t x, std::int32_t y, std::int32_t low, std::int32_t high);
    Voxels finish() const;

  private:
    Words& at(const Coord& origin) {
        const std::uint32_t i = index_.number(origin);
        if (i == words_.size()) {
            expect_few(words_.size());
            words_.push_back(Words{});
        }
        return words_[i];
    }

    OriginIndex index_;
    std::vector<Words> words_;
};

}  // namespace semmap::fields
