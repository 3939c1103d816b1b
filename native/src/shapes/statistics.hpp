// Quantiles of numbers that may be reordered.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace semmap::shapes {

// The quantile of at least one number, interpolated between neighbours.
inline double quantile(std::vector<double>& numbers, double share) {
    const double at = share * static_cast<double>(numbers.size() - 1);
    const auto low = static_cast<std::ptrdiff_t>(at);
    const auto middle = numbers.begin() + low;
    std::nth_element(numbers.begin(), middle, numbers.end());
    if (middle + 1 == numbers.end()) return *middle;
    const double next = *std::min_element(middle + 1, numbers.end());
    return *middle + (at - static_cast<double>(low)) * (next - *middle);
}

inline double median(std::vector<double>& numbers) { return quantile(numbers, 0.5); }

}  // namespace semmap::shapes
