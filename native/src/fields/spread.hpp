// Limits how far apart the voxels of a tree are: each cell of 4096^3 voxels takes memory.
#pragma once

#include <openvdb/openvdb.h>

#include <set>
#include <string>

#include "semmap/fields/limits.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

class Spread {
  public:
    template <typename Tree>
    explicit Spread(const Tree& tree) {
        for (auto cell = tree.root().cbeginChildOn(); cell; ++cell) add(cell.getCoord());
        for (auto cell = tree.root().cbeginValueOn(); cell; ++cell) add(cell.getCoord());
    }

    // Throws BadRegion, and changes nothing, if there would be too many cells, or if the nodes of
    // the tree would take too much for these voxels alone: a thin line has few in each.
    void add(const Voxels& voxels) {
        std::set<Coord> fresh;
        std::set<Coord> nodes;
        Coord last = Coord::max();
        for (const Coord& origin : voxels.origins) {
            const Coord node = node_of(origin);
            if (node == last) continue;
            last = node;
            nodes.insert(node);
            const Coord cell = cell_of(node);
            if (cells_.count(cell) == 0) fresh.insert(cell);
            if (cells_.size() + fresh.size() > kMostCells || nodes.size() > kMostNodes) refuse();
        }
        cells_.insert(fresh.begin(), fresh.end());
    }

    void add(const Coord& voxel) {
        if (cell_of(voxel) == last_) return;
        last_ = cell_of(voxel);
        cells_.insert(last_);
        if (cells_.size() > kMostCells) refuse();
    }

  private:
    static Coord cell_of(const Coord& voxel) { return voxel & ~4095; }
    static Coord node_of(const Coord& voxel) { return voxel & ~127; }
    [[noreturn]] static void refuse() {
        throw BadRegion("the voxels lie too far apart, in more than " + std::to_string(kMostCells) +
                        " cells of 4096 x 4096 x 4096 voxels or " + std::to_string(kMostNodes) +
                        " of 128 x 128 x 128: take larger voxels, or fewer regions");
    }

    std::set<Coord> cells_;
    Coord last_ = Coord::max();
};

}  // namespace semmap::fields
