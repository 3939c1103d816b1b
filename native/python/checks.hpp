// What arguments from Python have to be. Errors are ValueErrors that name the argument.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>

namespace semmap::checks {

namespace py = pybind11;

// C order. Other types are converted where no value can be lost, unless .noconvert() forbids it.
template <typename T>
using Array = py::array_t<T, py::array::c_style>;

constexpr py::ssize_t kAny = -1;

template <typename T>
std::size_t length(const Array<T>& array, int axis) {
    return static_cast<std::size_t>(array.shape(axis));
}

inline const std::uint8_t* bytes(const Array<bool>& array) {
    return reinterpret_cast<const std::uint8_t*>(array.data());
}

// Beyond it nothing is computed for one call: 2^34 numbers.
constexpr double kMostNumbers = 17179869184.0;

// An array of another type is refused.
inline py::arg exact(const char* name) { return py::arg(name).noconvert(); }

// What `work` returns, while other threads of Python run.
template <typename Work>
auto unlocked(Work&& work) {
    const py::gil_scoped_release release;
    return work();
}

// The text is built before the check: in loops over many values, throw from an `if` instead.
template <typename Text>
void expect(bool holds, const Text& text) {
    if (!holds) throw py::value_error(text);
}

// The sizes are the array's; kAny stands for any. `form` is how the error writes them.
template <typename T>
void expect_shape(const Array<T>& array, const char* name, std::initializer_list<py::ssize_t> sizes,
                  const char* form) {
    bool fits = array.ndim() == static_cast<py::ssize_t>(sizes.size());
    py::ssize_t axis = 0;
    for (const py::ssize_t size : sizes) {
        fits = fits && (size == kAny || array.shape(axis) == size);
        ++axis;
    }
    if (!fits) {
        std::string found;
        for (axis = 0; axis < array.ndim(); ++axis) {
            found += (axis > 0 ? ", " : "") + std::to_string(array.shape(axis));
        }
        throw py::value_error(std::string(name) + " has the shape (" + found + "): give " + form);
    }
    expect(reinterpret_cast<std::uintptr_t>(array.data()) % alignof(T) == 0,
           std::string(name) + " is not aligned in memory: copy it");
}

inline double finite(double value, const char* name, double most = 1e30) {
    if (std::abs(value) <= most) return value;
    throw py::value_error(std::string(name) + " is " + std::to_string(value) +
                          ": give a finite number of reasonable size");
}

inline double positive(double value, const char* name, double least = 1e-30, double most = 1e30) {
    if (value >= least && value <= most) return value;
    throw py::value_error(std::string(name) + " is " + std::to_string(value) +
                          ": give a number above 0 of reasonable size");
}

inline std::int64_t within(std::int64_t value, std::int64_t least, std::int64_t most,
                           const char* name) {
    if (value >= least && value <= most) return value;
    throw py::value_error(std::string(name) + " is " + std::to_string(value) + ": give " +
                          std::to_string(least) + " to " + std::to_string(most));
}

inline unsigned threads(std::int64_t value) {
    return static_cast<unsigned>(within(value, 1, 256, "threads"));
}

// The value of a name in a table.
template <typename Value, std::size_t N>
Value named(const std::string& name, const std::pair<const char*, Value> (&table)[N],
            const std::string& otherwise) {
    for (const auto& [known, value] : table) {
        if (name == known) return value;
    }
    throw py::value_error(otherwise);
}

// Whether three vectors are at right angles and of length 1.
template <typename Vectors>
void expect_rotation(const Vectors& vectors, const char* otherwise) {
    for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t b = 0; b < 3; ++b) {
            double product = 0;
            for (std::size_t k = 0; k < 3; ++k) product += vectors[a][k] * vectors[b][k];
            expect(std::abs(product - (a == b ? 1 : 0)) < 1e-6, otherwise);
        }
    }
}

template <typename T>
void expect_finite(const Array<T>& array, const char* name) {
    const T* data = array.data();
    for (py::ssize_t i = 0; i < array.size(); ++i) {
        if (!std::isfinite(data[i])) {
            throw py::value_error(std::string(name) +
                                  " holds NaN or infinity: leave those rows out");
        }
    }
}

// Whole numbers from 0 to `count` - 1.
template <typename T>
void expect_indices(const Array<T>& array, const char* name, std::int64_t count) {
    const T* data = array.data();
    for (py::ssize_t i = 0; i < array.size(); ++i) {
        if (data[i] < 0 || static_cast<std::int64_t>(data[i]) >= count) {
            throw py::value_error(
                std::string(name) + " holds " + std::to_string(data[i]) + ": " +
                (count == 0 ? "there are none" : "give 0 to " + std::to_string(count - 1)));
        }
    }
}

}  // namespace semmap::checks
