// Lower bounds of what is left to a target.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "adjacency.hpp"
#include "semmap/graph.hpp"

namespace semmap {

constexpr std::size_t kLandmarks = 16;
constexpr double kRounding = 1.0 / (1 << 20);  // of bounds in single precision, generously

// Distances from and to a few far nodes: differences of them bound other distances from below
// (Goldberg and Harrelson, Computing the shortest path: A* search meets graph theory, 2005).
struct Landmarks {
    Landmarks(const Edges& edges, const std::vector<double>& weights, std::uint32_t nodes);

    // In single precision. What is beyond all measure is made less, which keeps bounds low.
    static float single(double cost) {
        constexpr double most = 1e37;
        if (cost == kClosed) return std::numeric_limits<float>::infinity();
        return static_cast<float>(std::clamp(cost, -most, most));
    }

    struct Row {
        float from[kLandmarks];  // each landmark to the node
        float to[kLandmarks];    // the node to each landmark
    };

    std::vector<Row> rows;
    double span = 0.0;  // the farthest of the distances

    // What is left to the nearest target is at least this.
    struct Bound {
        Bound(const Landmarks& landmarks, const std::vector<End>& targets, double share)
            : rows(landmarks.rows.data()), share(share) {
            double dearest = 0.0;
            std::fill_n(from, kLandmarks, std::numeric_limits<float>::infinity());
            std::fill_n(to, kLandmarks, -std::numeric_limits<float>::infinity());
            for (const auto& [node, cost] : targets) {
                if (cost == kClosed) continue;
                dearest = std::max(dearest, cost);
                for (std::size_t i = 0; i < kLandmarks; ++i) {
                    const double least = rows[node].from[i] + cost;
                    const double most = rows[node].to[i] - cost;
                    from[i] = std::min(from[i], single(least));
                    to[i] = std::max(to[i], single(most));
                }
            }
            slack = (landmarks.span + dearest) * kRounding;
        }

        double operator()(std::uint32_t node) const {
            const Row& row = rows[node];
            float bounds[kLandmarks] = {};
            // Differences of infinities are not numbers, which are never more than a bound.
            for (std::size_t i = 0; i < kLandmarks; ++i) {
                const float far = from[i] - row.from[i];
                bounds[i] = far > bounds[i] ? far : bounds[i];
            }
            for (std::size_t i = 0; i < kLandmarks; ++i) {
                const float far = row.to[i] - to[i];
                bounds[i] = far > bounds[i] ? far : bounds[i];
            }
            for (std::size_t half = kLandmarks / 2; half > 0; half /= 2) {
                for (std::size_t i = 0; i < half; ++i) {
                    bounds[i] = bounds[i + half] > bounds[i] ? bounds[i + half] : bounds[i];
                }
            }
            return std::max(0.0, share * bounds[0] - slack);
        }

        const Row* rows;
        double share;
        double slack;
        alignas(64) float from[kLandmarks];
        alignas(64) float to[kLandmarks];
    };
};

}  // namespace semmap
