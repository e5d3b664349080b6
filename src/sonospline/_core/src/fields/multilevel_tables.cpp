#include "fields/multilevel_tables.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "common/parallel.hpp"

namespace sono {
namespace {

// Beyond it the tables would cost more than they save: the spacing is too anisotropic
// or the cutoff too small for the order.
constexpr int kMaxReach = 28;

using Block = std::vector<double>;

// U = r at the nodes first[a] + step * k of each axis, relative to the landmark.
Block kernel_block(const std::array<double, 3> &first, double step, int count, const std::array<double, 3> &ratio) {
    std::array<std::vector<double>, 3> square;
    for (int a = 0; a < 3; ++a)
        for (int k = 0; k < count; ++k) square[a].push_back(std::pow((first[a] + step * k) * ratio[a], 2));
    Block block;
    block.reserve(std::size_t(count) * count * count);
    for (double x2 : square[0])
        for (double y2 : square[1])
            for (double z2 : square[2]) block.push_back(std::sqrt(x2 + y2 + z2));
    return block;
}

// Interpolates the middle axis of (outer, coarse, inner); the first fine node is the even
// one that the first stencil reaches to the left of its midpoint.
Block refine_axis(const Block &in, std::size_t outer, int coarse, std::size_t inner, int fine,
                  const std::vector<double> &stencil) {
    const int order = static_cast<int>(stencil.size());
    Block out(outer * fine * inner, 0.0);
    for (std::size_t o = 0; o < outer; ++o)
        for (int k = 0; k < fine; ++k) {
            double *to = &out[(o * fine + k) * inner];
            const double *from = &in[(o * coarse + k / 2) * inner];
            for (int m = 0; m < order; ++m) {
                const double weight = k % 2 ? stencil[m] : double(m == order / 2 - 1);
                if (weight == 0.0) continue;
                for (std::size_t i = 0; i < inner; ++i) to[i] += weight * from[m * inner + i];
            }
        }
    return out;
}

// U minus its interpolant on even node -reach of the level and 2 reach + 2 more along each axis.
Block correction_block(const LevelSpec &spec, const std::array<int, 3> &landmark, int reach) {
    const std::vector<double> stencil = midpoint_stencil(spec.order);
    const int fine = 2 * reach + 3, coarse = reach + 1 + spec.order;
    const double step = 1 << spec.level;
    std::array<double, 3> first, first_coarse;
    for (int a = 0; a < 3; ++a) {
        first[a] = -reach * step - landmark[a];
        first_coarse[a] = first[a] - (spec.order / 2 - 1) * 2 * step;
    }
    Block values = kernel_block(first_coarse, 2 * step, coarse, spec.ratio);
    values = refine_axis(values, 1, coarse, std::size_t(coarse) * coarse, fine, stencil);
    values = refine_axis(values, fine, coarse, coarse, fine, stencil);
    values = refine_axis(values, std::size_t(fine) * fine, coarse, 1, fine, stencil);
    const Block exact = kernel_block(first, step, fine, spec.ratio);
    std::transform(exact.begin(), exact.end(), values.begin(), values.begin(), std::minus<>());
    return values;
}

// Classes that are mirror images of each other about a coarse node, or, where spacings are
// equal, swap axes, share one block: few need computing.
struct Symmetry {
    std::array<int, 3> landmark;  // of the block
    std::array<int, 3> axis;      // the block's axis for each of the class
    std::array<bool, 3> mirrored;

    Symmetry(const std::array<int, 3> &of, int period, const std::array<double, 3> &ratio) : axis{0, 1, 2} {
        std::array<int, 3> folded;
        for (int a = 0; a < 3; ++a) {
            mirrored[a] = of[a] > period / 2;
            folded[a] = mirrored[a] ? period - of[a] : of[a];
        }
        std::array<int, 3> order = {0, 1, 2};
        if (ratio[1] == 1.0 && ratio[2] == 1.0)
            std::sort(order.begin(), order.end(), [&](int a, int b) { return folded[a] < folded[b]; });
        for (int i = 0; i < 3; ++i) landmark[i] = folded[order[i]], axis[order[i]] = i;
    }

    // The class's nodes -reach to reach + 1; mirrored, node k is node 2 - k of the block.
    Block view(const Block &block, int reach) const {
        const int count = 2 * reach + 2, size = count + 1;
        const std::ptrdiff_t strides[3] = {std::ptrdiff_t(size) * size, size, 1};
        std::ptrdiff_t start = 0, step[3];
        for (int a = 0; a < 3; ++a) {
            step[a] = mirrored[a] ? -strides[axis[a]] : strides[axis[a]];
            start += mirrored[a] ? (size - 1) * strides[axis[a]] : 0;
        }
        Block result;
        result.reserve(std::size_t(count) * count * count);
        for (int x = 0; x < count; ++x)
            for (int y = 0; y < count; ++y)
                for (int z = 0; z < count; ++z)
                    result.push_back(block[start + x * step[0] + y * step[1] + z * step[2]]);
        return result;
    }
};

// Whether the two outermost layers, one odd and one even, stay within the cutoff.
bool dies_out(const Block &block, int count, double cutoff) {
    const auto near_edge = [&](int k) { return k < 2 || k >= count - 2; };
    std::size_t at = 0;
    for (int x = 0; x < count; ++x)
        for (int y = 0; y < count; ++y)
            for (int z = 0; z < count; ++z, ++at)
                if ((near_edge(x) || near_edge(y) || near_edge(z)) && std::abs(block[at]) > cutoff) return false;
    return true;
}

}  // namespace

std::vector<double> midpoint_stencil(int order) {
    std::vector<double> weights(order, 1.0);
    for (int i = 0; i < order; ++i)
        for (int m = 0; m < order; ++m)
            if (m != i) weights[i] *= (0.5 * (order - 1) - m) / (i - m);
    return weights;
}

double amplification(int order) {
    double sum = 0;
    for (double weight : midpoint_stencil(order)) sum += std::abs(weight);
    return sum * sum * sum;
}

LevelTables::Class LevelTables::runs_of(const std::vector<double> &block, int reach, double cutoff) {
    const int count = 2 * reach + 2;
    const auto matters = [&](double value) { return std::abs(value) > cutoff; };
    Class out = {-reach, {0}, {}, {}};
    for (int x = 0; x < count; ++x) {
        for (int y = 0; y < count; ++y) {
            const double *row = &block[(std::size_t(x) * count + y) * count], *end = row + count;
            const double *first = std::find_if(row, end, matters);
            // Runs until the last value that matters; what lies between is kept for free.
            while (first != end) {
                const auto z = static_cast<int>(first - row);
                out.runs.push_back({std::int16_t(x - reach), std::int16_t(y - reach), std::int16_t(z - reach)});
                const double *stop = first + std::min<std::ptrdiff_t>(kRun, end - first);
                out.values.insert(out.values.end(), first, stop);
                out.values.resize(kRun * out.runs.size(), 0.0f);
                first = std::find_if(stop, end, matters);
            }
        }
        out.starts.push_back(static_cast<std::uint32_t>(out.runs.size()));
    }
    out.values.resize(out.values.size() + kRun, 0.0f);  // vectors read past the last run
    return out;
}

// Every class at one reach; empty where a correction does not die out within it.
std::vector<LevelTables::Class> LevelTables::classes_within(const LevelSpec &spec, int period, int reach) {
    std::vector<Symmetry> symmetry;
    for (int x = 0; x < period; ++x)
        for (int y = 0; y < period; ++y)
            for (int z = 0; z < period; ++z) symmetry.emplace_back(std::array<int, 3>{x, y, z}, period, spec.ratio);

    std::vector<std::array<int, 3>> landmarks;
    for (const Symmetry &s : symmetry) landmarks.push_back(s.landmark);
    std::sort(landmarks.begin(), landmarks.end());
    landmarks.erase(std::unique(landmarks.begin(), landmarks.end()), landmarks.end());
    std::vector<Block> blocks(landmarks.size());
    parallel_for(blocks.size(), [&](std::size_t b) { blocks[b] = correction_block(spec, landmarks[b], reach); });

    std::vector<Class> classes(symmetry.size());
    std::atomic<bool> reached{true};
    parallel_for(classes.size(), [&](std::size_t c) {
        if (!reached) return;
        const auto at = std::lower_bound(landmarks.begin(), landmarks.end(), symmetry[c].landmark);
        const Block block = symmetry[c].view(blocks[at - landmarks.begin()], reach);
        if (dies_out(block, 2 * reach + 2, spec.cutoff))
            classes[c] = runs_of(block, reach, spec.cutoff);
        else
            reached = false;
    });
    if (!reached) classes.clear();
    return classes;
}

LevelTables LevelTables::build(const LevelSpec &spec) {
    LevelTables tables;
    tables.period_ = 2 << spec.level;
    // Reach is even, so that the first node of a table is a coarse one.
    for (int reach = spec.order + 2; reach <= kMaxReach && tables.empty(); reach += 2) {
        tables.reach_ = reach;
        tables.classes_ = classes_within(spec, tables.period_, reach);
    }
    for (const Class &c : tables.classes_)
        tables.views_.push_back({c.first_x, static_cast<int>(c.starts.size()) - 1, c.starts.data(), c.runs.data(),
                                 c.values.data()});
    return tables;
}

double LevelTables::runs_per_landmark() const {
    double runs = 0;
    for (const Class &c : classes_) runs += static_cast<double>(c.runs.size());
    return runs / static_cast<double>(classes_.size());
}

}  // namespace sono
