// Faults on demand, in builds for tests alone.
#pragma once

namespace sono {

/// Makes one allocation fail, after so many that do not; a number below 0 makes none fail.
void fail_allocation(long after);
/// Whether it has failed.
bool allocation_failed();
/// Makes all threads fail to start, after so many that do; a number below 0 makes none fail.
void fail_threads(long after);

}  // namespace sono
