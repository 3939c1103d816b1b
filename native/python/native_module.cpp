// The Python face of semmap_native. Arrays are checked in Python; here they are what they say.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "semmap/slices.hpp"

namespace py = pybind11;

namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;

Array<bool> slices(const Array<double>& vertices, const Array<std::int32_t>& faces,
                   const std::vector<double>& heights, double origin_x, double origin_y,
                   double resolution, py::ssize_t rows, py::ssize_t columns) {
    const semmap::GridFrame grid{origin_x, origin_y, resolution, rows, columns};
    Array<bool> cells({static_cast<py::ssize_t>(heights.size()), rows, columns});
    auto* data = reinterpret_cast<std::uint8_t*>(cells.mutable_data());
    const double* corners = vertices.data();
    const std::int32_t* corner_ids = faces.data();
    const auto count = static_cast<std::size_t>(faces.shape(0));
    const py::gil_scoped_release release;
    std::fill(data, data + heights.size() * static_cast<std::size_t>(rows * columns), 0);
    for (std::size_t i = 0; i < heights.size(); ++i) {
        semmap::slice(corners, corner_ids, count, heights[i], grid,
                      data + i * static_cast<std::size_t>(rows * columns));
    }
    return cells;
}

}  // namespace

PYBIND11_MODULE(semmap_native, module) {
    module.doc() = "Slices of triangle meshes on grids.";
    module.def("slices", &slices, py::arg("vertices"), py::arg("faces"), py::arg("heights"),
               py::arg("origin_x"), py::arg("origin_y"), py::arg("resolution"), py::arg("rows"),
               py::arg("columns"));
}
