// Linear elasticity on a lattice of trilinear elements without a matrix: conjugate
// gradients, preconditioned by a multigrid cycle with Chebyshev-Jacobi smoothing.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "common/buffers.hpp"
#include "elasticity/elastic_kernels.hpp"
#include "elasticity/elastic_layers.hpp"
#include "elasticity/elastic_level.hpp"

namespace sono {

/// What came of a number of iterations.
struct ElasticOutcome {
    std::vector<double> errors;  // mean |V r| over mean |u|: r before each iteration, u after it; then after the last
    bool sound = true;           // false: the operator was not positive along a search direction
};

class ElasticMultigrid {
  public:
    /// The finest level first, then the explicit operators of coarser ones; coarse_inverse is dense, over the three
    /// components of the free nodes of the last level in turn, or empty: then that level is smoothed many times.
    /// `layers` belong to the operator, not to the cycle. Threads may share one: each call has it alone.
    ElasticMultigrid(const std::vector<ElasticLevelData> &levels, const std::vector<ElasticStencilData> &stencils,
                     int degree, const float *coarse_inverse, std::size_t coarse_size, const ElasticLayersData &layers);

    const std::array<std::size_t, 3> &shape() const { return levels_.front()->shape(); }
    /// u (3, nx, ny, nz) is `start`, zero at nodes that do not move, improved for the load b; `estimate` asks for the
    /// error left.
    ElasticOutcome iterate(const float *b, const float *start, int iterations, bool estimate, float *u);
    /// out = A u, reactions at nodes that do not move included.
    void product(const float *u, float *out);

  private:
    class Program;
    struct Scalars;
    void emit_cycle(Program &program, std::size_t level, const Fields &right, double *dot);
    void emit_coarsest(Program &program, ElasticLevel &level, const Fields &right, double *dot);
    void emit_smoothing(Program &program, ElasticLevel &level, const Fields &right, int from, int to, double *dot);
    void emit_transfer(Program &program, std::size_t level);
    void emit_direction(Program &program, Scalars &scalars, bool first);
    void emit_layers(Program &program, const Fields &in, Fields &out, float sign, double *dot);
    void emit_update(Program &program, Scalars &scalars, const Fields &direction, bool goes_on);
    void emit_error(Program &program, Scalars &scalars);

    std::mutex mutex_;  // its vectors serve one caller at a time
    std::vector<std::unique_ptr<ElasticLevel>> levels_;
    int degree_;
    std::vector<float> coarse_inverse_;
    std::vector<std::size_t> coarse_places_;
    std::unique_ptr<ElasticLayers> layers_;
    Fields u_, b_, residual_, direction_, product_;
};

}  // namespace sono
