// Whether surfaces are closed, without a table of edges.
#pragma once

#include <algorithm>
#include <atomic>
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

// Leaves of the solids marked in `closed` those whose surface is closed.
//
// Each directed edge p-q counts s(p) t(q) - s(q) t(p). That is antisymmetric, so that opposite
// edges cancel; and with s and t as good as random a sum over edges that do not all cancel is as
// good as never zero (the identity test of polynomials of Schwartz and Zippel). A face's three
// edges make one determinant.
template <typename Index>
void keep_closed(const MeshView<Index>& mesh, const Team& team, std::vector<std::uint8_t>& closed) {
    constexpr std::size_t kChunk = 16384;
    // Calls found(solid, first, last) for neighbouring faces of one solid.
    const auto each_run = [&](std::size_t first, std::size_t last, auto&& found) {
        if (mesh.solids == nullptr) return found(std::size_t{0}, first, last);
        while (first < last) {
            const std::int32_t solid = mesh.solids[first];
            const std::size_t from = first;
            while (first < last && mesh.solids[first] == solid) ++first;
            if (closed[solid] != 0) found(static_cast<std::size_t>(solid), from, first);
        }
    };

    // Most solids have points of their own, side by side: only theirs are hashed, by the block.
    constexpr std::size_t kBlock = 64;
    std::vector<std::atomic<std::int64_t>> change(mesh.vertex_count / kBlock + 2);
    team.share(mesh.face_count, kChunk, [&](unsigned, std::size_t first, std::size_t last) {
        each_run(first, last, [&](std::size_t, std::size_t from, std::size_t to) {
            Index low = mesh.faces[3 * from];
            Index high = low;
            for (std::size_t i = 3 * from; i < 3 * to; ++i) {
                low = std::min(low, mesh.faces[i]);
                high = std::max(high, mesh.faces[i]);
            }
            change[static_cast<std::size_t>(low) / kBlock] += 1;
            change[static_cast<std::size_t>(high) / kBlock + 1] -= 1;
        });
    });
    std::vector<std::size_t> blocks;
    std::int64_t wanted = 0;
    for (std::size_t block = 0; block * kBlock < mesh.vertex_count; ++block) {
        wanted += change[block];
        if (wanted > 0) blocks.push_back(block);
    }
    const std::unique_ptr<PointHash[]> hash(new PointHash[mesh.vertex_count]);
    team.share(blocks.size(), 256, [&](unsigned, std::size_t first, std::size_t last) {
        for (; first < last; ++first) {
            const std::size_t end = std::min((blocks[first] + 1) * kBlock, mesh.vertex_count);
            for (std::size_t i = blocks[first] * kBlock; i < end; ++i) {
                hash[i] = hash_point(mesh.vertices + 3 * i);
            }
        }
    });
    std::vector<std::vector<std::uint64_t>> sums(team.size());
    for (auto& sum : sums) sum.assign(closed.size(), 0);
    team.share(mesh.face_count, kChunk, [&](unsigned thread, std::size_t first, std::size_t last) {
        each_run(first, last, [&](std::size_t solid, std::size_t from, std::size_t to) {
            std::uint64_t sum = 0;
            for (std::size_t f = from; f < to; ++f) {
                const Index* face = mesh.faces + 3 * f;
                const PointHash a = hash[face[0]];
                const PointHash b = hash[face[1]];
                const PointHash c = hash[face[2]];
                sum += (b.s - a.s) * (c.t - a.t) - (c.s - a.s) * (b.t - a.t);
            }
            sums[thread][solid] += sum;
        });
    });
    for (std::size_t i = 0; i < closed.size(); ++i) {
        std::uint64_t sum = 0;
        for (const auto& part : sums) sum += part[i];
        closed[i] = closed[i] != 0 && sum == 0;
    }
}

}  // namespace semmap
