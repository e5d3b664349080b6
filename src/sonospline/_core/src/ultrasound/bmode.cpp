#include "ultrasound/bmode.hpp"

#include <algorithm>
#include <cmath>

#include "common/kernels.hpp"
#include "common/phases.hpp"
#include "common/require.hpp"
#include "fields/trilinear4.hpp"

namespace sono {
namespace {

constexpr std::size_t kCellsPerBlock = 512, kRowsPerBlock = 32;
constexpr std::size_t kLeastStripLines = 16, kMostStripLines = 64;
constexpr int kRaysPerBlock = 8, kLinesPerBlock = 8;
constexpr std::size_t kLineApart = 32;   // floats between two lines: a power of two apart, they would share a part of the cache
constexpr std::size_t kPieceFloats = 512;
constexpr float kMostLossDb = 60;     // at one interface
constexpr float kLossPerNeper = 20 / 2.302585093f;

std::size_t blocks_of(std::size_t items, std::size_t size) { return (items + size - 1) / size; }

}  // namespace

BmodeRenderer::BmodeRenderer(const ProbeTables &probe)
    : probe_(probe), stride_(2 * static_cast<std::size_t>(probe.beam.samples) + kLineApart) {
    const std::size_t lines = static_cast<std::size_t>(probe.beam.lines);
    beams_.resize(lines * stride_ + kEchoSlack);
    transmitted_.resize(static_cast<std::size_t>(probe.rays) * probe.ray_samples);
    const std::size_t samples = static_cast<std::size_t>(probe.beam.samples);
    for (int k = 0; k <= 2 * probe.lateral_half; ++k) {
        const float *taps = probe.lateral + static_cast<std::size_t>(k) * samples;
        for (std::size_t n = 0; n < samples; ++n) taps_.insert(taps_.end(), 2, taps[n]);
        taps_.resize(taps_.size() + kLineApart);
    }
    for (int n = 0; n < probe.beam.samples; n += kLateralRun / 2) {
        int reach = probe.lateral_half;
        const auto silent = [&](int k) {
            const float *tap = probe.lateral + static_cast<std::ptrdiff_t>(probe.lateral_half + k) * probe.beam.samples + n;
            return std::all_of(tap, tap + kLateralRun / 2, [](float t) { return t == 0; });
        };
        while (reach > 0 && silent(reach) && silent(-reach)) --reach;
        reach_.push_back(reach);
    }
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
    const bool turns = aim.surfaces.starts[aim.cells.count] > 0;
    if (turns) amplitude_.resize(static_cast<std::size_t>(aim.cells.starts[aim.cells.count]) + kEchoSlack);
    const float spacing[3] = {static_cast<float>(in.field.spacing[0]), static_cast<float>(in.field.spacing[1]),
                              static_cast<float>(in.field.spacing[2])};
    const std::size_t ray_blocks = blocks_of(probe_.rays, kRaysPerBlock);
    const std::size_t lines = static_cast<std::size_t>(probe_.beam.lines);
    // equal strips for each thread, as wide as the second cache lets them be: what crosses their edges is heard twice
    const auto threads = static_cast<std::size_t>(thread_count());
    const std::size_t each = blocks_of(lines, threads * blocks_of(lines, threads * kMostStripLines));
    strip_lines_ = static_cast<int>(std::max(each, kLeastStripLines));
    const std::vector<std::size_t> blocks = {ray_blocks + blocks_of(aim.cells.count, kCellsPerBlock),
                                             blocks_of(lines, static_cast<std::size_t>(strip_lines_)),
                                             blocks_of(lines, kLinesPerBlock), blocks_of(probe_.rows, kRowsPerBlock)};
    parallel_phases(blocks, [&](std::size_t phase, std::size_t block) {
        const int number = static_cast<int>(block);
        if (phase == 0 && block < ray_blocks) {
            const int end = std::min(probe_.rays, (number + 1) * kRaysPerBlock);
            trace(aim, in, number * kRaysPerBlock, end);
        } else if (phase == 0) {
            const std::size_t first = (block - ray_blocks) * kCellsPerBlock;
            const std::size_t last = std::min(aim.cells.count, first + kCellsPerBlock);
            kernels().echo->place(probe_.beam, aim.cells, in.field.values, spacing, first, last, polynomials_.data(),
                                  spans_.data());
            if (turns)
                kernels().echo->reflect(probe_.beam, aim.cells, aim.surfaces, polynomials_.data(), spans_.data(), first,
                                        last, amplitude_.data());
        } else if (phase == 1) {
            strip(aim, in, number);
        } else if (phase == 2) {
            const int end = std::min(probe_.beam.lines, (number + 1) * kLinesPerBlock);
            beams(in, out, number * kLinesPerBlock, end);
        } else {
            const std::size_t end = std::min(probe_.rows, (block + 1) * kRowsPerBlock);
            for (std::size_t row = block * kRowsPerBlock; row < end; ++row) {
                const std::size_t at = row * probe_.columns;
                kernel.picture(out.grey, static_cast<std::size_t>(probe_.beam.samples), probe_.pixel + at,
                               probe_.fraction + 2 * at, probe_.columns, out.picture + at);
            }
        }
    });
}

// Walks down coarse beams through the undeformed labels, adding up what is lost. Several at once, since each
// step waits for the one before.
void BmodeRenderer::trace(const Aim &aim, const FrameInput &in, int first_ray, int last_ray) {
    const Trilinear4 displacement(in.field);
    const int rays = last_ray - first_ray;
    Float4 start[kRaysPerBlock] = {}, along[kRaysPerBlock] = {}, index[4] = {};
    Float4 u[kRaysPerBlock] = {}, change[kRaysPerBlock] = {};
    float db[kRaysPerBlock] = {};
    int last[kRaysPerBlock];
    for (int a = 0; a < 3; ++a) {
        for (int ray = 0; ray < rays; ++ray) {
            start[ray][a] = static_cast<float>(aim.ray_start[3 * (first_ray + ray) + a]);
            along[ray][a] = static_cast<float>(aim.ray_step[3 * (first_ray + ray) + a]);
        }
        for (int b = 0; b < 4; ++b) index[b][a] = static_cast<float>(aim.label_index[4 * a + b]);
    }
    index[3] += 0.5f;  // to the nearest voxel
    std::vector<float> loss(static_cast<std::size_t>(rays) * probe_.ray_samples);
    for (int n = 0; n < probe_.ray_samples; ++n)
        for (int ray = 0; ray < rays; ++ray) {
            // the inverse map, from where the last two samples lead
            const Float4 p = start[ray] + static_cast<float>(n) * along[ray];
            const Float4 before = u[ray];
            u[ray] = displacement(p - (before + change[ray]));
            change[ray] = n ? u[ray] - before : Float4{};
            const Float4 x = p - u[ray];
            const Float4 nearest = index[0] * x[0] + index[1] * x[1] + index[2] * x[2] + index[3];
            std::size_t voxel = 0;
            bool inside = true;
            for (int a = 0; a < 3; ++a) {
                inside = inside && nearest[a] >= 0 && nearest[a] < static_cast<float>(aim.label_shape[a]);
                voxel = voxel * aim.label_shape[a] + (inside ? static_cast<std::size_t>(nearest[a]) : 0);
            }
            const int label = inside ? aim.labels[voxel] : 0;
            if (n && label != last[ray]) {
                const float z1 = aim.impedance[last[ray]], z2 = aim.impedance[label];
                const float through = 4 * z1 * z2 / ((z1 + z2) * (z1 + z2));  // T12 T21 = 1 - R^2
                db[ray] += std::min(kMostLossDb, -kLossPerNeper * std::log(through));
            }
            last[ray] = label;
            db[ray] += aim.loss_db[label];
            loss[static_cast<std::size_t>(ray * probe_.ray_samples + n)] = db[ray] - 0.5f * aim.loss_db[label];  // at its middle
        }
    kernels().bmode->transmit(loss.data(), loss.size(),
                              transmitted_.data() + static_cast<std::size_t>(first_ray) * probe_.ray_samples);
}

// Amplitude left along one beam: coarse beams smoothed across the aperture, times the needle's shadow.
void BmodeRenderer::gain_of(const FrameInput &in, int line, float *gain) const {
    const int coarse = probe_.ray_samples, samples = probe_.beam.samples, taps = probe_.smoothing_taps;
    thread_local std::vector<float> smooth;
    smooth.resize(static_cast<std::size_t>(coarse) + 1);
    kernels().bmode->gain(taps, probe_.smoothing + static_cast<std::size_t>(line) * taps,
                          transmitted_.data() + static_cast<std::size_t>(probe_.smoothing_first[line]) * coarse,
                          static_cast<std::size_t>(coarse), coarse_.data(), beyond_.data(),
                          static_cast<std::size_t>(samples), smooth.data(), gain);
    const float begins = in.shadow[line], shaded = in.shadow[probe_.beam.lines + line];
    if (shaded >= 1) return;
    const float sample_mm = probe_.beam.depth_mm / static_cast<float>(samples), softness = 1 / in.shadow_soft_mm;
    for (int n = whole_within<int>(begins / sample_mm, 0.0f, static_cast<float>(samples)); n < samples; ++n) {
        const float behind = std::min(std::max((static_cast<float>(n) * sample_mm - begins) * softness, 0.0f), 1.0f);
        const float left = 1 - (1 - shaded) * behind;
        gain[2 * n] *= left, gain[2 * n + 1] *= left;
    }
}

void BmodeRenderer::strip(const Aim &aim, const FrameInput &in, int number) {
    const BmodeKernels &kernel = *kernels().bmode;
    const int first_line = number * strip_lines_, samples = probe_.beam.samples;
    const std::size_t row = 2 * static_cast<std::size_t>(2 * samples + 2 * kBinPad);
    thread_local std::vector<float> grid, scratch, gain;
    grid.assign((static_cast<std::size_t>(strip_lines_) + 2) * row, 0.0f);  // one line more on either side
    scratch.resize(4 * static_cast<std::size_t>(samples + kBinPad) + kEchoSlack);
    gain.resize(2 * static_cast<std::size_t>(samples));
    kernels().echo->splat(probe_.beam, aim.cells, aim.surfaces.starts, amplitude_.data(), polynomials_.data(), spans_.data(),
                          first_line, strip_lines_, grid.data(), row);
    for (std::size_t i = 0; i < in.echo_count; ++i) {
        const float *echo = in.echoes + 4 * i;
        const float whole_line = std::floor(echo[0]), whole_bin = std::floor(echo[1]);
        const float r = whole_line - static_cast<float>(first_line - 1), b = whole_bin + kBinPad;
        if (!(r >= 0 && r <= static_cast<float>(strip_lines_))) continue;
        if (!(b >= 0 && b < static_cast<float>(2 * samples + 2 * kBinPad - 2))) continue;
        const float across = echo[0] - whole_line, along = echo[1] - whole_bin;
        float *at = grid.data() + static_cast<std::size_t>(r) * row + 2 * static_cast<std::size_t>(b);
        for (int side = 0; side < 2; ++side, at += row)
            for (int half = 0; half < 2; ++half) {
                const float weight = (side ? across : 1 - across) * (half ? along : 1 - along);
                at[2 * half] += weight * echo[2], at[2 * half + 1] += weight * echo[3];
            }
    }
    for (int l = first_line; l < std::min(probe_.beam.lines, first_line + strip_lines_); ++l) {
        gain_of(in, l, gain.data());
        kernel.axial(probe_.axial_half, probe_.axial, grid.data() + static_cast<std::size_t>(l - first_line + 1) * row,
                     static_cast<std::size_t>(samples), gain.data(), scratch.data(),
                     beams_.data() + static_cast<std::size_t>(l) * stride_);
    }
}

void BmodeRenderer::beams(const FrameInput &in, const FrameOutput &out, int first, int last) const {
    const BmodeKernels &kernel = *kernels().bmode;
    const std::size_t samples = static_cast<std::size_t>(probe_.beam.samples);
    const int half = probe_.lateral_half;
    // piece by piece of all lines: taps and neighbours stay in the first cache
    for (std::size_t at = 0; at < 2 * samples; at += kPieceFloats)
        for (int l = first; l < last; ++l) {
            const std::size_t row = 2 * static_cast<std::size_t>(l) * samples;
            kernel.lateral(std::min(half, l), std::min(half, probe_.beam.lines - 1 - l),
                           taps_.data() + static_cast<std::size_t>(half) * stride_,
                           beams_.data() + static_cast<std::size_t>(l) * stride_, static_cast<std::ptrdiff_t>(stride_), at,
                           std::min(2 * samples, at + kPieceFloats), reach_.data(), in.noise + row, in.noise_level,
                           out.iq + row);
        }
    thread_local std::vector<float> scratch;
    scratch.resize(samples);
    for (int l = first; l < last; ++l) {
        const std::size_t at = static_cast<std::size_t>(l) * samples;
        add_clutter(in.clutter, l, out.iq + 2 * at);
        kernel.compress(out.iq + 2 * at, in.offset_db, in.range_db, samples, scratch.data(), out.grey + at);
    }
}

void BmodeRenderer::add_clutter(const Clutter &clutter, int number, float *iq) const {
    const BmodeKernels &kernel = *kernels().bmode;
    const std::size_t samples = static_cast<std::size_t>(probe_.beam.samples), row = 2 * samples;
    const auto line = static_cast<std::size_t>(number);
    if (clutter.again > 0) kernel.repeat(clutter.unit, clutter.loudness, clutter.again, samples, iq);
    if (clutter.wide_lines) {
        const float at = static_cast<float>(number) * static_cast<float>(clutter.wide_lines - 1) /
                         static_cast<float>(probe_.beam.lines - 1);
        const std::size_t low = std::min(static_cast<std::size_t>(at), clutter.wide_lines - 2);
        const float *wide = clutter.wide + low * row;
        kernel.widen(wide, wide + row, at - static_cast<float>(low), clutter.wide_scale, samples, iq);
    }
    const float *ghosts = clutter.ghosts ? clutter.ghosts + line * (samples / kTailRun) : nullptr;
    if (clutter.texture)
        kernel.tail(clutter.texture + line * row, clutter.tail_level, clutter.tail_keep, ghosts, samples, iq);
    const float *haze = clutter.haze + 2 * line * clutter.haze_samples;
    for (std::size_t i = 0; i < 2 * clutter.haze_samples; ++i) iq[i] += haze[i];
}

}  // namespace sono
