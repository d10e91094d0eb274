// Sparse 8 x 8 x 8 blocks of voxels: integer block coordinates -> row of a table, by open addressing.
#pragma once
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace coin3d {

constexpr int kBlockSide = 8;
constexpr int kBlockVoxels = kBlockSide * kBlockSide * kBlockSide;
constexpr int64_t kMaxBlock = (int64_t{1} << 20) - 2;  // room for a neighbour on either side

// Row-major (x, y, z) inside a block, so that a table of blocks is an array of shape (blocks, 8, 8, 8).
inline int voxel_in_block(int64_t x, int64_t y, int64_t z) {
  return static_cast<int>(((x & 7) << 6) | ((y & 7) << 3) | (z & 7));
}

inline uint64_t block_key(int64_t x, int64_t y, int64_t z) {
  constexpr int64_t half = int64_t{1} << 20;
  return static_cast<uint64_t>(x + half) << 42 | static_cast<uint64_t>(y + half) << 21 | static_cast<uint64_t>(z + half);
}

inline void block_of_key(uint64_t key, int32_t* xyz) {
  constexpr int64_t half = int64_t{1} << 20, mask = (int64_t{1} << 21) - 1;
  for (int a = 0; a < 3; ++a) xyz[a] = static_cast<int32_t>((static_cast<int64_t>(key >> (42 - 21 * a)) & mask) - half);
}

// Rows are numbered in the order of insertion, which callers keep independent of the number of threads.
class BlockMap {
 public:
  int32_t find(uint64_t key) const {
    for (uint64_t i = slot(key);; i = (i + 1) & mask_) {
      if (slots_[i].row < 0) return -1;
      if (slots_[i].key == key) return slots_[i].row;
    }
  }
  int32_t insert(uint64_t key) {
    uint64_t i = slot(key);
    for (; slots_[i].row >= 0; i = (i + 1) & mask_)
      if (slots_[i].key == key) return slots_[i].row;
    const int32_t row = static_cast<int32_t>(keys_.size());
    slots_[i] = {key, row};
    keys_.push_back(key);
    if (2 * keys_.size() > slots_.size()) grow();
    return row;
  }
  int64_t size() const { return static_cast<int64_t>(keys_.size()); }
  const std::vector<uint64_t>& keys() const { return keys_; }

 private:
  struct Slot {
    uint64_t key = 0;
    int32_t row = -1;
  };
  uint64_t slot(uint64_t key) const { return (key * 0x9E3779B97F4A7C15ull) >> shift_; }
  void grow() {
    --shift_;
    slots_.assign(slots_.size() * 2, Slot{});
    mask_ = slots_.size() - 1;
    for (size_t row = 0; row < keys_.size(); ++row) {
      uint64_t i = slot(keys_[row]);
      while (slots_[i].row >= 0) i = (i + 1) & mask_;
      slots_[i] = {keys_[row], static_cast<int32_t>(row)};
    }
  }
  std::vector<uint64_t> keys_;
  std::vector<Slot> slots_ = std::vector<Slot>(1024);
  uint64_t mask_ = 1023;
  int shift_ = 54;
};

}  // namespace coin3d
