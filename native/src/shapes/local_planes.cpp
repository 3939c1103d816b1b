// Planes through neighbours: the least eigenvalue of their covariance by Jacobi's rotations.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "semmap/shapes.hpp"

namespace semmap::shapes {
namespace {

using Symmetric = std::array<Vector, 3>;

constexpr int kSweeps = 12;  // five are usual

// Turns the axes so that the element (p, q) vanishes.
void rotate(Symmetric& a, Symmetric& axes, std::size_t p, std::size_t q) {
    if (a[p][q] == 0) return;
    const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
    const double tangent =
        std::copysign(1.0, theta) / (std::abs(theta) + std::sqrt(theta * theta + 1));
    const double cos = 1 / std::sqrt(tangent * tangent + 1), sin = tangent * cos;
    for (std::size_t k = 0; k < 3; ++k) {
        const double x = a[k][p], y = a[k][q];
        a[k][p] = cos * x - sin * y;
        a[k][q] = sin * x + cos * y;
    }
    for (std::size_t k = 0; k < 3; ++k) {
        const double x = a[p][k], y = a[q][k];
        a[p][k] = cos * x - sin * y;
        a[q][k] = sin * x + cos * y;
        const double u = axes[p][k], v = axes[q][k];
        axes[p][k] = cos * u - sin * v;
        axes[q][k] = sin * u + cos * v;
    }
}

}  // namespace

void local_planes(const PointsView& points, const std::int64_t* near, std::size_t rows,
                  std::size_t k, Vector* normals, double* variances) {
    for (std::size_t row = 0; row < rows; ++row) {
        const std::int64_t* numbers = near + row * k;
        Vector mean{};
        for (std::size_t i = 0; i < k; ++i) {
            for (std::size_t c = 0; c < 3; ++c) mean[c] += points.points[numbers[i]][c];
        }
        for (double& number : mean) number /= static_cast<double>(k);
        Symmetric covariance{}, axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
        for (std::size_t i = 0; i < k; ++i) {
            const Vector& p = points.points[numbers[i]];
            const Vector d{p[0] - mean[0], p[1] - mean[1], p[2] - mean[2]};
            for (std::size_t a = 0; a < 3; ++a) {
                for (std::size_t b = 0; b < 3; ++b) covariance[a][b] += d[a] * d[b];
            }
        }
        for (int sweep = 0; sweep < kSweeps; ++sweep) {
            const double off = std::abs(covariance[0][1]) + std::abs(covariance[0][2]) +
                               std::abs(covariance[1][2]);
            const double diagonal = covariance[0][0] + covariance[1][1] + covariance[2][2];
            if (!(off > 1e-15 * diagonal)) break;
            rotate(covariance, axes, 0, 1);
            rotate(covariance, axes, 0, 2);
            rotate(covariance, axes, 1, 2);
        }
        std::size_t least = 0;
        for (std::size_t a = 1; a < 3; ++a) {
            if (covariance[a][a] < covariance[least][least]) least = a;
        }
        normals[row] = axes[least];
        variances[row] = covariance[least][least] / static_cast<double>(k);
    }
}

}  // namespace semmap::shapes
