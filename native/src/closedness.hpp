// Whether surfaces are closed, without a table of edges.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "semmap/occupancy.hpp"
#include "team.hpp"

namespace semmap {

// Two numbers as good as random for a point, equal for equal points.
struct PointHash {
    std::uint64_t s;
    std::uint64_t t;
};

inline PointHash hash_point(const double* p) {
    constexpr std::uint64_t kOdd[3] = {0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9};
    std::uint64_t part[3];
    for (int i = 0; i < 3; ++i) {
        const double value = p[i] + 0.0;  // -0 is 0
        std::memcpy(&part[i], &value, sizeof value);
        part[i] = (part[i] ^ (part[i] >> 32)) * kOdd[i];
        part[i] ^= part[i] >> 29;
    }
    const std::uint64_t sum =
        part[0] + ((part[1] << 21) | (part[1] >> 43)) + ((part[2] << 42) | (part[2] >> 22));
    const std::uint64_t s = sum ^ (sum >> 32);
    const std::uint64_t t = s * 0xBF58476D1CE4E5B9;
    return {s, t ^ (t >> 29)};
}

// Leaves of the solids marked in `closed` those whose surface is closed: false where memory ran
// out.
//
// Each directed edge p-q counts s(p) t(q) - s(q) t(p). That is antisymmetric, so that opposite
// edges cancel; and with s and t as good as random a sum over edges that do not all cancel is as
// good as never zero (the identity test of polynomials of Schwartz and Zippel). A face's three
// edges make one determinant.
template <typename Index>
bool keep_closed(const MeshView<Index>& mesh, const Team& team, std::vector<std::uint8_t>& closed) {
    const std::unique_ptr<PointHash[]> hash(new PointHash[mesh.vertex_count]);
    if (!team.share(mesh.vertex_count, 16384, [&](unsigned, std::size_t first, std::size_t last) {
            for (std::size_t i = first; i < last; ++i) hash[i] = hash_point(mesh.vertices + 3 * i);
        })) {
        return false;
    }
    std::vector<std::vector<std::uint64_t>> sums(team.size());
    for (auto& sum : sums) sum.assign(closed.size(), 0);
    if (!team.share(
            mesh.face_count, 16384, [&](unsigned thread, std::size_t first, std::size_t last) {
                for (std::size_t f = first; f < last; ++f) {
                    const auto solid =
                        static_cast<std::size_t>(mesh.solids == nullptr ? 0 : mesh.solids[f]);
                    if (closed[solid] == 0) continue;
                    const Index* face = mesh.faces + 3 * f;
                    const PointHash a = hash[face[0]];
                    const PointHash b = hash[face[1]];
                    const PointHash c = hash[face[2]];
                    sums[thread][solid] += (b.s - a.s) * (c.t - a.t) - (c.s - a.s) * (b.t - a.t);
                }
            })) {
        return false;
    }
    for (std::size_t i = 0; i < closed.size(); ++i) {
        std::uint64_t sum = 0;
        for (const auto& part : sums) sum += part[i];
        closed[i] = closed[i] != 0 && sum == 0;
    }
    return true;
}

}  // namespace semmap
