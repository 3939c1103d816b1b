// Which cells of a grid a mesh occupies within intervals of height (Deeken et al., section 4.2),
// without sampling: a cell is occupied where its half-open square meets the projection of a
// triangle's part within the closed interval.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "semmap/grid.hpp"

namespace semmap {

// Intervals taken in one pass.
constexpr std::size_t kMostIntervals = 32;

// Coordinates beyond it are refused: exact arithmetic would leave the range of doubles.
constexpr double kFarthest = 1e30;

struct Interval {
    double low;
    double high;
};

template <typename Index>
struct MeshView {
    const double* vertices;  // x, y, z each
    std::size_t vertex_count;
    const Index* faces;  // three vertices each
    std::size_t face_count;
    const std::int32_t* solids;  // one a face, 0 or more; null where all are one solid
};

// Which solids have an inside that counts: none, all, or those that are marked.
struct Fill {
    bool any = false;
    const std::uint8_t* of_solid = nullptr;  // one a solid; null means all
    std::size_t solid_count = 1;
};

// Writes for each interval a layer of `cells` (intervals x rows x columns): 1 where occupied, else
// 0. At most kMostIntervals. A filled solid is the inside of its surface at the lower end of each
// interval, too, where that surface is closed. Throws std::invalid_argument for a vertex that is
// not finite or does not exist, and std::bad_alloc.
template <typename Index>
void occupancy(const MeshView<Index>& mesh, const std::vector<Interval>& intervals,
               const GridFrame& grid, const Fill& fill, unsigned threads, std::uint8_t* cells);

// Writes 1 for each solid whose surface is closed: each directed edge is met by as many opposite
// ones, vertices of equal coordinates being one. Decided by a hash that an open surface meets with
// a chance of about 2^-60. Throws as `occupancy`.
template <typename Index>
void closed_solids(const MeshView<Index>& mesh, std::size_t solid_count, unsigned threads,
                   std::uint8_t* closed);

}  // namespace semmap
