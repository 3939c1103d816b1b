// What one region, grid or list may take, so that a number too many in a file costs no memory and
// no minutes. The first two are settings of the process.
#pragma once

#include <atomic>
#include <cstdint>
#include <stdexcept>

namespace semmap::fields {

// What cannot be rasterised, or not within these limits; the text says what to do.
struct BadRegion : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

struct RegionLimits {
    std::atomic<std::int64_t> voxels{std::int64_t{1} << 30};  // of one region
    std::atomic<std::int64_t> blocks{std::int64_t{1} << 18};  // of it, those only partly its own
};

RegionLimits& region_limits();

// Voxels that are listed at once.
constexpr std::int64_t kMostListed = std::int64_t{1} << 26;

// Cells of 4096^3 voxels that a grid has something in: each takes 0.3 MB, however little is there.
constexpr std::size_t kMostCells = 2048;

// Blocks that operators look at: of 8^3 voxels.
constexpr std::int64_t kMostBlocks = std::int64_t{1} << 22;

// Entities and sets are numbered below these.
constexpr std::int32_t kMostEntities = 1 << 22;
constexpr std::int32_t kMostSets = 1 << 24;

// No voxel's index is so far from 0.
constexpr std::int32_t kFarthestVoxel = 1 << 30;

}  // namespace semmap::fields
