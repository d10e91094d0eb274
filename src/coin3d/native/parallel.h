// Split [0, n) into one contiguous range per thread. Results must not depend on the split.
#pragma once
#include <algorithm>
#include <cstdint>
#include <thread>
#include <vector>

namespace coin3d {

template <typename Body>
void parallel_ranges(int64_t n, int threads, const Body& body) {
  const int64_t parts = std::max<int64_t>(1, std::min<int64_t>(threads, n));
  std::vector<std::thread> pool;
  for (int64_t i = 1; i < parts; ++i) pool.emplace_back([&body, n, parts, i] { body(n * i / parts, n * (i + 1) / parts); });
  body(0, n / parts);
  for (auto& t : pool) t.join();
}

}  // namespace coin3d

// One binary, several instruction sets: the loader picks the best the machine has.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define COIN3D_SIMD __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default"), optimize("O3,fast-math")))
#else
#define COIN3D_SIMD
#endif
