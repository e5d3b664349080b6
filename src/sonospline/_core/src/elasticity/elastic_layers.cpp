#include "elasticity/elastic_layers.hpp"

#include <algorithm>

#include "common/kernels.hpp"

namespace sono {

ElasticLayers::ElasticLayers(const ElasticLayersData &data, const ElasticLevel &level) {
    const ElasticCells &cells = level.cells();
    const std::size_t planes = level.shape()[0] - 1;
    float volume = 1;
    for (int a = 0; a < 3; ++a) cells_.quarter[a] = cells.inverse[a] / 4, volume /= cells.inverse[a];
    cells_.row = cells.row, cells_.plane = cells.plane, cells_.component = cells.component;
    std::vector<std::vector<std::size_t>> of_plane(planes);
    for (std::size_t n = 0; n < data.count; ++n) of_plane[static_cast<std::size_t>(data.cells[3 * n])].push_back(n);
    for (const std::vector<std::size_t> &numbers : of_plane) {
        slots_.push_back(places_.size() / kElasticLanes);
        for (std::size_t first = 0; first < numbers.size(); first += kElasticLanes) {
            const std::size_t at = stiffness_.size();
            stiffness_.resize(at + 21 * kElasticLanes);
            for (std::size_t lane = 0; lane < kElasticLanes; ++lane) {
                const std::size_t n = numbers[std::min(first + lane, numbers.size() - 1)];
                const std::int64_t *const corner = data.cells + 3 * n;
                places_.push_back(level.place(static_cast<std::size_t>(corner[0]), static_cast<std::size_t>(corner[1]),
                                              static_cast<std::size_t>(corner[2])));
                if (first + lane >= numbers.size()) continue;  // fills the vector, and resists nothing
                std::size_t entry = at + lane;
                for (int i = 0; i < 6; ++i)
                    for (int j = i; j < 6; ++j, entry += kElasticLanes)
                        stiffness_[entry] = volume * data.stiffness[36 * n + static_cast<std::size_t>(6 * i + j)];
            }
        }
    }
    slots_.push_back(places_.size() / kElasticLanes);
}

double ElasticLayers::add(int parity, std::size_t block, const Fields &in, Fields &out, float sign) const {
    const std::size_t plane = 2 * block + static_cast<std::size_t>(parity), first = slots_[plane];
    return kernels().elastic_layers->add(cells_, places_.data() + first * kElasticLanes,
                                         stiffness_.data() + first * 21 * kElasticLanes, slots_[plane + 1] - first,
                                         in[0], out[0], sign);
}

}  // namespace sono
