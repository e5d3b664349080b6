#include "bmode.hpp"

#include <algorithm>
#include <cmath>

#include "kernels.hpp"
#include "phases.hpp"
#include "trilinear4.hpp"

namespace sono {
namespace {

constexpr std::size_t kCellsPerBlock = 512, kRowsPerBlock = 32;
constexpr int kRaysPerBlock = 8, kLinesPerBlock = 8;
constexpr int kInverseSteps = 2;      // started from the sample before: 0.002 mm at |grad u| = 0.3
constexpr float kMostLossDb = 60;     // at one interface
constexpr float kLossPerNeper = 20 / 2.302585093f;

std::size_t blocks_of(std::size_t items, std::size_t size) { return (items + size - 1) / size; }

}  // namespace

BmodeRenderer::BmodeRenderer(const ProbeTables &probe)
    : probe_(probe), stride_(2 * static_cast<std::size_t>(probe.beam.samples)) {
    const std::size_t lines = static_cast<std::size_t>(probe.beam.lines);
    beams_.resize(lines * stride_ + kEchoSlack);
    transmitted_.resize(static_cast<std::size_t>(probe.rays) * probe.ray_samples);
    const std::size_t taps = static_cast<std::size_t>(2 * probe.lateral_half + 1) * probe.beam.samples;
    taps_.resize(2 * taps + kEchoSlack);
    for (std::size_t i = 0; i < taps; ++i) taps_[2 * i] = taps_[2 * i + 1] = probe.lateral[i];
    const float ratio = static_cast<float>(probe.ray_samples) / static_cast<float>(probe.beam.samples);
    for (int n = 0; n < probe.beam.samples; ++n) {
        const float at = std::max(static_cast<float>(n) * ratio - 0.5f, 0.0f);
        coarse_.push_back(static_cast<int>(at));
        beyond_.push_back(at - std::floor(at));
    }
}

void BmodeRenderer::render(const Aim &aim, const FrameInput &in, const FrameOutput &out) {
    const BmodeKernels &kernel = *kernels().bmode;
    polynomials_.resize(kPolynomialFloats * aim.cells.count);
    spans_.resize(aim.cells.count);
    const float spacing[3] = {static_cast<float>(in.field.spacing[0]), static_cast<float>(in.field.spacing[1]),
                              static_cast<float>(in.field.spacing[2])};
    const std::size_t ray_blocks = blocks_of(probe_.rays, kRaysPerBlock);
    const std::size_t lines = static_cast<std::size_t>(probe_.beam.lines);
    const std::vector<std::size_t> blocks = {ray_blocks + blocks_of(aim.cells.count, kCellsPerBlock),
                                             blocks_of(lines, kStripLines), blocks_of(lines, kLinesPerBlock),
                                             blocks_of(probe_.rows, kRowsPerBlock)};
    parallel_phases(blocks, [&](std::size_t phase, std::size_t block) {
        const int number = static_cast<int>(block);
        if (phase == 0 && block < ray_blocks) {
            const int end = std::min(probe_.rays, (number + 1) * kRaysPerBlock);
            for (int ray = number * kRaysPerBlock; ray < end; ++ray) trace(aim, in, ray);
        } else if (phase == 0) {
            const std::size_t first = (block - ray_blocks) * kCellsPerBlock;
            kernel.place(probe_.beam, aim.cells, in.field.values, spacing, first,
                         std::min(aim.cells.count, first + kCellsPerBlock), polynomials_.data(), spans_.data());
        } else if (phase == 1) {
            strip(aim, in, number);
        } else if (phase == 2) {
            const int end = std::min(probe_.beam.lines, (number + 1) * kLinesPerBlock);
            for (int l = number * kLinesPerBlock; l < end; ++l) line(in, out, l);
        } else {
            const std::size_t end = std::min(probe_.rows, (block + 1) * kRowsPerBlock);
            for (std::size_t row = block * kRowsPerBlock; row < end; ++row) picture(out, row);
        }
    });
}

// Walks down one coarse beam through the undeformed labels, adding up what is lost.
void BmodeRenderer::trace(const Aim &aim, const FrameInput &in, int ray) {
    const Trilinear4 displacement(in.field);
    const double *start = aim.ray_start + 3 * ray, *step = aim.ray_step + 3 * ray;
    float *left = transmitted_.data() + static_cast<std::size_t>(ray) * probe_.ray_samples;
    Float4 u{}, first{}, along{}, index[4] = {};
    for (int a = 0; a < 3; ++a) {
        first[a] = static_cast<float>(start[a]), along[a] = static_cast<float>(step[a]);
        for (int b = 0; b < 4; ++b) index[b][a] = static_cast<float>(aim.label_index[4 * a + b]);
    }
    float db = 0;
    int last = -1;
    for (int n = 0; n < probe_.ray_samples; ++n) {
        const Float4 p = first + static_cast<float>(n) * along;
        for (int i = 0; i < kInverseSteps; ++i) u = displacement(p - u);
        const Float4 x = p - u;
        const Float4 nearest = index[0] * x[0] + index[1] * x[1] + index[2] * x[2] + index[3] + 0.5f;
        std::size_t voxel = 0;
        bool inside = true;
        for (int a = 0; a < 3; ++a) {
            inside = inside && nearest[a] >= 0 && nearest[a] < static_cast<float>(aim.label_shape[a]);
            voxel = voxel * aim.label_shape[a] + (inside ? static_cast<std::size_t>(nearest[a]) : 0);
        }
        const int label = inside ? aim.labels[voxel] : 0;
        if (last >= 0 && label != last) {
            const float z1 = aim.impedance[last], z2 = aim.impedance[label];
            const float through = 4 * z1 * z2 / ((z1 + z2) * (z1 + z2));  // T12 T21 = 1 - R^2
            db += std::min(kMostLossDb, -kLossPerNeper * std::log(through));
        }
        last = label;
        db += aim.loss_db[label];
        left[n] = std::exp((0.5f * aim.loss_db[label] - db) / kLossPerNeper);  // to the sample's middle
    }
}

// Amplitude left along one beam: coarse beams smoothed across the aperture, times the needle's shadow.
void BmodeRenderer::gain_of(const FrameInput &in, int line, float *gain) const {
    const int coarse = probe_.ray_samples, samples = probe_.beam.samples;
    thread_local std::vector<float> smooth;
    smooth.assign(static_cast<std::size_t>(coarse) + 1, 0.0f);
    const float *weights = probe_.smoothing + static_cast<std::size_t>(line) * probe_.smoothing_taps;
    for (int k = 0; k < probe_.smoothing_taps; ++k) {
        const float *ray = transmitted_.data() + static_cast<std::size_t>(probe_.smoothing_first[line] + k) * coarse;
        for (int n = 0; n < coarse; ++n) smooth[n] += weights[k] * ray[n];
    }
    smooth[coarse] = smooth[coarse - 1];
    for (int n = 0; n < samples; ++n)
        gain[n] = smooth[coarse_[n]] + beyond_[n] * (smooth[coarse_[n] + 1] - smooth[coarse_[n]]);
    const float begins = in.shadow[line], shaded = in.shadow[probe_.beam.lines + line];
    if (shaded >= 1) return;
    const float sample_mm = probe_.beam.depth_mm / static_cast<float>(samples), softness = 1 / in.shadow_soft_mm;
    for (int n = std::max(0, static_cast<int>(begins / sample_mm)); n < samples; ++n)
        gain[n] *= 1 - (1 - shaded) * std::min(std::max((static_cast<float>(n) * sample_mm - begins) * softness, 0.0f), 1.0f);
}

void BmodeRenderer::strip(const Aim &aim, const FrameInput &in, int number) {
    const BmodeKernels &kernel = *kernels().bmode;
    const int first_line = number * kStripLines, samples = probe_.beam.samples;
    const std::size_t row = 2 * static_cast<std::size_t>(2 * samples + 2 * kBinPad);
    thread_local std::vector<float> grid, scratch, gain;
    // one line on either side, and a row for what falls elsewhere with the one it spills into
    grid.assign((kStripLines + 4) * row, 0.0f);
    scratch.resize(4 * static_cast<std::size_t>(samples + kBinPad) + kEchoSlack);
    gain.resize(static_cast<std::size_t>(samples));
    kernel.splat(probe_.beam, aim.cells, polynomials_.data(), spans_.data(), first_line, grid.data(), row);
    for (std::size_t i = 0; i < in.echo_count; ++i) {
        const float *echo = in.echoes + 4 * i;
        const float whole_line = std::floor(echo[0]), whole_bin = std::floor(echo[1]);
        const float r = whole_line - static_cast<float>(first_line - 1), b = whole_bin + kBinPad;
        if (!(r >= 0 && r <= kStripLines && b >= 0 && b < static_cast<float>(2 * samples + 2 * kBinPad - 2))) continue;
        const float across = echo[0] - whole_line, along = echo[1] - whole_bin;
        float *at = grid.data() + static_cast<std::size_t>(r) * row + 2 * static_cast<std::size_t>(b);
        for (int side = 0; side < 2; ++side, at += row)
            for (int half = 0; half < 2; ++half) {
                const float weight = (side ? across : 1 - across) * (half ? along : 1 - along);
                at[2 * half] += weight * echo[2], at[2 * half + 1] += weight * echo[3];
            }
    }
    for (int l = first_line; l < std::min(probe_.beam.lines, first_line + kStripLines); ++l) {
        gain_of(in, l, gain.data());
        kernel.axial(probe_.axial_half, probe_.axial, grid.data() + static_cast<std::size_t>(l - first_line + 1) * row,
                     static_cast<std::size_t>(samples), gain.data(), scratch.data(),
                     beams_.data() + static_cast<std::size_t>(l) * stride_);
    }
}

void BmodeRenderer::line(const FrameInput &in, const FrameOutput &out, int number) const {
    const BmodeKernels &kernel = *kernels().bmode;
    const std::size_t samples = static_cast<std::size_t>(probe_.beam.samples);
    const int count = 2 * probe_.lateral_half + 1;
    std::vector<const float *> taps(count), lines(count);
    for (int k = 0; k < count; ++k) {
        const int l = number + k - probe_.lateral_half;
        taps[k] = taps_.data() + static_cast<std::size_t>(k) * stride_;
        lines[k] = l >= 0 && l < probe_.beam.lines ? beams_.data() + static_cast<std::size_t>(l) * stride_ : nullptr;
    }
    const std::size_t at = static_cast<std::size_t>(number) * samples;
    float *iq = out.iq + 2 * at;
    kernel.lateral(count, taps.data(), lines.data(), samples, in.noise + 2 * at, in.noise_level, iq);
    thread_local std::vector<float> scratch;
    scratch.resize(samples);
    kernel.compress(iq, in.offset_db, in.range_db, samples, scratch.data(), out.grey + at);
}

void BmodeRenderer::picture(const FrameOutput &out, std::size_t row) const {
    const std::int32_t *pixel = probe_.pixel + row * probe_.columns;
    const std::uint8_t *fraction = probe_.fraction + 2 * row * probe_.columns;
    std::uint8_t *to = out.picture + row * probe_.columns;
    const int samples = probe_.beam.samples;
    for (std::size_t c = 0; c < probe_.columns; ++c) {
        if (pixel[c] < 0) {
            to[c] = 0;
            continue;
        }
        const std::uint8_t *at = out.grey + pixel[c], *next = at + samples;
        const int across = fraction[2 * c], along = fraction[2 * c + 1];
        const int here = 256 * at[0] + along * (at[1] - at[0]), beside = 256 * next[0] + along * (next[1] - next[0]);
        to[c] = static_cast<std::uint8_t>((256 * here + across * (beside - here) + 32768) >> 16);
    }
}

}  // namespace sono
