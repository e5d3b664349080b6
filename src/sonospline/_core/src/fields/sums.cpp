#include "fields/sums.hpp"

#include <algorithm>
#include <vector>

#include "common/parallel.hpp"

namespace sono {
namespace {

// Below this many (point, centre) pairs a second thread costs more than it saves.
constexpr std::size_t kPairsWorthAThread = 200'000;

template <class T> class CentreStore {
  public:
    explicit CentreStore(const KernelSum &sum) : data_(6 * sum.count), count_(sum.count) {
        for (std::size_t j = 0; j < count_; ++j)
            for (int a = 0; a < 3; ++a) {
                data_[a * count_ + j] = static_cast<T>(sum.centres[3 * j + a]);
                data_[(3 + a) * count_ + j] = static_cast<T>(sum.weights[3 * j + a]);
            }
    }
    Centres<T> view() const {
        const T *d = data_.data();
        const std::size_t n = count_;
        return {d, d + n, d + 2 * n, d + 3 * n, d + 4 * n, d + 5 * n, n};
    }

  private:
    std::vector<T> data_;
    std::size_t count_;
};

template <class T> void sum_tile(const KernelSum &sum, const Tile<T> &p, const Centres<T> &c, Tile<T> &out) {
    const double *a = sum.affine;
    T *const component[3] = {out.x, out.y, out.z};
    for (int b = 0; b < 3; ++b) {
        const T a0 = T(a[b]), ax = T(a[3 + b]), ay = T(a[6 + b]), az = T(a[9 + b]);
        for (int i = 0; i < kTile; ++i) component[b][i] = a0 + ax * p.x[i] + ay * p.y[i] + az * p.z[i];
    }
    if constexpr (sizeof(T) == 4)
        kernels().sum_f32(sum.kernel, p, c, out);
    else
        kernels().sum_f64(sum.kernel, p, c, out);
}

// Fills the tile from `from` (m left), repeating the last point in the unused lanes.
template <class T> void fill_tile(const double *from, std::size_t left, Tile<T> &tile) {
    for (int i = 0; i < kTile; ++i) {
        const double *p = from + 3 * std::min<std::size_t>(i, left - 1);
        tile.x[i] = T(p[0]), tile.y[i] = T(p[1]), tile.z[i] = T(p[2]);
    }
}

template <class T> void write_tile(const Tile<T> &tile, std::size_t left, T *out) {
    const std::size_t used = std::min<std::size_t>(kTile, left);
    for (std::size_t i = 0; i < used; ++i)
        out[3 * i] = tile.x[i], out[3 * i + 1] = tile.y[i], out[3 * i + 2] = tile.z[i];
}

// Splits m points into blocks of whole tiles, several blocks a thread so that a
// busy core does not hold up the rest.
template <class Body> void over_tiles(std::size_t m, std::size_t centres, const Body &body) {
    const std::size_t tiles = (m + kTile - 1) / kTile;
    const std::size_t blocks =
        m * centres < kPairsWorthAThread ? 1 : std::min<std::size_t>(tiles, 16 * thread_count());
    parallel_for(blocks, [&](std::size_t block) {
        const std::size_t first = tiles * block / blocks, last = tiles * (block + 1) / blocks;
        for (std::size_t tile = first; tile < last; ++tile) body(tile * kTile);
    });
}

}  // namespace

template <class T>
void sum_at_points(const KernelSum &sum, const double *points, std::size_t m, T *out) {
    const CentreStore<T> store(sum);
    const Centres<T> centres = store.view();
    over_tiles(m, sum.count, [&](std::size_t start) {
        Tile<T> p, u;
        fill_tile(points + 3 * start, m - start, p);
        sum_tile(sum, p, centres, u);
        write_tile(u, m - start, out + 3 * start);
    });
}

template <class T>
void sum_on_lattice(const KernelSum &sum, const std::array<std::size_t, 3> &shape,
                    const std::array<double, 3> &spacing, T *out) {
    const CentreStore<T> store(sum);
    const Centres<T> centres = store.view();
    const std::size_t m = shape[0] * shape[1] * shape[2];
    over_tiles(m, sum.count, [&](std::size_t start) {
        Tile<T> p, u;
        std::size_t k = start % shape[2], j = start / shape[2] % shape[1], i = start / shape[2] / shape[1];
        for (int lane = 0; lane < kTile; ++lane) {
            p.x[lane] = T(i * spacing[0]), p.y[lane] = T(j * spacing[1]), p.z[lane] = T(k * spacing[2]);
            if (++k == shape[2]) {
                k = 0;
                if (++j == shape[1]) j = 0, ++i;
            }
        }
        sum_tile(sum, p, centres, u);
        write_tile(u, m - start, out + 3 * start);
    });
}

void gradient_at_points(const KernelSum &sum, const double *points, std::size_t m, double *out) {
    const CentreStore<double> store(sum);
    const Centres<double> centres = store.view();
    over_tiles(m, 3 * sum.count, [&](std::size_t start) {
        Tile<double> p;
        alignas(64) double gradient[9][kTile];
        fill_tile(points + 3 * start, m - start, p);
        kernels().gradient_f64(sum.kernel, p, centres, gradient);
        const std::size_t used = std::min<std::size_t>(kTile, m - start);
        for (std::size_t i = 0; i < used; ++i)
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b)
                    out[9 * (start + i) + 3 * a + b] = gradient[3 * a + b][i] + sum.affine[3 * (b + 1) + a];
    });
}

void kelvinlet_sum(const Kelvinlet &kernel, const double *points, std::size_t m, const double *centres,
                   const double *forces, std::size_t n, double *out) {
    const CentreStore<double> store(KernelSum{{}, centres, forces, n, nullptr});
    const Centres<double> view = store.view();
    over_tiles(m, 2 * n, [&](std::size_t start) {
        Tile<double> p, u;
        fill_tile(points + 3 * start, m - start, p);
        kernels().kelvinlet_f64(kernel, p, view, u);
        write_tile(u, m - start, out + 3 * start);
    });
}

void kernel_matrix(Kernel kernel, const double *points, std::size_t m, const double *centres, std::size_t n,
                   double *out) {
    // One tile of columns at a time: rows of the result are contiguous in the centres.
    over_tiles(n, m, [&](std::size_t start) {
        Tile<double> c;
        alignas(64) double value[kTile];
        fill_tile(centres + 3 * start, n - start, c);
        const std::size_t used = std::min<std::size_t>(kTile, n - start);
        for (std::size_t i = 0; i < m; ++i) {
            kernels().values_f64(kernel, c, points + 3 * i, value);
            std::copy(value, value + used, out + i * n + start);
        }
    });
}

template void sum_at_points<float>(const KernelSum &, const double *, std::size_t, float *);
template void sum_at_points<double>(const KernelSum &, const double *, std::size_t, double *);
template void sum_on_lattice<float>(const KernelSum &, const std::array<std::size_t, 3> &,
                                    const std::array<double, 3> &, float *);
template void sum_on_lattice<double>(const KernelSum &, const std::array<std::size_t, 3> &,
                                     const std::array<double, 3> &, double *);

}  // namespace sono
