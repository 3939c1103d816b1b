// Exact sums and products of doubles, as expansions: sums of doubles that do not overlap, the
// smallest first (Shewchuk, Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
// Predicates, 1997, section 2). Exact while no product leaves the range of doubles: magnitudes
// between 1e-60 and 1e60 are safe for products of four. Compile without contraction to FMA.
#pragma once

#include <cstddef>

namespace semmap::exact {

struct Pair {
    double high;
    double low;
};

inline Pair two_sum(double a, double b) {
    const double sum = a + b;
    const double part_b = sum - a;
    const double part_a = sum - part_b;
    return {sum, (a - part_a) + (b - part_b)};
}

inline Pair split(double a) {
    const double shifted = 134217729.0 * a;  // 2^27 + 1
    const double high = shifted - (shifted - a);
    return {high, a - high};
}

inline Pair two_product(double a, double b) {
    const double product = a * b;
    const Pair x = split(a);
    const Pair y = split(b);
    const double error = ((product - x.high * y.high) - x.low * y.high) - x.high * y.low;
    return {product, x.low * y.low - error};
}

// At most N terms; zeros are left out, so that count == 0 is the number zero.
template <std::size_t N>
struct Expansion {
    double term[N];
    std::size_t count = 0;

    Expansion() = default;
    Expansion(double value) { add(value); }  // NOLINT: a double is one
    Expansion(Pair pair) {                   // NOLINT
        push(pair.low);
        push(pair.high);
    }

    void push(double value) {
        if (value != 0.0) term[count++] = value;
    }

    // Shewchuk, Grow-Expansion with elimination of zeros.
    void add(double value) {
        std::size_t kept = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const Pair sum = two_sum(value, term[i]);
            value = sum.high;
            if (sum.low != 0.0) term[kept++] = sum.low;
        }
        if (value != 0.0) term[kept++] = value;
        count = kept;
    }

    int sign() const {
        if (count == 0) return 0;
        return term[count - 1] > 0.0 ? 1 : -1;
    }
};

template <std::size_t N, std::size_t M>
Expansion<N + M> operator+(const Expansion<N>& a, const Expansion<M>& b) {
    Expansion<N + M> sum;
    for (std::size_t i = 0; i < a.count; ++i) sum.term[i] = a.term[i];
    sum.count = a.count;
    for (std::size_t i = 0; i < b.count; ++i) sum.add(b.term[i]);
    return sum;
}

template <std::size_t N>
Expansion<N> operator-(Expansion<N> a) {
    for (std::size_t i = 0; i < a.count; ++i) a.term[i] = -a.term[i];
    return a;
}

template <std::size_t N, std::size_t M>
Expansion<N + M> operator-(const Expansion<N>& a, const Expansion<M>& b) {
    return a + (-b);
}

template <std::size_t N, std::size_t M>
Expansion<2 * N * M> operator*(const Expansion<N>& a, const Expansion<M>& b) {
    Expansion<2 * N * M> product;
    for (std::size_t i = 0; i < a.count; ++i) {
        for (std::size_t j = 0; j < b.count; ++j) {
            const Pair part = two_product(a.term[i], b.term[j]);
            if (part.low != 0.0) product.add(part.low);
            product.add(part.high);
        }
    }
    return product;
}

}  // namespace semmap::exact
