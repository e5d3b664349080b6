// What relaxing tissue remembers: fields that follow another one, each at a pace of its own.
#pragma once

#include <cstddef>

namespace sono {

/// Fields of so many floats, one after the other, and the one that they follow: where it was, and its change since.
struct Following {
    std::size_t fields, size;
    const float *values, *start, *change;
    const double *forgotten, *taken_up;  // of each field: parts of its distance from start, and of the change
};

/// out = values + forgotten (start - values) + taken_up change; what is smaller than `nil` is 0, as it would go on
/// to numbers that are slow to compute with.
void follow(const Following &f, float nil, float *out);

}  // namespace sono
