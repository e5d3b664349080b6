// Chooses, at run time, among the copies of kernels.cpp.
#include <atomic>
#include <cstring>

#include "common/kernels.hpp"

namespace sono {

namespace baseline { extern const KernelTable table; }
#ifdef SONO_X86
namespace avx2 { extern const KernelTable table; }
namespace avx512 { extern const KernelTable table; }
#endif

namespace {

struct Available {
    const KernelTable *tables[3];
    std::size_t count = 0;
    Available() {
#ifdef SONO_X86
        __builtin_cpu_init();
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
            __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))
            tables[count++] = &avx512::table;
        if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) tables[count++] = &avx2::table;
#endif
        tables[count++] = &baseline::table;
    }
};

const Available &available() {
    static const Available all;
    return all;
}

std::atomic<const KernelTable *> chosen{nullptr};

}  // namespace

const KernelTable *const *available_kernels(std::size_t &count) {
    count = available().count;
    return available().tables;
}

bool choose_kernels(const char *name) {
    for (std::size_t i = 0; i < available().count; ++i)
        if (std::strcmp(available().tables[i]->name, name) == 0) {
            chosen.store(available().tables[i]);
            return true;
        }
    return false;
}

const KernelTable &kernels() {
    if (!chosen.load()) chosen.store(available().tables[0]);
    return *chosen.load();
}

}  // namespace sono
