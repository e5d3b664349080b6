#include "elasticity/elastic_galerkin.hpp"

#include <algorithm>
#include <vector>

#include "common/parallel.hpp"
#include "elasticity/elastic_kernels.hpp"

namespace sono {
namespace {

using Lattice = std::array<std::size_t, 3>;

constexpr int kCorners = 8, kUnknowns = 24, kEntries = kUnknowns * kUnknowns;

std::size_t count(const Lattice &n) { return n[0] * n[1] * n[2]; }
std::size_t number(const Lattice &n, const Lattice &at) { return (at[0] * n[1] + at[1]) * n[2] + at[2]; }
std::size_t bit(int corner, int axis) { return static_cast<std::size_t>(corner >> (2 - axis)) & 1; }

// The place of an offset among those stored; -1 of those that come before.
int place_of(int x, int y, int z) {
    const int place = 9 * x + 3 * y + z;
    return place < 0 ? -1 : place;
}

// Where a fine cell lies in its coarse one along an axis.
enum Part : int { low, high, whole };

// Share of each end of the coarse cell in the value at each end of the fine one.
constexpr float kShares[3][2][2] = {{{1, 0}, {.5f, .5f}}, {{.5f, .5f}, {0, 1}}, {{1, 0}, {0, 1}}};

// Fine cells [first, first + count) of a coarse one along an axis.
struct Children {
    std::size_t first, count;
    Part part(std::size_t child) const { return count == 1 ? whole : child == 0 ? low : high; }
};

Children children(std::size_t fine, std::size_t coarse, std::size_t cell) {
    if (fine == coarse) return {cell, 1};
    return {2 * cell, std::min<std::size_t>(2, fine - 2 * cell)};
}

// The fine node a coarse one is.
std::size_t nested(std::size_t fine_nodes, std::size_t coarse_nodes, std::size_t node) {
    return fine_nodes == coarse_nodes ? node : std::min(2 * node, fine_nodes - 1);
}

struct Parents {
    std::size_t node[2];
    float share[2];
    int count;
};

Parents parents(std::size_t fine_nodes, std::size_t coarse_nodes, std::size_t node) {
    if (fine_nodes == coarse_nodes) return {{node, 0}, {1, 0}, 1};
    if (node + 1 == fine_nodes) return {{coarse_nodes - 1, 0}, {1, 0}, 1};
    if (node % 2 == 0) return {{node / 2, 0}, {1, 0}, 1};
    return {{node / 2, node / 2 + 1}, {.5f, .5f}, 2};
}

// Interpolation (fine corner, coarse corner) of a fine cell.
struct Interpolation {
    float share[kCorners][kCorners];

    explicit Interpolation(const Part (&part)[3]) {
        for (int f = 0; f < kCorners; ++f)
            for (int c = 0; c < kCorners; ++c) {
                share[f][c] = 1;
                for (int a = 0; a < 3; ++a) share[f][c] *= kShares[part[a]][bit(f, a)][bit(c, a)];
            }
    }
    void drop_fine(int corner) { std::fill_n(share[corner], kCorners, 0.f); }
    void drop_coarse(int corner) {
        for (auto &row : share) row[corner] = 0;
    }

    // out += P^T matrix P, for each pair of components
    void add(const float *matrix, float *out) const {
        for (int ab = 0; ab < 9; ++ab) {
            const std::size_t start = static_cast<std::size_t>(ab / 3) * kCorners * kUnknowns + ab % 3 * kCorners;
            float half[kCorners][kCorners] = {};
            for (int f = 0; f < kCorners; ++f)
                for (int g = 0; g < kCorners; ++g)
                    for (int c = 0; c < kCorners; ++c)
                        half[f][c] += matrix[start + static_cast<std::size_t>(f) * kUnknowns + g] * share[g][c];
            for (int f = 0; f < kCorners; ++f)
                for (int c = 0; c < kCorners; ++c)
                    if (share[f][c] != 0)
                        for (int g = 0; g < kCorners; ++g)
                            out[start + static_cast<std::size_t>(c) * kUnknowns + g] += share[f][c] * half[f][g];
        }
    }
};

// Calls body(plane) for all planes, never for two neighbours at once, and in an order that threads do not change what
// is added to a node in.
template <class Body> void by_planes(std::size_t planes, const Body &body) {
    for (const std::size_t odd : {0, 1})
        parallel_for((planes + 1 - odd) / 2, [&](std::size_t half) { body(2 * half + odd); });
}

// What cells of unit moduli become in their coarse cell, for each place in it, where all corners move.
class Whole {
  public:
    Whole(const float *dilatation, const float *distortion) : matrices_(27 * 2 * kEntries) {
        for (int kind = 0; kind < 27; ++kind) {
            const Interpolation from({Part(kind / 9), Part(kind / 3 % 3), Part(kind % 3)});
            from.add(dilatation, at(kind));
            from.add(distortion, at(kind) + kEntries);
        }
    }
    void add(const Part (&part)[3], float lame, float shear, float *out) const {
        const float *const first = matrices_.data() + offset(9 * part[0] + 3 * part[1] + part[2]);
        const float *const second = first + kEntries;
        for (int i = 0; i < kEntries; ++i) out[i] += lame * first[i] + shear * second[i];
    }

  private:
    static std::size_t offset(int kind) { return static_cast<std::size_t>(kind) * 2 * kEntries; }
    float *at(int kind) { return matrices_.data() + offset(kind); }
    std::vector<float> matrices_;
};

// Corners of a cell, by number.
Lattice corner(const Lattice &cell, int c) { return {cell[0] + bit(c, 0), cell[1] + bit(c, 1), cell[2] + bit(c, 2)}; }

// Adds the matrix of a coarse cell to the blocks of its nodes.
void scatter(const float *matrix, const Lattice &nodes, const Lattice &cell, float *out) {
    const std::size_t all = count(nodes);
    for (int c = 0; c < kCorners; ++c) {
        const std::size_t at = number(nodes, corner(cell, c));
        for (int g = 0; g < kCorners; ++g) {
            int to[3];
            for (int a = 0; a < 3; ++a) to[a] = static_cast<int>(bit(g, a)) - static_cast<int>(bit(c, a));
            const int place = place_of(to[0], to[1], to[2]);
            if (place < 0) continue;
            for (int ab = 0; ab < 9; ++ab)
                out[static_cast<std::size_t>(9 * place + ab) * all + at] +=
                    matrix[(ab / 3 * kCorners + c) * kUnknowns + ab % 3 * kCorners + g];
        }
    }
}

// Coarse cells of fine ones: each is the sum of what its children become.
class CoarseCells {
  public:
    CoarseCells(const GalerkinCells &fine, const Lattice &coarse)
        : fine_(fine), nodes_{fine.cells[0] + 1, fine.cells[1] + 1, fine.cells[2] + 1}, coarse_(coarse),
          cells_{coarse[0] - 1, coarse[1] - 1, coarse[2] - 1},
          dilatation_(fine.dilatation, fine.dilatation + kEntries),
          distortion_(fine.distortion, fine.distortion + kEntries), all_move_(dilatation_.data(), distortion_.data()) {}

    const Lattice &cells() const { return cells_; }
    void matrix_of(const Lattice &cell, float *matrix) const {
        Children of[3];
        for (int a = 0; a < 3; ++a) of[a] = children(fine_.cells[a], cells_[a], cell[a]);
        const Fixed dead = fixed_corners(cell);
        std::fill_n(matrix, kEntries, 0.f);
        for (std::size_t x = 0; x < of[0].count; ++x)
            for (std::size_t y = 0; y < of[1].count; ++y)
                for (std::size_t z = 0; z < of[2].count; ++z)
                    add_child({of[0].first + x, of[1].first + y, of[2].first + z},
                              {of[0].part(x), of[1].part(y), of[2].part(z)}, dead, matrix);
    }

  private:
    struct Fixed {
        bool corner[kCorners], any;
    };
    bool fixed(const Lattice &node) const { return fine_.fixed[number(nodes_, node)] != 0; }
    Fixed fixed_corners(const Lattice &cell) const {
        Fixed found{};
        for (int c = 0; c < kCorners; ++c) {
            Lattice at = corner(cell, c);
            for (int a = 0; a < 3; ++a) at[a] = nested(nodes_[a], coarse_[a], at[a]);
            found.any |= found.corner[c] = fixed(at);
        }
        return found;
    }
    void add_child(const Lattice &child, const Part (&part)[3], const Fixed &dead, float *matrix) const {
        const std::size_t at = number(fine_.cells, child);
        const float lame = fine_.lame[at], shear = fine_.shear[at];
        Interpolation from(part);
        bool cut = dead.any;
        for (int f = 0; f < kCorners; ++f)
            if (fixed(corner(child, f))) from.drop_fine(f), cut = true;
        if (!cut) return all_move_.add(part, lame, shear, matrix);
        for (int c = 0; c < kCorners; ++c)
            if (dead.corner[c]) from.drop_coarse(c);
        float own[kEntries];
        for (int i = 0; i < kEntries; ++i) own[i] = lame * dilatation_[i] + shear * distortion_[i];
        from.add(own, matrix);
    }

    const GalerkinCells &fine_;
    const Lattice nodes_, coarse_, cells_;
    const std::vector<float> dilatation_, distortion_;
    const Whole all_move_;
};

// A coarse stencil of a fine one: each block of a fine node goes to the pairs of its ends' parents.
class CoarseStencil {
  public:
    CoarseStencil(const float *fine, const Lattice &nodes, const Lattice &coarse, float *out)
        : fine_(fine), nodes_(nodes), coarse_(coarse), all_(count(nodes)), all_coarse_(count(coarse)), out_(out) {}

    void add_node(const Lattice &node) const {
        if (!moves(node)) return;
        const std::size_t at = number(nodes_, node);
        const Shares mine = shares(node);
        float block[9];
        for (int d = 0; d < kStencilHalf; ++d) {
            const StencilOffset &to = kStencilOffsets[d];
            const Lattice next{node[0] + static_cast<std::size_t>(to.x), node[1] + static_cast<std::size_t>(to.y),
                               node[2] + static_cast<std::size_t>(to.z)};
            if (next[0] >= nodes_[0] || next[1] >= nodes_[1] || next[2] >= nodes_[2] || !moves(next)) continue;
            for (int ab = 0; ab < 9; ++ab) block[ab] = fine_[static_cast<std::size_t>(9 * d + ab) * all_ + at];
            const Shares its = shares(next);
            for (int p = 0; p < mine.count; ++p)
                for (int q = 0; q < its.count; ++q) {
                    add(mine.of[p], its.of[q], block, false);
                    if (d > 0) add(its.of[q], mine.of[p], block, true);
                }
        }
    }

  private:
    struct Share {
        Lattice node;
        float share;
    };
    struct Shares {
        Share of[kCorners];
        int count;
    };
    bool moves(const Lattice &node) const { return fine_[number(nodes_, node)] > 0; }
    // Of a fine node in the coarse ones that move.
    Shares shares(const Lattice &node) const {
        Parents of[3];
        for (int a = 0; a < 3; ++a) of[a] = parents(nodes_[a], coarse_[a], node[a]);
        Shares found;
        found.count = 0;
        for (int x = 0; x < of[0].count; ++x)
            for (int y = 0; y < of[1].count; ++y)
                for (int z = 0; z < of[2].count; ++z) {
                    const Lattice parent{of[0].node[x], of[1].node[y], of[2].node[z]};
                    Lattice same;
                    for (int a = 0; a < 3; ++a) same[a] = nested(nodes_[a], coarse_[a], parent[a]);
                    if (moves(same))
                        found.of[found.count++] = {parent, of[0].share[x] * of[1].share[y] * of[2].share[z]};
                }
        return found;
    }
    void add(const Share &from, const Share &to, const float *block, bool turned) const {
        int apart[3];
        for (int a = 0; a < 3; ++a) apart[a] = static_cast<int>(to.node[a]) - static_cast<int>(from.node[a]);
        const int place = place_of(apart[0], apart[1], apart[2]);
        if (place < 0) return;
        const std::size_t at = number(coarse_, from.node);
        for (int ab = 0; ab < 9; ++ab)
            out_[static_cast<std::size_t>(9 * place + ab) * all_coarse_ + at] +=
                from.share * to.share * block[turned ? ab % 3 * 3 + ab / 3 : ab];
    }

    const float *const fine_;
    const Lattice nodes_, coarse_;
    const std::size_t all_, all_coarse_;
    float *const out_;
};

}  // namespace

void galerkin_of_cells(const GalerkinCells &fine, const Lattice &coarse, float *out) {
    const CoarseCells of(fine, coarse);
    std::fill_n(out, kStencilFloats * count(coarse), 0.f);
    by_planes(of.cells()[0], [&](std::size_t plane) {
        float matrix[kEntries];
        for (std::size_t j = 0; j < of.cells()[1]; ++j)
            for (std::size_t k = 0; k < of.cells()[2]; ++k) {
                of.matrix_of({plane, j, k}, matrix);
                scatter(matrix, coarse, {plane, j, k}, out);
            }
    });
}

void galerkin_of_stencil(const float *fine, const Lattice &nodes, const Lattice &coarse, float *out) {
    const CoarseStencil of(fine, nodes, coarse, out);
    std::fill_n(out, kStencilFloats * count(coarse), 0.f);
    // Nodes of a group of fine planes, with the neighbours after them, have their parents in two coarse planes.
    by_planes(coarse[0] - 1, [&](std::size_t group) {
        const Children planes = children(nodes[0] - 1, coarse[0] - 1, group);
        const std::size_t end = group + 2 == coarse[0] ? nodes[0] : planes.first + planes.count;
        for (std::size_t i = planes.first; i < end; ++i)
            for (std::size_t j = 0; j < nodes[1]; ++j)
                for (std::size_t k = 0; k < nodes[2]; ++k) of.add_node({i, j, k});
    });
}

}  // namespace sono
