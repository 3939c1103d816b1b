// One grid that states for each voxel the set of entities that have it (VDB-based Spatially
// Grounded Semantics for Interactive Robots, section III).
#pragma once

#include <array>
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

// The bytes of the grid, the index and the sets; the number of active voxels, leaves, tiles and
// sets.
using Memory = std::array<std::size_t, 7>;

// Another entity, the number of shared voxels, and the squared gap in voxels between the two
// nearest voxels as cubes; 0 where these touch, even if only at a corner.
using Neighbour = std::array<std::int64_t, 3>;

// The number of voxels in the lowest layer of an entity, and how many of them rest on another one:
// as it is, and if either is shifted up or down by a voxel. All are 0 where it begins too low.
using Support = std::array<std::int64_t, 3>;

// Entities are numbers from 0 to kMostEntities; use small ones. Safe for several threads: many read
// at the same time, or one writes.
class RegionMap {
  public:
    explicit RegionMap(double voxel_size);

    double voxel_size() const { return grid_.voxel_size(); }

    void insert(std::int32_t entity, const Shape& shape);
    void remove(std::int32_t entity);
    void move(std::int32_t entity, const Shape& shape);
    // Inserts many regions, which several threads rasterise. Returns for each region why it cannot
    // be inserted, or "". If one cannot, the others are inserted only if `others` is true.
    std::vector<std::string> insert_many(const std::vector<std::int32_t>& entities,
                                         const std::vector<const Shape*>& shapes, unsigned threads,
                                         bool others);

    void look_up(const double* points, std::size_t count, std::int32_t* numbers) const;
    // Returns the members of each set; none for a number without a set.
    std::vector<std::vector<std::int32_t>> members(const std::vector<std::int32_t>& numbers) const;
    Voxels voxels(std::int32_t entity) const;
    std::int64_t size(std::int32_t entity) const;
    bool has(std::int32_t entity) const;
    std::int64_t overlap(std::int32_t a, std::int32_t b) const;
    // Returns the entities within a squared gap, ascending; below 0, those that share a voxel.
    // Reads only the blocks around the entity.
    std::vector<Neighbour> neighbours(std::int32_t entity, std::int64_t farthest) const;
    Support support(std::int32_t a, std::int32_t b) const;
    Memory memory() const;
    void write(const std::string& path) const;

    // Returns the number of the set of each voxel, and the members of each set.
    using Sets = std::vector<std::pair<std::int32_t, std::vector<std::int32_t>>>;
    std::pair<Grid<std::int32_t>, Sets> state() const;
    // Sets the state of an empty map. Throws std::invalid_argument if grid and sets are not of one
    // map; do not use the map then.
    void restore(const Grid<std::int32_t>& grid, const Sets& sets);

  private:
    using Tree = openvdb::Int32Tree;
    using Accessor = openvdb::tree::ValueAccessor<Tree>;

    const Voxels& region(std::int32_t entity) const;
    std::map<std::int32_t, std::int64_t> counts_over(const Voxels& voxels) const;
    Voxels& region_to_change(std::int32_t entity);
    void add(std::int32_t entity, Voxels voxels);
    void change(std::int32_t entity, Voxels voxels);
    void apply(std::int32_t entity, const Voxels& voxels);
    void make_tile(Accessor& accessor, const Coord& origin, std::int32_t value);
    void prune();

    Grid<std::int32_t> grid_;
    Register sets_;
    std::vector<Voxels> regions_;     // by entity
    std::vector<std::int32_t> next_;  // by set, during one edit; -1: not known yet
    std::vector<Coord> emptied_;      // blocks of 128^3 that lost voxels
    mutable std::shared_mutex mutex_;
};

}  // namespace semmap::fields
