// Which entities are around one, how near, and what rests on what.
//
// The gap between two voxels is that between them as cubes, in voxels: along each axis one less
// than their indices differ. It is compared squared, as a whole number.
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

// Along one axis, between blocks: no voxel of the one is nearer to one of the other.
std::int64_t least_squared_gap(std::int32_t a, std::int32_t b) {
    const std::int64_t apart = std::abs(std::int64_t{a} - b) - kBlock;
    return apart > 0 ? apart * apart : 0;
}

std::int64_t least_squared_gap(const Origin& a, const Origin& b) {
    return least_squared_gap(a.x, b.x) + least_squared_gap(a.y, b.y) + least_squared_gap(a.z, b.z);
}

// Between rows of eight voxels along z, of which the second begins `offset` voxels further up.
std::int64_t row_gap(unsigned a, unsigned b, std::int32_t offset) {
    const auto lowest = [](unsigned row) { return __builtin_ctz(row); };
    const auto highest = [](unsigned row) { return 31 - __builtin_clz(row); };
    if (offset > 0) return squared_gap(offset + lowest(b) - highest(a));
    if (offset < 0) return squared_gap(offset + highest(b) - lowest(a));
    std::int32_t steps = 0;
    for (; (a & b) == 0; ++steps) a |= a << 1 | a >> 1;
    return squared_gap(steps);
}

// The smallest squared gap between voxels of two blocks, if it is below `best`; else `best`.
std::int64_t block_gap(const Origin& from, const Words& a, const Origin& to, const Words& b,
                       std::int64_t best) {
    for (std::int32_t i = 0; i < kBlock; ++i) {
        const std::uint64_t slice = a[static_cast<std::size_t>(i)];
        if (slice == 0) continue;
        for (std::int32_t j = 0; j < kBlock; ++j) {
            const std::uint64_t other = b[static_cast<std::size_t>(j)];
            const std::int64_t x = squared_gap(to.x + j - from.x - i);
            if (other == 0 || x >= best) continue;
            for (std::int32_t k = 0; k < kBlock; ++k) {
                const auto row = static_cast<unsigned>(slice >> (8 * k) & 0xFF);
                if (row == 0) continue;
                for (std::int32_t l = 0; l < kBlock; ++l) {
                    const auto across = static_cast<unsigned>(other >> (8 * l) & 0xFF);
                    const std::int64_t xy = x + squared_gap(to.y + l - from.y - k);
                    if (across == 0 || xy >= best) continue;
                    best = std::min(best, xy + row_gap(row, across, to.z - from.z));
                }
            }
        }
    }
    return best;
}

// Blocks and those up to `reach` blocks away along each axis.
std::vector<Origin> dilated(const std::vector<Origin>& blocks, std::int32_t reach) {
    std::vector<Origin> all = blocks;
    for (std::int32_t Origin::* axis : {&Origin::x, &Origin::y, &Origin::z}) {
        OriginIndex index;
        for (Origin origin : all) {
            const std::int32_t middle = origin.*axis;
            for (std::int32_t step = -reach; step <= reach; ++step) {
                origin.*axis = middle + step * kBlock;
                index.number(origin);
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

    const std::vector<std::int32_t>& in(const Origin& origin) {
        entities_.clear();
        const openvdb::Coord place(origin.x, origin.y, origin.z);
        const auto* leaf = reader_.probeConstLeaf(place);
        if (leaf == nullptr) {
            add(reader_.getValue(place));
        } else {
            const std::int32_t* values = leaf->buffer().data();
            std::int32_t last = 0;
            for (std::size_t i = 0; i < 512; ++i) {
                if (values[i] != last) add(last = values[i]);
            }
        }
        for (const std::int32_t set : seen_) marked_[static_cast<std::size_t>(set)] = false;
        seen_.clear();
        std::sort(entities_.begin(), entities_.end());
        entities_.erase(std::unique(entities_.begin(), entities_.end()), entities_.end());
        return entities_;
    }

  private:
    void add(std::int32_t set) {
        if (set == 0) return;
        if (marked_.empty()) marked_.resize(static_cast<std::size_t>(sets_.end()));
        if (marked_[static_cast<std::size_t>(set)]) return;
        marked_[static_cast<std::size_t>(set)] = true;
        seen_.push_back(set);
        const std::vector<std::int32_t>& members = sets_.members(set);
        entities_.insert(entities_.end(), members.begin(), members.end());
    }

    Reader reader_;
    const Register& sets_;
    std::vector<bool> marked_;  // by set
    std::vector<std::int32_t> seen_;
    std::vector<std::int32_t> entities_;
};

const Words* block_at(const Voxels& voxels, const Origin& origin) {
    const auto found = std::lower_bound(voxels.origins.begin(), voxels.origins.end(), origin);
    if (found == voxels.origins.end() || !(*found == origin)) return nullptr;
    return &voxels.words[static_cast<std::size_t>(found - voxels.origins.begin())];
}

struct Heights {
    std::int32_t low;
    std::int32_t high;
};

// The lowest and the highest z; of no voxels none.
Heights heights(const Voxels& voxels) {
    Heights all{std::numeric_limits<std::int32_t>::max(), std::numeric_limits<std::int32_t>::min()};
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const std::int32_t floor = voxels.origins[i].z;
        if (floor >= all.low && floor + kBlock - 1 <= all.high) continue;
        std::uint64_t rows = 0;
        for (const std::uint64_t word : voxels.words[i]) rows |= word;
        for (int shift = 32; shift >= 8; shift /= 2) rows |= rows >> shift;
        const auto row = static_cast<unsigned>(rows & 0xFF);
        all.low = std::min(all.low, floor + __builtin_ctz(row));
        all.high = std::max(all.high, floor + 31 - __builtin_clz(row));
    }
    return all;
}

// Of a column of blocks, the voxels at a height: a word a slice x, of which bit 8 y is (x, y).
Words plane(const Voxels& voxels, const Origin& column, std::int32_t z) {
    Words flat{};
    const Words* words = block_at(voxels, {column.x, column.y, block_floor(z)});
    if (words == nullptr) return flat;
    for (std::size_t x = 0; x < 8; ++x) flat[x] = (*words)[x] >> (z & 7) & kPlane;
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
        Present present(grid_->tree(), sets_);
        for (const Origin& there : dilated(voxels.origins, blocks)) {
            for (const std::int32_t other : present.in(there)) {
                if (other == entity) continue;
                Neighbour& best =
                    found.try_emplace(other, Neighbour{other, 0, farthest + 1}).first->second;
                if (best.gap == 0) continue;
                const Words& words = *block_at(region(other), there);
                const std::int32_t near = there.x - blocks * kBlock;
                const auto first = std::lower_bound(
                    voxels.origins.begin(), voxels.origins.end(), near,
                    [](const Origin& origin, std::int32_t x) { return origin.x < x; });
                for (auto i = static_cast<std::size_t>(first - voxels.origins.begin());
                     i < voxels.blocks() && voxels.origins[i].x <= there.x + blocks * kBlock; ++i) {
                    const Origin& here = voxels.origins[i];
                    if (least_squared_gap(here, there) >= best.gap) continue;
                    best.gap = block_gap(here, voxels.words[i], there, words, best.gap);
                }
            }
        }
    }
    std::vector<Neighbour> all;
    for (const auto& [other, each] : found) {
        if (each.shared > 0 || each.gap <= farthest) all.push_back(each);
    }
    return all;
}

// A voxel of the lowest layer rests on b where b has the one beneath it or itself, and goes no
// higher. Of two that begin at one height, only what reaches higher can rest on the other.
Support RegionMap::support(std::int32_t a, std::int32_t b) const {
    const std::shared_lock lock(mutex_);
    const Voxels& above = region(a);
    const Voxels& below = region(b);
    Support support{};
    if (above.blocks() == 0) return support;
    const Heights of_a = heights(above);
    const Heights of_b = heights(below);
    const std::int32_t z = of_a.low;
    for (const Origin& column : above.origins) {
        if (column.z != block_floor(z)) continue;
        const Words layer = plane(above, column, z);
        std::array<Words, 5> at{};  // from two beneath it to two above it
        for (std::int32_t step = -2; step <= 2; ++step) {
            at[static_cast<std::size_t>(step + 2)] = plane(below, column, z + step);
        }
        for (std::size_t x = 0; x < 8; ++x) {
            const std::uint64_t firm = (at[1][x] | at[2][x]) & ~at[3][x];
            const std::uint64_t loose =
                (at[0][x] | at[1][x] | at[2][x] | at[3][x]) & ~(at[3][x] & at[4][x]);
            support.layer += __builtin_popcountll(layer[x]);
            support.firm += __builtin_popcountll(layer[x] & firm);
            support.loose += __builtin_popcountll(layer[x] & loose);
        }
    }
    const bool lower = of_b.low < of_a.low;
    const bool shorter = of_b.high < of_a.high;
    if (!(lower || (of_b.low == of_a.low && shorter))) support.firm = 0;
    if (!(lower || (of_b.low <= of_a.low + 1 && shorter))) support.loose = 0;
    return support;
}

}  // namespace semmap::fields
