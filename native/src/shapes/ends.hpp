// Where a shape ends on which no points are: at the table, or where the points beside end.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "faces.hpp"

namespace semmap::shapes {

constexpr std::size_t kAcrossNone = 3;

// A flat face: which bound it has, and the axis and the side that it is across.
struct FlatFace {
    std::size_t face;
    std::size_t bound;
    std::size_t axis;
    double side;
};

std::vector<FlatFace> flat_faces(ShapeKind kind);

// A bound that no points are on, and what is known about it.
struct End {
    std::size_t bound;
    std::size_t axis;  // along which the bound moves, or kAcrossNone
    double deviation;
};

// Moves the ends of a shape that are not seen and returns them.
std::vector<End> place_ends(PlacedShape& shape, const Seen& seen, const PointsView& cloud,
                            double spacing, double noise, const std::optional<TablePlane>& table);

}  // namespace semmap::shapes
