#include "semmap/fields/grid.hpp"

#include <algorithm>

#include "convex.hpp"
#include "spread.hpp"

namespace semmap::fields {
namespace {

constexpr const char* kVoxelSize = "semmap_voxel_size";
constexpr const char* kPlacement = "semmap_placement";

openvdb::Mat4d matrix(const Placement& p) {
    openvdb::Mat4d m = openvdb::Mat4d::identity();
    m.setMat3(turn_of(p).transpose());  // OpenVDB multiplies rows
    m.setTranslation(shift_of(p));
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
void Grid<Value>::paint(const Voxels& voxels, Value value, bool active) {
    auto accessor = grid_->getAccessor();
    for (std::size_t i = 0; i < voxels.blocks(); ++i) {
        const Coord& origin = voxels.origins[i];
        if (is_full(voxels.words[i])) {
            accessor.addTile(1, origin, value, active);
            accessor.clear();  // it may still point to the deleted leaf
            continue;
        }
        const bool is_empty = accessor.probeLeaf(origin) == nullptr && !accessor.isValueOn(origin);
        if (is_empty && !active) continue;
        auto* leaf = accessor.touchLeaf(origin);
        each_voxel(voxels.words[i], [&](std::size_t voxel) {
            leaf->setValueOnly(static_cast<openvdb::Index>(voxel), value);
            leaf->setActiveState(static_cast<openvdb::Index>(voxel), active);
        });
    }
}

template <typename Value>
void Grid<Value>::fill(const Shape& shape, Value value) {
    const Voxels voxels = rasterise(shape, voxel_size_);
    Spread(grid_->constTree()).add(voxels);
    paint(voxels, value, true);
}

template <typename Value>
void Grid<Value>::clear(const Shape& shape) {
    paint(rasterise(shape, voxel_size_), background(), false);
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
    for (std::size_t i = 0; i < count; ++i) spread.add(Coord(voxels + 3 * i));
    auto accessor = grid_->getAccessor();
    for (std::size_t i = 0; i < count; ++i) {
        accessor.setValueOn(Coord(voxels + 3 * i), values[i]);
    }
}

// Down the tree level by level for many points at once, so that they wait for memory together.
template <typename Value>
void Grid<Value>::look_up(const double* points, std::size_t count, Value* values) const {
    using Upper = typename Tree::RootNodeType::ChildNodeType;
    using Lower = typename Upper::ChildNodeType;
    using Leaf = typename Lower::ChildNodeType;
    constexpr std::size_t few = 128;
    std::int32_t at[3 * few];
    Vector local[few];
    const Lower* lowers[few];
    const Leaf* leaves[few];
    const Value* found[few];
    const auto upright = turn_of(placement_).transpose();
    const bool moved = placement_ != kUnmoved;
    Coord cell = Coord::max();
    const Upper* upper = nullptr;
    Value outside{};  // of a cell without a node
    // The node beneath; none where a tile has the value.
    const auto child = [](const auto& node, const Coord& voxel, Value& value) {
        const auto n = node.coordToOffset(voxel);
        const auto* found = node.isChildMaskOn(n) ? node.getTable()[n].getChild() : nullptr;
        if (found == nullptr) value = node.getTable()[n].getValue();
        return found;
    };
    for (std::size_t first = 0; first < count; first += few) {
        const std::size_t here = std::min(few, count - first);
        const double* from = points + 3 * first;
        if (moved) {
            for (std::size_t i = 0; i < here; ++i) {
                local[i] = upright * (Vector(from + 3 * i) - shift_of(placement_));
            }
            from = local[0].asPointer();
        }
        voxel_indices(from, 3 * here, voxel_size_, at);
        Value* out = values + first;
        for (std::size_t i = 0; i < here; ++i) {
            const Coord voxel(at + 3 * i);
            if ((voxel & ~static_cast<std::int32_t>(Upper::DIM - 1)) != cell) {
                cell = voxel & ~static_cast<std::int32_t>(Upper::DIM - 1);
                upper = tree().template probeConstNode<Upper>(voxel);
                outside = upper == nullptr ? tree().getValue(voxel) : Value{};
            }
            out[i] = outside;
            lowers[i] = upper == nullptr ? nullptr : child(*upper, voxel, out[i]);
            if (lowers[i] == nullptr) continue;
            __builtin_prefetch(lowers[i]->getTable() + Lower::coordToOffset(voxel));
        }
        for (std::size_t i = 0; i < here; ++i) {
            leaves[i] =
                lowers[i] == nullptr ? nullptr : child(*lowers[i], Coord(at + 3 * i), out[i]);
            __builtin_prefetch(leaves[i]);
        }
        for (std::size_t i = 0; i < here; ++i) {
            found[i] = out + i;
            if (leaves[i] == nullptr) continue;
            const openvdb::Index n = Leaf::coordToOffset(Coord(at + 3 * i));
            if constexpr (std::is_same_v<Value, bool>) {
                out[i] = leaves[i]->getValue(n);
            } else {
                found[i] = leaves[i]->buffer().data() + n;
                __builtin_prefetch(found[i]);
            }
        }
        for (std::size_t i = 0; i < here; ++i) out[i] = *found[i];
    }
}

template <typename Value>
void Grid<Value>::read(std::int32_t* voxels, Value* values) const {
    for (auto it = grid_->cbeginValueOn(); it; ++it) {
        const CoordBBox box = it.getBoundingBox();
        const Value value = *it;
        for (auto voxel = box.begin(); voxel; ++voxel) {
            voxels = std::copy_n((*voxel).data(), 3, voxels);
            *values++ = value;
        }
    }
}

template <typename Value>
void Grid<Value>::read_box(const Coord& low, const Coord& shape, Value* values) const {
    auto accessor = grid_->getConstAccessor();
    each_cube({low, low + shape - Coord(1)}, 1,
              [&](const Coord& voxel) { *values++ = accessor.getValue(voxel); });
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
