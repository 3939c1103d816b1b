// Draws the part of a triangle within a slab.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "semmap/grid.hpp"
#include "semmap/locate.hpp"
#include "slabs.hpp"
#include "small_polygon.hpp"

namespace semmap {

// The part of a triangle within a slab projects to a convex polygon, which meets in each row of
// cells one run of columns: that of the corners in the row and of the points in which edges cross
// the row's borders. The upper border is the next row's, so that a crossing there is approached,
// not reached.
//
// A Canvas has run(row, first column, last column) and upright(column, first row, last row).
class Painter {
  public:
    explicit Painter(const GridFrame& grid)
        : grid_(grid),
          locator_(grid),
          small_(grid),
          spans_(static_cast<std::size_t>(grid.rows) + 2) {}

    const Locator& locator() const { return locator_; }
    const SmallPolygon& small() const { return small_; }

    static double error_of(const Corner& a, const Corner& b, const Corner& c) {
        return Locator::kCornerError * std::max({std::abs(a.u), std::abs(b.u), std::abs(c.u),
                                                 std::abs(a.v), std::abs(b.v), std::abs(c.v)});
    }

    // What fills a row or a column of cells, or one.
    template <typename Canvas>
    void rectangle(std::int32_t low_row, std::int32_t high_row, std::int32_t low_column,
                   std::int32_t high_column, Canvas& canvas) const {
        low_column = std::max(low_column, 0);
        high_column = std::min(high_column, grid_.columns - 1);
        if (low_column > high_column) return;
        low_row = std::max(low_row, 0);
        high_row = std::min(high_row, grid_.rows - 1);
        if (low_column == high_column) {
            canvas.upright(low_column, low_row, high_row);
            return;
        }
        for (std::int32_t row = low_row; row <= high_row; ++row) {
            canvas.run(row, low_column, high_column);
        }
    }

    // A triangle that is not clipped.
    template <typename Canvas>
    void whole(const Corner& a, const Corner& b, const Corner& c, Canvas& canvas) {
        const double error = error_of(a, b, c);
        begin(std::min({a.row, b.row, c.row}), std::max({a.row, b.row, c.row}));
        reach(a);
        reach(b);
        reach(c);
        edge(a, b, a, b, error);
        edge(b, c, b, c, error);
        edge(a, c, a, c, error);
        paint(canvas);
    }

    // The part between two planes of a triangle that meets the slab; a, b, c ascend, and so do
    // their places. `bottom` is the section at the slab's lower end, where that cuts through, and
    // becomes that at its upper end.
    template <typename Canvas>
    void clipped(const std::array<Corner, 3>& corner, const std::array<Place, 3>& place,
                 const Slab& slab, std::array<Corner, 2>& bottom, Canvas& canvas) {
        const auto& [a, b, c] = corner;
        const double error = error_of(a, b, c);
        const Place low = slab.low_place;
        const Place high = slab.high_place;
        // Points of the long edge a-c and of the short ones a-b-c in the planes that cut through.
        const bool cut_low = place[0] < low && low < place[2];
        const bool cut_high = place[0] < high && high < place[2];
        std::array<Corner, 2> roof;
        if (cut_high) roof = section(locator_, corner, place, slab.high, high);

        // Around the part, up the edges a-b-c and down a-c.
        std::array<const Corner*, 5> around;
        std::size_t count = 0;
        if (cut_low) around[count++] = &bottom[1];
        for (int i = 0; i < 3; ++i) {
            if (low <= place[i] && place[i] <= high) around[count++] = &corner[i];
        }
        if (cut_high) {
            around[count++] = &roof[1];
            around[count++] = &roof[0];
        }
        if (cut_low) around[count++] = &bottom[0];
        Extent extent{around[0]->row, around[0]->row, around[0]->column, around[0]->column};
        for (std::size_t i = 1; i < count; ++i) {
            extent.low_row = std::min(extent.low_row, around[i]->row);
            extent.high_row = std::max(extent.high_row, around[i]->row);
            extent.low_column = std::min(extent.low_column, around[i]->column);
            extent.high_column = std::max(extent.high_column, around[i]->column);
        }
        const bool straight =
            extent.low_row == extent.high_row || extent.low_column == extent.high_column;
        if (straight) {
            rectangle(extent.low_row, extent.high_row, extent.low_column, extent.high_column,
                      canvas);
        }
        if (straight || (error < 0x1p-25 && extent.is_small(grid_) &&
                         small_.polygon(around, count, extent, canvas))) {
            bottom = roof;
            return;
        }

        begin(std::min({a.row, b.row, c.row}), std::max({a.row, b.row, c.row}));
        for (int i = 0; i < 3; ++i) {
            if (low <= place[i] && place[i] <= high) reach(corner[i]);
        }
        if (cut_low) {
            reach(bottom[0]);
            reach(bottom[1]);
            edge(bottom[0], bottom[1], bottom[0], bottom[1], error);
        }
        if (cut_high) {
            reach(roof[0]);
            reach(roof[1]);
            edge(roof[0], roof[1], roof[0], roof[1], error);
        }
        part(a, c, place[0], place[2], slab, bottom[0], roof[0], error);
        part(a, b, place[0], place[1], slab, bottom[1], roof[1], error);
        part(b, c, place[1], place[2], slab, bottom[1], roof[1], error);
        paint(canvas);
        bottom = roof;
    }

    // The parts within slabs of a triangle that lies in one row of cells (Axis 0: its columns
    // count) or in one column; a, b, c ascend, and so do their places. Each part is found(slab,
    // low, high).
    template <int Axis, typename Found>
    void strip(const std::array<Corner, 3>& corner, const std::array<Place, 3>& place,
               const Slab* first, const Slab* end, Found&& found) const {
        struct Reach {
            std::int32_t low = std::numeric_limits<std::int32_t>::max();
            std::int32_t high = std::numeric_limits<std::int32_t>::min();
            void take(std::int32_t at) {
                low = std::min(low, at);
                high = std::max(high, at);
            }
            void take(const Reach& other) {
                low = std::min(low, other.low);
                high = std::max(high, other.high);
            }
        };
        const auto& [a, b, c] = corner;
        const double error = error_of(a, b, c);
        const auto section = [&](double height, Place at) {
            Reach reach;
            if (at <= place[0] || place[2] <= at) return reach;  // nothing, or a vertex
            reach.take(locator_.pass_cell<Axis>(a, c, height, error));
            if (at < place[1]) reach.take(locator_.pass_cell<Axis>(a, b, height, error));
            if (at > place[1]) reach.take(locator_.pass_cell<Axis>(b, c, height, error));
            return reach;
        };
        Place reached = 0;
        Reach roof;
        for (const Slab* slab = first; slab != end; ++slab) {
            Reach reach;
            for (int i = 0; i < 3; ++i) {
                if (slab->low_place <= place[i] && place[i] <= slab->high_place) {
                    reach.take(Axis == 0 ? corner[i].column : corner[i].row);
                }
            }
            reach.take(slab->low_place == reached ? roof : section(slab->low, slab->low_place));
            reached = slab->high_place;
            roof = section(slab->high, reached);
            reach.take(roof);
            found(*slab, reach.low, reach.high);
        }
    }

    // The points in which a plane that cuts through meets the edge a-c and the edges a-b-c.
    static std::array<Corner, 2> section(const Locator& locator,
                                         const std::array<Corner, 3>& corner,
                                         const std::array<Place, 3>& place, double height,
                                         Place at) {
        const auto& [a, b, c] = corner;
        const double error = error_of(a, b, c);
        std::array<Corner, 2> points{locator.pass(a, c, height, error), b};
        if (at < place[1]) points[1] = locator.pass(a, b, height, error);
        if (at > place[1]) points[1] = locator.pass(b, c, height, error);
        return points;
    }

  private:
    struct Span {
        std::int32_t low;
        std::int32_t high;
    };

    // Spans of rows -1 to `rows`, the outer two of which are not painted.
    Span& span(std::int32_t row) { return spans_[static_cast<std::size_t>(row + 1)]; }

    void begin(std::int32_t low_row, std::int32_t high_row) {
        low_row_ = std::max(low_row, 0);
        high_row_ = std::min(high_row, grid_.rows - 1);
        for (std::int32_t row = low_row_; row <= high_row_; ++row) {
            span(row) = {std::numeric_limits<std::int32_t>::max(), -1};
        }
    }

    void include(std::int32_t row, std::int32_t low, std::int32_t high) {
        Span& at = span(row);
        at.low = std::min(at.low, low);
        at.high = std::max(at.high, high);
    }

    void reach(const Corner& corner) { include(corner.row, corner.column, corner.column); }

    // The part of an edge, whose ends ascend, within the slab.
    void part(const Corner& p, const Corner& q, Place p_place, Place q_place, const Slab& slab,
              const Corner& bottom, const Corner& roof, double error) {
        if (p_place > slab.high_place || q_place < slab.low_place) return;
        const Corner& from = p_place >= slab.low_place ? p : q_place > slab.low_place ? bottom : q;
        const Corner& to = q_place <= slab.high_place ? q : p_place < slab.high_place ? roof : p;
        edge(from, to, p, q, error);
    }

    // Where the part from-to of the line p-q crosses borders of rows.
    void edge(const Corner& from, const Corner& to, const Corner& p, const Corner& q,
              double error) {
        if (from.row == to.row) return;
        if (from.row > to.row) {
            edge(to, from, q, p, error);
            return;
        }
        const std::int32_t first = std::max(from.row + 1, 0);
        const std::int32_t last = std::min(to.row, grid_.rows);
        if (p.column == q.column) {
            for (std::int32_t row = first - 1; row <= last; ++row) {
                include(row, p.column, p.column);
            }
            return;
        }
        // A row has what is between its lower and its upper border.
        std::int32_t low = std::numeric_limits<std::int32_t>::max();
        std::int32_t high = -1;
        locator_.crossings(p, q, first, last, error, [&](std::int32_t row, Crossing at) {
            include(row - 1, std::min(low, at.column),
                    std::max(high, at.column - (at.at_border ? 1 : 0)));
            low = high = at.column;
        });
        if (first <= last) include(last, low, high);
    }

    template <typename Canvas>
    void paint(Canvas& canvas) {
        for (std::int32_t row = low_row_; row <= high_row_; ++row) {
            const Span at = span(row);
            const std::int32_t low = std::max(at.low, 0);
            const std::int32_t high = std::min(at.high, grid_.columns - 1);
            if (low <= high) canvas.run(row, low, high);
        }
    }

    GridFrame grid_;
    Locator locator_;
    SmallPolygon small_;
    std::vector<Span> spans_;
    std::int32_t low_row_ = 0;
    std::int32_t high_row_ = -1;
};

}  // namespace semmap
