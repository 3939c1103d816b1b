// A cube is a byte that names this format, then records of its blocks of 8 x 8 x 8 in ascending
// order, each: its kind, its number in the cube (z fastest), and
//   on, off         how many blocks of one value and state follow each other, and the value
//   one             which voxels are active (64 bytes), and their one value; others are background
//   each            which are active, and their values one by one; others are background
//   all             which are active, and all 512 values
// Numbers are little-endian. The first kind that fits is taken, and runs are as long as they can
// be, so that equal cubes have equal bytes. Values are compared by their bits: OpenVDB's own
// pruning takes -0 for 0.
#include "semmap/fields/blocks.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "spread.hpp"

namespace semmap::fields {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "bytes are kept as they lie in memory");
static_assert(sizeof(bool) == 1 && sizeof(Words) == 64);

constexpr char kFormat = 1;
enum Kind : char { on, off, one, each, all };

template <typename Value>
bool same(const Value& a, const Value& b) {
    return std::memcmp(&a, &b, sizeof a) == 0;
}

void expect_edge(int edge) {
    for (int known = 8; known <= 128; known *= 2) {
        if (edge == known) return;
    }
    throw std::invalid_argument("cubes have an edge of 8, 16, 32, 64 or 128 voxels");
}

// A block of 8 x 8 x 8, or a run of equal ones.
template <typename Value>
struct Record {
    Coord cube;
    std::uint16_t number;
    std::uint16_t run;
    const typename Grid<Value>::Tree::LeafNodeType* leaf;  // none: a tile
    Value value;
    bool active;
};

template <typename Value>
class Writer {
  public:
    explicit Writer(Value background) : background_(background) {}

    void add(const Record<Value>& record) {
        if (record.leaf == nullptr) {
            add_run(record.number, record.run, record.value, record.active);
            return;
        }
        Content<Value> content;
        read_leaf(*record.leaf, content);
        const Words& active = content.active;
        const auto& values = content.values;
        const bool none = is_empty(active);
        if (none || is_full(active)) {
            const auto differs = [&](const Value& v) { return !same(v, values[0]); };
            if (std::none_of(values.begin(), values.end(), differs)) {
                add_run(record.number, 1, values[0], !none);
                return;
            }
        }
        bool plain = true;
        std::size_t count = 0;
        for (std::size_t i = 0; i < kVoxels; ++i) {
            if (is_on(active, i)) {
                chosen_[count++] = values[i];
            } else {
                plain = plain && same(values[i], background_);
            }
        }
        finish_run();
        if (!plain) {
            put_head(all, record.number);
            put(active);
            for (const Value& value : values) put(value);
            return;
        }
        const auto begin = chosen_.cbegin();
        const auto end = begin + static_cast<std::ptrdiff_t>(count);
        const bool single =
            std::all_of(begin, end, [&](const Value& v) { return same(v, chosen_[0]); });
        put_head(single ? one : each, record.number);
        put(active);
        for (auto v = begin; v != (single ? begin + 1 : end); ++v) put(*v);
    }

    std::string finish() {
        finish_run();
        return std::move(bytes_);
    }

  private:
    template <typename T>
    void put(const T& what) {
        bytes_.append(reinterpret_cast<const char*>(&what), sizeof what);
    }
    void put_head(Kind kind, std::uint16_t number) {
        if (bytes_.empty()) bytes_.push_back(kFormat);
        bytes_.push_back(kind);
        put(number);
    }
    void add_run(std::uint16_t number, std::uint16_t count, Value value, bool active) {
        if (run_.run > 0 && run_.number + run_.run == number && same(run_.value, value) &&
            run_.active == active) {
            run_.run = static_cast<std::uint16_t>(run_.run + count);
            return;
        }
        finish_run();
        if (active || !same(value, background_)) run_ = {{}, number, count, nullptr, value, active};
    }
    void finish_run() {
        if (run_.run == 0) return;
        put_head(run_.active ? on : off, run_.number);
        put(run_.run);
        put(run_.value);
        run_.run = 0;
    }

    Value background_;
    std::string bytes_;
    std::array<Value, kVoxels> chosen_;
    Record<Value> run_{};
};

// Reads bytes from the front; throws if there are too few.
class Reader {
  public:
    explicit Reader(const std::string& bytes) : at_(bytes.data()), end_(at_ + bytes.size()) {}

    bool done() const { return at_ == end_; }
    template <typename T>
    T take() {
        if (static_cast<std::size_t>(end_ - at_) < sizeof(T)) refuse();
        T what;
        std::memcpy(&what, at_, sizeof what);
        at_ += sizeof what;
        return what;
    }
    [[noreturn]] static void refuse() {
        throw std::invalid_argument("these bytes are not a cube of a grid of this type");
    }

  private:
    const char* at_;
    const char* end_;
};

template <typename Value>
Value take_value(Reader& in) {
    if constexpr (std::is_same_v<Value, bool>) {
        const auto byte = in.take<std::uint8_t>();
        if (byte > 1) Reader::refuse();
        return byte == 1;
    } else {
        return in.take<Value>();
    }
}

template <typename Value>
void put_leaf(Grid<Value>& grid, const Coord& origin, Kind kind, Reader& in) {
    const auto active = in.take<Words>();
    auto* leaf = grid.tree().touchLeaf(origin);
    Value value = kind == one ? take_value<Value>(in) : grid.background();
    for (std::size_t i = 0; i < kVoxels; ++i) {
        const bool here = is_on(active, i);
        if (kind == all || (kind == each && here)) value = take_value<Value>(in);
        const auto n = static_cast<openvdb::Index>(i);
        if (here) {
            leaf->setValueOn(n, value);
        } else {
            leaf->setValueOff(n, kind == all ? value : grid.background());
        }
    }
}

template <typename Value>
void put_block(Grid<Value>& grid, const Coord& cube, const std::string& bytes, int edge) {
    const int side = edge / kBlock;
    const int most = side * side * side;
    const auto place = [&](int n) -> Coord {
        return cube + (Coord(n / (side * side), n / side % side, n % side) << 3);
    };
    Reader in(bytes);
    if (in.take<char>() != kFormat) Reader::refuse();
    int next = 0;
    while (!in.done()) {
        const auto kind = static_cast<Kind>(in.take<char>());
        const int first = in.take<std::uint16_t>();
        if (kind < on || kind > all || first < next) Reader::refuse();
        const int run = kind == on || kind == off ? in.take<std::uint16_t>() : 1;
        next = first + run;
        if (run < 1 || next > most) Reader::refuse();
        if (kind != on && kind != off) {
            put_leaf(grid, place(first), kind, in);
            continue;
        }
        const auto value = take_value<Value>(in);
        if (run == most && edge == 128) {
            grid.tree().addTile(2, cube, value, kind == on);
            continue;
        }
        for (int n = first; n < next; ++n) {
            grid.tree().addTile(1, place(n), value, kind == on);
        }
    }
}

}  // namespace

template <typename Value>
Blocks blocks_of(const Grid<Value>& grid, int edge) {
    expect_edge(edge);
    const int side = edge / kBlock;
    const auto whole = static_cast<std::uint16_t>(side * side * side);
    const auto cube_of = [&](const Coord& at) { return at & ~(edge - 1); };
    const auto number_of = [&](const Coord& at) {
        const Coord in = (at & (edge - 1)) >> 3;
        return static_cast<std::uint16_t>((in.x() * side + in.y()) * side + in.z());
    };
    std::vector<Record<Value>> records;
    const auto add = [&records](const Record<Value>& record) {
        if (static_cast<std::int64_t>(records.size()) == kMostBlocks) {
            throw BadRegion("the grid has too many blocks to be kept: crop it");
        }
        records.push_back(record);
    };
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
        const Coord at = leaf->origin();
        add({cube_of(at), number_of(at), 1, &*leaf, Value{}, false});
    }
    auto tile = grid.tree().cbeginValueAll();
    tile.setMaxDepth(Grid<Value>::Tree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
        const Value value = *tile;
        const bool active = tile.isValueOn();
        if (!active && same(value, grid.background())) continue;
        const CoordBBox box = tile.getBoundingBox();
        const bool small = box.dim().x() < edge;
        const int step = small ? kBlock : edge;
        each_cube(box, step, [&](const Coord& at) {
            add({cube_of(at), number_of(at), small ? std::uint16_t{1} : whole, nullptr, value,
                 active});
        });
    }
    std::sort(records.begin(), records.end(), [](const auto& a, const auto& b) {
        return std::tie(a.cube, a.number) < std::tie(b.cube, b.number);
    });
    Blocks blocks;
    for (std::size_t i = 0; i < records.size();) {
        const Coord cube = records[i].cube;
        Writer<Value> writer(grid.background());
        for (; i < records.size() && records[i].cube == cube; ++i) writer.add(records[i]);
        std::string bytes = writer.finish();
        if (!bytes.empty()) blocks.emplace_hint(blocks.end(), cube, std::move(bytes));
    }
    return blocks;
}

template <typename Value>
void put_blocks(Grid<Value>& grid, const Blocks& blocks, int edge) {
    expect_edge(edge);
    Spread spread(grid.tree());
    for (const auto& [cube, bytes] : blocks) {
        for (const std::int32_t at : {cube.x(), cube.y(), cube.z()}) {
            if (at < -kFarthestVoxel || at >= kFarthestVoxel) Reader::refuse();
        }
        spread.add(cube);
        if ((cube & (edge - 1)) != Coord(0)) Reader::refuse();
        put_block(grid, cube, bytes, edge);
    }
}

#define SEMMAP_BLOCKS(Value)                            \
    template Blocks blocks_of(const Grid<Value>&, int); \
    template void put_blocks(Grid<Value>&, const Blocks&, int);
SEMMAP_BLOCKS(bool)
SEMMAP_BLOCKS(std::int32_t)
SEMMAP_BLOCKS(float)
#undef SEMMAP_BLOCKS

}  // namespace semmap::fields
