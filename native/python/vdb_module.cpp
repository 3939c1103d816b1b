// The Python module semmap_vdb. Arguments are checked here, so that no call can crash;
// semmap.fields checks them before, with errors that name its own parameters.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "checks.hpp"
#include "convex.hpp"
#include "semmap/fields/blocks.hpp"
#include "semmap/fields/grid.hpp"
#include "semmap/fields/operators.hpp"
#include "semmap/fields/region_map.hpp"
#include "semmap/fields/shapes.hpp"

namespace py = pybind11;
namespace fields = semmap::fields;

// pybind11 would convert a std::variant; a shape stays one object.
PYBIND11_MAKE_OPAQUE(fields::Shape);

namespace pybind11::detail {

// From a sequence of three numbers.
template <typename Triple, typename Number>
struct triple_caster {
    PYBIND11_TYPE_CASTER(Triple, const_name("three numbers"));

    bool load(handle from, bool convert) {
        make_caster<std::array<Number, 3>> three;
        if (!three.load(from, convert)) return false;
        value = Triple(cast_op<std::array<Number, 3>&>(three).data());
        return true;
    }
};

template <>
struct type_caster<fields::Vector> : triple_caster<fields::Vector, double> {};
template <>
struct type_caster<fields::Coord> : triple_caster<fields::Coord, std::int32_t> {};

}  // namespace pybind11::detail

namespace {

using namespace semmap::checks;

template <typename T>
void expect_columns(const Array<T>& array, const char* name) {
    expect_shape(array, name, {kAny, 3}, "an (N, 3) array");
}

fields::Vector vector(const fields::Vector& v, const char* name) {
    for (int k = 0; k < 3; ++k) finite(v[k], name);
    return v;
}

fields::Vector direction(const fields::Vector& v, const char* name) {
    vector(v, name);
    const double length = v.length();
    expect(std::abs(length - 1) < 1e-6, std::string(name) + " has the length " +
                                            std::to_string(length) + ": give a unit vector");
    return v;
}

// With smaller voxels, indices would exceed their range within metres.
double voxel(double size) { return positive(size, "voxel_size", 1e-9, 1e9); }

std::vector<fields::Vector> vectors(const Array<double>& rows, const char* name) {
    expect_columns(rows, name);
    expect_finite(rows, name);
    const auto* data = reinterpret_cast<const fields::Vector*>(rows.data());
    return std::vector<fields::Vector>(data, data + rows.shape(0));
}

std::vector<fields::Triangle> triangles(const Array<std::int32_t>& rows, std::size_t vertices) {
    expect_columns(rows, "faces");
    expect_indices(rows, "faces", static_cast<std::int64_t>(vertices));
    const auto* data = reinterpret_cast<const fields::Triangle*>(rows.data());
    return {data, data + rows.shape(0)};
}

void expect_listed(std::int64_t voxels) {
    expect(voxels <= fields::kMostListed, std::to_string(voxels) + " voxels are more than " +
                                              std::to_string(fields::kMostListed) +
                                              ", which can be listed: take larger voxels");
}

// Needs the lock of the interpreter: NumPy makes the array.
Array<std::int32_t> rows_of(const fields::Voxels& voxels) {
    expect_listed(voxels.size());
    Array<std::int32_t> rows({static_cast<py::ssize_t>(voxels.size()), py::ssize_t{3}});
    voxels.write(rows.mutable_data());
    return rows;
}

fields::Shape ball(const fields::Vector& center, double radius) {
    return fields::Ball{vector(center, "center"), positive(radius, "radius")};
}

fields::Shape cylinder(const fields::Vector& center, const fields::Vector& axis, double radius,
                       double height) {
    expect(height >= 0, "height is " + std::to_string(height) + ": give at least 0");
    return {fields::Cylinder{vector(center, "center"), direction(axis, "axis"),
                             positive(radius, "radius"), finite(height, "height")}};
}

fields::Shape cone(const fields::Vector& apex, const fields::Vector& axis, double half_angle,
                   double height) {
    positive(half_angle, "half_angle");
    expect(half_angle < M_PI / 2,
           "half_angle is " + std::to_string(half_angle) + ": give radians below pi / 2");
    return {fields::Cone{vector(apex, "apex"), direction(axis, "axis"), half_angle,
                         positive(height, "height")}};
}

fields::Shape polytope(const Array<double>& corners, const Array<double>& normals,
                       const Array<double>& edges) {
    fields::Polytope made{vectors(corners, "corners"), vectors(normals, "normals"),
                          vectors(edges, "edges")};
    expect(!made.corners.empty(), "corners is empty: give at least one");
    for (const fields::Vector& normal : made.normals) direction(normal, "normals");
    return {std::move(made)};
}

fields::Shape points(const Array<double>& rows) {
    return {fields::Points{vectors(rows, "points")}};
}

fields::Shape solid(const Array<double>& vertices, const Array<std::int32_t>& faces) {
    fields::Solid solid{{vectors(vertices, "vertices"), {}}};
    solid.faces = triangles(faces, solid.vertices.size());
    const std::size_t open = unlocked([&] { return fields::weld(solid.vertices, solid.faces); });
    if (open > 0) {
        throw py::value_error(
            "the mesh is not closed: " + std::to_string(open) +
            " edges have a face on one side only, or faces that turn against each "
            "other; close it, or give it as a Surface");
    }
    return {std::move(solid)};
}

fields::Shape surface(const Array<double>& vertices, const Array<std::int32_t>& faces) {
    fields::Surface surface{{vectors(vertices, "vertices"), {}}};
    surface.faces = triangles(faces, surface.vertices.size());
    return {std::move(surface)};
}

Array<std::int32_t> voxels_of(const fields::Shape& shape, double voxel_size) {
    voxel(voxel_size);
    return rows_of(unlocked([&] { return fields::rasterise(shape, voxel_size); }));
}

// What a map of regions or a grid has at points.
template <typename Value, typename Where>
Array<Value> look_up(const Where& where, const Array<double>& rows) {
    expect_columns(rows, "points");
    Array<Value> values(rows.shape(0));
    Value* out = values.mutable_data();
    const py::gil_scoped_release release;
    where.look_up(rows.data(), length(rows, 0), out);
    return values;
}

Array<std::int32_t> voxels_in(const fields::RegionMap& map, std::int32_t entity) {
    return rows_of(map.voxels(entity));
}

std::vector<std::string> insert_many(fields::RegionMap& map,
                                     const std::vector<std::int32_t>& entities,
                                     const std::vector<const fields::Shape*>& shapes,
                                     std::int64_t thread_count, bool others) {
    expect(entities.size() == shapes.size(), "entities and shapes differ in length");
    const unsigned team = threads(thread_count);
    for (const auto* shape : shapes) expect(shape != nullptr, "shapes holds None");
    for (const std::int32_t entity : entities) {
        within(entity, 0, fields::kMostEntities - 1, "entities");
    }
    const py::gil_scoped_release release;
    return map.insert_many(entities, shapes, team, others);
}

fields::Camera camera_of(const std::array<double, 4>& intrinsics, const fields::Placement& pose) {
    for (const double number : intrinsics) finite(number, "intrinsics");
    positive(intrinsics[0], "fx");
    positive(intrinsics[1], "fy");
    for (const auto& row : pose) {
        for (const double number : row) finite(number, "pose");
    }
    return {intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3], pose};
}

// A rotation and a shift.
fields::Placement rigid(const fields::Placement& placement) {
    for (const auto& row : placement) {
        for (const double number : row) finite(number, "placement", 1e12);
    }
    expect_rotation(placement, "placement: its first three columns are not a rotation");
    return placement;
}

fields::Shape depth_image(const Array<float>& depth, const std::optional<Array<bool>>& mask,
                          const std::array<double, 4>& intrinsics, const fields::Placement& pose,
                          double farthest) {
    expect_shape(depth, "depth", {kAny, kAny}, "an (H, W) array");
    if (mask) {
        expect_shape(*mask, "mask", {depth.shape(0), depth.shape(1)}, "the shape of depth");
    }
    const fields::Camera camera = camera_of(intrinsics, pose);
    const py::gil_scoped_release release;
    return {fields::points_of_depth(depth.data(), mask ? bytes(*mask) : nullptr, length(depth, 0),
                                    length(depth, 1), camera, farthest)};
}

template <typename Value>
void grid_set(fields::Grid<Value>& grid, const Array<std::int32_t>& voxels,
              const Array<Value>& values) {
    expect_columns(voxels, "voxels");
    expect_shape(values, "values", {voxels.shape(0)}, "one value a voxel");
    const py::gil_scoped_release release;
    grid.set(voxels.data(), values.data(), length(voxels, 0));
}

template <typename Value>
std::pair<Array<std::int32_t>, Array<Value>> grid_read(const fields::Grid<Value>& grid) {
    const auto count = static_cast<py::ssize_t>(grid.size());
    expect_listed(count);
    Array<std::int32_t> voxels({count, py::ssize_t{3}});
    Array<Value> values(count);
    std::int32_t* at = voxels.mutable_data();
    Value* data = values.mutable_data();
    {
        const py::gil_scoped_release release;
        grid.read(at, data);
    }
    return {voxels, values};
}

template <typename Value>
Array<Value> grid_read_box(const fields::Grid<Value>& grid, const fields::Coord& low,
                           const fields::Coord& shape) {
    double voxels = 1;
    for (int k = 0; k < 3; ++k) {
        within(shape[k], 0, fields::kFarthestVoxel, "shape");
        within(low[k], -fields::kFarthestVoxel, fields::kFarthestVoxel, "low");
        voxels *= std::max(shape[k], 1);
    }
    expect(voxels <= 4.0 * static_cast<double>(fields::kMostListed),
           "shape holds too many voxels: read parts of the box");
    Array<Value> values({shape[0], shape[1], shape[2]});
    Value* data = values.mutable_data();
    const py::gil_scoped_release release;
    grid.read_box(low, shape, data);
    return values;
}

template <typename Value>
void expect_same_lattice(const fields::Grid<Value>& a, double voxel_size,
                         const fields::Placement& placement) {
    if (a.voxel_size() != voxel_size || a.placement() != placement) {
        throw py::value_error("grids of one lattice and placement combine: resample one of them");
    }
}

constexpr std::pair<const char*, fields::Join> kJoins[] = {
    {"first", fields::Join::first}, {"last", fields::Join::last}, {"max", fields::Join::max},
    {"min", fields::Join::min},     {"sum", fields::Join::sum},
};

fields::Grid<std::int32_t> labelled(const Array<float>& depth, const Array<std::int32_t>& labels,
                                    const std::array<double, 4>& intrinsics,
                                    const fields::Placement& pose, double farthest,
                                    double voxel_size) {
    expect_shape(depth, "depth", {kAny, kAny}, "an (H, W) array");
    expect_shape(labels, "labels", {depth.shape(0), depth.shape(1)}, "the shape of depth");
    voxel(voxel_size);
    const fields::Camera camera = camera_of(intrinsics, pose);
    const py::gil_scoped_release release;
    return fields::labelled(depth.data(), labels.data(), length(depth, 0), length(depth, 1), camera,
                            farthest, voxel_size);
}

using Index = std::array<std::int32_t, 3>;

// Operators.
template <typename Value>
void define_operators(py::class_<fields::Grid<Value>>& grid) {
    using py::arg;
    using Release = py::call_guard<py::gil_scoped_release>;
    using Grid = fields::Grid<Value>;
    grid.def(
            "joined",
            [](const Grid& self, const Grid& other, const std::string& how) {
                expect_same_lattice(self, other.voxel_size(), other.placement());
                const fields::Join join =
                    named(how, kJoins, "grids are joined by first, last, max, min or sum");
                const py::gil_scoped_release release;
                return fields::joined(self, other, join);
            },
            arg("other"), arg("how"))
        .def(
            "masked",
            [](const Grid& self, const fields::Grid<bool>& mask, bool inside) {
                expect_same_lattice(self, mask.voxel_size(), mask.placement());
                const py::gil_scoped_release release;
                return fields::masked(self, mask, inside);
            },
            arg("mask"), arg("inside") = true)
        .def("active", &fields::active<Value>, Release())
        .def("between", &fields::between<Value>, arg("low"), arg("high"), Release())
        .def("cropped", &fields::cropped<Value>, arg("low"), arg("high"), Release())
        .def(
            "bounds",
            [](const Grid& self) -> std::optional<std::pair<Index, Index>> {
                fields::CoordBBox box;
                if (!self.tree().evalActiveVoxelBoundingBox(box) || box.empty()) return {};
                return std::pair{Index{box.min().x(), box.min().y(), box.min().z()},
                                 Index{box.max().x(), box.max().y(), box.max().z()}};
            },
            Release())
        .def(
            "resampled",
            [](const Grid& self, double voxel_size, const fields::Placement& placement) {
                voxel(voxel_size);
                rigid(placement);
                const py::gil_scoped_release release;
                return fields::resampled(self, voxel_size, placement);
            },
            arg("voxel_size"), arg("placement"));
    if constexpr (std::is_same_v<Value, std::int32_t>) {
        grid.def("renumbered", &fields::renumbered, arg("pairs"), Release())
            .def_static("of_labels", &labelled, arg("depth"), arg("labels"), arg("intrinsics"),
                        arg("pose"), arg("farthest"), arg("voxel_size"));
    }
}

using BlocksInPython = std::map<std::tuple<std::int32_t, std::int32_t, std::int32_t>, py::bytes>;

template <typename Value>
BlocksInPython grid_blocks(const fields::Grid<Value>& grid, int edge) {
    const fields::Blocks blocks = unlocked([&] { return fields::blocks_of(grid, edge); });
    BlocksInPython found;
    for (const auto& [cube, bytes] : blocks)
        found[{cube.x(), cube.y(), cube.z()}] = py::bytes(bytes);
    return found;
}

template <typename Value>
void grid_put_blocks(fields::Grid<Value>& grid, const BlocksInPython& given, int edge) {
    fields::Blocks blocks;
    for (const auto& [at, bytes] : given) {
        const auto [x, y, z] = at;
        blocks[fields::Coord(x, y, z)] = std::string(bytes);
    }
    const py::gil_scoped_release release;
    fields::put_blocks(grid, blocks, edge);
}

template <typename Value>
void define_grid(py::module_& module, const char* name) {
    using py::arg;
    using Release = py::call_guard<py::gil_scoped_release>;
    using Grid = fields::Grid<Value>;
    py::class_<Grid> grid(module, name);
    define_operators(grid);
    grid.def(py::init([](double voxel_size, Value background) {
                 return Grid(voxel(voxel_size), background);
             }),
             arg("voxel_size"), arg("background"))
        .def_property_readonly("voxel_size", &Grid::voxel_size)
        .def_property_readonly("background", &Grid::background)
        .def_property_readonly("placement", &Grid::placement)
        .def(
            "place",
            [](Grid& self, const fields::Placement& placement) { self.place(rigid(placement)); },
            arg("placement"))
        .def(
            "placed",
            [](const Grid& self, const fields::Placement& placement) {
                return self.placed(rigid(placement));
            },
            arg("placement"))
        .def("fill", &Grid::fill, arg("shape"), arg("value"), Release())
        .def("clear", &Grid::clear, arg("shape"), Release())
        .def("set", &grid_set<Value>, arg("voxels"), arg("values"))
        .def("at", &look_up<Value, Grid>, arg("points"))
        .def("read", &grid_read<Value>)
        .def("read_box", &grid_read_box<Value>, arg("low"), arg("shape"))
        .def("prune", &Grid::prune, Release())
        .def("__len__", &Grid::size, Release())
        .def("write", &Grid::write, arg("path"), arg("name"), Release());
    grid.def("blocks", &grid_blocks<Value>, arg("edge"))
        .def("put_blocks", &grid_put_blocks<Value>, arg("blocks"), arg("edge"));
}

}  // namespace

PYBIND11_MODULE(semmap_vdb, module) {
    py::register_exception_translator([](std::exception_ptr thrown) {
        try {
            if (thrown) std::rethrow_exception(thrown);
        } catch (const openvdb::IoError& error) {
            py::set_error(PyExc_OSError, error.what());
        } catch (const openvdb::Exception& error) {
            py::set_error(PyExc_ValueError, error.what());
        }
    });
    module.doc() = "Regions of space as voxels, and the grid of sets of entities, over OpenVDB.";
    using py::arg;
    using Release = py::call_guard<py::gil_scoped_release>;

    py::class_<fields::Shape>(module, "Shape")
        .def_static("ball", &ball, arg("center"), arg("radius"))
        .def_static("cylinder", &cylinder, arg("center"), arg("axis"), arg("radius"), arg("height"))
        .def_static("cone", &cone, arg("apex"), arg("axis"), arg("half_angle"), arg("height"))
        .def_static("polytope", &polytope, arg("corners"), arg("normals"), arg("edges"))
        .def_static("points", &points, arg("points"))
        .def_static("solid", &solid, arg("vertices"), arg("faces"))
        .def_static("surface", &surface, arg("vertices"), arg("faces"))
        .def_static("depth_image", &depth_image, arg("depth"), arg("mask").none(true),
                    arg("intrinsics"), arg("pose"), arg("farthest"))
        .def("voxels", &voxels_of, arg("voxel_size"));

    py::class_<fields::RegionMap>(module, "RegionMap")
        .def(py::init([](double voxel_size) {
                 return std::make_unique<fields::RegionMap>(voxel(voxel_size));
             }),
             arg("voxel_size"))
        .def("insert", &fields::RegionMap::insert, arg("entity"), arg("shape"), Release())
        .def("remove", &fields::RegionMap::remove, arg("entity"), Release())
        .def("move", &fields::RegionMap::move, arg("entity"), arg("shape"), Release())
        .def("insert_many", &insert_many, arg("entities"), arg("shapes"), arg("threads"),
             arg("others") = false)
        .def("set_numbers_at", &look_up<std::int32_t, fields::RegionMap>, arg("points"))
        .def("members", &fields::RegionMap::members, arg("numbers"), Release())
        .def("voxels", &voxels_in, arg("entity"))
        .def("size", &fields::RegionMap::size, arg("entity"), Release())
        .def("has", &fields::RegionMap::has, arg("entity"), Release())
        .def("overlap", &fields::RegionMap::overlap, arg("a"), arg("b"), Release())
        .def(
            "neighbours",
            [](const fields::RegionMap& self, std::int32_t entity, std::int64_t farthest) {
                // -1: those that share a voxel.
                within(farthest, -1, 1 << 20, "farthest");
                return self.neighbours(entity, farthest);
            },
            arg("entity"), arg("farthest"), Release())
        .def("support", &fields::RegionMap::support, arg("a"), arg("b"), Release())
        .def("memory", &fields::RegionMap::memory, Release())
        .def("write", &fields::RegionMap::write, arg("path"), Release())
        .def("state", &fields::RegionMap::state, Release())
        .def("restore", &fields::RegionMap::restore, arg("grid"), arg("sets"), Release());

    module.def(
        "limit_regions",
        [](std::int64_t voxels, std::int64_t blocks) {
            within(voxels, 512, std::int64_t{1} << 36, "voxels");
            within(blocks, 1, std::int64_t{1} << 27, "blocks");
            fields::region_limits().voxels = voxels;
            fields::region_limits().blocks = blocks;
        },
        arg("voxels"), arg("blocks"));
    module.def("variants", &semmap::family_names);
    module.def(
        "choose_variant",
        [](const std::string& name) { fields::used_family() = semmap::family_named(name); },
        arg("name"));

    define_grid<bool>(module, "BoolGrid");
    define_grid<std::int32_t>(module, "Int32Grid");
    define_grid<float>(module, "FloatGrid");
}
