#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "checks.hpp"
#include "semmap/shapes.hpp"

namespace py = pybind11;

namespace {

using namespace semmap::checks;
using semmap::shapes::PlacedShape;
using semmap::shapes::ShapeKind;
using semmap::shapes::Vector;

using Floats = Array<double>;

constexpr double kFarthest = 1e6;  // metres
constexpr std::pair<const char*, ShapeKind> kKinds[] = {{"sphere", ShapeKind::sphere},
                                                        {"cylinder", ShapeKind::cylinder},
                                                        {"cone", ShapeKind::cone},
                                                        {"cuboid", ShapeKind::cuboid}};

void expect_near(const Floats& array, const char* name) {
    const double* data = array.data();
    for (py::ssize_t i = 0; i < array.size(); ++i) finite(data[i], name, kFarthest);
}

PlacedShape placed(const std::string& kind, const Floats& rotation, const Floats& origin,
                   const Floats& bounds) {
    PlacedShape shape{};
    shape.kind =
        named(kind, kKinds, "kind is \"" + kind + "\": give one of sphere, cylinder, cone, cuboid");
    expect_shape(rotation, "rotation", {3, 3}, "a (3, 3) array");
    expect_shape(origin, "origin", {3}, "a (3,) array");
    expect_shape(bounds, "bounds",
                 {static_cast<py::ssize_t>(semmap::shapes::counts(shape.kind).bounds)},
                 "the bounds of the kind");
    expect_near(origin, "origin");
    expect_near(bounds, "bounds");
    for (py::ssize_t i = 0; i < 3; ++i) {
        shape.origin[i] = origin.at(i);
        for (py::ssize_t k = 0; k < 3; ++k) shape.axes[k][i] = rotation.at(i, k);
    }
    expect_rotation(shape.axes, "rotation is not a rotation: give orthogonal columns of length 1");
    for (py::ssize_t i = 0; i < bounds.size(); ++i) shape.bounds[i] = bounds.at(i);
    return shape;
}

semmap::shapes::PointsView points_of(const Floats& points, const char* name) {
    expect_shape(points, name, {kAny, 3}, "an (N, 3) array");
    expect_near(points, name);
    return {reinterpret_cast<const Vector*>(points.data()),
            static_cast<std::size_t>(points.shape(0))};
}

semmap::shapes::SurfelsView surfels_of(const Floats& points, const Floats& normals,
                                       double spacing) {
    const auto [data, count] = points_of(points, "points");
    expect_shape(normals, "normals", {points.shape(0), 3}, "one normal a point");
    expect_near(normals, "normals");
    expect(count > 0, "points is empty: give at least one point");
    return {data, reinterpret_cast<const Vector*>(normals.data()), count, spacing};
}

using Table = std::optional<std::pair<Vector, double>>;

std::optional<semmap::shapes::TablePlane> plane_of(const Table& table) {
    if (!table) return std::nullopt;
    for (const double number : table->first) finite(number, "table", kFarthest);
    return semmap::shapes::TablePlane{table->first, finite(table->second, "table", kFarthest)};
}

std::optional<py::tuple> fit_shape(const std::string& kind, const Floats& rotation,
                                   const Floats& origin, const Floats& bounds, const Floats& points,
                                   const Floats& normals, const Floats& whole, double spacing,
                                   double noise, const Table& table, std::int64_t turns) {
    const PlacedShape rough = placed(kind, rotation, origin, bounds);
    expect(spacing >= 0, "spacing is " + std::to_string(spacing) + ": give a number from 0");
    const auto cloud = surfels_of(points, normals, finite(spacing, "spacing", kFarthest));
    const auto all = points_of(whole, "whole");
    expect(all.count > 0, "whole is empty: give at least one point");
    positive(noise, "noise");
    within(turns, 1, 16, "turns");
    const auto plane = plane_of(table);
    const auto fit = unlocked([&] {
        return semmap::shapes::fit_shape(rough, cloud, all, noise, plane, static_cast<int>(turns));
    });
    if (!fit) return std::nullopt;
    const PlacedShape& shape = fit->shape;
    Floats axes({3, 3});
    for (py::ssize_t i = 0; i < 3; ++i) {
        for (py::ssize_t k = 0; k < 3; ++k) axes.mutable_at(i, k) = shape.axes[k][i];
    }
    Array<bool> seen(static_cast<py::ssize_t>(semmap::shapes::counts(shape.kind).faces),
                     fit->seen.data());
    return py::make_tuple(axes, Floats(3, shape.origin.data()),
                          Floats(bounds.size(), shape.bounds.data()), seen,
                          Floats(static_cast<py::ssize_t>(semmap::shapes::counts(shape.kind).sizes),
                                 fit->deviations.data()));
}

Floats shape_distances(const std::string& kind, const Floats& rotation, const Floats& origin,
                       const Floats& bounds, const Floats& points) {
    const PlacedShape shape = placed(kind, rotation, origin, bounds);
    const auto view = points_of(points, "points");
    Floats distances(points.shape(0));
    double* data = distances.mutable_data();
    const py::gil_scoped_release release;
    semmap::shapes::shape_distances(shape, view, data);
    return distances;
}

double shape_cost(const std::string& kind, const Floats& rotation, const Floats& origin,
                  const Floats& bounds, const Floats& points, const Floats& normals,
                  double tolerance) {
    const PlacedShape shape = placed(kind, rotation, origin, bounds);
    const auto cloud = surfels_of(points, normals, 0);
    positive(tolerance, "tolerance");
    const py::gil_scoped_release release;
    return semmap::shapes::shape_cost(shape, cloud, tolerance);
}

std::pair<Floats, Floats> local_planes(const Floats& points, const Array<std::int64_t>& near) {
    const auto view = points_of(points, "points");
    expect_shape(near, "near", {kAny, kAny}, "an (M, K) array of numbers of points");
    expect(near.shape(1) > 0, "near has no columns: give at least one neighbour");
    expect_indices(near, "near", points.shape(0));
    Floats normals({near.shape(0), py::ssize_t{3}}), variances(near.shape(0));
    auto* normal = reinterpret_cast<Vector*>(normals.mutable_data());
    double* variance = variances.mutable_data();
    {
        const py::gil_scoped_release release;
        semmap::shapes::local_planes(view, near.data(), static_cast<std::size_t>(near.shape(0)),
                                     static_cast<std::size_t>(near.shape(1)), normal, variance);
    }
    return {normals, variances};
}

}  // namespace

void define_shapes(py::module_& module) {
    using py::arg;
    module.def("fit_shape", &fit_shape, arg("kind"), arg("rotation"), arg("origin"), arg("bounds"),
               arg("points"), arg("normals"), arg("whole"), arg("spacing"), arg("noise"),
               arg("table").none(true), arg("turns"));
    module.def("shape_distances", &shape_distances, arg("kind"), arg("rotation"), arg("origin"),
               arg("bounds"), arg("points"));
    module.def("shape_cost", &shape_cost, arg("kind"), arg("rotation"), arg("origin"),
               arg("bounds"), arg("points"), arg("normals"), arg("tolerance"));
    module.def("local_planes", &local_planes, arg("points"), exact("near"));
}
