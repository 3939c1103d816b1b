// The entities around an entity, the gaps to them, and which one rests on which.
//
// The gap between two voxels is that between cubes, in voxels: along each axis the difference of
// the indices minus 1. Gaps are compared squared, as integers.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <mutex>

#include "semmap/fields/region_map.hpp"

namespace semmap::fields {
namespace {

using Tree = openvdb::Int32Tree;
using Reader = openvdb::tree::ValueAccessor<const Tree>;

constexpr std::uint64_t kPlane = 0x0101010101010101;  // the voxels of a slice with z = 0

std::int64_t squared_gap(std::int32_t difference) {
    const std::int64_t gap = std::max(std::abs(difference) - 1, 0);
    return gap * gap;
}

int lowest(unsigned bits) { return __builtin_ctz(bits); }
int highest(unsigned bits) { return 31 - __builtin_clz(bits); }

// No voxel within the one is nearer to one within the other.
std::int64_t least_squared_gap(const CoordBBox& a, const CoordBBox& b) {
    std::int64_t squared = 0;
    for (int k = 0; k < 3; ++k) {
        const std::int64_t up = std::int64_t{b.min()[k]} - a.max()[k];
        const std::int64_t down = std::int64_t{a.min()[k]} - b.max()[k];
        const std::int64_t gap = std::max({up, down, std::int64_t{1}}) - 1;
        squared += gap * gap;
    }
    return squared;
}

// Between rows of eight voxels along z, of which the second begins `offset` voxels further up.
std::int64_t row_gap(unsigned a, unsigned b, std::int32_t offset) {
    if (offset > 0) return squared_gap(offset + lowest(b) - highest(a));
    if (offset < 0) return squared_gap(offset + highest(b) - lowest(a));
    std::int32_t steps = 0;
    for (; (a & b) == 0; ++steps) a |= a << 1 | a >> 1;
    return squared_gap(steps);
}

// The smallest squared gap between voxels of two blocks, if it is below `best`; else `best`.
std::int64_t block_gap(const Coord& from, const Words& a, const Coord& to, const Words& b,
                       std::int64_t best) {
    for (std::int32_t i = 0; i < kBlock; ++i) {
        const std::uint64_t slice = a[static_cast<std::size_t>(i)];
        if (slice == 0) continue;
        for (std::int32_t j = 0; j < kBlock; ++j) {
            const std::uint64_t other = b[static_cast<std::size_t>(j)];
            const std::int64_t x = squared_gap(to.x() + j - from.x() - i);
            if (other == 0 || x >= best) continue;
            for (std::int32_t k = 0; k < kBlock; ++k) {
                const auto row = static_cast<unsigned>(slice >> (8 * k) & 0xFF);
                if (row == 0) continue;
                for (std::int32_t l = 0; l < kBlock; ++l) {
                    const auto across = static_cast<unsigned>(other >> (8 * l) & 0xFF);
                    const std::int64_t xy = x + squared_gap(to.y() + l - from.y() - k);
                    if (across == 0 || xy >= best) continue;
                    best = std::min(best, xy + row_gap(row, across, to.z() - from.z()));
                }
            }
        }
    }
    return best;
}

// Blocks and those up to `reach` blocks away along each axis.
std::vector<Coord> dilated(const std::vector<Coord>& blocks, std::int32_t reach) {
    std::vector<Coord> all = blocks;
    for (int axis = 0; axis < 3; ++axis) {
        OriginIndex index;
        for (Coord origin : all) {
            const std::int32_t middle = origin[axis];
            for (std::int32_t step = -reach; step <= reach; ++step) {
                origin[axis] = middle + step * kBlock;
                index.number(origin);
            }
            if (static_cast<std::int64_t>(index.origins().size()) > kMostBlocks) {
                throw BadRegion("too many blocks lie within reach: take a shorter reach");
            }
        }
        all = index.origins();
    }
    return all;
}

// The entities that have a voxel in a block, each once.
class Present {
  public:
    Present(const Tree& tree, const Register& sets) : reader_(tree), sets_(sets) {}

    const std::vector<std::int32_t>& in(const Coord& origin) {
        numbers_.clear();
        const auto* leaf = reader_.probeConstLeaf(origin);
        if (leaf == nullptr) {
            numbers_.push_back(reader_.getValue(origin));
        } else {
            const std::int32_t* values = leaf->buffer().data();
            for (std::size_t i = 0; i < 512; ++i) {
                if (i > 0 && values[i] == values[i - 1]) continue;
                if (std::find(numbers_.begin(), numbers_.end(), values[i]) == numbers_.end()) {
                    numbers_.push_back(values[i]);
                }
            }
        }
        entities_.clear();
        for (const std::int32_t set : numbers_) {
            const std::vector<std::int32_t>& members = sets_.members(set);
            entities_.insert(entities_.end(), members.begin(), members.end());
        }
        std::sort(entities_.begin(), entities_.end());
        entities_.erase(std::unique(entities_.begin(), entities_.end()), entities_.end());
        return entities_;
    }

  private:
    Reader reader_;
    const Register& sets_;
    std::vector<std::int32_t> numbers_;
    std::vector<std::int32_t> entities_;
};

const Words* block_at(const Voxels& voxels, const Coord& origin) {
    const auto found = std::lower_bound(voxels.origins.begin(), voxels.origins.end(), origin);
    if (found == voxels.origins.end() || !(*found == origin)) return nullptr;
    return &voxels.words[static_cast<std::size_t>(found - voxels.origins.begin())];
}

// The blocks of an entity, with their bounds, for gaps to blocks of others.
class Near {
  public:
    // Those further than `blocks` blocks along x are not looked at.
    Near(const Voxels& voxels, std::int32_t blocks) : voxels_(voxels), reach_(blocks * kBlock) {
        bounds_.reserve(voxels.blocks());
        for (std::size_t i = 0; i < voxels.blocks(); ++i) {
            bounds_.push_back(box_of(voxels.origins[i], voxels.words[i]));
        }
    }

    // The squared gap to a block of another, if it is below `best`; else `best`.
    std::int64_t gap(const Coord& there, const Words& words, std::int64_t best) const {
        const CoordBBox bounds = box_of(there, words);
        const auto first =
            std::lower_bound(voxels_.origins.begin(), voxels_.origins.end(), there.x() - reach_,
                             [](const Coord& origin, std::int32_t x) { return origin.x() < x; });
        for (auto i = static_cast<std::size_t>(first - voxels_.origins.begin());
             i < voxels_.blocks() && voxels_.origins[i].x() <= there.x() + reach_; ++i) {
            if (least_squared_gap(bounds_[i], bounds) < best) {
                best = block_gap(voxels_.origins[i], voxels_.words[i], there, words, best);
            }
        }
        return best;
    }

  private:
    const Voxels& voxels_;
    std::vector<CoordBBox> bounds_;
    std::int32_t reach_;
};

// The lowest and the highest z of voxels; there is at least one.
std::pair<std::int32_t, std::int32_t> heights(const Voxels& voxels) {
    std::int32_t low = std::numeric_limits<std::int32_t>::max();
    std::int32_t high = std::numeric_limits<std::int32_t>::min();
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const Coord& origin = voxels.origins[i];
        if (low <= origin.z() && origin.z() + kBlock <= high) continue;
        const CoordBBox box = box_of(origin, voxels.words[i]);
        low = std::min(low, box.min().z());
        high = std::max(high, box.max().z());
    }
    return {low, high};
}

// The voxels of a block at a height: a word a slice x, of which bit 8 y is (x, y).
Words plane(const Words& words, std::int32_t z) {
    Words flat{};
    for (std::size_t x = 0; x < 8; ++x) flat[x] = words[x] >> (z & 7) & kPlane;
    return flat;
}

}  // namespace

std::vector<Neighbour> RegionMap::neighbours(std::int32_t entity, std::int64_t farthest) const {
    const std::shared_lock lock(mutex_);
    const Voxels& voxels = region(entity);
    std::map<std::int32_t, Neighbour> found;
    for (const auto& [other, shared] : counts_over(voxels)) {
        if (other != entity) found[other] = {other, shared, 0};
    }
    if (farthest >= 0 && voxels.blocks() > 0) {
        const auto reach = static_cast<std::int32_t>(std::sqrt(static_cast<double>(farthest))) + 1;
        const std::int32_t blocks = (reach + kBlock - 1) / kBlock;
        Present present(grid_.tree(), sets_);
        const Near near(voxels, blocks);
        for (const Coord& there : dilated(voxels.origins, blocks)) {
            for (const std::int32_t other : present.in(there)) {
                if (other == entity) continue;
                const Neighbour unmet{other, 0, farthest + 1};
                auto& gap = found.try_emplace(other, unmet).first->second[2];
                if (gap > 0) gap = near.gap(there, *block_at(region(other), there), gap);
            }
        }
    }
    std::vector<Neighbour> all;
    for (const auto& [other, each] : found) {
        if (each[1] > 0 || each[2] <= farthest) all.push_back(each);
    }
    return all;
}

// A voxel of the lowest layer rests on b where b has the voxel below it or the same one, but not
// the one above. Of two entities that begin at one height, only the higher one can rest on the
// other.
Support RegionMap::support(std::int32_t a, std::int32_t b) const {
    const std::shared_lock lock(mutex_);
    const Voxels& above = region(a);
    const Voxels& below = region(b);
    Support support{};
    auto& [lowest_layer, resting, nearly] = support;
    if (above.blocks() == 0 || below.blocks() == 0) return support;
    const auto [z, top] = heights(above);
    const auto [lower, upper] = heights(below);
    const bool shorter = lower <= z + 1 && lower >= z && upper < top;
    const bool firm = lower < z || (lower == z && shorter);
    const bool loose = lower < z || shorter;
    if (!loose) return support;
    for (std::size_t i = 0; i < above.blocks(); ++i) {
        const Coord& column = above.origins[i];
        if (column.z() != block_floor(z)) continue;
        const Words layer = plane(above.words[i], z);
        for (const std::uint64_t slice : layer) lowest_layer += __builtin_popcountll(slice);
        std::array<Words, 5> at{};  // from two beneath it to two above it
        const Words* block = nullptr;
        for (std::int32_t step = -2; step <= 2; ++step) {
            const std::int32_t floor = block_floor(z + step);
            if (step == -2 || floor == z + step) {
                block = block_at(below, Coord(column.x(), column.y(), floor));
            }
            if (block != nullptr) at[static_cast<std::size_t>(step + 2)] = plane(*block, z + step);
        }
        for (std::size_t x = 0; x < 8; ++x) {
            const std::uint64_t rests = (at[1][x] | at[2][x]) & ~at[3][x];
            const std::uint64_t about =
                (at[0][x] | at[1][x] | at[2][x] | at[3][x]) & ~(at[3][x] & at[4][x]);
            if (firm) resting += __builtin_popcountll(layer[x] & rests);
            nearly += __builtin_popcountll(layer[x] & about);
        }
    }
    return support;
}

}  // namespace semmap::fields
