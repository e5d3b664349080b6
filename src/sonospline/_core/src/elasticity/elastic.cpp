#include "elasticity/elastic.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/phases.hpp"
#include "common/require.hpp"
#include "common/row_kernels.hpp"

namespace sono {
namespace {

constexpr int kCoarsestSteps = 30, kHighestDegree = 100;

const RowKernels &inner() { return *kernels().rows; }

}  // namespace

// Work in phases, each a number of independent blocks. Small grids do it at once, in this
// thread; large ones collect it and wake the team once for all of it.
class ElasticMultigrid::Program {
  public:
    explicit Program(bool at_once) : at_once_(at_once) {}

    template <class Body> void add(std::size_t blocks, Body body) {
        if (at_once_) {
            for (std::size_t block = 0; block < blocks; ++block) body(block);
        } else {
            blocks_.push_back(blocks);
            bodies_.emplace_back(std::move(body));
        }
    }

    /// A sweep whose sum of dots goes to `total` (where not null).
    void sweep(Sweep kind, ElasticLevel &level, const Fields &in, const Fields *b, Fields *d, Fields &out,
               std::array<float, 2> smoothing, double *total) {
        if (at_once_ && level.blocks() == 1) {
            const double dot = level.sweep(kind, 0, in, b, d, out, smoothing[0], smoothing[1]);
            if (total) *total = dot;
            return;
        }
        const auto parts = std::make_shared<std::vector<double>>(level.blocks());
        add(level.blocks(), [=, &level, &in, &out](std::size_t block) {
            (*parts)[block] = level.sweep(kind, block, in, b, d, out, smoothing[0], smoothing[1]);
        });
        if (total)
            add(1, [=](std::size_t) {
                *total = 0;
                for (double part : *parts) *total += part;
            });
    }

    void run() {
        if (!bodies_.empty())
            parallel_phases(blocks_, [&](std::size_t phase, std::size_t block) { bodies_[phase](block); });
    }

  private:
    const bool at_once_;
    std::vector<std::size_t> blocks_;
    std::vector<std::function<void(std::size_t)>> bodies_;
};

ElasticMultigrid::ElasticMultigrid(const std::vector<ElasticLevelData> &levels,
                                   const std::vector<ElasticStencilData> &stencils, int degree,
                                   const float *coarse_inverse, std::size_t coarse_size,
                                   const ElasticLayersData &layers)
    : degree_(degree), coarse_inverse_(coarse_inverse, coarse_inverse + coarse_size * coarse_size) {
    require(!levels.empty(), "levels is empty");
    require(degree >= 1 && degree <= kHighestDegree, "degree is not between 1 and 100");
    for (const ElasticLevelData &data : levels) levels_.push_back(std::make_unique<ElasticLevel>(data));
    for (const ElasticStencilData &data : stencils) levels_.push_back(std::make_unique<ElasticLevel>(data));
    for (std::size_t i = 1; i < levels_.size(); ++i) levels_[i - 1]->join(*levels_[i]);
    for (std::size_t i = 0; i < levels_.size(); ++i)
        levels_[i]->find_smoothing(i + 1 == levels_.size() ? kCoarsestSteps : degree);
    const ElasticLevel &last = *levels_.back();
    const auto &n = last.shape();
    for (std::size_t i = 0; i < n[0]; ++i)
        for (std::size_t j = 0; j < n[1]; ++j)
            for (std::size_t k = 0; k < n[2]; ++k)
                if (last.free(i, j, k)) coarse_places_.push_back(static_cast<std::size_t>(last.place(i, j, k)));
    require(coarse_size == 0 || coarse_size == 3 * coarse_places_.size(),
            "coarse_inverse is neither empty nor over the free unknowns of the last level");
    const ElasticLevel &first = *levels_.front();
    layers_ = std::make_unique<ElasticLayers>(layers, first);
    u_ = first.make_fields(), b_ = first.make_fields(), residual_ = first.make_fields();
    direction_ = first.make_fields(), product_ = first.make_fields();
}

// Chebyshev steps [from, to) of the smoothing of level.x for `right`.
void ElasticMultigrid::emit_smoothing(Program &program, ElasticLevel &level, const Fields &right, int from, int to,
                                      double *dot) {
    for (int step = from; step < to; ++step) {
        Fields &out = level.in_place() ? level.x : level.other;
        program.sweep(Sweep::smooth, level, level.x, &right, &level.d, out, level.smoothing()[step],
                      step + 1 == to ? dot : nullptr);
        if (!level.in_place()) program.add(1, [&level](std::size_t) { std::swap(level.x, level.other); });
    }
}

void ElasticMultigrid::emit_coarsest(Program &program, ElasticLevel &level, const Fields &right, double *dot) {
    if (coarse_inverse_.empty()) {
        program.add(level.slabs(), [&](std::size_t slab) {
            level.start(slab, right, level.d, level.x, level.smoothing()[0][1]);
        });
        emit_smoothing(program, level, right, 1, kCoarsestSteps, dot);
        return;
    }
    program.add(1, [&, dot](std::size_t) {
        const std::size_t nodes = coarse_places_.size(), size = 3 * nodes;
        std::vector<float> found(size);
        for (std::size_t column = 0; column < size; ++column)
            inner().add(right[static_cast<int>(column / nodes)][coarse_places_[column % nodes]],
                        coarse_inverse_.data() + column * size, found.data(), size);
        double sum = 0;
        for (std::size_t i = 0; i < size; ++i) {
            const int a = static_cast<int>(i / nodes);
            const std::size_t at = coarse_places_[i % nodes];
            level.x[a][at] = found[i];
            sum += static_cast<double>(right[a][at]) * found[i];
        }
        if (dot) *dot = sum;
    });
}

// levels_[number]->x = V right, with V the cycle from that level down; dot = x . right.
void ElasticMultigrid::emit_cycle(Program &program, std::size_t number, const Fields &right, double *dot) {
    ElasticLevel &level = *levels_[number];
    if (number + 1 == levels_.size()) return emit_coarsest(program, level, right, dot);
    program.add(level.slabs(), [&](std::size_t slab) {
        level.start(slab, right, level.d, level.x, level.smoothing()[0][1]);
    });
    emit_smoothing(program, level, right, 1, degree_, nullptr);
    program.sweep(Sweep::residual, level, level.x, &right, nullptr, level.residual, {}, nullptr);
    emit_transfer(program, number);
    emit_smoothing(program, level, right, 0, degree_, dot);
}

void ElasticMultigrid::emit_transfer(Program &program, std::size_t number) {
    ElasticLevel &level = *levels_[number], &coarser = *levels_[number + 1];
    const std::size_t planes = coarser.shape()[0], parts = level.slabs();
    const auto part = [planes, parts](std::size_t block) {
        return std::array<std::size_t, 2>{block * planes / parts, (block + 1) * planes / parts};
    };
    program.add(parts, [&, part](std::size_t block) {
        level.restrict_to(coarser, level.residual, part(block)[0], part(block)[1]);
    });
    if (level.in_place() || !coarser.in_place()) {
        emit_cycle(program, number + 1, coarser.b, nullptr);
    } else {  // from here down one thread is enough
        program.add(1, [this, number, &coarser](std::size_t) {
            Program alone(true);
            emit_cycle(alone, number + 1, coarser.b, nullptr);
        });
    }
    program.add(parts, [&, part](std::size_t block) { level.widen(coarser, part(block)[0], part(block)[1]); });
    program.add(parts, [&](std::size_t block) {
        level.correct(coarser, level.slab(block)[0], level.slab(block)[1]);
    });
}

// The scalars of conjugate gradients: r . V r now and before, p . A p; and the sizes of V r and of u.
struct ElasticMultigrid::Scalars {
    double size = 0, old_size = 0, stiffness = 0, missing = 0, found = 0;
    ElasticOutcome outcome;

    void note_direction() {
        outcome.sound = outcome.sound && std::isfinite(stiffness) && (stiffness > 0 || size == 0);
        old_size = size;
    }
    void note_error() {
        const double error = missing == 0 ? 0 : found > 0 ? missing / found : 1;
        outcome.sound = outcome.sound && std::isfinite(error);
        outcome.errors.push_back(error);
    }
    float step() const { return stiffness > 0 ? static_cast<float>(old_size / stiffness) : 0.f; }
};

ElasticOutcome ElasticMultigrid::iterate(const float *b, const float *start, int iterations, bool estimate, float *u) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ElasticLevel &fine = *levels_.front();
    fine.read(start, u_);
    fine.read(b, b_);
    fine.release_fixed(b_);
    Program program(fine.in_place());
    Scalars s;
    program.sweep(Sweep::residual, fine, u_, &b_, nullptr, residual_, {}, nullptr);
    emit_layers(program, u_, residual_, -1, nullptr);
    for (int iteration = 0; iteration < iterations; ++iteration) {
        emit_cycle(program, 0, residual_, &s.size);
        const bool only = iterations == 1;
        if (!only) emit_direction(program, s, iteration == 0);
        const Fields &direction = only ? fine.x : direction_;
        program.sweep(Sweep::product, fine, direction, nullptr, nullptr, product_, {}, &s.stiffness);
        emit_layers(program, direction, product_, 1, &s.stiffness);
        program.add(1, [&](std::size_t) { s.note_direction(); });
        emit_update(program, s, direction, estimate || iteration + 1 < iterations);
        emit_error(program, s);
    }
    if (estimate) {
        emit_cycle(program, 0, residual_, &s.size);
        emit_error(program, s);
    }
    program.run();
    fine.write(u_, u);
    return s.outcome;
}

// out += sign L in, with L the layers' part of A; dot += in . L in. Every other plane of cells at a time: those share
// no node.
void ElasticMultigrid::emit_layers(Program &program, const Fields &in, Fields &out, float sign, double *dot) {
    if (!layers_->any()) return;
    for (int parity : {0, 1}) {
        const std::size_t blocks = layers_->blocks(parity);
        const auto parts = std::make_shared<std::vector<double>>(blocks);
        program.add(blocks, [this, &in, &out, sign, parity, parts](std::size_t block) {
            (*parts)[block] = layers_->add(parity, block, in, out, sign);
        });
        if (dot)
            program.add(1, [parts, dot](std::size_t) {
                for (double part : *parts) *dot += part;
            });
    }
}

// p = V r + beta p
void ElasticMultigrid::emit_direction(Program &program, Scalars &s, bool first) {
    ElasticLevel &fine = *levels_.front();
    program.add(fine.slabs(), [this, &fine, &s, first](std::size_t slab) {
        const auto [at, n] = fine.floats(slab);
        for (int a = 0; a < 3; ++a)
            inner().extend(first ? 0.f : static_cast<float>(s.size / s.old_size), fine.x[a] + at, direction_[a] + at, n);
    });
}

// u += step p, and where the iteration goes on r -= step A p.
void ElasticMultigrid::emit_update(Program &program, Scalars &s, const Fields &direction, bool goes_on) {
    ElasticLevel &fine = *levels_.front();
    program.add(fine.slabs(), [this, &fine, &s, &direction, goes_on](std::size_t slab) {
        const auto [at, n] = fine.floats(slab);
        for (int a = 0; a < 3; ++a) {
            inner().add(s.step(), direction[a] + at, u_[a] + at, n);
            if (goes_on)
                inner().add_masked(-s.step(), product_[a] + at, fine.inverse_diagonal()[a] + at, residual_[a] + at, n);
        }
    });
}

// V r is what u lacked when r was its residual, as nearly as the cycle is the inverse.
void ElasticMultigrid::emit_error(Program &program, Scalars &s) {
    ElasticLevel &fine = *levels_.front();
    const auto parts = std::make_shared<std::vector<std::array<double, 2>>>(fine.slabs());
    program.add(fine.slabs(), [this, &fine, parts](std::size_t slab) {
        const auto [at, n] = fine.floats(slab);
        (*parts)[slab] = {inner().lengths(fine.x[0] + at, fine.x[1] + at, fine.x[2] + at, n),
                          inner().lengths(u_[0] + at, u_[1] + at, u_[2] + at, n)};
    });
    program.add(1, [&s, parts](std::size_t) {
        s.missing = s.found = 0;
        for (const auto &part : *parts) s.missing += part[0], s.found += part[1];
        s.note_error();
    });
}

void ElasticMultigrid::product(const float *u, float *out) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ElasticLevel &fine = *levels_.front();
    fine.read(u, u_);
    parallel_for(fine.blocks(), [&](std::size_t block) {
        fine.sweep(Sweep::product, block, u_, nullptr, nullptr, product_, 0, 0);
    });
    Program program(true);
    emit_layers(program, u_, product_, 1, nullptr);
    fine.write(product_, out);
}

}  // namespace sono
