// Limits of a region, grid or list: a wrong number in a file must not cost gigabytes or minutes.
// The first two limits are settings of the process.
#pragma once

#include <atomic>
#include <cstdint>
#include <stdexcept>

namespace semmap::fields {

// A region cannot be rasterised, or exceeds a limit; the message says how to fix it.
struct BadRegion : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

struct RegionLimits {
    std::atomic<std::int64_t> voxels{std::int64_t{1} << 30};  // of one region
    std::atomic<std::int64_t> blocks{std::int64_t{1}
                                     << 18};  // of one region: those that it fills in part
};

RegionLimits& region_limits();

// The most voxels in a list.
constexpr std::int64_t kMostListed = std::int64_t{1} << 26;

// The most cells of 4096^3 voxels in which a grid has voxels; each takes at least 0.3 MB.
constexpr std::size_t kMostCells = 2048;

// The most cells of 128^3 voxels in which one region lies; each takes at least 33 kB.
constexpr std::size_t kMostNodes = 8192;

// The most blocks of 8^3 voxels that an operator reads.
constexpr std::int64_t kMostBlocks = std::int64_t{1} << 22;

// Numbers of entities and sets are below these.
constexpr std::int32_t kMostEntities = 1 << 22;
constexpr std::int32_t kMostSets = 1 << 24;

// The distance of all indices of voxels from 0 is below this.
constexpr std::int32_t kFarthestVoxel = 1 << 30;

}  // namespace semmap::fields
