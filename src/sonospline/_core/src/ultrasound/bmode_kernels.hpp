// The hot loops of B-mode synthesis, compiled once per instruction set. Echoes are added
// to a strip of beams at half the sampling step, linearly between four bins, with the
// exact phase of the carrier at their range; the pulse and the beam follow as convolutions.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

constexpr int kStripLines = 32;        // among which cells are sorted
constexpr int kFrameFloats = 16;       // of one cell: see CellFrame
constexpr int kSurfaceFloats = 5;     // of one scatterer on a surface: see Surfaces
constexpr int kPolynomialFloats = 32;  // of one cell: 1 u v w uv uw vw uvw, each lateral, elevation, axial; then 0, or in the first whether the beams lie narrow
constexpr int kBinPad = 64;            // half-samples kept beyond either end of a beam
constexpr int kLateralRun = 32;        // floats for which the beam's width is given
constexpr int kTailRun = 16;           // samples
constexpr int kMostRepeats = 4;        // echoes of a line that are heard again
constexpr int kEchoSlack = 64;         // scatterers that may be read past the last

struct BeamGeometry {
    bool curved;
    float lines_per_step;  // 1 / distance between beams (mm or radians)
    float cycles_per_mm;   // of the carrier, there and back
    float half_samples_per_mm;
    float focus_variance, spread_squared, focus_mm;  // elevation: variance at its focus, growth, depth of focus
    float cut_squared;                               // squared elevation, in variances, beyond which there is no echo
    float cut_weight;                                // exp(-cut_squared / 2)
    float depth_mm, margin_mm;
    int lines, samples;
};

/// Where a cell of the displacement lattice lies in the beam: rows lateral, elevation, axial of the
/// rotation from lattice axes; then range, line, carrier cycles (fraction), distance from the apex and
/// elevation of its first corner.
struct CellFrame {
    float rotation[9], range, line, cycles, reach, elevation, unused[2];
};
static_assert(sizeof(CellFrame) == kFrameFloats * sizeof(float), "as Python lays it out");

/// The first corner's node and how many nodes further the opposite one lies along each axis (0 beyond the lattice).
struct CellNodes {
    std::int32_t first, step[3];
};

/// The lines a cell touches; none where last < first.
struct LineSpan {
    std::int16_t first, last;
};

struct Cells {
    const CellFrame *frames;
    const CellNodes *nodes;
    const std::int32_t *starts;  // first scatterer of each cell, count + 1 entries
    const std::uint16_t *u, *v, *w;  // place within the cell, of 65536
    const std::int16_t *amplitude;
    float amplitude_step;
    std::size_t count;
};

/// Scatterers that lie on surfaces, the last of each cell: SoA over all cells.
struct Surfaces {
    const std::int32_t *starts;         // first of each cell, count + 1 entries
    const float *normal[3];             // along the lattice's axes, each times the lattice's spacing
    const float *specular, *diffuse;    // amplitude where the beam meets the surface squarely, and at any angle
    float width;                        // of the specular part: exp(-width sin^2)
};

struct EchoKernels {
    /// Polynomials and line spans of cells [first, last) under displacements at the lattice's nodes
    void (*place)(const BeamGeometry &, const Cells &, const float *displacement, const float spacing[3],
                  std::size_t first, std::size_t last, float *polynomials, LineSpan *spans);
    /// Amplitudes of the scatterers on surfaces of cells [first, last) that touch a line: the displacement turns their
    /// normals (n' = F^-T n)
    void (*reflect)(const BeamGeometry &, const Cells &, const Surfaces &, const float *polynomials, const LineSpan *spans,
                    std::size_t first, std::size_t last, std::int16_t *amplitude);
    /// Adds every scatterer to lines first_line - 1 to first_line + lines of `strip`; row r of it holds
    /// line first_line - 1 + r. Those on surfaces have their amplitudes in `turned`
    void (*splat)(const BeamGeometry &, const Cells &, const std::int32_t *surface_starts, const std::int16_t *turned,
                  const float *polynomials, const LineSpan *spans, int first_line, int lines, float *strip,
                  std::size_t row);
};

struct BmodeKernels {
    /// out (samples, 2) = gain (samples, 2) times taps (2 half + 1) over half-samples `in`, which starts kBinPad
    /// before range 0
    void (*axial)(int half, const float *taps, const float *in, std::size_t samples, const float *gain,
                  float *scratch, float *out);
    /// out[from, end) = noise + sum_k taps[k] * line[k] for k from -below to above: rows that lie `stride` floats apart,
    /// of which the middle ones are given. Taps beyond reach[j] are 0 in the j-th run of kLateralRun floats
    void (*lateral)(int below, int above, const float *taps, const float *line, std::ptrdiff_t stride, std::size_t from,
                    std::size_t end, const int *reach, const float *noise, float noise_level, float *out);
    /// out (samples, 2) += scale times two rows of a wide beam, mixed
    void (*widen)(const float *low, const float *high, float of_high, const float *scale, std::size_t samples, float *out);
    /// out (samples, 2) += texture times an amplitude that the power before it feeds: of each run of kTailRun samples
    /// the mean power is added to what `keep` leaves, and `level` of that, with the run's `more` (or null), sounds
    void (*tail)(const float *texture, float level, float keep, const float *more, std::size_t samples, float *out);
    /// out (samples, 2) += echoes of itself from what is loud in it (power times loudness above 1): the face sends
    /// `again` of them back, where amplitudes count in `unit`
    void (*repeat)(const float *unit, const float *loudness, float again, std::size_t samples, float *out);
    /// left = 10^(-loss_db / 20); count is a multiple of kLateralRun / 2
    void (*transmit)(const float *loss_db, std::size_t count, float *left);
    /// out (samples, 2), each value twice = rows of `rays` weighted, then linear between samples before[n] and the
    /// next; scratch holds ray_samples + 1
    void (*gain)(int count, const float *weights, const float *rays, std::size_t ray_samples, const std::int32_t *before,
                 const float *beyond, std::size_t samples, float *scratch, float *out);
    /// grey = 255 (10 log10 |s|^2 + offset_db + range_db) / range_db, clipped
    void (*compress)(const float *in, const float *offset_db, float range_db, std::size_t samples, float *scratch,
                     std::uint8_t *grey);
    /// One row of pixels, linear between four samples
    void (*picture)(const std::uint8_t *grey, std::size_t samples, const std::int32_t *pixel,
                    const std::uint8_t *fraction, std::size_t columns, std::uint8_t *to);
};

}  // namespace sono
