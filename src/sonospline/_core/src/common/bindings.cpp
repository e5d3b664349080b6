// Python side of the core: its parts, and what it runs on.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <string>
#include <vector>

#include "common/bindings.hpp"
#include "common/faults.hpp"
#include "common/kernels.hpp"
#include "common/parallel.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

std::vector<std::string> instruction_sets() {
    std::size_t count;
    const sono::KernelTable *const *tables = sono::available_kernels(count);
    std::vector<std::string> names;
    for (std::size_t i = 0; i < count; ++i) names.emplace_back(tables[i]->name);
    return names;
}

}  // namespace

NB_MODULE(_native, m) {
    sono::watch_forks();
    nb::set_leak_warnings(false);  // a daemon thread may hold what it computes with until the process is gone
    bind_bmode(m);
    bind_cholesky(m);
    bind_contact(m);
    bind_force(m);
    bind_sampling(m);
    bind_sums(m);
    m.def("instruction_sets", &instruction_sets);
    m.def("instruction_set", [] { return std::string(sono::kernels().name); });
    m.def("use_instruction_set", [](const std::string &name) {
        if (!sono::choose_kernels(name.c_str()))
            throw nb::value_error(("this machine has no instruction set '" + name + "'").c_str());
    });
    bind_igtl(m);
    bind_multilevel(m);
    bind_reslice(m);
    bind_scatterers(m);
    bind_elastic(m);
    m.def("thread_count", &sono::thread_count);
    m.def("set_thread_count", &sono::set_thread_count, "count"_a);
#ifdef SONO_FAULTS
    m.def("fail_allocation", &sono::fail_allocation, "after"_a);
    m.def("allocation_failed", &sono::allocation_failed);
    m.def("fail_threads", &sono::fail_threads, "after"_a);
#endif
}
