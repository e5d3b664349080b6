#include "fields/multilevel.hpp"

#include <algorithm>
#include <memory>
#include <numeric>
#include <stdexcept>

#include "common/kernels.hpp"
#include "fields/multilevel_coarse.hpp"
#include "common/parallel.hpp"
#include "common/phases.hpp"
#include "common/require.hpp"

namespace sono {
namespace {

// Costs in nanoseconds of one core, measured with AVX-512; only their ratios matter.
// Tables of higher levels are larger, and further away in the caches.
constexpr double kDirectPair = 0.18, kCoarsePair = 0.10, kNode = 1.8, kFixed = 30'000;
constexpr std::size_t kMaxLevels = 3;
constexpr double kRunOfLevel[kMaxLevels] = {4.4, 4.7, 8.0};
// Below this a second thread costs more than it saves.
constexpr double kWorthAThread = 60'000;

}  // namespace

MultilevelPlan::MultilevelPlan(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                               double tolerance, const std::vector<int> &orders)
    : shape_(shape), spacing_(spacing), tolerance_(tolerance), orders_(orders) {
    const auto offered = [](int order) { return order >= 4 && order <= kMaxOrder && order % 2 == 0; };
    if (orders.empty() || orders.size() > kMaxLevels || !std::all_of(orders.begin(), orders.end(), offered))
        throw std::invalid_argument("orders is not 1 to 3 of 4, 6, 8, 10 and 12");
    require(numbered(shape, 1), "shape has no node along an axis, or too many");
    require_spacing(spacing);
    require(std::isfinite(tolerance) && tolerance > 0, "tolerance is not above 0");
    for (int a = 0; a < 3; ++a) ratio_[a] = spacing[a] / spacing[0];
    lattices_.push_back({{0, 0, 0}, {int(shape[0]), int(shape[1]), int(shape[2])}});
    for (int order : orders) lattices_.push_back(lattices_.back().coarser(order));
    values_.resize(lattices_.size());
    prepare(1);
    if (orders_.empty())
        throw std::invalid_argument("spacing is too anisotropic, or tolerance too small, for a multilevel sum");
}

int MultilevelPlan::max_depth() const {
    std::lock_guard<std::mutex> lock(in_use_);
    return levels();
}

// Tables for `depth` levels; forgets the levels that have none.
void MultilevelPlan::prepare(int depth) {
    while (static_cast<int>(tables_.size()) < std::min(depth, levels())) {
        const int level = static_cast<int>(tables_.size());
        LevelTables tables = LevelTables::build({level, orders_[level], ratio_, tolerance_ / spacing_[0]});
        if (tables.empty())
            orders_.resize(level);
        else
            tables_.push_back(std::move(tables));
    }
}

double MultilevelPlan::cost(int depth, std::size_t landmarks) const {
    const double n = static_cast<double>(landmarks);
    if (depth == 0) return kDirectPair * n * static_cast<double>(lattices_[0].nodes());
    double total = kFixed + kCoarsePair * n * static_cast<double>(lattices_[depth].nodes());
    for (int level = 0; level < depth; ++level) {
        // Tables are alike from level to level: no need to build one to know its cost.
        const double runs = tables_[std::min<std::size_t>(level, tables_.size() - 1)].runs_per_landmark();
        total += kRunOfLevel[level] * runs * n + kNode * static_cast<double>(lattices_[level].nodes());
    }
    return total;
}

int MultilevelPlan::depth(std::size_t landmarks) {
    std::lock_guard<std::mutex> lock(in_use_);
    return fastest_depth(landmarks);
}

int MultilevelPlan::fastest_depth(std::size_t landmarks) {
    int best = 0;
    for (int d = 1; d <= levels(); ++d)
        if (cost(d, landmarks) < cost(best, landmarks)) best = d;
    prepare(best);
    return std::min(best, levels());
}

double MultilevelPlan::error_per_weight(int depth) const {
    std::lock_guard<std::mutex> lock(in_use_);
    require(depth >= 0 && depth <= levels(), "depth is not between 0 and max_depth");
    double sum = 0, amplified = tolerance_;
    for (int level = 0; level < depth; ++level) {
        sum += amplified;
        amplified *= amplification(orders_[level]);
    }
    return sum;
}

// By counting, as x takes few values.
SortedLandmarks MultilevelPlan::sort(const std::int64_t *index, const double *weights, std::size_t count) const {
    std::vector<int> node(3 * count);
    for (std::size_t i = 0; i < node.size(); ++i) {
        require(index[i] >= 0 && index[i] < static_cast<std::int64_t>(shape_[i % 3]),
                "centre_index has a node outside the lattice");
        node[i] = static_cast<int>(index[i]);
    }
    std::vector<std::size_t> next(shape_[0] + 1, 0);
    for (std::size_t j = 0; j < count; ++j) ++next[static_cast<std::size_t>(node[3 * j]) + 1];
    std::partial_sum(next.begin(), next.end(), next.begin());
    SortedLandmarks sorted;
    for (auto *axis : {&sorted.x, &sorted.y, &sorted.z}) axis->resize(count);
    sorted.weights.assign(4 * count + kLanePad, 0.0f);  // read a vector at a time
    for (std::size_t j = 0; j < count; ++j) {
        const std::size_t at = next[static_cast<std::size_t>(node[3 * j])]++;
        sorted.x[at] = node[3 * j], sorted.y[at] = node[3 * j + 1], sorted.z[at] = node[3 * j + 2];
        for (int c = 0; c < 3; ++c) sorted.weights[4 * at + c] = float(weights[3 * j + c] * spacing_[0]);
    }
    return sorted;
}

void MultilevelPlan::evaluate(const std::int64_t *index, const double *weights, std::size_t count,
                              const double *affine, int depth, float *out) {
    std::lock_guard<std::mutex> lock(in_use_);
    if (depth == 0) depth = std::max(fastest_depth(count), 1);
    prepare(depth);
    require(depth >= 1 && depth <= levels(), "depth is not between 1 and max_depth");
    const int threads = cost(depth, count) < kWorthAThread ? 1 : thread_count();
    const SortedLandmarks landmarks = sort(index, weights, count);

    // Inside, lengths are in units of the spacing along x.
    std::array<float, 12> scaled_affine;
    for (int i = 0; i < 12; ++i) scaled_affine[i] = float(affine[i] * (i < 3 ? 1.0 : spacing_[0]));
    CoarseSum coarse(lattices_[depth], depth, ratio_, landmarks, scaled_affine);

    std::vector<Refinement> refinements;  // coarsest first
    std::vector<std::size_t> blocks = {coarse.cut(threads)};
    const auto plane = [&](int level) {
        return level == depth ? CoarseSum::plane(lattices_[level]) : lattices_[level].count[1] * lattices_[level].row();
    };
    for (int level = depth; level > 0; --level) {
        auto &values = values_[level];
        values.resize(std::max(values.size(), lattices_[level].count[0] * plane(level) + kRowSlack));
        refinements.emplace_back(lattices_[level], lattices_[level - 1], level - 1, orders_[level - 1],
                                 tables_[level - 1]);
        blocks.push_back(refinements.back().cut(threads));
    }
    const auto run = [&](std::size_t phase, std::size_t block) {
        if (phase == 0) return coarse.run(block, values_[depth].data());
        const int from = depth - static_cast<int>(phase) + 1, to = from - 1;
        refinements[phase - 1].run(block, {values_[from].data(), plane(from)}, landmarks,
                                   {to ? values_[to].data() : out, plane(to)});
    };
    if (threads > 1) return parallel_phases(blocks, run);
    for (std::size_t phase = 0; phase < blocks.size(); ++phase)
        for (std::size_t block = 0; block < blocks[phase]; ++block) run(phase, block);
}

}  // namespace sono
