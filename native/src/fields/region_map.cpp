#include "semmap/fields/region_map.hpp"

#include <algorithm>
#include <cstring>
#include <map>
#include <mutex>
#include <stdexcept>
#include <utility>

#include "convex.hpp"
#include "retag.hpp"
#include "spread.hpp"
#include "team.hpp"

namespace semmap::fields {
namespace {

using Tree = openvdb::Int32Tree;
using Leaf = Tree::LeafNodeType;
using Lower = Tree::RootNodeType::ChildNodeType::ChildNodeType;
using Upper = Tree::RootNodeType::ChildNodeType;
using Reader = openvdb::tree::ValueAccessor<const Tree>;

constexpr std::int32_t kUnknown = -1;
constexpr std::uint64_t kAll = ~std::uint64_t{0};

static_assert(Leaf::DIM == kBlock, "blocks are leaves");

std::uint64_t& active_word(Leaf& leaf, std::size_t x) {
    return leaf.getValueMask().getWord<std::uint64_t>(static_cast<openvdb::Index>(x));
}

bool is_uniform(const std::int32_t* values) {
    if (values[0] != values[511] || values[0] != values[255]) return false;
    return std::memcmp(values, values + 1, 511 * sizeof *values) == 0;
}

// One entity inserted or removed.
struct Toggle {
    Register& sets;
    std::vector<std::int32_t>& known;
    std::int32_t entity;
    std::vector<std::int32_t> touched{};
    Words cleared{};

    std::int32_t next(std::int32_t from) {
        const std::int32_t to = known[static_cast<std::size_t>(from)];
        return to != kUnknown ? to : learn(from);
    }
    std::int32_t learn(std::int32_t from) {
        const std::int32_t to = sets.toggled(from, entity);
        if (known.size() < static_cast<std::size_t>(sets.end())) {
            known.resize(static_cast<std::size_t>(2 * sets.end()), kUnknown);
        }
        known[static_cast<std::size_t>(from)] = to;
        touched.push_back(from);
        return to;
    }
    void moved(std::size_t x, std::int32_t from, std::int32_t to, std::uint64_t which, int count) {
        sets.count(from) -= count;
        sets.count(to) += count;
        if (to == 0) cleared[x] |= which;
    }
    void finish() {
        for (const std::int32_t from : touched) {
            known[static_cast<std::size_t>(from)] = kUnknown;
            sets.free_if_unused(from);
        }
    }
};

}  // namespace

RegionMap::RegionMap(double voxel_size) : grid_(voxel_size, 0) {}

const Voxels& RegionMap::region(std::int32_t entity) const {
    static const Voxels none;
    const auto i = static_cast<std::size_t>(entity);
    return i < regions_.size() ? regions_[i] : none;
}

Voxels& RegionMap::region_to_change(std::int32_t entity) {
    if (entity < 0 || entity >= kMostEntities) {
        throw std::invalid_argument("entity is " + std::to_string(entity) + ": give 0 to " +
                                    std::to_string(kMostEntities - 1));
    }
    const auto i = static_cast<std::size_t>(entity);
    if (i >= regions_.size()) regions_.resize(i + 1);
    return regions_[i];
}

void RegionMap::insert(std::int32_t entity, const Shape& shape) {
    Voxels voxels = rasterise(shape, voxel_size());
    const std::unique_lock lock(mutex_);
    Spread(grid_.tree()).add(voxels);
    add(entity, std::move(voxels));
}

void RegionMap::remove(std::int32_t entity) {
    const std::unique_lock lock(mutex_);
    if (region(entity).blocks() == 0) return;
    const Voxels had = std::exchange(region_to_change(entity), {});
    apply(entity, had);
    prune();
}

void RegionMap::move(std::int32_t entity, const Shape& shape) {
    Voxels voxels = rasterise(shape, voxel_size());
    const std::unique_lock lock(mutex_);
    Spread(grid_.tree()).add(voxels);
    change(entity, std::move(voxels));
}

void RegionMap::add(std::int32_t entity, Voxels voxels) {
    const Voxels& has = region(entity);
    change(entity, has.blocks() == 0 ? std::move(voxels) : united(has, voxels));
}

void RegionMap::change(std::int32_t entity, Voxels voxels) {
    Voxels& has = region_to_change(entity);
    apply(entity, without(voxels, has));
    apply(entity, without(has, voxels));
    has = std::move(voxels);
    prune();
}

std::vector<std::string> RegionMap::insert_many(const std::vector<std::int32_t>& entities,
                                                const std::vector<const Shape*>& shapes,
                                                unsigned threads, bool others) {
    std::vector<Voxels> voxels(shapes.size());
    std::vector<std::string> reasons(shapes.size());
    Team(threads).share(shapes.size(), 1, [&](unsigned, std::size_t i, std::size_t) {
        try {
            voxels[i] = rasterise(*shapes[i], voxel_size());
        } catch (const BadRegion& bad) {
            reasons[i] = bad.what();
        }
    });
    const std::unique_lock lock(mutex_);
    Spread spread(grid_.tree());
    for (std::size_t i = 0; i < voxels.size(); ++i) {
        try {
            spread.add(voxels[i]);
        } catch (const BadRegion& bad) {
            reasons[i] = bad.what();
            voxels[i] = {};
        }
    }
    const auto given = [](const std::string& reason) { return !reason.empty(); };
    if (!others && std::any_of(reasons.begin(), reasons.end(), given)) return reasons;
    for (std::size_t i = 0; i < entities.size(); ++i) add(entities[i], std::move(voxels[i]));
    return reasons;
}

void RegionMap::make_tile(Accessor& accessor, const Coord& origin, std::int32_t value) {
    accessor.addTile(1, origin, value, value != 0);
    accessor.clear();  // it may still point to the deleted leaf
    if (value != 0) return;
    const Coord block = origin & ~std::int32_t{127};
    if (emptied_.empty() || emptied_.back() != block) emptied_.push_back(block);
}

// None of the voxels has the entity, or all have it.
void RegionMap::apply(std::int32_t entity, const Voxels& voxels) {
    if (next_.size() < static_cast<std::size_t>(sets_.end())) {
        next_.resize(static_cast<std::size_t>(2 * sets_.end()), kUnknown);
    }
    const Family family = used_family();
    Toggle step{sets_, next_, entity};
    Accessor accessor(grid_.tree());
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const Coord& origin = voxels.origins[i];
        const Words& words = voxels.words[i];
        Leaf* leaf = accessor.probeLeaf(origin);
        if (leaf == nullptr) {
            if (is_full(words)) {
                const std::int32_t from = accessor.getValue(origin);
                const std::int32_t to = step.next(from);
                step.moved(0, from, to, 0, 512);
                make_tile(accessor, origin, to);
                continue;
            }
            leaf = accessor.touchLeaf(origin);
        }
        std::int32_t* values = leaf->buffer().data();
        step.cleared = {};
        retag(family, values, words, step);
        for (std::size_t x = 0; x < 8; ++x) {
            std::uint64_t& active = active_word(*leaf, x);
            active = (active | words[x]) & ~step.cleared[x];
        }
        if (is_uniform(values)) {
            const std::int32_t value = values[0];
            make_tile(accessor, origin, value);
        }
    }
    step.finish();
}

void RegionMap::prune() {
    Tree& tree = grid_.tree();
    for (const Coord& block : emptied_) {
        const auto* lower = tree.probeNode<Lower>(block);
        if (lower != nullptr && lower->isInactive()) tree.addTile(2, block, 0, false);
        const auto* upper = tree.probeNode<Upper>(block);
        if (upper != nullptr && upper->isInactive()) tree.addTile(3, block, 0, false);
    }
    if (!emptied_.empty()) tree.root().eraseBackgroundTiles();
    emptied_.clear();
}

void RegionMap::look_up(const double* points, std::size_t count, std::int32_t* numbers) const {
    const std::shared_lock lock(mutex_);
    grid_.look_up(points, count, numbers);
}

std::vector<std::vector<std::int32_t>> RegionMap::members(
    const std::vector<std::int32_t>& numbers) const {
    const std::shared_lock lock(mutex_);
    std::vector<std::vector<std::int32_t>> all(numbers.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (numbers[i] > 0 && numbers[i] < sets_.end()) all[i] = sets_.members(numbers[i]);
    }
    return all;
}

Voxels RegionMap::voxels(std::int32_t entity) const {
    const std::shared_lock lock(mutex_);
    return region(entity);
}

std::int64_t RegionMap::size(std::int32_t entity) const {
    const std::shared_lock lock(mutex_);
    return region(entity).size();
}

bool RegionMap::has(std::int32_t entity) const {
    const std::shared_lock lock(mutex_);
    return region(entity).blocks() > 0;
}

std::int64_t RegionMap::overlap(std::int32_t a, std::int32_t b) const {
    const std::shared_lock lock(mutex_);
    return common(region(a), region(b));
}

std::map<std::int32_t, std::int64_t> RegionMap::counts_over(const Voxels& voxels) const {
    std::vector<std::int64_t> by_set(static_cast<std::size_t>(sets_.end()));
    Reader reader(grid_.tree());
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const Leaf* leaf = reader.probeConstLeaf(voxels.origins[i]);
        if (leaf == nullptr) {
            const std::int32_t set = reader.getValue(voxels.origins[i]);
            by_set[static_cast<std::size_t>(set)] += count(voxels.words[i]);
            continue;
        }
        const std::int32_t* values = leaf->buffer().data();
        each_voxel(voxels.words[i],
                   [&](std::size_t voxel) { ++by_set[static_cast<std::size_t>(values[voxel])]; });
    }
    std::map<std::int32_t, std::int64_t> by_entity;
    for (std::int32_t set = 1; set < sets_.end(); ++set) {
        const std::int64_t here = by_set[static_cast<std::size_t>(set)];
        if (here == 0) continue;
        for (const std::int32_t entity : sets_.members(set)) by_entity[entity] += here;
    }
    return by_entity;
}

Memory RegionMap::memory() const {
    const std::shared_lock lock(mutex_);
    std::size_t index = 0;
    for (const Voxels& region : regions_) index += sizeof region + region.bytes();
    const auto& tree = grid_.tree();
    return {tree.memUsage(),
            index,
            sets_.bytes() + next_.capacity() * sizeof(std::int32_t),
            grid_.size(),
            tree.leafCount(),
            tree.activeTileCount(),
            static_cast<std::size_t>(sets_.size())};
}

std::pair<Grid<std::int32_t>, RegionMap::Sets> RegionMap::state() const {
    const std::shared_lock lock(mutex_);
    Grid<std::int32_t> grid(voxel_size(), 0);
    grid.tree().root() = grid_.tree().root();
    Sets sets;
    for (std::int32_t set = 1; set < sets_.end(); ++set) {
        if (!sets_.members(set).empty()) sets.emplace_back(set, sets_.members(set));
    }
    return {std::move(grid), std::move(sets)};
}

void RegionMap::restore(const Grid<std::int32_t>& grid, const Sets& sets) {
    const auto refuse = [] {
        throw std::invalid_argument("this grid and these sets are not the state of a region map");
    };
    const std::unique_lock lock(mutex_);
    if (!grid_.tree().empty() || sets_.size() > 0) {
        throw std::invalid_argument("a region map that has entities cannot be restored");
    }
    if (grid.voxel_size() != voxel_size() || grid.background() != 0) refuse();
    if (grid.size() > static_cast<std::size_t>(kMostBlocks) * 512) refuse();
    for (const auto& [set, members] : sets) {
        if (!sets_.restore(set, members)) refuse();
    }
    sets_.finish_restoring();
    Tree& tree = grid_.tree();
    tree.root() = grid.tree().root();
    // Tiles are blocks here: the first one put into a larger tile splits it.
    std::vector<CoordBBox> large;
    auto tile = tree.cbeginValueOn();
    tile.setMaxDepth(Tree::ValueOnCIter::LEAF_DEPTH - 2);
    for (; tile; ++tile) large.push_back(tile.getBoundingBox());
    std::vector<Coord> origins;
    for (const CoordBBox& box : large) {
        each_cube(box, Lower::DIM,
                  [&](const Coord& at) { tree.addTile(1, at, tree.getValue(at), true); });
    }
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) origins.push_back(leaf->origin());
    for (tile = tree.cbeginValueOn(); tile; ++tile) {
        if (tile.isTileValue()) origins.push_back(tile.getBoundingBox().min());
    }
    std::sort(origins.begin(), origins.end());
    std::int32_t last = -1;
    for (const auto& [set, members] : sets) last = std::max(last, members.back());
    if (last >= 0) region_to_change(last);
    const auto give = [&](const Coord& origin, std::int32_t set, const Words& words) {
        if (set <= 0 || set >= sets_.end() || sets_.members(set).empty()) refuse();
        sets_.count(set) += count(words);
        for (const std::int32_t entity : sets_.members(set)) {
            Voxels& has = regions_[static_cast<std::size_t>(entity)];
            if (has.blocks() == 0 || !(has.origins.back() == origin)) has.append(origin, {});
            for (std::size_t x = 0; x < 8; ++x) has.words.back()[x] |= words[x];
        }
    };
    Accessor accessor(tree);
    for (const Coord& origin : origins) {
        Leaf* leaf = accessor.probeLeaf(origin);
        if (leaf == nullptr) {
            Words whole;
            whole.fill(kAll);
            give(origin, accessor.getValue(origin), whole);
            continue;
        }
        const std::int32_t* values = leaf->buffer().data();
        if (is_uniform(values)) refuse();
        Words rest{};
        for (std::size_t x = 0; x < 8; ++x) rest[x] = active_word(*leaf, x);
        for (openvdb::Index i = 0; i < 512; ++i) {
            if (!leaf->isValueOn(i) && values[i] != 0) refuse();
        }
        while (!is_empty(rest)) {
            Words words{};
            std::int32_t set = 0;
            for (std::size_t x = 0; x < 8; ++x) {
                for (std::uint64_t w = rest[x]; w != 0; w &= w - 1) {
                    const auto i = 64 * x + static_cast<std::size_t>(__builtin_ctzll(w));
                    if (set == 0) set = values[i];
                    if (values[i] == set) words[x] |= w & ~(w - 1);
                }
                rest[x] &= ~words[x];
            }
            if (is_empty(words)) refuse();  // an active 0
            give(origin, set, words);
        }
    }
    for (const auto& [set, members] : sets) {
        if (sets_.count(set) == 0) refuse();
    }
}

void RegionMap::write(const std::string& path) const {
    const std::shared_lock lock(mutex_);
    grid_.write(path, "regions");
}

}  // namespace semmap::fields
