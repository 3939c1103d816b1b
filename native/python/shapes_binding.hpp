// The Python face of semmap/shapes.hpp.
#pragma once

#include <pybind11/pybind11.h>

void define_shapes(pybind11::module_& module);
