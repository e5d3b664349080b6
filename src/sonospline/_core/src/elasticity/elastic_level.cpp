#include "elasticity/elastic_level.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/row_kernels.hpp"

namespace sono {
namespace {

constexpr std::size_t kAlone = 34 * 34 * 34;  // nodes up to which one thread is faster than several
constexpr std::size_t kStencilAlone = kAlone / 4;  // of an explicit operator, which takes longer
constexpr std::ptrdiff_t kTileNodes = 4096;        // nodes of a plane in one block: its values stay in the cache
constexpr int kPowerIterations = 15;
constexpr double kMargin = 1.1, kRange = 20;

std::ptrdiff_t round_up(std::ptrdiff_t n) { return (n + kElasticLanes - 1) / kElasticLanes * kElasticLanes; }

const ElasticKernels &inner() { return *kernels().elastic; }
const RowKernels &row_loops() { return *kernels().rows; }

}  // namespace

Fields::Fields(std::size_t planes, std::ptrdiff_t plane, std::ptrdiff_t front)
    : size_(planes * static_cast<std::size_t>(plane)) {
    const std::size_t each = size_ + static_cast<std::size_t>(front);
    memory_ = Buffer<float>(3 * each + static_cast<std::size_t>(front));
    std::fill_n(memory_.data(), 3 * each + static_cast<std::size_t>(front), 0.f);
    for (int a = 0; a < 3; ++a) start_[a] = memory_.data() + front + static_cast<std::size_t>(a) * each;
}

AxisTransfer::AxisTransfer(std::size_t fine_cells, std::size_t coarse_cells, bool nested) {
    const double ratio = static_cast<double>(coarse_cells) / static_cast<double>(fine_cells);
    std::vector<std::vector<std::pair<std::size_t, float>>> seen(coarse_cells + 1);
    for (std::size_t i = 0; i <= fine_cells; ++i) {
        double at = static_cast<double>(i) * ratio;
        if (nested && coarse_cells < fine_cells)
            at = i == fine_cells ? static_cast<double>(coarse_cells) : static_cast<double>(i) / 2;
        const std::size_t first = std::min(static_cast<std::size_t>(at + 1e-9), coarse_cells - 1);
        const float second = static_cast<float>(std::max(at - static_cast<double>(first), 0.0));
        coarse.push_back(first), weight.push_back(second);
        if (second < 1) seen[first].emplace_back(i, 1 - second);
        if (second > 0) seen[first + 1].emplace_back(i, second);
    }
    for (const auto &list : seen) {
        starts.push_back(fine.size());
        for (const auto &[node, part] : list) fine.push_back(node), share.push_back(part);
    }
    starts.push_back(fine.size());
}

ElasticLevel::ElasticLevel(const ElasticLevelData &data)
    : shape_{data.cells[0] + 1, data.cells[1] + 1, data.cells[2] + 1}, some_fixed_(data.fixed) {
    lay_out(kAlone);
    take_moduli(data);
    find_diagonal(data);
}

ElasticLevel::ElasticLevel(const ElasticStencilData &data) : shape_(data.nodes), some_fixed_(true) {
    lay_out(kStencilAlone);
    take_blocks(data);
}

// Planes of values, their blocks for threads, and the vectors.
void ElasticLevel::lay_out(std::size_t most_alone) {
    const auto row = static_cast<std::ptrdiff_t>(shape_[2]), nodes = static_cast<std::ptrdiff_t>(shape_[1]) * row;
    front_ = round_up(row + 3 * kElasticLanes);
    cells_.planes = shape_[0], cells_.row = row, cells_.plane = round_up(nodes) + front_;
    cells_.component = front_ + static_cast<std::ptrdiff_t>(shape_[0]) * cells_.plane;
    const bool small = shape_[0] * shape_[1] * shape_[2] <= most_alone;
    const auto threads = static_cast<std::size_t>(thread_count());
    slabs_ = small || threads == 1 ? 1 : std::clamp<std::size_t>(shape_[0] / 4, 1, 2 * threads);
    tiles_ = small || most_alone != kAlone ? 1 : static_cast<std::size_t>((nodes + kTileNodes - 1) / kTileNodes);
    const auto tile = static_cast<std::ptrdiff_t>((shape_[1] + tiles_ - 1) / tiles_) * row;
    const std::size_t scratch = most_alone == kAlone ? elastic_scratch(tile, row) : stencil_scratch(nodes, row);
    scratch_size_ = static_cast<std::size_t>(round_up(static_cast<std::ptrdiff_t>(scratch)));
    scratch_ = Buffer<float>(scratch_size_ * blocks());
    inverse_diagonal_ = make_fields();
    b = make_fields(), x = make_fields(), d = make_fields(), residual = make_fields();
    if (!in_place()) other = make_fields();
}

void ElasticLevel::take_moduli(const ElasticLevelData &data) {
    cells_.full = data.full;
    double volume = 1;
    for (int a = 0; a < 3; ++a) cells_.inverse[a] = static_cast<float>(1 / data.spacing[a]), volume *= data.spacing[a];
    const auto each = static_cast<std::size_t>(cells_.component);
    memory_ = Buffer<float>(2 * each);
    std::fill_n(memory_.data(), 2 * each, 0.f);
    float *const lame = memory_.data() + front_, *const shear = lame + each;
    const float sixteenth = static_cast<float>(volume / 16);
    const float *from_lame = data.lame, *from_shear = data.shear;
    for (std::size_t i = 0; i < data.cells[0]; ++i)
        for (std::size_t j = 0; j < data.cells[1]; ++j)
            for (std::size_t k = 0; k < data.cells[2]; ++k, ++from_lame, ++from_shear) {
                lame[place(i, j, k)] = sixteenth * *from_lame;
                shear[place(i, j, k)] = sixteenth * *from_shear;
            }
    cells_.lame = lame;
    if (!data.springs) return;
    springs_ = make_fields();
    read(data.springs, springs_);
    cells_.springs = springs_[0];
}

// The same of a cell at each of its corners: eight neighbours, seen through the zeros around the cells.
void ElasticLevel::find_diagonal(const ElasticLevelData &data) {
    const auto on_pinned_face = [&](const std::size_t (&index)[3]) {
        for (int a = 0; a < 3; ++a)
            if ((index[a] == 0 && data.pinned[2 * a]) || (index[a] + 1 == shape_[a] && data.pinned[2 * a + 1])) return true;
        return false;
    };
    float squares[3], all = 0;
    for (int a = 0; a < 3; ++a) squares[a] = cells_.inverse[a] * cells_.inverse[a], all += squares[a];
    const std::ptrdiff_t plane = cells_.plane, row = cells_.row;
    parallel_for(shape_[0], [&](std::size_t i) {
        for (std::size_t j = 0; j < shape_[1]; ++j)
            for (std::size_t k = 0; k < shape_[2]; ++k) {
                if (on_pinned_face({i, j, k})) continue;
                if (data.fixed && data.fixed[(i * shape_[1] + j) * shape_[2] + k]) continue;
                const std::ptrdiff_t at = place(i, j, k);
                const float *const stiff = cells_.lame + cells_.component;
                float lame = 0, shear = 0;
                for (std::ptrdiff_t cell : {at, at - plane}) {
                    if (i == 0 && cell < at) continue;
                    lame += cells_.lame[cell] + cells_.lame[cell - 1] + cells_.lame[cell - row] + cells_.lame[cell - row - 1];
                    shear += stiff[cell] + stiff[cell - 1] + stiff[cell - row] + stiff[cell - row - 1];
                }
                for (int a = 0; a < 3; ++a)
                    inverse_diagonal_[a][at] = 1 / (lame * squares[a] * (cells_.full ? 16.f / 9 : 1.f) +
                                                    shear * (all + squares[a]) * (16.f / 9) +
                                                    (cells_.springs ? springs_[a][at] : 0));
            }
    });
}

void ElasticLevel::take_blocks(const ElasticStencilData &data) {
    const std::size_t nodes = shape_[1] * shape_[2], all = shape_[0] * nodes;
    stencil_.planes = cells_.planes, stencil_.row = cells_.row, stencil_.plane = cells_.plane;
    stencil_.component = cells_.component, stencil_.stride = round_up(static_cast<std::ptrdiff_t>(nodes) + 2);
    const auto stride = static_cast<std::size_t>(stencil_.stride), plane = static_cast<std::size_t>(cells_.plane);
    const std::size_t size = kStencilFloats * shape_[0] * stride;
    memory_ = Buffer<float>(size);
    std::fill_n(memory_.data(), size, 0.f);
    float *const blocks = memory_.data();
    parallel_for(shape_[0], [&](std::size_t i) {
        for (std::size_t number = 0; number < kStencilFloats; ++number) {
            const auto neighbour = static_cast<std::ptrdiff_t>(number / 9);
            const std::ptrdiff_t first = neighbour < 2 ? 0 : neighbour - (neighbour - 2) % 3, count = neighbour < 2 ? 2 : 3;
            float *const row = blocks + kStencilFloats * i * stride + (number - 9 * static_cast<std::size_t>(first)) * kElasticLanes;
            const float *const from = data.blocks + number * all + i * nodes;
            for (std::size_t q = 0; q < nodes; ++q)
                row[stencil_place(first, count, static_cast<std::ptrdiff_t>(q), stencil_.stride)] = from[q];
        }
        for (std::size_t a = 0; a < 3; ++a)
            for (std::size_t q = 0; q < nodes; ++q) {
                const float diagonal = data.blocks[4 * a * all + i * nodes + q];
                inverse_diagonal_[static_cast<int>(a)][i * plane + q] = diagonal > 0 ? 1 / diagonal : 0;
            }
    });
    stencil_.blocks = blocks;
}

std::ptrdiff_t ElasticLevel::place(std::size_t i, std::size_t j, std::size_t k) const {
    return static_cast<std::ptrdiff_t>(i) * cells_.plane + static_cast<std::ptrdiff_t>(j) * cells_.row +
           static_cast<std::ptrdiff_t>(k);
}

void ElasticLevel::read(const float *from, Fields &to) const {
    const std::size_t nodes = shape_[1] * shape_[2];
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = 0; i < shape_[0]; ++i, from += nodes) std::copy_n(from, nodes, to[a] + place(i, 0, 0));
}

void ElasticLevel::write(const Fields &from, float *to) const {
    const std::size_t nodes = shape_[1] * shape_[2];
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = 0; i < shape_[0]; ++i, to += nodes) std::copy_n(from[a] + place(i, 0, 0), nodes, to);
}

std::array<std::size_t, 2> ElasticLevel::slab(std::size_t number) const {
    return {number * shape_[0] / slabs_, (number + 1) * shape_[0] / slabs_};
}

std::array<std::size_t, 2> ElasticLevel::floats(std::size_t number) const {
    const auto plane = static_cast<std::size_t>(cells_.plane);
    return {slab(number)[0] * plane, (slab(number)[1] - slab(number)[0]) * plane};
}

void ElasticLevel::release_fixed(Fields &values) const {
    for (int a = 0; a < 3; ++a)
        row_loops().add_masked(0, values[a], inverse_diagonal_[a], values[a], values.size());
}

double ElasticLevel::sweep(Sweep kind, std::size_t block, const Fields &in, const Fields *right, Fields *direction,
                           Fields &out, float momentum, float step) {
    const auto planes = slab(block / tiles_);
    const std::size_t tile = block % tiles_;
    const ElasticSweep work{planes[0], planes[1],
                      static_cast<std::ptrdiff_t>(tile * shape_[1] / tiles_) * cells_.row,
                      static_cast<std::ptrdiff_t>((tile + 1) * shape_[1] / tiles_) * cells_.row,
                      in[0], right ? (*right)[0] : nullptr, inverse_diagonal_[0], direction ? (*direction)[0] : nullptr,
                      out[0], momentum, step, scratch_.data() + scratch_size_ * block};
    if (!stencil_.blocks) return inner().sweep(kind, cells_, work);
    kernels().stencil->sweep(kind, stencil_, work);
    return 0;  // only the finest level is asked for its dots
}

void ElasticLevel::start(std::size_t block, const Fields &right, Fields &direction, Fields &out, float step) {
    const auto planes = slab(block);
    ElasticSweep work{};
    work.begin = planes[0], work.end = planes[1];
    work.first = 0, work.last = static_cast<std::ptrdiff_t>(shape_[1]) * cells_.row;
    work.step = step;
    work.b = right[0], work.d = direction[0], work.out = out[0], work.inverse_diagonal = inverse_diagonal_[0];
    inner().start(cells_, work);
}

// Of D^-1 A, by power iteration from a fixed irregular vector: with |x| = 1 in the norm of D, |D^-1 A x| is a
// lower bound that grows.
double ElasticLevel::largest_eigenvalue() {
    std::uint32_t seed = 12345;
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = 0; i < shape_[0]; ++i)
            for (std::size_t j = 0; j < shape_[1]; ++j)
                for (std::size_t k = 0; k < shape_[2]; ++k) {
                    seed = seed * 1664525u + 1013904223u;
                    x[a][place(i, j, k)] = free(i, j, k) ? static_cast<float>(seed >> 16) / 65536 - 0.5f : 0.f;
                }
    double largest = 1;
    for (int iteration = 0; iteration < kPowerIterations; ++iteration) {
        parallel_for(blocks(), [&](std::size_t block) {
            sweep(Sweep::product, block, x, nullptr, nullptr, residual, 0, 0);
        });
        std::vector<double> parts(slabs());
        parallel_for(slabs(), [&](std::size_t slab) {
            const auto [at, n] = floats(slab);
            for (int a = 0; a < 3; ++a)
                for (std::size_t i = at; i < at + n; ++i)
                    parts[slab] += static_cast<double>(inverse_diagonal_[a][i] * residual[a][i]) * residual[a][i];
        });
        double squared = 0;
        for (double part : parts) squared += part;
        largest = std::sqrt(squared);
        const float scale = static_cast<float>(1 / largest);
        for (int a = 0; a < 3; ++a)
            for (std::size_t i = 0; i < x.size(); ++i) x[a][i] = scale * inverse_diagonal_[a][i] * residual[a][i];
    }
    for (int a = 0; a < 3; ++a) std::fill_n(x[a], x.size(), 0.f), std::fill_n(residual[a], residual.size(), 0.f);
    return largest;
}

void ElasticLevel::find_smoothing(int degree) {
    const double largest = largest_eigenvalue(), high = kMargin * largest, low = largest / kRange;
    const double middle = (high + low) / 2, half = (high - low) / 2, ratio = middle / half;
    double rho = 1 / ratio;
    smoothing_ = {{0.f, static_cast<float>(1 / middle)}};
    for (int step = 1; step < degree; ++step) {
        const double next = 1 / (2 * ratio - rho);
        smoothing_.push_back({static_cast<float>(next * rho), static_cast<float>(2 * next / half)});
        rho = next;
    }
}

void ElasticLevel::join(const ElasticLevel &coarser) {
    for (int a = 0; a < 3; ++a) transfer_[a] = AxisTransfer(shape_[a] - 1, coarser.shape_[a] - 1, coarser.stencil_.blocks);
    widened_ = Buffer<float>(3 * coarser.shape_[0] * coarser.shape_[1] * shape_[2]);
}

void ElasticLevel::restrict_to(ElasticLevel &coarser, const Fields &from, std::size_t begin, std::size_t end) {
    const std::size_t nodes = shape_[1] * shape_[2], row = shape_[2];
    std::vector<float> plane(nodes), line(row);
    std::vector<const float *> rows;
    const auto gather = [&](const AxisTransfer &along, std::size_t to, const float *base, std::ptrdiff_t stride,
                            std::size_t n, float *out) {
        const std::size_t first = along.starts[to], count = along.starts[to + 1] - first;
        rows.resize(count);
        for (std::size_t j = 0; j < count; ++j)
            rows[j] = base + static_cast<std::ptrdiff_t>(along.fine[first + j]) * stride;
        row_loops().combine(static_cast<int>(count), along.share.data() + first, rows.data(), out, n, false);
    };
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = begin; i < end; ++i) {
            gather(transfer_[0], i, from[a], cells_.plane, nodes, plane.data());
            for (std::size_t j = 0; j < coarser.shape_[1]; ++j) {
                gather(transfer_[1], j, plane.data(), static_cast<std::ptrdiff_t>(row), row, line.data());
                float *const out = coarser.b[a] + coarser.place(i, j, 0);
                for (std::size_t k = 0; k < coarser.shape_[2]; ++k) {
                    float sum = 0;
                    for (std::size_t s = transfer_[2].starts[k]; s < transfer_[2].starts[k + 1]; ++s)
                        sum += transfer_[2].share[s] * line[transfer_[2].fine[s]];
                    out[k] = coarser.free(i, j, k) ? sum : 0;
                }
            }
        }
}

void ElasticLevel::widen(const ElasticLevel &coarser, std::size_t begin, std::size_t end) {
    const AxisTransfer &along = transfer_[2];
    const std::size_t rows = coarser.shape_[1], n = shape_[2];
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = begin; i < end; ++i)
            for (std::size_t j = 0; j < rows; ++j) {
                const float *const from = coarser.x[a] + coarser.place(i, j, 0);
                float *const to = widened_.data() + ((static_cast<std::size_t>(a) * coarser.shape_[0] + i) * rows + j) * n;
                for (std::size_t k = 0; k < n; ++k) {
                    const float *const pair = from + along.coarse[k];
                    to[k] = pair[0] + along.weight[k] * (pair[1] - pair[0]);
                }
            }
}

void ElasticLevel::correct(const ElasticLevel &coarser, std::size_t begin, std::size_t end) {
    const std::size_t rows = coarser.shape_[1], n = shape_[2], nodes = shape_[1] * n;
    for (int a = 0; a < 3; ++a)
        for (std::size_t i = begin; i < end; ++i) {
            for (std::size_t j = 0; j < shape_[1]; ++j) {
                const float wx = transfer_[0].weight[i], wy = transfer_[1].weight[j];
                const float pairs[4] = {(1 - wx) * (1 - wy), (1 - wx) * wy, wx * (1 - wy), wx * wy};
                const float *from[4];
                float weight[4];
                int count = 0;
                for (std::size_t corner = 0; corner < 4; ++corner)
                    if (pairs[corner] != 0) {
                        const std::size_t plane = transfer_[0].coarse[i] + corner / 2;
                        const std::size_t line = transfer_[1].coarse[j] + corner % 2;
                        weight[count] = pairs[corner];
                        from[count++] = widened_.data() +
                                        ((static_cast<std::size_t>(a) * coarser.shape_[0] + plane) * rows + line) * n;
                    }
                float *const to = x[a] + place(i, j, 0);
                row_loops().combine(count, weight, from, to, n, true);
            }
            float *const plane = x[a] + place(i, 0, 0);
            if (some_fixed_) row_loops().add_masked(0, plane, inverse_diagonal_[a] + place(i, 0, 0), plane, nodes);
        }
}

}  // namespace sono
