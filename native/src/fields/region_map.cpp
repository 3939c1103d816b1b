#include "semmap/fields/region_map.hpp"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>

#include "convex.hpp"
#include "retag.hpp"
#include "spread.hpp"

namespace semmap::fields {
namespace {

using Tree = openvdb::Int32Tree;
using Leaf = Tree::LeafNodeType;
using Lower = Tree::RootNodeType::ChildNodeType::ChildNodeType;
using Upper = Tree::RootNodeType::ChildNodeType;
using Reader = openvdb::tree::ValueAccessor<const Tree>;

constexpr std::int32_t kUnknown = -1;
constexpr std::size_t kChunk = 64;  // leaves that one task takes; a part of what the numbers are
constexpr std::uint64_t kAll = ~std::uint64_t{0};

static_assert(Leaf::DIM == kBlock, "blocks are leaves");

std::uint64_t& active_word(Leaf& leaf, std::size_t x) {
    return leaf.getValueMask().getWord<std::uint64_t>(static_cast<openvdb::Index>(x));
}

bool is_uniform(const std::int32_t* values) {
    if (values[0] != values[511] || values[0] != values[255]) return false;
    return std::memcmp(values, values + 1, 511 * sizeof *values) == 0;
}

// One entity inserted or removed; numbers of sets are assigned at once.
struct Direct {
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

// Many entities over a few leaves: steps are numbered here, from `base` on, and become sets later.
struct Chunk {
    struct Step {
        std::int32_t from;
        std::int32_t edit;
        std::int64_t count;
    };

    std::int32_t base = 0;
    std::int32_t edit = 0;
    std::vector<Step> steps{};
    std::vector<std::int32_t> slots = std::vector<std::int32_t>(256, kUnknown);
    std::size_t last = 0;
    std::vector<std::int32_t> sets{};  // of the steps, once known

    std::int32_t next(std::int32_t from) {
        if (last < steps.size() && steps[last].from == from && steps[last].edit == edit) {
            return base + static_cast<std::int32_t>(last);
        }
        if (2 * (steps.size() + 1) >= slots.size()) grow();
        std::size_t i = home(from, edit);
        for (; slots[i] != kUnknown; i = (i + 1) & (slots.size() - 1)) {
            const Step& step = steps[static_cast<std::size_t>(slots[i])];
            if (step.from == from && step.edit == edit) break;
        }
        if (slots[i] == kUnknown) {
            slots[i] = static_cast<std::int32_t>(steps.size());
            steps.push_back({from, edit, 0});
        }
        last = static_cast<std::size_t>(slots[i]);
        return base + slots[i];
    }
    void moved(std::size_t, std::int32_t, std::int32_t, std::uint64_t, int count) {
        steps[last].count += count;
    }
    std::size_t home(std::int32_t from, std::int32_t by) const {
        const std::uint64_t both =
            static_cast<std::uint64_t>(from) << 32 | static_cast<std::uint32_t>(by);
        return static_cast<std::size_t>((both * 0x9E3779B97F4A7C15ULL) >> 32) & (slots.size() - 1);
    }
    void grow() {
        slots.assign(2 * slots.size(), kUnknown);
        for (std::size_t n = 0; n < steps.size(); ++n) {
            std::size_t i = home(steps[n].from, steps[n].edit);
            while (slots[i] != kUnknown) i = (i + 1) & (slots.size() - 1);
            slots[i] = static_cast<std::int32_t>(n);
        }
    }
    std::int32_t set_of(std::int32_t value) const {
        return value < base ? value : sets[static_cast<std::size_t>(value - base)];
    }
};

// A block that edits touch: a leaf, or a tile that they touch as a whole.
struct Touched {
    Leaf* leaf = nullptr;
    std::int32_t tile = 0;
    bool uniform = false;
    std::uint32_t first = 0;
    std::uint32_t last = 0;
};

struct Touch {
    std::int32_t edit;
    const Words* words;
    std::uint32_t next;
};

constexpr std::uint32_t kEnd = 0xFFFFFFFF;

template <typename Body>
void in_parallel(std::size_t count, int threads, const Body& body) {
    if (threads == 1 || count <= 1) {
        for (std::size_t i = 0; i < count; ++i) body(i);
        return;
    }
    // More than there are processors are allowed too.
    const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism,
                                      static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    arena.execute([&] { tbb::parallel_for(std::size_t{0}, count, body); });
}

// What the steps of a chunk are as sets; only those that still have voxels become one.
void resolve(Chunk& chunk, const std::vector<Edit>& edits, Register& sets,
             std::vector<std::int32_t>& emptier) {
    std::vector<std::int64_t> rest(chunk.steps.size());
    for (std::size_t i = 0; i < rest.size(); ++i) {
        const Chunk::Step& step = chunk.steps[i];
        rest[i] += step.count;
        if (step.from >= chunk.base) {
            rest[static_cast<std::size_t>(step.from - chunk.base)] -= step.count;
        } else {
            sets.count(step.from) -= step.count;
            emptier.push_back(step.from);
        }
    }
    chunk.sets.assign(rest.size(), 0);
    std::vector<std::int32_t> members;
    for (std::size_t i = 0; i < rest.size(); ++i) {
        if (rest[i] == 0) continue;
        std::int32_t from = static_cast<std::int32_t>(i) + chunk.base;
        while (from >= chunk.base) {
            from = chunk.steps[static_cast<std::size_t>(from - chunk.base)].from;
        }
        members = sets.members(from);
        for (from = static_cast<std::int32_t>(i) + chunk.base; from >= chunk.base;) {
            const Chunk::Step& step = chunk.steps[static_cast<std::size_t>(from - chunk.base)];
            toggle(members, edits[static_cast<std::size_t>(step.edit)].entity);
            from = step.from;
        }
        chunk.sets[i] = sets.number(members);
        sets.count(chunk.sets[i]) += rest[i];
    }
}

// The steps of a chunk taken to their sets.
struct Renumber {
    const Chunk& chunk;
    Words cleared{};

    std::int32_t next(std::int32_t from) const { return chunk.set_of(from); }
    void moved(std::size_t x, std::int32_t, std::int32_t to, std::uint64_t which, int) {
        if (to == 0) cleared[x] |= which;
    }
};

void rewrite(Touched& touched, const std::vector<Touch>& touches, const Chunk& chunk,
             Family family) {
    if (touched.leaf == nullptr) {
        touched.tile = chunk.set_of(touched.tile);
        return;
    }
    std::int32_t* values = touched.leaf->buffer().data();
    Words all{};
    for (std::uint32_t t = touched.first; t != kEnd; t = touches[t].next) {
        for (std::size_t x = 0; x < 8; ++x) all[x] |= (*touches[t].words)[x];
    }
    Renumber step{chunk};
    retag(family, values, all, step);
    for (std::size_t x = 0; x < 8; ++x) {
        std::uint64_t& active = active_word(*touched.leaf, x);
        active = (active | all[x]) & ~step.cleared[x];
    }
    touched.uniform = is_uniform(values);
    if (touched.uniform) touched.tile = values[0];
}

}  // namespace

RegionMap::RegionMap(double voxel_size) : voxel_size_(voxel_size) {
    openvdb::initialize();
    grid_ = openvdb::Int32Grid::create(0);
    grid_->setName("regions");
    // A voxel's index names its lowest corner; OpenVDB's transform its centre.
    const auto transform = openvdb::math::Transform::createLinearTransform(voxel_size);
    transform->postTranslate(openvdb::Vec3d(voxel_size / 2));
    grid_->setTransform(transform);
}

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
    Voxels voxels = rasterise(shape, voxel_size_);
    const std::unique_lock lock(mutex_);
    Spread(grid_->tree()).add(voxels);
    Voxels& has = region_to_change(entity);
    if (has.blocks() == 0) {
        apply({entity, &voxels});
        has = std::move(voxels);
        return;
    }
    const Voxels fresh = without(voxels, has);
    apply({entity, &fresh});
    has = united(has, fresh);
}

void RegionMap::remove(std::int32_t entity) {
    const std::unique_lock lock(mutex_);
    if (region(entity).blocks() == 0) return;
    const Voxels had = std::move(regions_[static_cast<std::size_t>(entity)]);
    regions_[static_cast<std::size_t>(entity)] = {};
    apply({entity, &had});
    prune();
}

void RegionMap::move(std::int32_t entity, const Shape& shape) {
    Voxels voxels = rasterise(shape, voxel_size_);
    const std::unique_lock lock(mutex_);
    Spread(grid_->tree()).add(voxels);
    Voxels& has = region_to_change(entity);
    const Voxels left = without(has, voxels);
    const Voxels entered = without(voxels, has);
    apply({entity, &entered});
    apply({entity, &left});
    has = std::move(voxels);
    prune();
}

std::vector<std::string> RegionMap::insert_many(const std::vector<std::int32_t>& entities,
                                                const std::vector<const Shape*>& shapes,
                                                int threads, bool others) {
    std::vector<Voxels> voxels(shapes.size());
    std::vector<std::string> reasons(shapes.size());
    in_parallel(shapes.size(), threads, [&](std::size_t i) {
        try {
            voxels[i] = rasterise(*shapes[i], voxel_size_);
        } catch (const BadRegion& bad) {
            reasons[i] = bad.what();
        }
    });
    const std::unique_lock lock(mutex_);
    Spread spread(grid_->tree());
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
    // An entity named twice is one edit.
    std::map<std::int32_t, std::size_t> first;
    std::vector<std::size_t> once;
    for (std::size_t i = 0; i < entities.size(); ++i) {
        const auto [found, is_new] = first.emplace(entities[i], i);
        if (is_new) {
            once.push_back(i);
        } else {
            voxels[found->second] = united(voxels[found->second], voxels[i]);
        }
    }
    for (const std::size_t i : once) region_to_change(entities[i]);
    in_parallel(once.size(), threads, [&](std::size_t n) {
        const std::size_t i = once[n];
        const Voxels& has = region(entities[i]);
        if (has.blocks() > 0) voxels[i] = without(voxels[i], has);
    });
    std::vector<Edit> edits;
    for (const std::size_t i : once) edits.push_back({entities[i], &voxels[i]});
    apply_many(edits, threads);
    for (const std::size_t i : once) {
        Voxels& has = region_to_change(entities[i]);
        has = has.blocks() == 0 ? std::move(voxels[i]) : united(has, voxels[i]);
    }
    return reasons;
}

void RegionMap::make_tile(Accessor& accessor, const Origin& origin, std::int32_t value) {
    accessor.addTile(1, coord(origin), value, value != 0);
    accessor.clear();  // it may still point to the deleted leaf
    if (value != 0) return;
    const openvdb::Coord block = coord(origin) & ~std::int32_t{127};
    if (emptied_.empty() || emptied_.back() != block) emptied_.push_back(block);
}

void RegionMap::apply(const Edit& edit) {
    if (next_.size() < static_cast<std::size_t>(sets_.end())) {
        next_.resize(static_cast<std::size_t>(2 * sets_.end()), kUnknown);
    }
    const Family family = used_family();
    Direct step{sets_, next_, edit.entity};
    Accessor accessor(grid_->tree());
    const Voxels& voxels = *edit.voxels;
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const Origin& origin = voxels.origins[i];
        const Words& words = voxels.words[i];
        Leaf* leaf = accessor.probeLeaf(coord(origin));
        if (leaf == nullptr) {
            if (is_full(words)) {
                const std::int32_t from = accessor.getValue(coord(origin));
                const std::int32_t to = step.next(from);
                step.moved(0, from, to, 0, 512);
                make_tile(accessor, origin, to);
                continue;
            }
            leaf = accessor.touchLeaf(coord(origin));
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

void RegionMap::apply_many(const std::vector<Edit>& edits, int threads) {
    OriginIndex index;
    std::vector<Touched> blocks;
    std::vector<Touch> touches;
    std::vector<bool> all_full;
    for (std::size_t e = 0; e < edits.size(); ++e) {
        const Voxels& voxels = *edits[e].voxels;
        for (std::size_t i = 0; i < voxels.blocks(); ++i) {
            const std::uint32_t n = index.number(voxels.origins[i]);
            const auto t = static_cast<std::uint32_t>(touches.size());
            touches.push_back({static_cast<std::int32_t>(e), &voxels.words[i], kEnd});
            if (n == blocks.size()) {
                blocks.push_back({nullptr, 0, false, t, t});
                all_full.push_back(is_full(voxels.words[i]));
            } else {
                touches[blocks[n].last].next = t;
                blocks[n].last = t;
                all_full[n] = all_full[n] && is_full(voxels.words[i]);
            }
        }
    }
    const std::vector<Origin>& origins = index.origins();
    Accessor accessor(grid_->tree());
    for (std::size_t n = 0; n < blocks.size(); ++n) {
        blocks[n].leaf = accessor.probeLeaf(coord(origins[n]));
        if (blocks[n].leaf != nullptr) continue;
        if (all_full[n]) {
            blocks[n].tile = accessor.getValue(coord(origins[n]));
        } else {
            blocks[n].leaf = accessor.touchLeaf(coord(origins[n]));
        }
    }
    const Family family = used_family();
    std::vector<Chunk> chunks((blocks.size() + kChunk - 1) / kChunk);
    in_parallel(chunks.size(), threads, [&](std::size_t c) {
        Chunk& chunk = chunks[c];
        chunk.base = sets_.end();
        for (std::size_t n = c * kChunk; n < std::min((c + 1) * kChunk, blocks.size()); ++n) {
            Touched& block = blocks[n];
            for (std::uint32_t t = block.first; t != kEnd; t = touches[t].next) {
                chunk.edit = touches[t].edit;
                if (block.leaf == nullptr) {
                    block.tile = chunk.next(block.tile);
                    chunk.moved(0, 0, 0, 0, 512);
                } else {
                    retag(family, block.leaf->buffer().data(), *touches[t].words, chunk);
                }
            }
        }
    });
    std::vector<std::int32_t> emptier;
    for (Chunk& chunk : chunks) resolve(chunk, edits, sets_, emptier);
    for (const std::int32_t set : emptier) sets_.free_if_unused(set);
    in_parallel(chunks.size(), threads, [&](std::size_t c) {
        for (std::size_t n = c * kChunk; n < std::min((c + 1) * kChunk, blocks.size()); ++n) {
            rewrite(blocks[n], touches, chunks[c], family);
        }
    });
    for (std::size_t n = 0; n < blocks.size(); ++n) {
        if (blocks[n].leaf == nullptr || blocks[n].uniform) {
            make_tile(accessor, origins[n], blocks[n].tile);
        }
    }
    prune();
}

void RegionMap::prune() {
    Tree& tree = grid_->tree();
    for (const openvdb::Coord& block : emptied_) {
        const auto* lower = tree.probeNode<Lower>(block);
        if (lower != nullptr && lower->isInactive()) tree.addTile(2, block, 0, false);
        const auto* upper = tree.probeNode<Upper>(block);
        if (upper != nullptr && upper->isInactive()) tree.addTile(3, block, 0, false);
    }
    if (!emptied_.empty()) tree.root().eraseBackgroundTiles();
    emptied_.clear();
}

// Down the tree level by level for many points at once, so that they wait for memory together.
void RegionMap::look_up(const double* points, std::size_t count, std::int32_t* numbers) const {
    const std::shared_lock lock(mutex_);
    constexpr std::size_t few = 128;
    std::int32_t at[3 * few];
    const Lower* lowers[few];
    const Leaf* leaves[few];
    const std::int32_t* values[few];
    const Tree& tree = grid_->tree();
    openvdb::Coord key = openvdb::Coord::max();
    const Upper* upper = nullptr;
    for (std::size_t first = 0; first < count; first += few) {
        const std::size_t here = std::min(few, count - first);
        voxel_indices(points + 3 * first, 3 * here, voxel_size_, at);
        const auto place = [&](std::size_t i) {
            return openvdb::Coord(at[3 * i], at[3 * i + 1], at[3 * i + 2]);
        };
        std::int32_t* out = numbers + first;
        for (std::size_t i = 0; i < here; ++i) {
            const openvdb::Coord p = place(i);
            if ((p & ~static_cast<std::int32_t>(Upper::DIM - 1)) != key) {
                key = p & ~static_cast<std::int32_t>(Upper::DIM - 1);
                upper = tree.probeConstNode<Upper>(p);
            }
            out[i] = 0;
            lowers[i] = nullptr;
            if (upper == nullptr) continue;
            const openvdb::Index n = Upper::coordToOffset(p);
            if (upper->isChildMaskOn(n)) {
                lowers[i] = upper->getTable()[n].getChild();
                __builtin_prefetch(lowers[i]->getTable() + Lower::coordToOffset(p));
            } else {
                out[i] = upper->getTable()[n].getValue();
            }
        }
        for (std::size_t i = 0; i < here; ++i) {
            leaves[i] = nullptr;
            if (lowers[i] == nullptr) continue;
            const openvdb::Index n = Lower::coordToOffset(place(i));
            if (lowers[i]->isChildMaskOn(n)) {
                leaves[i] = lowers[i]->getTable()[n].getChild();
                __builtin_prefetch(leaves[i]);
            } else {
                out[i] = lowers[i]->getTable()[n].getValue();
            }
        }
        for (std::size_t i = 0; i < here; ++i) {
            values[i] = out + i;
            if (leaves[i] == nullptr) continue;
            values[i] = leaves[i]->buffer().data() + Leaf::coordToOffset(place(i));
            __builtin_prefetch(values[i]);
        }
        for (std::size_t i = 0; i < here; ++i) out[i] = *values[i];
    }
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

std::vector<std::pair<std::int32_t, std::int64_t>> RegionMap::entities_in(
    const Shape& shape) const {
    const Voxels voxels = rasterise(shape, voxel_size_);
    const std::shared_lock lock(mutex_);
    const std::map<std::int32_t, std::int64_t> counts = counts_over(voxels);
    return {counts.begin(), counts.end()};
}

std::map<std::int32_t, std::int64_t> RegionMap::counts_over(const Voxels& voxels) const {
    std::vector<std::int64_t> by_set(static_cast<std::size_t>(sets_.end()));
    Reader reader(grid_->tree());
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const Leaf* leaf = reader.probeConstLeaf(coord(voxels.origins[i]));
        if (leaf == nullptr) {
            const std::int32_t set = reader.getValue(coord(voxels.origins[i]));
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
    Memory memory{};
    memory.grid = static_cast<std::size_t>(grid_->tree().memUsage());
    for (const Voxels& region : regions_) memory.index += sizeof region + region.bytes();
    memory.sets = sets_.bytes() + next_.capacity() * sizeof(std::int32_t);
    memory.active_voxels = static_cast<std::int64_t>(grid_->activeVoxelCount());
    memory.leaves = grid_->tree().leafCount();
    memory.tiles = static_cast<std::int64_t>(grid_->tree().activeTileCount());
    memory.set_count = sets_.size();
    return memory;
}

void RegionMap::check() const {
    const std::shared_lock lock(mutex_);
    const auto expect = [](bool holds, const char* text) {
        if (!holds) throw std::logic_error(text);
    };
    std::map<std::int32_t, std::int64_t> counts;
    for (auto leaf = grid_->tree().cbeginLeaf(); leaf; ++leaf) {
        const std::int32_t* values = leaf->buffer().data();
        expect(!is_uniform(values), "a uniform leaf is no tile");
        for (openvdb::Index i = 0; i < 512; ++i) {
            expect(leaf->isValueOn(i) == (values[i] != 0), "a voxel is active without a set");
            if (values[i] != 0) ++counts[values[i]];
        }
    }
    for (auto tile = grid_->cbeginValueOn(); tile; ++tile) {
        if (tile.isTileValue()) counts[*tile] += static_cast<std::int64_t>(tile.getVoxelCount());
    }
    std::map<std::int32_t, std::int64_t> sizes;
    std::set<std::vector<std::int32_t>> distinct;
    for (const auto& [set, count] : counts) {
        expect(set > 0 && set < sets_.end() && !sets_.members(set).empty(),
               "a voxel holds the number of no set");
        expect(distinct.insert(sets_.members(set)).second, "two numbers are of one set");
        expect(sets_.count(set) == count, "a set's count is not that of its voxels");
        for (const std::int32_t entity : sets_.members(set)) sizes[entity] += count;
    }
    expect(static_cast<std::int64_t>(counts.size()) == sets_.size(), "an unused set is not freed");
    for (std::size_t e = 0; e < regions_.size(); ++e) {
        const auto found = sizes.find(static_cast<std::int32_t>(e));
        expect(regions_[e].size() == (found == sizes.end() ? 0 : found->second),
               "an entity's index is not that of its voxels");
    }
    for (auto node = grid_->tree().cbeginNode(); node; ++node) {
        if (node.getDepth() == 1) {
            const Upper* upper = nullptr;
            node.getNode(upper);
            expect(upper == nullptr || !upper->isInactive(), "an empty node is not pruned");
        } else if (node.getDepth() == 2) {
            const Lower* lower = nullptr;
            node.getNode(lower);
            expect(lower == nullptr || !lower->isInactive(), "an empty node is not pruned");
        }
    }
}

std::pair<Grid<std::int32_t>, RegionMap::Sets> RegionMap::state() const {
    const std::shared_lock lock(mutex_);
    Grid<std::int32_t> grid(voxel_size_, 0);
    grid.tree().root() = grid_->tree().root();
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
    if (!grid_->tree().empty() || sets_.size() > 0) {
        throw std::invalid_argument("a region map that has entities cannot be restored");
    }
    if (grid.voxel_size() != voxel_size_ || grid.background() != 0) refuse();
    if (grid.size() > static_cast<std::size_t>(kMostBlocks) * 512) refuse();
    for (const auto& [set, members] : sets) {
        if (!sets_.restore(set, members)) refuse();
    }
    sets_.finish_restoring();
    Tree& tree = grid_->tree();
    tree.root() = grid.tree().root();
    // Tiles are blocks here: the first one put into a larger tile splits it.
    std::vector<openvdb::CoordBBox> large;
    auto tile = tree.cbeginValueOn();
    tile.setMaxDepth(Tree::ValueOnCIter::LEAF_DEPTH - 2);
    for (; tile; ++tile) large.push_back(tile.getBoundingBox());
    std::vector<Origin> origins;
    for (const openvdb::CoordBBox& box : large) {
        each_cube(box, Lower::DIM,
                  [&](const openvdb::Coord& at) { tree.addTile(1, at, tree.getValue(at), true); });
    }
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) {
        const openvdb::Coord at = leaf->origin();
        origins.push_back({at.x(), at.y(), at.z()});
    }
    for (tile = tree.cbeginValueOn(); tile; ++tile) {
        if (!tile.isTileValue()) continue;
        const openvdb::Coord at = tile.getBoundingBox().min();
        origins.push_back({at.x(), at.y(), at.z()});
    }
    std::sort(origins.begin(), origins.end());
    std::int32_t last = -1;
    for (const auto& [set, members] : sets) last = std::max(last, members.back());
    if (last >= 0) region_to_change(last);
    const auto give = [&](const Origin& origin, std::int32_t set, const Words& words) {
        if (set <= 0 || set >= sets_.end() || sets_.members(set).empty()) refuse();
        sets_.count(set) += count(words);
        for (const std::int32_t entity : sets_.members(set)) {
            Voxels& has = regions_[static_cast<std::size_t>(entity)];
            if (has.blocks() == 0 || !(has.origins.back() == origin)) has.append(origin, {});
            for (std::size_t x = 0; x < 8; ++x) has.words.back()[x] |= words[x];
        }
    };
    Accessor accessor(tree);
    for (const Origin& origin : origins) {
        Leaf* leaf = accessor.probeLeaf(coord(origin));
        if (leaf == nullptr) {
            Words whole;
            whole.fill(kAll);
            give(origin, accessor.getValue(coord(origin)), whole);
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
    openvdb::io::File file(path);
    file.write({grid_});
}

}  // namespace semmap::fields
