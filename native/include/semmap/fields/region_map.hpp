// One grid for all: which set of entities each voxel belongs to (VDB-based Spatially Grounded
// Semantics for Interactive Robots, section III).
#pragma once

#include <openvdb/openvdb.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <shared_mutex>
#include <string>
#include <utility>
#include <vector>

#include "semmap/fields/grid.hpp"
#include "semmap/fields/sets.hpp"
#include "semmap/fields/shapes.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

// Voxels of one entity that all lack it, or all have it, and change that.
struct Edit {
    std::int32_t entity;
    const Voxels* voxels;
};

struct Memory {
    std::size_t grid;
    std::size_t index;
    std::size_t sets;
    std::int64_t active_voxels;
    std::int64_t leaves;
    std::int64_t tiles;
    std::int64_t set_count;
};

// How another entity lies to one: voxels of both, and the squared gap in voxels between the nearest
// two as cubes, 0 where these meet, if only by a corner.
struct Neighbour {
    std::int32_t entity;
    std::int64_t shared;
    std::int64_t gap;
};

// How many voxels the lowest layer of one entity has, and how many of them rest on another: for
// sure, and if either is taken for one voxel higher or lower than it is. All 0 where it begins too
// low.
struct Support {
    std::int64_t layer;
    std::int64_t firm;
    std::int64_t loose;
};

// Entities are numbers from 0 to kMostEntities, best close together. Readers and writers may be of
// any thread: many read at once, or one writes.
class RegionMap {
  public:
    explicit RegionMap(double voxel_size);

    double voxel_size() const { return voxel_size_; }

    void insert(std::int32_t entity, const Shape& shape);
    void remove(std::int32_t entity);
    void move(std::int32_t entity, const Shape& shape);
    // The same voxels as one by one, in one pass on several threads; the numbers do not depend on
    // how many. Gives the reason why a region cannot be inserted, or "", for each; where one
    // cannot, the others are inserted only if that is said.
    std::vector<std::string> insert_many(const std::vector<std::int32_t>& entities,
                                         const std::vector<const Shape*>& shapes, int threads,
                                         bool others);

    void look_up(const double* points, std::size_t count, std::int32_t* numbers) const;
    // The members of each of the given sets; empty for what is none.
    std::vector<std::vector<std::int32_t>> members(const std::vector<std::int32_t>& numbers) const;
    Voxels voxels(std::int32_t entity) const;
    std::int64_t size(std::int32_t entity) const;
    bool has(std::int32_t entity) const;
    // How many voxels of the shape each entity has, ascending by entity.
    std::vector<std::pair<std::int32_t, std::int64_t>> entities_in(const Shape& shape) const;
    std::int64_t overlap(std::int32_t a, std::int32_t b) const;
    // The others no further than a squared gap, ascending; below 0: those that share a voxel. Looks
    // at the blocks around the entity only.
    std::vector<Neighbour> neighbours(std::int32_t entity, std::int64_t farthest) const;
    Support support(std::int32_t a, std::int32_t b) const;
    Memory memory() const;
    // Throws std::logic_error that says what is amiss: numbers, counts and index against the grid.
    void check() const;
    void write(const std::string& path) const;

    // The number of each voxel's set, and the members of each set.
    using Sets = std::vector<std::pair<std::int32_t, std::vector<std::int32_t>>>;
    std::pair<Grid<std::int32_t>, Sets> state() const;
    // Brings an empty map to such a state. Throws std::invalid_argument where grid and sets do not
    // belong together; the map is then useless.
    void restore(const Grid<std::int32_t>& grid, const Sets& sets);

  private:
    using Tree = openvdb::Int32Tree;
    using Accessor = openvdb::tree::ValueAccessor<Tree>;

    const Voxels& region(std::int32_t entity) const;
    std::map<std::int32_t, std::int64_t> counts_over(const Voxels& voxels) const;
    Voxels& region_to_change(std::int32_t entity);
    void apply(const Edit& edit);
    void apply_many(const std::vector<Edit>& edits, int threads);
    void make_tile(Accessor& accessor, const Origin& origin, std::int32_t value);
    void prune();

    double voxel_size_;
    openvdb::Int32Grid::Ptr grid_;
    Register sets_;
    std::vector<Voxels> regions_;          // by entity
    std::vector<std::int32_t> next_;       // by set, during one edit; -1: not known yet
    std::vector<openvdb::Coord> emptied_;  // blocks of 128^3 that lost voxels
    mutable std::shared_mutex mutex_;
};

}  // namespace semmap::fields
