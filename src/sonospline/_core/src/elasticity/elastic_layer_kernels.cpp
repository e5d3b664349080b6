// Forces of layered cells, a vector of cells at a time: their nodes are gathered, and the forces go back one cell
// after another.
#include "elasticity/elastic_layer_kernels.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

// Values of kElasticLanes cells side by side.
using Lanes = float[kElasticLanes];

// Four differences of a component along each axis, of each cell: its corners in the order of their numbers.
inline void differences(const ElasticLayerCells &cells, const std::ptrdiff_t *places, const float *in, Lanes found[3]) {
    Lanes corner[8];
    for (int lane = 0; lane < kElasticLanes; ++lane)
        for (int c = 0; c < 8; ++c)
            corner[c][lane] = in[places[lane] + (c & 4 ? cells.plane : 0) + (c & 2 ? cells.row : 0) + (c & 1)];
    for (int lane = 0; lane < kElasticLanes; ++lane) {
        float sum[4], difference[4];  // along z
        for (int c = 0; c < 4; ++c) {
            sum[c] = corner[2 * c][lane] + corner[2 * c + 1][lane];
            difference[c] = corner[2 * c + 1][lane] - corner[2 * c][lane];
        }
        found[0][lane] = cells.quarter[0] * ((sum[2] + sum[3]) - (sum[0] + sum[1]));
        found[1][lane] = cells.quarter[1] * ((sum[1] + sum[3]) - (sum[0] + sum[2]));
        found[2][lane] = cells.quarter[2] * ((difference[0] + difference[1]) + (difference[2] + difference[3]));
    }
}

// The force of a component at the corners, from the stresses along each axis.
inline void push(const ElasticLayerCells &cells, const std::ptrdiff_t *places, const Lanes &x, const Lanes &y,
                 const Lanes &z, float sign, float *out) {
    Lanes corner[8];
    for (int lane = 0; lane < kElasticLanes; ++lane) {
        const float fx = sign * cells.quarter[0] * x[lane], fy = sign * cells.quarter[1] * y[lane],
                    fz = sign * cells.quarter[2] * z[lane];
        for (int c = 0; c < 8; ++c) corner[c][lane] = (c & 4 ? fx : -fx) + (c & 2 ? fy : -fy) + (c & 1 ? fz : -fz);
    }
    for (int lane = 0; lane < kElasticLanes; ++lane)  // one after another: neighbours share corners
        for (int c = 0; c < 8; ++c)
            out[places[lane] + (c & 4 ? cells.plane : 0) + (c & 2 ? cells.row : 0) + (c & 1)] += corner[c][lane];
}

double add(const ElasticLayerCells &cells, const std::ptrdiff_t *places, const float *stiffness, std::size_t groups,
              const float *in, float *out, float sign) {
    double energy = 0;
    for (std::size_t group = 0; group < groups; ++group, places += kElasticLanes) {
        Lanes slope[3][3], strain[6], stress[6] = {};
        for (int a = 0; a < 3; ++a) differences(cells, places, in + a * cells.component, slope[a]);
        for (int lane = 0; lane < kElasticLanes; ++lane) {
            for (int a = 0; a < 3; ++a) strain[a][lane] = slope[a][a][lane];
            strain[3][lane] = slope[1][2][lane] + slope[2][1][lane];
            strain[4][lane] = slope[0][2][lane] + slope[2][0][lane];
            strain[5][lane] = slope[0][1][lane] + slope[1][0][lane];
        }
        for (int i = 0; i < 6; ++i)
            for (int j = i; j < 6; ++j, stiffness += kElasticLanes)
                for (int lane = 0; lane < kElasticLanes; ++lane) {
                    stress[i][lane] += stiffness[lane] * strain[j][lane];
                    if (j != i) stress[j][lane] += stiffness[lane] * strain[i][lane];
                }
        Lanes product = {};
        for (int i = 0; i < 6; ++i)
            for (int lane = 0; lane < kElasticLanes; ++lane) product[lane] += strain[i][lane] * stress[i][lane];
        for (float of_cell : product) energy += of_cell;
        push(cells, places, stress[0], stress[5], stress[4], sign, out);
        push(cells, places, stress[5], stress[1], stress[3], sign, out + cells.component);
        push(cells, places, stress[4], stress[3], stress[2], sign, out + 2 * cells.component);
    }
    return energy;
}

}  // namespace

extern const ElasticLayerKernels elastic_layers;
const ElasticLayerKernels elastic_layers = {add};

}  // namespace SONO_ISA
}  // namespace sono
