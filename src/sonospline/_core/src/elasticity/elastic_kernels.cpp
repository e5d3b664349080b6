// Element forces by Walsh-Hadamard modes. With X_m the sum over the corners of a cell of
// u_x times the sign of the mode m (x, y, z, yz, xz, xy, xyz), the strain energy is a short
// sum of squares of modes, and its derivatives go back to the corners by the same signs: a
// cell costs about 200 operations and no matrix. A sweep goes through the cells once, plane
// after plane, and acts on each node as soon as its eighth cell is done.
#include "elasticity/elastic_kernels.hpp"

#include <cstring>
#include <utility>

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr int kWidth = lanes<float>;
constexpr std::ptrdiff_t kFlush = 32 * kWidth;  // terms summed in float before they join a double

// The four modes in a plane of one component, and, after the law, its four corner forces.
struct Four {
    VecF plain, y, z, yz;
};

inline Four operator+(const Four &a, const Four &b) { return {a.plain + b.plain, a.y + b.y, a.z + b.z, a.yz + b.yz}; }
inline Four operator-(const Four &a, const Four &b) { return {a.plain - b.plain, a.y - b.y, a.z - b.z, a.yz - b.yz}; }

// Forces on the low-low, low-high, high-low and high-high corner (along y, z) of the plane.
inline Four corners(const Four &f) {
    const VecF low = f.plain - f.y, high = f.plain + f.y, low_z = f.z - f.yz, high_z = f.z + f.yz;
    return {low - low_z, low + low_z, high - high_z, high + high_z};
}

// The modes in a plane of cells q to q + kWidth, from the nodes u around them.
inline Four plane_modes(const float *u, std::ptrdiff_t row) {
    const VecF a = load(u), b = load(u + 1), c = load(u + row), d = load(u + row + 1);
    const VecF low = a + b, high = c + d, low_z = b - a, high_z = d - c;
    return {low + high, high - low, low_z + high_z, high_z - low_z};
}

// The values one place before those of `now`, whose predecessors are `before`.
template <int... I> inline VecF delayed(VecF before, VecF now, std::integer_sequence<int, I...>) {
    return __builtin_shufflevector(before, now, (kWidth - 1 + I)...);
}

// Derivatives of the strain energy of a cell by its modes: sums and differences along x.
struct CellForces {
    Four sum, difference;
};

template <bool kCube, bool kFull> struct Law {
    float x, y, z;                          // inverse sides
    float xx2, yy2, zz2;                    // 2 x^2 and so on
    float xy, xz, yx, yz, zx, zy;           // 2 x^2 + y^2 and so on
    float xyz[3];                           // 2 x^2 + y^2 + z^2, cyclic

    explicit Law(const float i[3]) : x(i[0]), y(i[1]), z(i[2]) {
        const float a = x * x, b = y * y, c = z * z;
        xx2 = 2 * a, yy2 = 2 * b, zz2 = 2 * c;
        xy = 2 * a + b, xz = 2 * a + c, yx = 2 * b + a, yz = 2 * b + c, zx = 2 * c + a, zy = 2 * c + b;
        xyz[0] = 2 * a + b + c, xyz[1] = 2 * b + a + c, xyz[2] = 2 * c + a + b;
    }

    // s, d: sums and differences along x of the modes in the plane, of u_x, u_y, u_z
    void operator()(VecF lame, VecF shear, const Four s[3], const Four d[3], CellForces f[3]) const {
        if (kCube) return cube(lame, shear, s, d, f);
        const VecF third = shear * (1 / 3.f), ninth = shear * (1 / 9.f);
        const VecF dilatation = lame * (x * d[0].plain + y * s[1].y + z * s[2].z);
        const VecF xy_ = shear * (y * s[0].y + x * d[1].plain), xz_ = shear * (z * s[0].z + x * d[2].plain),
                   yz_ = shear * (z * s[1].z + y * s[2].y);
        const VecF p = third * (y * s[0].yz + x * d[1].z), q = third * (z * s[0].yz + x * d[2].y),
                   r = third * (z * d[1].z + y * d[2].y);
        f[0].difference.plain = x * dilatation + xx2 * (shear * d[0].plain);
        f[1].sum.y = y * dilatation + yy2 * (shear * s[1].y);
        f[2].sum.z = z * dilatation + zz2 * (shear * s[2].z);
        f[0].sum.y = y * xy_, f[1].difference.plain = x * xy_;
        f[0].sum.z = z * xz_, f[2].difference.plain = x * xz_;
        f[1].sum.z = z * yz_, f[2].sum.y = y * yz_;
        f[0].sum.yz = y * p + z * q;
        f[1].difference.z = x * p + z * r;
        f[2].difference.y = x * q + y * r;
        f[0].difference.y = xy * (third * d[0].y), f[2].sum.yz = zy * (third * s[2].yz);
        f[0].difference.z = xz * (third * d[0].z), f[1].sum.yz = yz * (third * s[1].yz);
        f[1].difference.y = yx * (third * d[1].y), f[2].difference.z = zx * (third * d[2].z);
        for (int a = 0; a < 3; ++a) f[a].difference.yz = xyz[a] * (ninth * d[a].yz);
        if (kFull) {
            const VecF l3 = lame * (1 / 3.f), l9 = lame * (1 / 9.f);
            const VecF e1 = l3 * (x * d[0].y + z * s[2].yz), e2 = l3 * (x * d[0].z + y * s[1].yz),
                       e3 = l3 * (y * d[1].y + z * d[2].z);
            f[0].difference.y += x * e1, f[2].sum.yz += z * e1;
            f[0].difference.z += x * e2, f[1].sum.yz += y * e2;
            f[1].difference.y += y * e3, f[2].difference.z += z * e3;
            f[0].difference.yz += x * x * l9 * d[0].yz;
            f[1].difference.yz += y * y * l9 * d[1].yz;
            f[2].difference.yz += z * z * l9 * d[2].yz;
        }
    }

    // The same with all sides equal, and their inverse square taken into the moduli.
    void cube(VecF lame, VecF shear, const Four s[3], const Four d[3], CellForces f[3]) const {
        const VecF third = shear * (1 / 3.f), corner = shear * (4 / 9.f) + (kFull ? lame * (1 / 9.f) : VecF{});
        const VecF dilatation = lame * (d[0].plain + s[1].y + s[2].z), twice = shear + shear;
        const VecF yz_third = third * s[0].yz, xz_third = third * d[1].z, xy_third = third * d[2].y;
        const VecF all = yz_third + xz_third + xy_third;
        f[0].difference.plain = dilatation + twice * d[0].plain;
        f[1].sum.y = dilatation + twice * s[1].y;
        f[2].sum.z = dilatation + twice * s[2].z;
        f[0].sum.y = f[1].difference.plain = shear * (s[0].y + d[1].plain);
        f[0].sum.z = f[2].difference.plain = shear * (s[0].z + d[2].plain);
        f[1].sum.z = f[2].sum.y = shear * (s[1].z + s[2].y);
        f[0].sum.yz = yz_third + all, f[1].difference.z = xz_third + all, f[2].difference.y = xy_third + all;
        f[0].difference.y = shear * d[0].y, f[2].sum.yz = shear * s[2].yz;
        f[0].difference.z = shear * d[0].z, f[1].sum.yz = shear * s[1].yz;
        f[1].difference.y = shear * d[1].y, f[2].difference.z = shear * d[2].z;
        for (int a = 0; a < 3; ++a) f[a].difference.yz = corner * d[a].yz;
        if (kFull) {
            const VecF l3 = lame * (1 / 3.f);
            const VecF e1 = l3 * (d[0].y + s[2].yz), e2 = l3 * (d[0].z + s[1].yz), e3 = l3 * (d[1].y + d[2].z);
            f[0].difference.y += e1, f[2].sum.yz += e1;
            f[0].difference.z += e2, f[1].sum.yz += e2;
            f[1].difference.y += e3, f[2].difference.z += e3;
        }
    }
};

// What the cells of a row pushed on the row of nodes above them, kept until that row is reached: a ring of places,
// each of a vector for either plane of nodes and each component.
class Above {
  public:
    Above(float *memory, std::ptrdiff_t row)
        : memory_(memory), end_(memory + whole(row) * kPlace + kPlace), put_(memory), take_(memory + kPlace),
          window_(static_cast<int>(whole(row) * kWidth - row)) {
        std::memset(memory, 0, sizeof(float) * static_cast<std::size_t>(size(row)));
    }
    static std::ptrdiff_t size(std::ptrdiff_t row) { return (whole(row) + 2) * kPlace; }

    void put(int which, VecF value) {
        store(put_ + which * kWidth, value);
        if (put_ == memory_) store(end_ + which * kWidth, value);  // so that no vector wraps round
    }
    // From the cells one row before those that put now.
    VecF take(int which) const { return window_(take_ + which * kWidth, kPlace); }
    void advance() {
        if ((put_ += kPlace) == end_) put_ = memory_;
        if ((take_ += kPlace) == end_) take_ = memory_;
    }

  private:
    static constexpr std::ptrdiff_t kPlace = 6 * kWidth;
    static std::ptrdiff_t whole(std::ptrdiff_t row) { return (row + kWidth - 1) / kWidth; }

    float *const memory_, *const end_;
    float *put_;
    const float *take_;
    const Window window_;
};

// Gathers, for one component and one plane of nodes, what four rows of cells push on them.
struct Gather {
    VecF low{}, high{};  // of the cells before, at their high z

    VecF operator()(Above &above, int which, const Four &corner) {
        constexpr std::make_integer_sequence<int, kWidth> all;
        above.put(which, corner.z + delayed(high, corner.yz, all));  // first: short rows take from this very vector
        const VecF force = corner.plain + delayed(low, corner.y, all) + above.take(which);
        low = corner.y, high = corner.yz;
        return force;
    }
};

// The nodes of a plane, and what a sweep does there. Copied into a loop, whose stores then cannot change it.
template <Sweep kSweep> struct Plane {
    const float *in, *b, *inverse_diagonal, *springs;
    float *d, *out;
    std::ptrdiff_t component;
    float momentum, step;

    Plane(const ElasticCells &cells, const ElasticSweep &work, std::size_t i)
        : component(cells.component), momentum(work.momentum), step(work.step) {
        const std::ptrdiff_t shift = static_cast<std::ptrdiff_t>(i) * cells.plane;
        in = work.in + shift, b = work.b + shift, inverse_diagonal = work.inverse_diagonal + shift;
        d = work.d + shift, out = work.out + shift;
        springs = cells.springs ? cells.springs + shift : nullptr;
    }

    VecF whole(int a, std::ptrdiff_t q, VecF force) const {
        const std::ptrdiff_t at = a * component + q;
        VecF moved = kSweep == Sweep::smooth ? load(d + at) : VecF{}, result;
        const VecF dot = act(at, force, moved, result);
        if (kSweep == Sweep::smooth) store(d + at, moved);
        store(out + at, result);
        return dot;
    }

    // At most `count` nodes: the padding or another range of rows lies beyond them.
    double some(int a, std::ptrdiff_t q, VecF force, std::ptrdiff_t count) const {
        const std::ptrdiff_t at = a * component + q;
        VecF moved = kSweep == Sweep::smooth ? load(d + at) : VecF{}, result;
        const VecF dot = act(at, force, moved, result);
        double total = 0;
        for (std::ptrdiff_t lane = 0; lane < count; ++lane) {
            if (kSweep == Sweep::smooth) d[at + lane] = moved[lane];
            out[at + lane] = result[lane];
            total += dot[lane];
        }
        return total;
    }

    VecF act(std::ptrdiff_t at, VecF force, VecF &moved, VecF &result) const {
        const VecF value = load(in + at);
        if (springs) force += load(springs + at) * value;
        if constexpr (kSweep == Sweep::product) {
            result = force;
            return value * force;
        } else {
            const VecF right = load(b + at), inverse = load(inverse_diagonal + at);
            if constexpr (kSweep == Sweep::residual) {
                result = inverse > 0.f ? right - force : VecF{};
                return value * right;
            } else {
                moved = momentum * moved + step * inverse * (right - force);
                result = value + moved;
                return result * right;
            }
        }
    }
};

inline double sum(VecF v) {
    double total = 0;
    for (int lane = 0; lane < kWidth; ++lane) total += v[lane];
    return total;
}

// One sweep over some nodes. A plane's values are read before any of them is written, so
// `out` may be `in` where a sweep has all rows and planes.
template <Sweep kSweep, bool kCube, bool kFull> class Sweeper {
  public:
    Sweeper(const ElasticCells &cells, const ElasticSweep &work)
        : cells_(cells), work_(work), law_(cells.inverse), scale_(kCube ? cells.inverse[0] * cells.inverse[0] : 1),
          begin_(work.first - (cells.row + kWidth) / kWidth * kWidth),  // the row of cells below, and a cell more
          right_(work.scratch + Above::size(cells.row)) {}

    double run() {
        if (work_.begin)
            slab<false>(work_.begin - 1);
        else
            std::memset(right_, 0, 3 * sizeof(float) * static_cast<std::size_t>(work_.last - begin_ + kWidth));
        double total = 0;
        for (std::size_t i = work_.begin; i < work_.end; ++i) total += i + 1 < cells_.planes ? slab<true>(i) : last(i);
        return total;
    }

  private:
    // Cells between planes i and i + 1. Their push on plane i + 1 goes to right_; where kNodes, their push on
    // plane i completes the forces there.
    template <bool kNodes> double slab(std::size_t i) const {
        const Plane<kSweep> plane(cells_, work_, i);
        const std::ptrdiff_t row = cells_.row, next = cells_.plane, first = work_.first, last = work_.last;
        const float *const lame = cells_.lame + static_cast<std::ptrdiff_t>(i) * next, *const shear = lame + cells_.component;
        const Law<kCube, kFull> law = law_;
        const float scale = scale_;
        float *right = right_;
        Above above(work_.scratch, row);
        Gather gather[6];
        double total = 0;
        VecF dot{};
        std::ptrdiff_t summed = 0;
        for (std::ptrdiff_t q = begin_; q < last; q += kWidth, right += 3 * kWidth, above.advance()) {
            Four sums[3], differences[3];
            for (int a = 0; a < 3; ++a) {
                const float *const at = plane.in + a * plane.component + q;
                const Four low = plane_modes(at, row), high = plane_modes(at + next, row);
                sums[a] = low + high, differences[a] = high - low;
            }
            CellForces force[3];
            law(scale * load(lame + q), scale * load(shear + q), sums, differences, force);
            VecF pushed[3];
            for (int a = 0; a < 3; ++a) {
                force[a].sum.plain = VecF{};  // a cell that only moves resists nothing
                const VecF before = load(right + a * kWidth);
                store(right + a * kWidth, gather[a](above, a, corners(force[a].sum + force[a].difference)));
                if (kNodes)
                    pushed[a] = before + gather[3 + a](above, 3 + a, corners(force[a].sum - force[a].difference));
            }
            if (!kNodes || q < first) continue;
            if (q + kWidth <= last) {
                for (int a = 0; a < 3; ++a) dot += plane.whole(a, q, pushed[a]);
                if ((summed += kWidth) == kFlush) total += sum(dot), dot = VecF{}, summed = 0;
            } else {
                for (int a = 0; a < 3; ++a) total += plane.some(a, q, pushed[a], last - q);
            }
        }
        return total + sum(dot);
    }

    // The last plane has no cells beyond it.
    double last(std::size_t i) const {
        const Plane<kSweep> plane(cells_, work_, i);
        double total = 0;
        const float *right = right_ + 3 * (work_.first - begin_);
        for (std::ptrdiff_t q = work_.first; q < work_.last; q += kWidth, right += 3 * kWidth)
            for (int a = 0; a < 3; ++a)
                total += plane.some(a, q, load(right + a * kWidth), work_.last - q < kWidth ? work_.last - q : kWidth);
        return total;
    }

    const ElasticCells &cells_;
    const ElasticSweep &work_;
    const Law<kCube, kFull> law_;
    const float scale_;
    const std::ptrdiff_t begin_;
    float *const right_;  // three components side by side, a vector each
};

template <Sweep kSweep> double sweep_of(const ElasticCells &cells, const ElasticSweep &work) {
    const float *i = cells.inverse;
    const bool cube = i[0] == i[1] && i[1] == i[2];
    if (cube && cells.full) return Sweeper<kSweep, true, true>(cells, work).run();
    if (cube) return Sweeper<kSweep, true, false>(cells, work).run();
    if (cells.full) return Sweeper<kSweep, false, true>(cells, work).run();
    return Sweeper<kSweep, false, false>(cells, work).run();
}

double sweep(Sweep kind, const ElasticCells &cells, const ElasticSweep &work) {
    switch (kind) {
        case Sweep::product: return sweep_of<Sweep::product>(cells, work);
        case Sweep::residual: return sweep_of<Sweep::residual>(cells, work);
        default: return sweep_of<Sweep::smooth>(cells, work);
    }
}

void start(const ElasticCells &cells, const ElasticSweep &work) {
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = work.begin; i < work.end; ++i) {
            const std::ptrdiff_t at = a * cells.component + static_cast<std::ptrdiff_t>(i) * cells.plane;
            const float *const b = work.b + at, *const inverse = work.inverse_diagonal + at;
            float *const d = work.d + at, *const out = work.out + at;
            for (std::ptrdiff_t q = work.first; q < work.last; ++q) out[q] = d[q] = work.step * inverse[q] * b[q];
        }
}

}  // namespace

extern const ElasticKernels elastic;
const ElasticKernels elastic = {sweep, start};

}  // namespace SONO_ISA
}  // namespace sono
