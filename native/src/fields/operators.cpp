#include "semmap/fields/operators.hpp"

#include <algorithm>
#include <unordered_map>

#include "convex.hpp"
#include "spread.hpp"

namespace semmap::fields {
namespace {

// The voxels of one block of a grid: of a leaf, of a tile or of nothing.
template <typename Value>
struct Block : Content<Value> {
    bool uniform;  // all active and of values[0]
};

template <typename Value>
void take_tile(Value value, Block<Value>& block) {
    block.active.fill(~std::uint64_t{0});
    block.values.fill(value);
    block.uniform = true;
}

// Reads blocks by their origin.
template <typename Value>
class Reader {
  public:
    explicit Reader(const Grid<Value>& grid) : accessor_(grid.tree()) {}

    // False where nothing is active.
    bool read(const Coord& origin, Block<Value>& block) {
        if (const auto* leaf =
                accessor_.template probeConstNode<typename Grid<Value>::Tree::LeafNodeType>(
                    origin)) {
            read_leaf(*leaf, static_cast<Content<Value>&>(block));
            block.uniform = false;
            return !is_empty(block.active);
        }
        Value value;
        if (!accessor_.probeValue(origin, value)) return false;
        take_tile(value, block);
        return true;
    }

    // Whether a block has active voxels, and which: for masks.
    bool read_mask(const Coord& origin, Words& active) {
        if (const auto* leaf =
                accessor_.template probeConstNode<typename Grid<Value>::Tree::LeafNodeType>(
                    origin)) {
            const auto& mask = leaf->valueMask();
            for (openvdb::Index x = 0; x < 8; ++x) {
                active[x] = mask.template getWord<std::uint64_t>(x);
            }
            return true;
        }
        if (!accessor_.isValueOn(origin)) return false;
        active.fill(~std::uint64_t{0});
        return true;
    }

  private:
    openvdb::tree::ValueAccessor<const typename Grid<Value>::Tree> accessor_;
};

// Calls found(origin) for each block with active voxels; larger tiles are split.
template <typename Value, typename Found>
void each_origin(const Grid<Value>& grid, Found&& found) {
    const auto tiles = [&grid] {
        auto tile = grid.tree().cbeginValueOn();
        tile.setMaxDepth(Grid<Value>::Tree::ValueOnCIter::LEAF_DEPTH - 1);
        return tile;
    };
    auto blocks = static_cast<std::int64_t>(grid.tree().leafCount());
    for (auto tile = tiles(); tile; ++tile) {
        blocks += static_cast<std::int64_t>(tile.getVoxelCount() / kVoxels);
    }
    if (blocks > kMostBlocks) {
        throw BadRegion("the grid has " + std::to_string(blocks) +
                        " blocks of 8 x 8 x 8 voxels, more than are combined: crop it, or take "
                        "larger voxels");
    }
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
        if (!leaf->isEmpty()) found(leaf->origin());
    }
    for (auto tile = tiles(); tile; ++tile) {
        each_cube(tile.getBoundingBox(), kBlock, found);
    }
}

template <typename Value>
std::size_t nodes(const Grid<Value>& grid) {
    return static_cast<std::size_t>(grid.tree().leafCount()) +
           static_cast<std::size_t>(grid.tree().activeTileCount());
}

// Writes blocks; a full block with one value becomes a tile.
template <typename Value>
class Writer {
  public:
    template <typename Like>
    explicit Writer(const Grid<Like>& like, Value background)
        : grid_(like.voxel_size(), background), accessor_(grid_.tree()) {
        grid_.place(like.placement());
    }

    void write(const Coord& origin, const Block<Value>& block) {
        if (is_empty(block.active)) return;
        if (block.uniform || is_uniform(block)) {
            accessor_.addTile(1, origin, block.values[0], true);
            accessor_.clear();
            return;
        }
        using Leaf = typename Grid<Value>::Tree::LeafNodeType;
        auto* leaf = new Leaf(origin, grid_.background(), false);
        each_voxel(block.active, [&](std::size_t i) {
            leaf->setValueOn(static_cast<openvdb::Index>(i), block.values[i]);
        });
        accessor_.addLeaf(leaf);
    }

    // Throws BadRegion where blocks lie too far apart.
    void expect_near(const std::vector<Coord>& origins) {
        Spread spread(grid_.tree());
        for (const Coord& origin : origins) spread.add(origin);
    }

    Grid<Value> finish() {
        grid_.prune();
        return std::move(grid_);
    }

  private:
    static bool is_uniform(const Block<Value>& block) {
        if (!is_full(block.active)) return false;
        return std::all_of(block.values.begin(), block.values.end(),
                           [&](Value v) { return v == block.values[0]; });
    }

    Grid<Value> grid_;
    openvdb::tree::ValueAccessor<typename Grid<Value>::Tree> accessor_;
};

template <typename Value, typename Holds>
Grid<bool> where(const Grid<Value>& grid, Holds&& holds) {
    Writer<bool> out(grid, false);
    Reader<Value> reader(grid);
    Block<Value> block;
    Block<bool> answer;
    answer.values.fill(true);
    each_origin(grid, [&](const Coord& origin) {
        if (!reader.read(origin, block)) return;
        answer.uniform = block.uniform;
        if (block.uniform) {
            answer.active = block.active;
            if (!holds(block.values[0])) return;
        } else {
            answer.active.fill(0);
            for (std::size_t i = 0; i < kVoxels; ++i) {
                answer.active[i / 64] |= std::uint64_t{holds(block.values[i])} << (i % 64);
            }
            for (std::size_t x = 0; x < 8; ++x) answer.active[x] &= block.active[x];
        }
        out.write(origin, answer);
    });
    return out.finish();
}

template <typename Value>
Value both(Value a, Value b, Join how) {
    switch (how) {
        case Join::first:
            return a;
        case Join::last:
            return b;
        case Join::max:
            return std::max(a, b);
        case Join::min:
            return std::min(a, b);
        case Join::sum:
            break;
    }
    if constexpr (std::is_same_v<Value, bool>) {
        return a || b;
    } else if constexpr (std::is_same_v<Value, std::int32_t>) {
        return static_cast<Value>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
    } else {
        return a + b;
    }
}

}  // namespace

template <typename Value>
Grid<Value> joined(const Grid<Value>& a, const Grid<Value>& b, Join how) {
    Writer<Value> out(a, a.background());
    Reader<Value> of_a(a);
    Reader<Value> of_b(b);
    Block<Value> one;
    Block<Value> other;
    each_origin(a, [&](const Coord& origin) {
        if (!of_a.read(origin, one)) return;
        if (of_b.read(origin, other)) {
            for (std::size_t i = 0; i < kVoxels; ++i) {
                if (!is_on(other.active, i)) continue;
                one.values[i] = is_on(one.active, i) ? both(one.values[i], other.values[i], how)
                                                     : other.values[i];
            }
            for (std::size_t x = 0; x < 8; ++x) one.active[x] |= other.active[x];
            one.uniform = false;
        }
        out.write(origin, one);
    });
    each_origin(b, [&](const Coord& origin) {
        if (!of_a.read(origin, one) && of_b.read(origin, other)) out.write(origin, other);
    });
    return out.finish();
}

template <typename Value>
Grid<Value> masked(const Grid<Value>& grid, const Grid<bool>& mask, bool inside) {
    Writer<Value> out(grid, grid.background());
    Reader<Value> reader(grid);
    Reader<bool> of_mask(mask);
    Block<Value> block;
    Words active;
    const auto at = [&](const Coord& origin) {
        const bool met = of_mask.read_mask(origin, active);
        if (!met && inside) return;
        if (!reader.read(origin, block)) return;
        if (met) {
            for (std::size_t x = 0; x < 8; ++x) {
                block.active[x] &= inside ? active[x] : ~active[x];
            }
            block.uniform = block.uniform && is_full(block.active);
        }
        out.write(origin, block);
    };
    // Only the blocks of the smaller grid can be in the result.
    if (inside && nodes(mask) < nodes(grid)) {
        each_origin(mask, at);
    } else {
        each_origin(grid, at);
    }
    return out.finish();
}

template <typename Value>
Grid<bool> active(const Grid<Value>& grid) {
    return where(grid, [](Value) { return true; });
}

template <typename Value>
Grid<bool> between(const Grid<Value>& grid, Value low, Value high) {
    return where(grid, [=](Value v) { return low <= v && v <= high; });
}

Grid<std::int32_t> renumbered(const Grid<std::int32_t>& grid,
                              const std::vector<std::pair<std::int32_t, std::int32_t>>& pairs) {
    const std::unordered_map<std::int32_t, std::int32_t> to(pairs.begin(), pairs.end());
    Writer<std::int32_t> out(grid, grid.background());
    Reader<std::int32_t> reader(grid);
    Block<std::int32_t> block;
    each_origin(grid, [&](const Coord& origin) {
        if (!reader.read(origin, block)) return;
        for (std::int32_t& value : block.values) {
            const auto found = to.find(value);
            if (found != to.end()) value = found->second;
        }
        out.write(origin, block);
    });
    return out.finish();
}

template <typename Value>
Grid<Value> cropped(const Grid<Value>& grid, const Coord& low, const Coord& high) {
    const CoordBBox box(Coord::maxComponent(low, Coord(-kFarthestVoxel)),
                        Coord::minComponent(high, Coord(kFarthestVoxel)));
    Writer<Value> out(grid, grid.background());
    Reader<Value> reader(grid);
    Block<Value> block;
    const auto at = [&](const Coord& origin) {
        const CoordBBox here(origin, origin.offsetBy(kBlock - 1));
        if (!box.hasOverlap(here) || !reader.read(origin, block)) return;
        if (!box.isInside(here)) {
            Words inside{};
            for (std::size_t i = 0; i < kVoxels; ++i) {
                inside[i / 64] |= std::uint64_t{box.isInside(voxel_of(origin, i))} << i % 64;
            }
            for (std::size_t x = 0; x < 8; ++x) block.active[x] &= inside[x];
            block.uniform = false;
        }
        out.write(origin, block);
    };
    if (box.empty()) return out.finish();
    const Vector blocks = (box.max().asVec3d() - box.min().asVec3d()) / double{kBlock} + Vector(2);
    if (blocks.product() > static_cast<double>(nodes(grid))) {
        each_origin(grid, at);
        return out.finish();
    }
    each_cube({block_floor(box.min()), box.max()}, kBlock, at);
    return out.finish();
}

template <typename Value>
Grid<Value> resampled(const Grid<Value>& grid, double voxel_size, const Placement& placement) {
    Grid<Value> frame(voxel_size, grid.background());
    frame.place(placement);
    // From voxels of the answer (their lowest corners) to those of the grid: p = turn q + shift.
    const double scale = grid.voxel_size() / voxel_size;
    const auto upright = turn_of(grid.placement()).transpose();
    const auto turn = upright * turn_of(placement) * (1 / scale);
    const auto back = turn.transpose() * (scale * scale);
    const Vector shift =
        upright * (shift_of(placement) - shift_of(grid.placement())) / grid.voxel_size();
    // Blocks of the answer that the box around the active voxels of a block of the grid meets.
    OriginIndex candidates;
    Reader<Value> reader(grid);
    Words active;
    each_origin(grid, [&](const Coord& origin) {
        if (!reader.read_mask(origin, active)) return;
        const CoordBBox here = box_of(origin, active);
        const Vector low = here.min().asVec3d();
        const Vector high = here.max().asVec3d() + Vector(1);
        const Vector middle = back * ((low + high) / 2.0 - shift);
        Vector reach;
        for (int k = 0; k < 3; ++k) {
            reach[k] = 1 + Abs(back.row(k)).dot(high - low) / 2;  // 1 for what is rounded
        }
        const CoordBBox box(block_floor(Coord::floor(checked(middle - reach))),
                            Coord::floor(checked(middle + reach)));
        const Vector met = (box.max().asVec3d() - box.min().asVec3d()) / double{kBlock} + Vector(1);
        if (static_cast<double>(candidates.origins().size()) + met.product() >
            static_cast<double>(kMostBlocks)) {
            throw BadRegion("the grid has too many voxels of that size: take larger ones");
        }
        each_cube(box, kBlock, [&](const Coord& at) { candidates.number(at); });
    });
    Writer<Value> out(frame, grid.background());
    out.expect_near(candidates.origins());
    auto accessor = openvdb::tree::ValueAccessor<const typename Grid<Value>::Tree>(grid.tree());
    Block<Value> block;
    block.uniform = false;
    std::array<Vector, kVoxels> centres;
    std::array<std::int32_t, 3 * kVoxels> at;
    for (const Coord& origin : candidates.origins()) {
        block.active.fill(0);
        block.values.fill(grid.background());
        for (std::size_t i = 0; i < kVoxels; ++i) {
            centres[i] = turn * (voxel_of(origin, i).asVec3d() + Vector(0.5)) + shift;
        }
        voxel_indices(centres[0].asPointer(), 3 * kVoxels, 1.0, at.data());
        for (std::size_t i = 0; i < kVoxels; ++i) {
            Value value;
            if (!accessor.probeValue(Coord(&at[3 * i]), value)) continue;
            block.active[i / 64] |= std::uint64_t{1} << (i % 64);
            block.values[i] = value;
        }
        out.write(origin, block);
    }
    return out.finish();
}

Grid<std::int32_t> labelled(const float* depth, const std::int32_t* labels, std::size_t rows,
                            std::size_t columns, const Camera& camera, double farthest,
                            double voxel_size) {
    // The vote of Boyer and Moore in each voxel: a label that has more than half of it wins.
    struct Vote {
        std::int32_t label = 0;
        std::uint32_t lead = 0;
    };
    OriginIndex index;
    std::vector<std::array<Vote, kVoxels>> votes;
    constexpr std::size_t few = 512;
    std::array<Vector, few> points;
    std::array<std::int32_t, few> shown;
    std::array<std::int32_t, 3 * few> voxels;
    std::size_t count = 0;
    const auto vote = [&] {
        voxel_indices(points[0].asPointer(), 3 * count, voxel_size, voxels.data());
        for (std::size_t i = 0; i < count; ++i) {
            const Coord voxel(&voxels[3 * i]);
            const std::size_t block = index.number(block_floor(voxel));
            if (block == votes.size()) {
                // Each block takes 4 kB here.
                if (static_cast<std::int64_t>(block) >= region_limits().blocks / 4) {
                    throw BadRegion("the image shows too many voxels: take larger ones");
                }
                votes.emplace_back();
            }
            Vote& vote = votes[block][in_block(voxel)];
            if (vote.label == shown[i]) {
                ++vote.lead;
            } else if (vote.lead == 0) {
                vote = {shown[i], 1};
            } else {
                --vote.lead;
            }
        }
        count = 0;
    };
    each_point(
        depth, rows, columns, camera, farthest,
        [&](std::size_t pixel) { return labels[pixel] != 0; },
        [&](std::size_t pixel, const Vector& point) {
            points[count] = point;
            shown[count++] = labels[pixel];
            if (count == few) vote();
        });
    vote();
    const Grid<std::int32_t> frame(voxel_size, 0);
    Writer<std::int32_t> out(frame, 0);
    out.expect_near(index.origins());
    Block<std::int32_t> block;
    block.uniform = false;
    for (std::size_t b = 0; b < votes.size(); ++b) {
        block.active.fill(0);
        for (std::size_t i = 0; i < kVoxels; ++i) {
            block.values[i] = votes[b][i].label;
            block.active[i / 64] |= std::uint64_t{votes[b][i].label != 0} << (i % 64);
        }
        out.write(index.origins()[b], block);
    }
    return out.finish();
}

#define SEMMAP_FOR_VALUE(Value)                                                   \
    template Grid<Value> joined(const Grid<Value>&, const Grid<Value>&, Join);    \
    template Grid<Value> masked(const Grid<Value>&, const Grid<bool>&, bool);     \
    template Grid<bool> active(const Grid<Value>&);                               \
    template Grid<bool> between(const Grid<Value>&, Value, Value);                \
    template Grid<Value> cropped(const Grid<Value>&, const Coord&, const Coord&); \
    template Grid<Value> resampled(const Grid<Value>&, double, const Placement&);

SEMMAP_FOR_VALUE(bool)
SEMMAP_FOR_VALUE(std::int32_t)
SEMMAP_FOR_VALUE(float)

}  // namespace semmap::fields
