// Sorting the keys of one tile: one counting pass over depth buckets, then what little is left within them.
#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

#include "splat_types.h"

namespace coin3d {

class SplatSorter {
 public:
  // The keys in ascending order, in memory that is valid until the next call.
  const SplatKey* sort(const SplatKey* keys, int64_t n) {
    if (static_cast<int64_t>(sorted_.size()) < n) sorted_.resize(n + n / 4);
    SplatKey* out = sorted_.data();
    if (n < 32) {
      std::copy(keys, keys + n, out);
      std::sort(out, out + n);
      return out;
    }
    uint32_t low = UINT32_MAX, high = 0;
    for (int64_t i = 0; i < n; ++i) {
      const uint32_t z = static_cast<uint32_t>(keys[i] >> 32);
      low = std::min(low, z);
      high = std::max(high, z);
    }
    int64_t buckets = 64;
    while (buckets < 2 * n && buckets < kMaxBuckets) buckets *= 2;
    // float bits grow with depth, about as its logarithm
    const uint64_t scale = (static_cast<uint64_t>(buckets) << 32) / (static_cast<uint64_t>(high - low) + 1);
    auto bucket = [&](SplatKey key) { return static_cast<uint32_t>(((key >> 32) - low) * scale >> 32); };
    first_.assign(buckets + 1, 0);
    uint32_t* first = first_.data();
    for (int64_t i = 0; i < n; ++i) ++first[bucket(keys[i])];
    uint32_t sum = 0, fullest = 0;
    for (int64_t b = 0; b < buckets; ++b) {
      const uint32_t count = first[b];
      fullest = std::max(fullest, count);
      first[b] = sum;
      sum += count;
    }
    for (int64_t i = 0; i < n; ++i) out[first[bucket(keys[i])]++] = keys[i];
    if (fullest > kInsertionLimit) {  // first[b] is now the end of bucket b
      for (int64_t b = 0; b < buckets; ++b) {
        const uint32_t begin = b ? first[b - 1] : 0;
        if (first[b] - begin > kInsertionLimit) std::sort(out + begin, out + first[b]);
      }
    }
    for (int64_t i = 1; i < n; ++i) {
      const SplatKey key = out[i];
      int64_t j = i;
      for (; j > 0 && out[j - 1] > key; --j) out[j] = out[j - 1];
      out[j] = key;
    }
    return out;
  }

 private:
  static constexpr int64_t kMaxBuckets = 8192;  // their counters stay in the first-level cache
  static constexpr uint32_t kInsertionLimit = 24;
  std::vector<SplatKey> sorted_;
  std::vector<uint32_t> first_;
};

}  // namespace coin3d
