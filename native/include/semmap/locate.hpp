// In which cell a corner of a clipped triangle lies, and where a line crosses a row's lower border:
// computed in double with a bound on the error, and with exact arithmetic where that cannot decide.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "semmap/exact.hpp"
#include "semmap/grid.hpp"

// What the compiler leaves out of line, called for each crossing of an edge and a border.
#define SEMMAP_INLINE __attribute__((always_inline)) inline

namespace semmap {

// A vertex (both ends are it), or the point where the edge from `low` up to `high` passes the plane
// z = height.
struct Corner {
    double u;  // x and y in cells from the origin, rounded
    double v;
    std::int32_t column;  // the cell, exact; -1 and `columns` stand for all that lies beyond
    std::int32_t row;
    const double* low;
    const double* high;
    double height;
};

// The cell of a vertex, exact; -1 and the count stand for all that lies beyond.
struct Spot {
    std::int32_t column;
    std::int32_t row;
};

// The column in which a line crosses a border, and whether it does so in the column's own lower
// border, so that what lies just before it is of the column below.
struct Crossing {
    std::int32_t column;
    bool at_border;
};

class Locator {
    // x and y at once.
    typedef double Pair __attribute__((vector_size(16)));
    typedef std::int32_t Indices __attribute__((vector_size(8)));

  public:
    explicit Locator(const GridFrame& grid)
        : grid_(grid),
          per_metre_(1.0 / grid.resolution),
          border_error_(0x1p-51 * per_metre_ *
                        (std::max(std::abs(grid.origin_x), std::abs(grid.origin_y)) +
                         std::max(grid.rows, grid.columns) * grid.resolution)),
          spot_error_(border_error_ + (std::max(grid.rows, grid.columns) + 1) * kVertexError),
          origin_{grid.origin_x, grid.origin_y},
          most_{grid.columns + 0.5, grid.rows + 0.5} {}

    // Relative error of u and v of a vertex: difference, reciprocal, product, and as much again.
    static constexpr double kVertexError = 0x1p-50;
    // Error of u and v of any corner, in units of the largest |u| or |v| of the triangle.
    static constexpr double kCornerError = 0x1p-48;

    SEMMAP_INLINE Spot spot(const double* p) const {
        Pair at;
        std::memcpy(&at, p, sizeof at);
        const Pair cells = (at - origin_) * per_metre_;
        const Pair above = cells > -0.5 ? cells : Pair{-0.5, -0.5};  // also of no number
        const Pair inside = above < most_ ? above : most_;
        const Indices index = __builtin_convertvector(inside + 1.0, Indices) - 1;
        const Pair off = inside - 0.5 - __builtin_convertvector(index, Pair);
        const auto sure = (off < 0.5 - spot_error_) & (off > spot_error_ - 0.5);
        Spot found{index[0], index[1]};
        if ((sure[0] & sure[1]) == 0) {
            const double u = cells[0];
            const double v = cells[1];
            const double u_error = std::abs(u) * kVertexError + border_error_;
            const double v_error = std::abs(v) * kVertexError + border_error_;
            found.column = vertex_cell<0>(p[0], u, u_error, grid_.columns);
            found.row = vertex_cell<1>(p[1], v, v_error, grid_.rows);
        }
        return found;
    }

    Corner vertex(const double* p, Spot spot) const {
        return {(p[0] - grid_.origin_x) * per_metre_,
                (p[1] - grid_.origin_y) * per_metre_,
                spot.column,
                spot.row,
                p,
                p,
                p[2]};
    }

    // Where the edge from `low` up to `high` passes a height strictly between theirs.
    SEMMAP_INLINE Corner pass(const Corner& low, const Corner& high, double height,
                              double error) const {
        if ((low.u == high.u) & (low.v == high.v) & (low.column == high.column) &
            (low.row == high.row)) {
            return {low.u, low.v, low.column, low.row, low.low, high.low, height};
        }
        error += border_error_;
        Corner corner;
        const double share = (height - low.low[2]) / (high.low[2] - low.low[2]);
        corner.u = low.u + share * (high.u - low.u);
        corner.v = low.v + share * (high.v - low.v);
        corner.low = low.low;
        corner.high = high.low;
        corner.height = height;
        corner.column = between<0>(corner, low.column, high.column, error);
        corner.row = between<1>(corner, low.row, high.row, error);
        return corner;
    }

    // The column (Axis 0) or row of that point alone.
    template <int Axis>
    SEMMAP_INLINE std::int32_t pass_cell(const Corner& low, const Corner& high, double height,
                                         double error) const {
        const std::int32_t from = Axis == 0 ? low.column : low.row;
        if (from == (Axis == 0 ? high.column : high.row)) return from;
        const double a = Axis == 0 ? low.u : low.v;
        const double b = Axis == 0 ? high.u : high.v;
        const double share = (height - low.low[2]) / (high.low[2] - low.low[2]);
        const std::int32_t index = cell(a + share * (b - a), error + border_error_,
                                        Axis == 0 ? grid_.columns : grid_.rows);
        if (index != kUnsure) return index;
        const Corner corner = pass(low, high, height, error);
        return Axis == 0 ? corner.column : corner.row;
    }

    // Calls found(row, crossing) for each border of rows first..last, all of which the line from p
    // to q crosses; p lies below q and in another column.
    template <typename Found>
    void crossings(const Corner& p, const Corner& q, std::int32_t first, std::int32_t last,
                   double error, Found&& found) const {
        const double rise = q.v - p.v;
        error += border_error_;
        const bool steep_enough = rise > 1024.0 * error;
        const double slope = steep_enough ? (q.u - p.u) / rise : 0.0;
        const double off = steep_enough ? 4.0 * error * (1.0 + std::abs(slope)) : 1.0;
        for (std::int32_t row = first; row <= last; ++row) {
            const double u = p.u + (row - p.v) * slope;
            Crossing crossing{cell(u, off, grid_.columns), false};
            if (crossing.column == kUnsure) {
                crossing = exact_crossing(p, q, row, u, steep_enough ? off : HUGE_VAL);
            }
            found(row, crossing);
        }
    }

    // Of u and v of a vertex in the grid.
    double spot_error() const { return spot_error_; }

  private:
    static constexpr std::int32_t kUnsure = -2;

    // The cell of a coordinate known to within `error`, if that decides it.
    SEMMAP_INLINE static std::int32_t cell(double u, double error, std::int32_t count) {
        const double inside = std::min(count + 0.5, std::max(-0.5, u));  // also of no number
        const std::int32_t index = static_cast<std::int32_t>(inside + 1.0) - 1;
        return std::abs(inside - index - 0.5) < 0.5 - error ? index : kUnsure;
    }

    template <int Axis>
    double border(std::int32_t index) const {
        return (Axis == 0 ? grid_.origin_x : grid_.origin_y) + index * grid_.resolution;
    }

    // W * (coordinate - border), where W > 0 is that of homogeneous coordinates.
    template <int Axis>
    exact::Expansion<12> beyond(const Corner& c, std::int32_t index) const {
        using exact::Expansion;
        using exact::two_product;
        const Expansion<1> at(border<Axis>(index));
        Expansion<12> result;
        if (c.low == c.high) {
            const Expansion<2> rest = Expansion<1>(c.low[Axis]) - at;
            std::copy(rest.term, rest.term + rest.count, result.term);
            result.count = rest.count;
            return result;
        }
        const Expansion<2> from_low(exact::two_sum(c.height, -c.low[2]));
        const Expansion<2> to_high(exact::two_sum(c.high[2], -c.height));
        const Expansion<2> whole(exact::two_sum(c.high[2], -c.low[2]));
        const Expansion<8> there =
            Expansion<1>(c.low[Axis]) * to_high + Expansion<1>(c.high[Axis]) * from_low;
        return there - whole * at;
    }

    // Leaves of low..high what a coordinate known to within `error` can be in.
    static void narrow(double u, double error, std::int32_t& low, std::int32_t& high) {
        if (!(std::abs(u) < HUGE_VAL)) return;
        const auto within = [&](double index) {
            return static_cast<std::int32_t>(std::clamp<double>(std::floor(index), low, high));
        };
        const std::int32_t first = within(u - error);
        high = within(u + error);
        low = first;
    }

    // The last border in (low, high] that `reached` says is reached, or low.
    template <typename Reached>
    static std::int32_t last_reached(std::int32_t low, std::int32_t high, Reached&& reached) {
        while (low < high) {
            const std::int32_t middle = low + (high - low + 1) / 2;
            if (reached(middle)) {
                low = middle;
            } else {
                high = middle - 1;
            }
        }
        return low;
    }

    template <int Axis>
    std::int32_t vertex_cell(double at, double u, double error, std::int32_t count) const {
        std::int32_t low = -1;
        std::int32_t high = count;
        narrow(u, error, low, high);
        return last_reached(low, high,
                            [&](std::int32_t index) { return at >= border<Axis>(index); });
    }

    template <int Axis>
    std::int32_t exact_cell(const Corner& corner, double error, std::int32_t low,
                            std::int32_t high) const {
        narrow(Axis == 0 ? corner.u : corner.v, error, low, high);
        return last_reached(low, high,
                            [&](std::int32_t at) { return beyond<Axis>(corner, at).sign() >= 0; });
    }

    // The column (Axis 0) or row of a corner of the edge between two.
    template <int Axis>
    SEMMAP_INLINE std::int32_t between(const Corner& corner, std::int32_t from, std::int32_t to,
                                       double error) const {
        if (from == to) return from;
        const std::int32_t index =
            cell(Axis == 0 ? corner.u : corner.v, error, Axis == 0 ? grid_.columns : grid_.rows);
        if (index != kUnsure) return index;
        return exact_cell<Axis>(corner, error, std::min(from, to), std::max(from, to));
    }

    Crossing exact_crossing(const Corner& p, const Corner& q, std::int32_t row, double u,
                            double error) const {
        const exact::Expansion<12> below = beyond<1>(p, row);
        const exact::Expansion<12> above = beyond<1>(q, row);
        const auto side = [&](std::int32_t at) {
            return (beyond<0>(p, at) * above - beyond<0>(q, at) * below).sign();
        };
        std::int32_t low = std::min(p.column, q.column);
        std::int32_t high = std::max(p.column, q.column);
        narrow(u, error, low, high);
        const std::int32_t column =
            last_reached(low, high, [&](std::int32_t at) { return side(at) >= 0; });
        return {column, column >= 0 && side(column) == 0};
    }

    GridFrame grid_;
    double per_metre_;
    double border_error_;  // of a border, which is a rounded number, in cells
    double spot_error_;    // of a vertex on the grid, which includes its border's
    Pair origin_;
    Pair most_;
};

}  // namespace semmap
