#include "semmap/occupancy.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "closedness.hpp"
#include "painter.hpp"
#include "slabs.hpp"
#include "small_polygon.hpp"
#include "team.hpp"

namespace semmap {
namespace {

constexpr std::size_t kVertexChunk = 65536;
constexpr std::size_t kFaceChunk = 8192;

// Where a vertex is: column, row, the place of its height, nothing. Vectors, so that three vertices
// are compared at once.
typedef std::int16_t ShortPlacing __attribute__((vector_size(8)));  // for grids that short is
typedef std::int32_t Placing __attribute__((vector_size(16)));

template <typename Vector>
bool same(const Vector& a, const Vector& b) {
    return std::memcmp(&a, &b, sizeof a) == 0;
}

// The intervals in which a cell is occupied, one bit each.
template <typename Bits>
struct MaskCanvas {
    Bits* cells;
    std::size_t columns;
    Bits bits = 0;

    void choose(Mask intervals) { bits = static_cast<Bits>(intervals); }

    void run(std::int32_t row, std::int32_t first, std::int32_t last) {
        Bits* line = cells + static_cast<std::size_t>(row) * columns;
        if constexpr (sizeof(Bits) == 1) {
            // Runs are short: eight cells at once cost no more than one.
            if (last - first < 8 && static_cast<std::size_t>(first) + 8 <= columns) {
                std::uint64_t eight;
                std::memcpy(&eight, line + first, 8);
                eight |= (bits * std::uint64_t{0x0101010101010101}) >> (56 - 8 * (last - first));
                std::memcpy(line + first, &eight, 8);
                return;
            }
        }
        for (std::int32_t column = first; column <= last; ++column) line[column] |= bits;
    }

    void upright(std::int32_t column, std::int32_t first, std::int32_t last) {
        Bits* cell = cells + static_cast<std::size_t>(first) * columns + column;
        for (std::int32_t row = first; row <= last; ++row, cell += columns) *cell |= bits;
    }

    static constexpr Bits kEmpty = 0;
    static Bits join(Bits a, Bits b) { return static_cast<Bits>(a | b); }
};

// A face that a fill plane cuts.
struct Cut {
    std::uint32_t plane;
    std::int32_t solid;
    std::size_t face;
};

// The winding number changes by `turn` to the right of a column, in a row's lower border.
struct Turn {
    std::int32_t row;
    std::int32_t column;
    std::int32_t turn;
};

// Throws for a vertex that the mesh does not have.
template <typename Index>
[[noreturn]] void refuse_vertex(const MeshView<Index>& mesh) {
    throw std::invalid_argument(mesh.vertex_count == 0 ? "there are faces, but no vertices"
                                                       : "faces name vertices 0 to " +
                                                             std::to_string(mesh.vertex_count - 1));
}

template <typename Index, typename Canvas, typename Placed>
class Drawing {
  public:
    Drawing(const MeshView<Index>& mesh, const std::vector<Interval>& intervals,
            const GridFrame& grid, const Fill& fill, const Team& team)
        : mesh_(mesh), slabs_(intervals), grid_(grid), fill_(fill), team_(team) {}

    template <typename Cell>
    void draw(Cell* cells) {
        const std::size_t count = grid_.cells();
        std::fill(cells, cells + count, Canvas::kEmpty);
        std::vector<std::unique_ptr<Cell[]>> own;  // the first thread draws into the answer
        for (unsigned i = 0; i < team_.size(); ++i) {
            Cell* canvas = cells;
            if (i > 0) {
                own.emplace_back(new Cell[count]);
                canvas = own.back().get();
                std::fill(canvas, canvas + count, Canvas::kEmpty);
            }
            members_.emplace_back(grid_, Canvas{canvas, static_cast<std::size_t>(grid_.columns)});
        }
        place_vertices();
        draw_faces();
        if (fill_.any) fill_solids();
        team_.share(count, 1 << 16, [&](unsigned, std::size_t a, std::size_t b) {
            for (const auto& other : own) {
                for (std::size_t i = a; i < b; ++i) cells[i] = Canvas::join(cells[i], other[i]);
            }
        });
    }

  private:
    typedef double Pair __attribute__((vector_size(16)));
    typedef std::int64_t Longs __attribute__((vector_size(16)));
    using Whole = std::decay_t<decltype(Placed{}[0])>;

    struct Member {
        Member(const GridFrame& grid, Canvas canvas) : painter(grid), canvas(canvas) {}
        Painter painter;
        Canvas canvas;
        std::vector<Cut> cuts;
        std::vector<std::size_t> beyond;  // groups of cuts that may have an inside of their own
        // The last rectangle: neighbours in an upright wall draw the same.
        Placed low{};
        Placed high{};
    };

    void place_vertices() {
        places_.reset(new Place[mesh_.vertex_count]);
        placed_.reset(new Placed[mesh_.vertex_count]);
        team_.share(
            mesh_.vertex_count, kVertexChunk, [&](unsigned, std::size_t first, std::size_t last) {
                const bool near = slabs_.planes.size() <= 2 ? place_vertices<true>(first, last)
                                                            : place_vertices<false>(first, last);
                if (near) return;
                throw std::invalid_argument(
                    "vertices are finite and within 1e30 m: fix or leave out those that are not");
            });
    }

    // False where a coordinate is too far away, or none.
    template <bool kBetweenTwo>
    bool place_vertices(std::size_t first, std::size_t last) {
        const Locator locator(grid_);
        // What is in the lowest plane and the highest, and above.
        const Pair planes{slabs_.planes.front(), slabs_.planes.back()};
        const Longs counted{-1, slabs_.planes.size() == 1 ? 0 : -1};
        Place* __restrict places = places_.get();
        Placed* __restrict placed = placed_.get();
        const Longs sign = Longs{} + std::numeric_limits<std::int64_t>::max();
        const double* vertices = mesh_.vertices;
        Longs near{};
        for (std::size_t i = first; i < last; ++i) {
            const double* p = vertices + 3 * i;
            Pair at;
            std::memcpy(&at, p, sizeof at);
            const Pair height{p[2], p[2]};
            near -= (Pair)((Longs)at & sign) <= kFarthest;
            near -= (Pair)((Longs)height & sign) <= kFarthest;
            Place place;
            if (kBetweenTwo) {
                const Longs reached = ((height >= planes) + (height > planes)) & counted;
                place = static_cast<Place>(-(reached[0] + reached[1]));
            } else {
                place = slabs_.place(p[2]);
            }
            places[i] = place;
            const Spot spot = locator.spot(p);
            placed[i] =
                Placed{static_cast<Whole>(spot.column), static_cast<Whole>(spot.row), place, 0};
        }
        const auto all = static_cast<std::int64_t>(2 * (last - first));
        return near[0] == all && near[1] == all;
    }

    Corner corner_of(std::size_t vertex, const Locator& locator) const {
        const Placed at = placed_[vertex];
        return locator.vertex(mesh_.vertices + 3 * vertex, {at[0], at[1]});
    }

    void draw_faces() {
        team_.share(mesh_.face_count, kFaceChunk,
                    [&](unsigned thread, std::size_t first, std::size_t last) {
                        std::array<std::uint32_t, kFaceChunk> inside;
                        const std::size_t count = select(first, last, inside.data());
                        for (std::size_t i = 0; i < count; ++i) {
                            draw_face(first + inside[i], members_[thread]);
                        }
                    });
    }

    // The faces, counted from the first, that reach between the lowest and the highest plane.
    std::size_t select(std::size_t first, std::size_t last, std::uint32_t* inside) {
        using Unsigned = std::make_unsigned_t<Index>;
        const unsigned all_above = 3u * slabs_.top - 1;  // a sum of places, less one; of 0 the most
        std::size_t count = 0;
        for (std::size_t f = first; f < last; ++f) {
            const Index* face = mesh_.faces + 3 * f;
            const std::size_t i = static_cast<Unsigned>(face[0]);
            const std::size_t j = static_cast<Unsigned>(face[1]);
            const std::size_t k = static_cast<Unsigned>(face[2]);
            if ((i >= mesh_.vertex_count) | (j >= mesh_.vertex_count) | (k >= mesh_.vertex_count)) {
                refuse_vertex(mesh_);
            }
            const Place a = places_[i];
            const Place b = places_[j];
            const Place c = places_[k];
            inside[count] = static_cast<std::uint32_t>(f - first);
            count += static_cast<unsigned>(a + b + c - 1) < all_above;
        }
        return count;
    }

    std::int32_t solid_of(std::size_t face) const {
        return mesh_.solids == nullptr ? 0 : mesh_.solids[face];
    }

    bool is_filled(std::int32_t solid) const {
        return fill_.of_solid == nullptr || fill_.of_solid[solid] != 0;
    }

    void draw_face(std::size_t f, Member& member) {
        const Index* face = mesh_.faces + 3 * f;
        const Placed a = placed_[face[0]];
        const Placed b = placed_[face[1]];
        const Placed c = placed_[face[2]];
        const Placed lower = a < b ? a : b;
        const Placed upper = a < b ? b : a;
        const Placed low = lower < c ? lower : c;
        const Placed high = upper < c ? c : upper;
        const std::int32_t solid = solid_of(f);
        const auto lowest = static_cast<Place>(low[2]);
        const auto highest = static_cast<Place>(high[2]);

        const bool only = slabs_.slabs.size() == 1;
        const std::size_t first_slab = only ? 0 : slabs_.first_from[lowest];
        std::size_t end_slab = only ? 1 : first_slab;
        Mask intervals = only ? slabs_.slabs[0].intervals : 0;
        for (; end_slab < slabs_.slabs.size() && slabs_.slabs[end_slab].low_place <= highest;
             ++end_slab) {
            intervals |= slabs_.slabs[end_slab].intervals;
        }
        if (end_slab == first_slab) return;
        if (fill_.any && is_filled(solid)) {
            for (std::size_t i = 0; i < slabs_.fills.size(); ++i) {
                const FillPlane& plane = slabs_.fills[i];
                // Within a row a section does not turn.
                if (lowest <= plane.place && plane.place < highest && low[1] != high[1]) {
                    member.cuts.push_back({static_cast<std::uint32_t>(i), solid, f});
                }
                if (lowest <= plane.reach && plane.reach < highest) {
                    member.beyond.push_back(group_of(i, solid));
                }
            }
        }

        const std::int32_t low_column = low[0];
        const std::int32_t high_column = high[0];
        const std::int32_t low_row = low[1];
        const std::int32_t high_row = high[1];
        if ((high_row < 0) | (high_column < 0) | (low_row >= grid_.rows) |
            (low_column >= grid_.columns)) {
            return;
        }
        const bool one_row = low_row == high_row;
        const bool one_column = low_column == high_column;
        const Slab& slab = slabs_.slabs[first_slab];
        const bool whole =
            end_slab == first_slab + 1 && lowest >= slab.low_place && highest <= slab.high_place;
        if ((one_row & one_column) || (whole && (one_row | one_column))) {
            if (same(low, member.low) && same(high, member.high)) return;
            member.low = low;
            member.high = high;
            member.canvas.choose(intervals);
            member.painter.rectangle(low_row, high_row, low_column, high_column, member.canvas);
            return;
        }
        const Extent extent{low_row, high_row, low_column, high_column};
        if (whole && extent.is_small(grid_)) {
            const double* at = mesh_.vertices;
            member.canvas.choose(intervals);
            if (member.painter.small().triangle(at + 3 * face[0], at + 3 * face[1],
                                                at + 3 * face[2], extent, member.canvas)) {
                return;
            }
        }
        const Locator& locator = member.painter.locator();
        std::array<Corner, 3> corner{corner_of(face[0], locator), corner_of(face[1], locator),
                                     corner_of(face[2], locator)};
        if (whole) {
            member.canvas.choose(intervals);
            member.painter.whole(corner[0], corner[1], corner[2], member.canvas);
            return;
        }
        std::array<Place, 3> place{static_cast<Place>(a[2]), static_cast<Place>(b[2]),
                                   static_cast<Place>(c[2])};
        if (place[0] > place[1]) swap(0, 1, corner, place);
        if (place[1] > place[2]) swap(1, 2, corner, place);
        if (place[0] > place[1]) swap(0, 1, corner, place);
        if (one_row | one_column) {
            const Slab* first = slabs_.slabs.data() + first_slab;
            const Slab* end = slabs_.slabs.data() + end_slab;
            const auto draw = [&](const Slab& each, auto low, auto high) {
                member.canvas.choose(each.intervals);
                if (one_row) {
                    member.painter.rectangle(low_row, low_row, low, high, member.canvas);
                } else {
                    member.painter.rectangle(low, high, low_column, low_column, member.canvas);
                }
            };
            if (one_row) {
                member.painter.template strip<0>(corner, place, first, end, draw);
            } else {
                member.painter.template strip<1>(corner, place, first, end, draw);
            }
            return;
        }
        std::array<Corner, 2> bottom{corner[0], corner[0]};
        for (std::size_t i = first_slab; i < end_slab; ++i) {
            const Slab& each = slabs_.slabs[i];
            const bool cut = place[0] < each.low_place && each.low_place < place[2];
            if (cut && (i == first_slab || slabs_.slabs[i - 1].high_place != each.low_place)) {
                bottom = Painter::section(locator, corner, place, each.low, each.low_place);
            }
            member.canvas.choose(each.intervals);
            member.painter.clipped(corner, place, each, bottom, member.canvas);
        }
    }

    static void swap(int i, int j, std::array<Corner, 3>& corner, std::array<Place, 3>& place) {
        std::swap(corner[i], corner[j]);
        std::swap(place[i], place[j]);
    }

    std::size_t group_of(std::size_t plane, std::int32_t solid) const {
        return static_cast<std::size_t>(solid) * slabs_.fills.size() + plane;
    }

    // Fills each closed solid by the winding number of its section just above each fill plane.
    void fill_solids() {
        // A cell that is inside throughout an interval is inside beyond it, too.
        const std::size_t planes = slabs_.fills.size();
        std::vector<std::uint8_t> beyond(fill_.solid_count * planes, 0);
        for (const Member& member : members_) {
            for (const std::size_t group : member.beyond) beyond[group] = 1;
        }
        std::vector<Cut> cuts;
        std::vector<std::uint8_t> closed(fill_.solid_count, 0);
        for (const Member& member : members_) {
            for (const Cut& cut : member.cuts) {
                if (beyond[group_of(cut.plane, cut.solid)] == 0) continue;
                cuts.push_back(cut);
                closed[static_cast<std::size_t>(cut.solid)] = 1;
            }
        }
        if (cuts.empty()) return;
        keep_closed(mesh_, team_, closed);

        // Cuts of a solid and plane side by side.
        std::vector<std::size_t> start(beyond.size() + 1, 0);
        for (const Cut& cut : cuts) ++start[group_of(cut.plane, cut.solid) + 1];
        for (std::size_t i = 1; i < start.size(); ++i) start[i] += start[i - 1];
        std::vector<Cut> grouped(cuts.size());
        std::vector<std::size_t> next = start;
        for (const Cut& cut : cuts) grouped[next[group_of(cut.plane, cut.solid)]++] = cut;

        team_.share(start.size() - 1, 16,
                    [&](unsigned thread, std::size_t first, std::size_t last) {
                        for (std::size_t i = first; i < last; ++i) {
                            if (start[i] == start[i + 1] || closed[i / planes] == 0) continue;
                            fill_group(grouped.data() + start[i], grouped.data() + start[i + 1],
                                       members_[thread]);
                        }
                    });
    }

    void fill_group(const Cut* first, const Cut* last, Member& member) const {
        std::vector<Turn> turns;
        for (const Cut* cut = first; cut != last; ++cut) {
            add_turns(*cut, slabs_.fills[cut->plane], member.painter, turns);
        }
        if (turns.empty()) return;
        member.canvas.choose(slabs_.fills[first->plane].intervals);
        std::sort(turns.begin(), turns.end(), [](const Turn& a, const Turn& b) {
            return a.row != b.row ? a.row < b.row : a.column < b.column;
        });
        for (std::size_t i = 0; i < turns.size();) {
            const std::int32_t row = turns[i].row;
            std::int32_t winding = 0;
            for (; i < turns.size() && turns[i].row == row; ++i) {
                winding += turns[i].turn;
                const bool more = i + 1 < turns.size() && turns[i + 1].row == row;
                // Turns beside the grid are in columns -1 and grid_.columns.
                const std::int32_t from = std::max(turns[i].column + 1, 0);
                const std::int32_t to =
                    more ? std::min(turns[i + 1].column, grid_.columns - 1) : grid_.columns - 1;
                if (winding != 0 && from <= to) member.canvas.run(row, from, to);
            }
        }
    }

    // The section of a face just above a plane runs from the edge that falls through it to the
    // edge that rises, so that sections of neighbours make closed curves.
    void add_turns(const Cut& cut, const FillPlane& plane, const Painter& painter,
                   std::vector<Turn>& turns) const {
        const Locator& locator = painter.locator();
        std::array<Corner, 3> corner;
        std::array<Place, 3> place;
        for (int i = 0; i < 3; ++i) {
            const auto vertex = static_cast<std::size_t>(mesh_.faces[3 * cut.face + i]);
            corner[i] = corner_of(vertex, locator);
            place[i] = places_[vertex];
        }
        const double error = Painter::error_of(corner[0], corner[1], corner[2]);
        Corner from{};
        Corner to{};
        for (int i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3;
            const bool rises = place[i] <= plane.place && plane.place < place[j];
            const bool falls = place[j] <= plane.place && plane.place < place[i];
            if (!rises && !falls) continue;
            const int low = rises ? i : j;
            const int high = rises ? j : i;
            Corner& point = rises ? to : from;
            point = place[low] == plane.place
                        ? corner[low]
                        : locator.pass(corner[low], corner[high], plane.height, error);
        }
        if (from.row == to.row) return;
        const bool up = from.row < to.row;
        const Corner& p = up ? from : to;
        const Corner& q = up ? to : from;
        const std::int32_t first = std::max(p.row + 1, 0);
        const std::int32_t last = std::min(q.row, grid_.rows - 1);
        const std::int32_t turn = up ? 1 : -1;
        if (p.column == q.column) {
            for (std::int32_t row = first; row <= last; ++row) {
                turns.push_back({row, p.column, turn});
            }
            return;
        }
        locator.crossings(p, q, first, last, error, [&](std::int32_t row, Crossing at) {
            turns.push_back({row, at.column, turn});
        });
    }

    const MeshView<Index>& mesh_;
    const Slabs slabs_;
    const GridFrame grid_;
    const Fill& fill_;
    const Team& team_;
    std::vector<Member> members_;
    std::unique_ptr<Place[]> places_;
    std::unique_ptr<Placed[]> placed_;
};

template <typename Canvas, typename Cell, typename Index>
void draw(const MeshView<Index>& mesh, const std::vector<Interval>& intervals,
          const GridFrame& grid, const Fill& fill, const Team& team, Cell* cells) {
    if (std::max(grid.rows, grid.columns) < std::numeric_limits<std::int16_t>::max()) {
        Drawing<Index, Canvas, ShortPlacing>(mesh, intervals, grid, fill, team).draw(cells);
    } else {
        Drawing<Index, Canvas, Placing>(mesh, intervals, grid, fill, team).draw(cells);
    }
}

template <typename Bits, typename Index>
void draw_layers(const MeshView<Index>& mesh, const std::vector<Interval>& intervals,
                 const GridFrame& grid, const Fill& fill, const Team& team, std::uint8_t* cells) {
    const std::size_t count = grid.cells();
    const std::unique_ptr<Bits[]> masks(new Bits[count]);
    draw<MaskCanvas<Bits>>(mesh, intervals, grid, fill, team, masks.get());
    team.share(count, 4096, [&](unsigned, std::size_t first, std::size_t last) {
        for (std::size_t k = 0; k < intervals.size(); ++k) {
            const Bits* __restrict mask = masks.get();
            std::uint8_t* __restrict layer = cells + k * count;
            const Bits bit = static_cast<Bits>(Bits{1} << k);
            for (std::size_t i = first; i < last; ++i) layer[i] = (mask[i] & bit) != 0;
        }
    });
}

}  // namespace

template <typename Index>
void occupancy(const MeshView<Index>& mesh, const std::vector<Interval>& intervals,
               const GridFrame& grid, const Fill& fill, unsigned threads, std::uint8_t* cells) {
    const Team team(threads);
    if (intervals.empty()) return;
    if (intervals.size() == 1) {
        draw<MaskCanvas<std::uint8_t>>(mesh, intervals, grid, fill, team, cells);
    } else if (intervals.size() <= 8) {
        draw_layers<std::uint8_t>(mesh, intervals, grid, fill, team, cells);
    } else {
        draw_layers<Mask>(mesh, intervals, grid, fill, team, cells);
    }
}

template <typename Index>
void closed_solids(const MeshView<Index>& mesh, std::size_t solid_count, unsigned threads,
                   std::uint8_t* closed) {
    for (std::size_t i = 0; i < 3 * mesh.face_count; ++i) {
        if (static_cast<std::size_t>(mesh.faces[i]) >= mesh.vertex_count) refuse_vertex(mesh);
    }
    std::vector<std::uint8_t> all(solid_count, 1);
    keep_closed(mesh, Team(threads), all);
    std::copy(all.begin(), all.end(), closed);
}

#define SEMMAP_FOR_INDEX(Index)                                                      \
    template void occupancy(const MeshView<Index>&, const std::vector<Interval>&,    \
                            const GridFrame&, const Fill&, unsigned, std::uint8_t*); \
    template void closed_solids(const MeshView<Index>&, std::size_t, unsigned, std::uint8_t*);

SEMMAP_FOR_INDEX(std::int32_t)
SEMMAP_FOR_INDEX(std::int64_t)

}  // namespace semmap
