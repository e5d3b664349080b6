// A B-mode frame from scatterers that a displacement field carries: attenuation along the
// beams, echoes, pulse and beam, logarithm, picture.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "ultrasound/bmode_kernels.hpp"
#include "common/buffers.hpp"
#include "fields/sampling.hpp"

namespace sono {

/// Taps and tables of one probe.
struct ProbeTables {
    BeamGeometry beam;
    int axial_half;
    const float *axial;  // 2 axial_half + 1
    int lateral_half;
    const float *lateral;  // (2 lateral_half + 1, samples)
    int rays, ray_samples;            // attenuation: coarse beams and samples along them
    int smoothing_taps;
    const std::int32_t *smoothing_first;  // (lines), first coarse beam
    const float *smoothing;               // (lines, smoothing_taps)
    std::size_t rows, columns;
    const std::int32_t *pixel;            // (rows, columns): line * samples + sample, -1 outside
    const std::uint8_t *fraction;         // (rows, columns, 2): of the next line, of the next sample; of 256
};

/// What a pose of the probe sees of a scene.
struct Aim {
    Cells cells;
    Surfaces surfaces;
    const double *ray_start, *ray_step;  // (rays, 3) lattice mm: middle of the first coarse sample, and the step
    const std::uint8_t *labels;
    std::size_t label_shape[3];
    double label_index[12];              // (3, 4) lattice mm -> voxel index
    const float *loss_db;                // (256) per coarse sample
    const float *impedance;              // (256)
};

/// What is heard beside the beam; what has no lines is not there.
struct Clutter {
    const float *wide;        // (wide_lines, samples, 2) beams of a wide, weak probe
    std::size_t wide_lines;
    const float *wide_scale;  // (samples)
    const float *haze;        // (lines, haze_samples, 2) under the face
    std::size_t haze_samples;
    const float *texture;     // (lines, samples, 2) what reverberation sounds like; null without it
    float tail_level, tail_keep;
    const float *ghosts;      // (lines, samples / kTailRun) power of grating lobes; null without them
    const float *unit;        // (samples) amplitude of liver's speckle
    const float *loudness;    // (samples) times power: above 1 where an echo is heard again
    float again;              // what the face sends back, where amplitudes count in `unit`; 0 for nothing
};

struct FrameInput {
    LatticeField field;
    const float *echoes;  // (echo_count, 4): line, half-sample, re, im
    std::size_t echo_count;
    const float *shadow;  // (2, lines): range where it begins (mm), amplitude left
    float shadow_soft_mm;
    const float *noise;   // (lines, samples, 2)
    float noise_level;
    const float *offset_db;  // (samples)
    float range_db;
    Clutter clutter;
};

struct FrameOutput {
    float *iq;                // (lines, samples, 2)
    std::uint8_t *grey;       // (lines, samples)
    std::uint8_t *picture;    // (rows, columns)
};

class BmodeRenderer {
  public:
    explicit BmodeRenderer(const ProbeTables &);
    void render(const Aim &, const FrameInput &, const FrameOutput &);

  private:
    void trace(const Aim &, const FrameInput &, int first_ray, int last_ray);
    void strip(const Aim &, const FrameInput &, int number);
    void gain_of(const FrameInput &, int line, float *gain) const;
    void beams(const FrameInput &, const FrameOutput &, int first, int last) const;
    void add_clutter(const Clutter &, int line, float *iq) const;

    const ProbeTables probe_;
    const std::size_t stride_;       // floats of a line in beams_
    int strip_lines_ = 0;
    std::vector<float> beams_;       // (lines, samples, 2), after the pulse
    std::vector<float> transmitted_; // (rays, ray_samples) amplitude left
    std::vector<float> taps_;        // lateral taps, each twice: for real and imaginary parts
    std::vector<float> polynomials_;
    std::vector<LineSpan> spans_;
    std::vector<std::int16_t> amplitude_;     // of scatterers on surfaces, as they have turned
    std::vector<int> reach_;         // taps on either side that count, by run of samples
    std::vector<std::int32_t> coarse_;        // (samples) coarse sample before each
    std::vector<float> beyond_;      // (samples) and how far beyond it
};

}  // namespace sono
