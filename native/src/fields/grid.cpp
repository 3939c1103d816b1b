#include "semmap/fields/grid.hpp"

#include <algorithm>
#include <cmath>

#include "convex.hpp"
#include "spread.hpp"

namespace semmap::fields {
namespace {

constexpr const char* kVoxelSize = "semmap_voxel_size";
constexpr const char* kPlacement = "semmap_placement";

openvdb::Mat4d matrix(const Placement& p) {
    // OpenVDB multiplies rows.
    openvdb::Mat4d m = openvdb::Mat4d::identity();
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 4; ++j) {
            m(j, i) = p[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
        }
    }
    return m;
}

}  // namespace

template <typename Value>
Grid<Value>::Grid(double voxel_size, Value background) : voxel_size_(voxel_size) {
    openvdb::initialize();
    grid_ = VdbGrid::create(background);
    place(kUnmoved);
}

template <typename Value>
void Grid<Value>::place(const Placement& placement) {
    placement_ = placement;
    // A voxel's index names its lowest corner; OpenVDB's transform its centre.
    openvdb::Mat4d m = openvdb::Mat4d::identity();
    m.preScale(openvdb::Vec3d(voxel_size_));
    m.setTranslation(openvdb::Vec3d(voxel_size_ / 2));
    grid_->setTransform(openvdb::math::Transform::createLinearTransform(m * matrix(placement)));
    grid_->removeMeta(kVoxelSize);
    grid_->removeMeta(kPlacement);
    grid_->insertMeta(kVoxelSize, openvdb::DoubleMetadata(voxel_size_));
    grid_->insertMeta(kPlacement, openvdb::Mat4DMetadata(matrix(placement)));
}

template <typename Value>
Grid<Value> Grid<Value>::placed(const Placement& placement) const {
    Grid other = *this;
    other.grid_ = grid_->copy();
    other.place(placement);
    return other;
}

template <typename Value>
void Grid<Value>::fill(const Shape& shape, Value value) {
    const Voxels voxels = rasterise(shape, voxel_size_);
    Spread(grid_->constTree()).add(voxels);
    auto accessor = grid_->getAccessor();
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const openvdb::Coord origin = coord(voxels.origins[i]);
        if (is_full(voxels.words[i])) {
            accessor.addTile(1, origin, value, true);
            accessor.clear();  // it may still point to the deleted leaf
            continue;
        }
        auto* leaf = accessor.touchLeaf(origin);
        each_voxel(voxels.words[i], [&](std::size_t voxel) {
            leaf->setValueOn(static_cast<openvdb::Index>(voxel), value);
        });
    }
}

template <typename Value>
void Grid<Value>::clear(const Shape& shape) {
    const Voxels voxels = rasterise(shape, voxel_size_);
    auto accessor = grid_->getAccessor();
    const Value background = grid_->background();
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const openvdb::Coord origin = coord(voxels.origins[i]);
        const bool whole = is_full(voxels.words[i]);
        if (whole || (accessor.probeLeaf(origin) == nullptr && !accessor.isValueOn(origin))) {
            if (whole) {
                accessor.addTile(1, origin, background, false);
                accessor.clear();
            }
            continue;
        }
        auto* leaf = accessor.touchLeaf(origin);
        each_voxel(voxels.words[i], [&](std::size_t voxel) {
            leaf->setValueOff(static_cast<openvdb::Index>(voxel), background);
        });
    }
    prune();
}

template <typename Value>
void Grid<Value>::set(const std::int32_t* voxels, const Value* values, std::size_t count) {
    Spread spread(grid_->constTree());
    for (std::size_t i = 0; i < 3 * count; ++i) {
        if (voxels[i] <= -kFarthestVoxel || voxels[i] >= kFarthestVoxel) {
            throw BadRegion("a voxel lies beyond 2^30 voxels from the origin: take a nearer frame");
        }
    }
    for (std::size_t i = 0; i < count; ++i) {
        spread.add({voxels[3 * i], voxels[3 * i + 1], voxels[3 * i + 2]});
    }
    auto accessor = grid_->getAccessor();
    for (std::size_t i = 0; i < count; ++i) {
        accessor.setValueOn({voxels[3 * i], voxels[3 * i + 1], voxels[3 * i + 2]}, values[i]);
    }
}

template <typename Value>
void Grid<Value>::look_up(const double* points, std::size_t count, Value* values) const {
    auto accessor = grid_->getConstAccessor();
    constexpr std::size_t few = 128;
    std::int32_t at[3 * few];
    double local[3 * few];
    const bool moved = placement_ != kUnmoved;
    for (std::size_t first = 0; first < count; first += few) {
        const std::size_t here = std::min(few, count - first);
        const double* from = points + 3 * first;
        if (moved) {
            for (std::size_t i = 0; i < here; ++i) {
                double d[3];
                for (std::size_t k = 0; k < 3; ++k) d[k] = from[3 * i + k] - placement_[k][3];
                for (std::size_t k = 0; k < 3; ++k) {
                    local[3 * i + k] =
                        placement_[0][k] * d[0] + placement_[1][k] * d[1] + placement_[2][k] * d[2];
                }
            }
            from = local;
        }
        voxel_indices(from, 3 * here, voxel_size_, at);
        for (std::size_t i = 0; i < here; ++i) {
            values[first + i] = accessor.getValue({at[3 * i], at[3 * i + 1], at[3 * i + 2]});
        }
    }
}

template <typename Value>
void Grid<Value>::read(std::int32_t* voxels, Value* values) const {
    for (auto it = grid_->cbeginValueOn(); it; ++it) {
        const openvdb::CoordBBox box = it.getBoundingBox();
        const Value value = *it;
        for (auto voxel = box.begin(); voxel; ++voxel) {
            for (int k = 0; k < 3; ++k) *voxels++ = (*voxel)[k];
            *values++ = value;
        }
    }
}

template <typename Value>
void Grid<Value>::read_box(const std::array<std::int32_t, 3>& low,
                           const std::array<std::int32_t, 3>& shape, Value* values) const {
    auto accessor = grid_->getConstAccessor();
    for (std::int32_t x = 0; x < shape[0]; ++x) {
        for (std::int32_t y = 0; y < shape[1]; ++y) {
            for (std::int32_t z = 0; z < shape[2]; ++z) {
                *values++ = accessor.getValue({low[0] + x, low[1] + y, low[2] + z});
            }
        }
    }
}

template <typename Value>
void Grid<Value>::prune() {
    grid_->pruneGrid();
}

template <typename Value>
void Grid<Value>::write(const std::string& path, const std::string& name) const {
    const auto named = grid_->copyGrid();
    named->setName(name);
    openvdb::io::File file(path);
    file.write({named});
}

template class Grid<bool>;
template class Grid<std::int32_t>;
template class Grid<float>;

}  // namespace semmap::fields
